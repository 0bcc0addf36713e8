"""When the flight recorder is written to disk: when a client asks, or by itself for a `Cause`.

This file only makes the task; the helper process writes. There is one dump at a time, and by
itself at most one in `APART_S`: the next dump shows what happens between.
"""

from collections.abc import Callable
from typing import Literal, TypeAlias

from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.motor import MotorPhase
from litegripd.model.state import Event, HelperTask, TaskResult
from litegripd.recorder.recorder import KEPT_S

Cause: TypeAlias = Literal[
    "demand",
    "motor_fault",
    "motor_silent",
    "motor_reset",
    "implausible",
    "second_master",
    "bus_lost",
    "tick_error",
]
"""`motor_silent`: a motor that may be energised has stopped answering, though the bus works.
`motor_reset`: an enabled motor reports that it is disabled, though the daemon did not ask for it;
its supply failed for a moment, or another program did it. `implausible`: the daemon has disabled
the motor because its position jumped.
"""

AFTER_S = 1.0
"""The dump is made this long after its cause, so that it shows the effects."""

APART_S = KEPT_S - 5.0
"""Less than the recorded time: the next dump still shows a fault right after this one."""

_MOST_CAUSES = 10
_POWERED = (MotorPhase.ENABLING, MotorPhase.ENABLED, MotorPhase.DISABLING)


class Dumps:
    """Asks for dumps; call `step` once per tick."""

    NOT_CARRIED = (
        "_bus_was_up",
        "_causes",
        "_controller",
        "_due_s",
        "_dumped_s",
        "_has_worked",
        "_is_busy",
        "_is_powered",
        "_phase",
        "_seen_s",
    )

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._is_busy = False
        self._causes: list[Cause] = []
        self._due_s = 0.0
        self._dumped_s = float("-inf")
        self._phase = MotorPhase.UNKNOWN
        self._has_worked = False
        self._is_powered = False
        self._bus_was_up = True
        self._seen_s: dict[Cause, float] = {}

    def ask(self, cause: Cause, note: str, then: Callable[[TaskResult], None]) -> Refusal | None:
        """Ask for a dump, or return a refusal; `then` gets the result."""
        if self._is_busy:
            text = "a dump of the recorder is being written already: ask again when it is done"
            return Refusal("too_many_requests", text, {"limit": 1})
        self._is_busy = True

        def done(result: TaskResult) -> None:
            self._is_busy = False
            self._controller.events.append(_told(cause, result))
            then(result)

        parameters = {"cause": cause, "note": note}
        self._controller.tasks.append(HelperTask("recorder.dump", parameters, done))
        return None

    def step(self, now_s: float, *, failed: bool, bus_is_up: bool) -> None:
        """Look for a cause; `failed` is True if a defect broke this tick off."""
        before, phase = self._phase, self._controller.motor.phase
        if phase is not before:
            self._phase = phase
            self._note_phase(before, phase, now_s, bus_is_up=bus_is_up)
        if bus_is_up is not self._bus_was_up:
            self._bus_was_up = bus_is_up
            if not bus_is_up and self._is_powered:
                self._note("bus_lost", now_s)
        other = self._controller.second_master
        if other.is_active and not other.is_tolerated:
            self._note_once("second_master", now_s)
        if failed:
            self._note_once("tick_error", now_s)
        if self._causes and now_s >= self._due_s and not self._is_busy:
            self._dump(now_s)

    def finish(self, now_s: float) -> None:
        """Before the daemon ends, ask for the dump that is still due."""
        if self._causes and not self._is_busy:
            self._dump(now_s)

    def _note_phase(
        self, before: MotorPhase, phase: MotorPhase, now_s: float, *, bus_is_up: bool
    ) -> None:
        """Note the cause that a change of the motor's phase shows, if any."""
        has_jumped = self._controller.motor.has_jumped
        if phase in _POWERED:
            self._is_powered = True
        elif phase in (MotorPhase.DISABLED, MotorPhase.FAULT):
            self._is_powered = False
            self._seen_s.pop("motor_silent", None)  # the next one needs a client that enables it
        if phase is MotorPhase.FAULT and self._has_worked:
            self._has_worked = False
            self._note("motor_fault", now_s)
        elif phase in (MotorPhase.ENABLED, MotorPhase.DISABLED):
            self._has_worked = True
        elif phase is MotorPhase.SILENT and self._is_powered and bus_is_up:
            self._note_once("motor_silent", now_s)
        elif phase is MotorPhase.UNKNOWN and before is MotorPhase.ENABLED:
            self._note("motor_reset", now_s)
        elif (before, phase) == (MotorPhase.ENABLED, MotorPhase.DISABLING) and has_jumped:
            self._note("implausible", now_s)

    def _note_once(self, cause: Cause, now_s: float) -> None:
        """Note a cause that lasts, or repeats, only when it begins: one dump shows it."""
        if now_s - self._seen_s.get(cause, float("-inf")) > APART_S:
            self._note(cause, now_s)
        self._seen_s[cause] = now_s

    def _note(self, cause: Cause, now_s: float) -> None:
        if not self._causes:
            self._due_s = max(now_s + AFTER_S, self._dumped_s + APART_S)
        if len(self._causes) < _MOST_CAUSES:
            self._causes.append(cause)

    def _dump(self, now_s: float) -> None:
        causes, self._causes, self._dumped_s = self._causes, [], now_s
        self.ask(causes[0], ", then ".join(causes), lambda _result: None)


def _told(cause: Cause, result: TaskResult) -> Event:
    """Return an event that says where the dump is, or why there is none."""
    if isinstance(result.value, dict):
        value = result.value
        text = f"the last {value['seconds']:.0f} s are recorded in {value['path']} ({cause})"
        return Event("recorder", text, {"cause": cause, "path": value["path"]})
    text = f"the last minute could NOT be recorded ({cause}): {result.error}"
    return Event("recorder", text, {"cause": cause, "error": result.error})
