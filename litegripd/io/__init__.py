"""Clocks, sockets, processes and the CAN bus live here, and nowhere below."""
