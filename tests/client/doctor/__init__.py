"""What litegripctl doctor finds.

The files in links/ are what iproute2 6.1 said on Linux 6.1 of a Kvaser PCI card and of a vcan
interface. That card was an emulated one, which knows no errors: bus_off.json and
error_passive.json are its no_restart.json with the state, the counters and the flags that the
kernel's can_bus_off() and can_change_state() set.
"""
