"""Between python-can's messages and the frames of the core."""

import time

import can
import can.bus

from litegripd.io.bus import BusSettings
from litegripd.model.frame import CanFrame

# python-can asks the time of day how long `recv` still has to wait: were it set back by an hour in
# the middle of a `recv(0)`, that would wait for an hour, in the control thread.
can.bus.time = time.monotonic  # type: ignore[attr-defined]


def open_bus(settings: BusSettings) -> can.BusABC:
    """Open the bus by python-can; raises whatever its interface raises.

    `ignore_config` keeps a stray python-can configuration file from changing the bus.
    """
    return can.Bus(
        interface=settings.interface,
        channel=settings.channel,
        bitrate=settings.bitrate,
        ignore_config=True,
        **settings.options,
    )


def to_message(frame: CanFrame) -> can.Message:
    """Make python-can's message of a frame."""
    return can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)


def to_frame(message: can.Message) -> CanFrame | None:
    """Make a frame of a message; None for every kind that is not a classic data frame.

    Error frames go first: their ids are masked to 11 bits and can equal the feedback id.
    """
    if message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd:
        return None
    return CanFrame(message.arbitration_id, bytes(message.data))


def describe(error: BaseException) -> str:
    """Say in one line what python-can raised, with the system's error number where it has one."""
    code = getattr(error, "error_code", None)
    text = str(error) or type(error).__name__
    return text if code is None else f"{text} (error {code})"
