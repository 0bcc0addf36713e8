"""Clocks, sockets, processes and the CAN bus: no lower room has any of them."""
