"""Grippers of other machines: latency, scale, faults."""
