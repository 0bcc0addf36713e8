"""Where the daemon's log goes, and what of the gripper is told there."""

import logging
from collections.abc import Callable

from litegripd.io.log import FIELDS, JournalSink, LogHandler, goes_to_journal
from litegripd.model.events import Event
from litegripd.model.motor import MotorIdentity
from litegripd.model.motor_types import MotorType
from litegripd.motor.identity import warnings

_log = logging.getLogger(__name__)

_FIELDS = {
    "job": "LITEGRIP_JOB",
    "client": "LITEGRIP_CLIENT",
    "pid": "LITEGRIP_CLIENT_PID",
    "reason": "LITEGRIP_REASON",
}
"""What of an event's data the journal can be searched for."""

_WARNINGS = frozenset({"stop", "refused", "object_lost", "heat", "second_master", "implausible"})


def make_log_handler(channel: str, post: Callable[[str], bool]) -> LogHandler:
    """Return a handler that never waits: to the journal, or by `post`, which takes a text."""
    if goes_to_journal():
        return LogHandler(JournalSink(channel))
    handler = LogHandler(lambda _record, text: post(text + "\n"))
    form = "%(asctime)s %(levelname)-7s %(message)s"
    handler.setFormatter(logging.Formatter(form, "%H:%M:%S"))
    return handler


def log_event(event: Event) -> None:
    """Tell of one event."""
    is_bad = event.kind in _WARNINGS or bool(event.data.get("error"))
    level = logging.WARNING if is_bad else logging.INFO
    fields = {name: event.data[key] for key, name in _FIELDS.items() if event.data.get(key)}
    _log.log(level, "%s", event.message, extra={FIELDS: {"LITEGRIP_EVENT": event.kind, **fields}})


def warn_of_untried(motor_type: MotorType) -> None:
    """Log once, at the start, that nobody has tried the configured type of motor."""
    if motor_type.is_untried:
        _log.warning(
            "[motor] type %s has NEVER BEEN TRIED ON HARDWARE: its figures are the maker's data and"
            " estimates; keep hands and valuables away until you have tried it",
            motor_type.name,
        )


class MotorGreeting:
    """Tells once what a motor that was found has told about itself, and what is unusual anew."""

    def __init__(self, motor_type: MotorType) -> None:
        self._motor_type = motor_type
        self._was_known = False
        self._identity: MotorIdentity | None = None
        self._warnings: list[str] = []

    def look(self, identity: MotorIdentity | None) -> None:
        """Tell, if it has just become known."""
        if identity is not None and not self._was_known:
            _log_motor(identity)
            self._warnings = []
        self._was_known = identity is not None
        if identity is None or identity is self._identity:
            return
        self._identity, before = identity, self._warnings
        self._warnings = warnings(identity, self._motor_type)
        for warning in self._warnings:
            if warning not in before:
                _log.warning("%s", warning)


def _log_motor(identity: MotorIdentity) -> None:
    serial = identity.registers.get("SN")
    _log.info(
        "motor 0x%02X answers on 0x%02X, serial %s", identity.can_id, identity.master_id, serial
    )
