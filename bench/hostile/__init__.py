"""Clients that mean no good, beside those that behave."""
