"""Clocks, sockets, processes and the CAN bus live here, and in no lower layer."""
