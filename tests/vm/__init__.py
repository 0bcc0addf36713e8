"""Checks on real SocketCAN in a virtual machine; `tests/vm/run` runs them, pytest does not."""
