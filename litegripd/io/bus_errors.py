"""What python-can and the system raise about a bus, by the name of the state that it means."""

import errno
from pathlib import Path

import can

from litegripd.model.bus import BusCondition, BusState

BUS_OFF = 0x40
RESTARTED = 0x100
"""Classes of an error frame, in its id (linux/can/error.h)."""

_STATES: dict[int, BusState] = {
    errno.ENETDOWN: "link_down",
    errno.ENODEV: "adapter_gone",
    errno.ENXIO: "adapter_gone",
    errno.ENOENT: "adapter_gone",
    errno.EBADF: "adapter_gone",
    errno.ENOBUFS: "bus_stalled",
    errno.EAGAIN: "bus_stalled",
}


_UNOPENED = {
    errno.ENODEV: "there is no network interface {channel}",
    errno.EAFNOSUPPORT: "this system has no CAN sockets: load them by 'sudo modprobe can_raw' (of a"
    " container, on its host); a kernel without that module cannot use SocketCAN",
}
"""What the errors of SocketCAN's socket mean."""


def code_of(error: BaseException) -> int | None:
    """Return the system's error number of an error or of what caused it, where there is one."""
    seen: BaseException | None = error
    while seen is not None:
        code = getattr(seen, "error_code", None) or getattr(seen, "errno", None)
        if isinstance(code, int):
            return code
        seen = seen.__cause__ or seen.__context__
    return None


def condition_of(error: BaseException, text: str, channel: str) -> BusCondition:
    """Name what was raised; a device file that is no longer there is an adapter that is gone."""
    if "buffer full" in str(error):
        return BusCondition("bus_stalled", text)
    is_missing = channel.startswith("/") and not Path(channel).exists()
    state = _STATES.get(code_of(error) or 0, "down")
    return BusCondition("adapter_gone" if is_missing else state, text)


def not_opened(error: BaseException, text: str, interface: str, channel: str) -> BusCondition:
    """Name what opening a bus has raised, in words where the system's own do not tell."""
    condition = condition_of(error, f"cannot be opened: {text}", channel)
    why = _UNOPENED.get(code_of(error) or 0)
    if interface != "socketcan" or why is None:
        return condition
    return BusCondition(
        condition.state, f"cannot be opened: {why.format(channel=channel)} ({text})"
    )


def told_by(message: can.Message) -> BusState | None:
    """Return the state that an error frame tells of, if any: `bus_off`, or `up` when over."""
    if not message.is_error_frame:
        return None
    if message.arbitration_id & RESTARTED:
        return "up"
    return "bus_off" if message.arbitration_id & BUS_OFF else None
