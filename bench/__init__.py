"""Measurements: figures are reported, never asserted."""
