"""Fifty clients that hang and die at one daemon."""
