"""Damiao frames and registers, bytes in and values out, and the motor's life cycle: pure."""
