"""A restart that holds: what a successor takes over, and how it is asked for."""
