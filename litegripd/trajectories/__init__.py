"""Trajectories: recorded, kept, and replayed."""
