"""What the leader and the follower share."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

from litegripd.control.motions.base import PlainAction, Step
from litegripd.model.motor import Feedback, MotorView, Status, status_name
from litegripd.model.results import TeleopResult
from litegripd.model.state import Event
from litegripd.model.teleop import LinkOptions, LinkStatus, TeleopMode, TeleopStatus
from litegripd.teleop.link import Link

_WINDOW_S = 1.0


class LoopRate:
    """Counts the ticks of whole windows; before the first window ends, the ticks so far."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._ticks = 0
        self._last_hz: float | None = None
        self._latest_s = 0.0

    def tick(self, now_s: float) -> None:
        """Count one tick."""
        self._latest_s = now_s
        if self._began_s is None:
            self._began_s = now_s
            return
        self._ticks += 1
        elapsed_s = now_s - self._began_s
        if elapsed_s >= _WINDOW_S:
            self._last_hz = self._ticks / elapsed_s
            self._began_s, self._ticks = now_s, 0

    @property
    def hz(self) -> float:
        """The rate; 0 before the second tick."""
        if self._last_hz is not None:
            return self._last_hz
        elapsed_s = 0.0 if self._began_s is None else self._latest_s - self._began_s
        return self._ticks / elapsed_s if elapsed_s > 0.0 else 0.0


Tell: TypeAlias = Callable[[Event], None]
"""Receives events for the log and the subscribers."""

_OPEN: Mapping[TeleopMode, str] = {
    "master": (
        "everyone who reaches the link can take part: zenoh_config asks neither for certificates of"
        " both ends nor for an access list or passwords"
    ),
    "slave": (
        "whoever answers at the leader's address can move these jaws: zenoh_config names no"
        " authority for the leader's certificate"
    ),
}


class TeleopAction(PlainAction, ABC):
    """One end of a teleoperation, while it lasts; only `finish` or a fault ends it."""

    def __init__(self, link: Link, options: LinkOptions, tell: Tell) -> None:
        self.options = options
        self.link = link
        self.loop = LoopRate()
        self.send_failed = 0
        self.is_warned = False
        """True after the warning that the link is open to others was logged."""
        self.is_finished = False
        self.feedback: Feedback | None = None
        self._say = tell
        self._told = LinkStatus()

    def finish(self) -> TeleopResult:
        """End it on its owner's request; return the result."""
        self.is_finished = True
        return self.result()

    def close(self) -> None:
        """Release the link; a leader's session stays open for the next teleoperation."""
        self.link.close()

    @abstractmethod
    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`."""

    @abstractmethod
    def result(self) -> TeleopResult:
        """Return the result so far."""

    @abstractmethod
    def status(self, now_s: float) -> TeleopStatus:
        """Return the status."""

    def complaint(self) -> str | None:
        """Return what the daemon's health should report, including the link, or None."""
        return None

    def tell(self, text: str, *, warning: bool = False, **data: object) -> None:
        """Report an event."""
        self._say(Event("teleop", f"teleop: {text}", {**data, "warning": warning}))

    def note_link(self) -> None:
        """Report a change of the link's state, once."""
        status, told = self.link.status, self._told
        if (status.state, status.error) != (told.state, told.error):
            self._told = status
            why = "" if status.error is None else f": {status.error}"
            failed = status.state == "failed"
            self.tell(f"the link is {status.state}{why}", warning=failed, link=status.state)
            if status.is_protected is False and not self.is_warned:
                self.is_warned = True
                self.tell(_OPEN[self.options.mode], warning=True)

    def base_status(self) -> TeleopStatus:
        """Return the part of the status that is the same for both ends."""
        link, feedback = self.link.status, self.feedback
        return TeleopStatus(
            active=True,
            mode=self.options.mode,
            topic=self.options.topic,
            link=self.options.kind,
            host=self.options.host,
            port=None if self.options.kind == "none" else self.options.port,
            link_state=link.state,
            link_error=link.error,
            link_protected=link.is_protected,
            reflects=self.options.reflects,
            matching=link.matching if self.options.mode == "master" else None,
            dropped=link.dropped,
            send_failed=self.send_failed,
            loop_hz=round(self.loop.hz, 1),
            torque_nm=None if feedback is None else feedback.torque_nm,
            fault=fault_of(feedback),
        )


def fault_of(feedback: Feedback | None) -> str | None:
    """Return the motor's status if it is not "enabled"."""
    if feedback is None or feedback.status == Status.ENABLED:
        return None
    return status_name(feedback.status)


def ended(status: TeleopStatus, why: str | None) -> TeleopStatus:
    """Return the last status of a teleoperation that has ended."""
    return replace(
        status,
        active=False,
        fault=why or status.fault,
        link_state=None,  # the action has released it
        link_protected=None,
        matching=None,
        dq_cmd=0.0,
        loop_hz=0.0,
        reflected_n=None,
        followers=None,
        round_trip_ms=None,
    )
