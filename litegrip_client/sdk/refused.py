"""Names of the SDK that cannot work here: using one raises, with the reason and the way."""

from __future__ import annotations

from litegrip_client.values.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, NoReturn

_BUS = "the bus is the daemon's, so that many programs can use one gripper"
_LOOP = "the daemon runs that loop, so that it continues while a script is late"


def refusal(name: str, why: str, hint: str) -> CommandError:
    """Return the error for a name that cannot work here."""
    data = {"name": name, "hint": hint}
    return CommandError(f"{name} cannot be used: {why}", reason="unsupported", data=data)


class Refused:
    """A class whose objects cannot be made here."""

    why = _LOOP
    hint = ""

    def __init__(self, *_arguments: Any, **_keywords: Any) -> None:
        """Raise `CommandError`, reason "unsupported"."""
        raise refusal(type(self).__name__, self.why, self.hint)


class RefusedFunction:
    """A function that cannot be called here."""

    def __init__(self, name: str, why: str, hint: str) -> None:
        self.__name__ = name
        self.why = why
        self.hint = hint

    def __call__(self, *_arguments: Any, **_keywords: Any) -> NoReturn:
        """Raise `CommandError`, reason "unsupported"."""
        raise refusal(self.__name__, self.why, self.hint)


class RefusedModule:
    """A module that cannot be used here: every attribute of it raises."""

    def __init__(self, name: str, why: str, hint: str) -> None:
        self._name = name
        self.why = why
        self.hint = hint

    def __getattr__(self, attribute: str) -> NoReturn:
        """Raise `CommandError`; `AttributeError` for what Python itself looks for."""
        if attribute.startswith("__"):
            raise AttributeError(attribute)
        raise refusal(f"{self._name}.{attribute}", self.why, self.hint)


_OWN_LINK = (
    'link="udp" or link="zenoh" of teleop_start; a link of your own sends the same frames to'
    " either (docs/teleoperation.md, encode_frame)"
)


class TeleopTransport(Refused):
    """A link of the script's own."""

    hint = f"use {_OWN_LINK}"


class TeleopSubscription(TeleopTransport):
    """What a link's listener is ended by."""


class UdpTeleopTransport(TeleopTransport):
    """The link over UDP."""

    hint = 'use teleop_start(mode, link="udp", host=...)'


class ZenohTeleopTransport(TeleopTransport):
    """The link over zenoh."""

    hint = "use teleop_start(mode, host=...), whose link is zenoh"


class InProcTeleopTransport(TeleopTransport):
    """The link inside a process."""

    hint = "use teleop_start('slave', fake_leader=True), or two simulated grippers over UDP"


class Listener(TeleopTransport):
    """The leader's end of a link."""


class Connector(TeleopTransport):
    """The follower's end of a link."""


class LatestSlot(Refused):
    """Where the SDK's loop finds the newest frame."""

    hint = "teleop_status() has the newest frame's figures, states() the jaws'"


class GripperTeleop(Refused):
    """The SDK's teleoperation loop."""

    hint = "use teleop_start(), teleop_status() and teleop_stop() of LiteGrip"


class TrajectoryRecorder(Refused):
    """The SDK's recording loop."""

    hint = "use record_start() and record_stop(), or record(), of LiteGrip"


class TrajectoryPlayer(Refused):
    """The SDK's replay loop."""

    hint = "use play_start() and play_stop(), or play(), of LiteGrip"


can = RefusedModule("can", _BUS, "states() and events() of LiteGrip, or candump, show the bus")

_INSIDE = "the daemon computes that for each motion, with the calibration in use"
limit_target = RefusedFunction(
    "limit_target", _INSIDE, "config.pos_open_rad and config.pos_closed_rad are the stops"
)
press_target = RefusedFunction(
    "press_target", _INSIDE, "target_rad of the result of open() and close() is what they aim at"
)
check_ready = RefusedFunction(
    "check_ready", _INSIDE, "teleop_start() raises TeleopNotReady; wait_for_ready() waits"
)
clamp_to_calibrated = RefusedFunction(
    "clamp_to_calibrated",
    "no motion takes a target outside the travel, so nothing is clamped",
    "config.pos_open_rad and config.pos_closed_rad are the limits",
)
