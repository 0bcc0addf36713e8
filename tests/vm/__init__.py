"""Checks on real SocketCAN, systemd and USB adapters in a virtual machine, by `tests/vm/run`.

pytest runs only what needs no machine: what would be booted, and the emulated adapter's protocol.
"""
