"""Symptoms on the bench: what the doctor says of them, and what its remedy does."""
