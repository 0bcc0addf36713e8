"""What every action has: one method `step`, called once per tick, until there is an outcome.

The shortest ones are here: changes of the motor itself, each confirmed by it. None moves the jaws.
A new zero changes what the positions of a calibration mean: its result says by how much.
"""

from dataclasses import dataclass
from typing import Protocol

from litegripd.control.holds import Idle
from litegripd.control.limiter import Bounds
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.motor import ClearFault as ClearFaultRequest
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    Feedback,
    MitCommand,
    MotorPhase,
    MotorRequest,
    MotorView,
    status_name,
)
from litegripd.model.motor import SetZero as SetZeroRequest
from litegripd.model.state import (
    ClearFaultResult,
    DisableResult,
    EnableResult,
    HelperTask,
    Progress,
    Result,
    SetZeroResult,
)


@dataclass(frozen=True, slots=True)
class Adopted:
    """A calibration that is in use from now on, and its file, if any."""

    calibration: Calibration
    file: str | None


@dataclass(frozen=True, slots=True)
class Step:
    """What an action wants in this tick, and its outcome in its last one."""

    command: MitCommand | None = None
    request: MotorRequest | None = None
    outcome: Result | Refusal | None = None
    task: HelperTask | None = None
    adopted: Adopted | None = None


class Action(Protocol):
    """A motion, or a change of the motor itself."""

    needs_power: bool
    """True if it runs only while the motor is enabled; losing power ends it."""

    bounds: Bounds | None
    """The bounds of its commands; None for those of the calibrated travel."""

    by_force: bool
    """True while it drives the jaws by a set torque, and not by a grip that it would leave."""

    is_held_back: bool
    """True while its speed alone keeps it from where it is sent."""

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`. A position on a ramp follows from the time, not from the calls."""

    def idle_after(self) -> Idle | None:
        """Return what the jaws do if it ends now; None to hold where they are."""

    def progress(self) -> Progress | None:
        """Return how far it is; None if the action reports no progress."""

    def close(self) -> None:
        """Release what it has, other than the jaws; called once, when it has ended."""


def gives_up_after_s(planned_s: float) -> float:
    """Return how long a motion may take: twice what was planned, and 2 s more."""
    return 2.0 * planned_s + 2.0


def progress_of(
    phase: str, step: int, total_steps: int, command_rad: float, feedback: Feedback
) -> Progress:
    """Return the progress of a motion, with what was measured."""
    return Progress(
        phase,
        step,
        total_steps,
        command_rad,
        feedback.position_rad,
        feedback.torque_nm,
        feedback.coil_temperature_c,
    )


class PlainAction:
    """What most actions have in common: no own bounds or torque, a hold at the end, no progress."""

    needs_power = True
    bounds: Bounds | None = None
    by_force = False
    is_held_back = False

    def idle_after(self) -> Idle | None:
        """Return None: the jaws hold where they are."""
        return None

    def progress(self) -> Progress | None:
        """Return None: there is no progress to report."""
        return None

    def close(self) -> None:
        """Release nothing."""


_DISABLE_WITHIN_S = 1.0
_CLEAR_WITHIN_S = 0.5
_SCAN_WITHIN_S = 3.0
"""How long reading all registers again may take, with a third of the frames lost."""


class Enable(PlainAction):
    """Enables the motor; ends when the motor confirms it, or with the reason why it does not.

    Whose power is just back, its registers are read first: nothing is asked of it before.
    """

    needs_power = False

    def __init__(self, request: EnableMotor) -> None:
        self._request: EnableMotor | None = request
        self._began_s: float | None = None
        self._read_s = 0.0

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Wait for the registers, and for the end of a disabling; ask once, then watch."""
        if self._began_s is None:
            self._began_s = self._read_s = now_s
        is_early = now_s - self._began_s < _SCAN_WITHIN_S
        if self._request is not None and motor.is_being_read and is_early:
            self._read_s = now_s
            return Step()
        if motor.phase is MotorPhase.ENABLED:
            return Step(outcome=EnableResult(ok=True, tries=motor.enable_tries))
        if self._request is not None and motor.phase is MotorPhase.DISABLING:
            waits = now_s - self._read_s < _DISABLE_WITHIN_S
            return Step(outcome=None if waits else _STILL_DISABLING)
        if self._request is not None:
            request, self._request = self._request, None
            return Step(request=request)
        if motor.phase is MotorPhase.ENABLING:
            return Step()
        failure = motor.failure or motor.problem
        if failure is not None and failure.reason != "not_confirmed":
            return Step(outcome=failure)
        why = "the motor was not enabled" if failure is None else failure.message
        tries, reason = motor.enable_tries, "not_confirmed"
        return Step(outcome=EnableResult(ok=False, tries=tries, reason=reason, message=why))


class Disable(PlainAction):
    """Disables the motor; ends when the motor confirms it, or as not confirmed."""

    needs_power = False

    def __init__(self) -> None:
        self._asked_s: float | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Ask once, then watch; a motor with a fault is not energised either."""
        if self._asked_s is None:
            self._asked_s = now_s
            return Step(request=DisableMotor())
        if motor.phase in (MotorPhase.DISABLED, MotorPhase.FAULT):
            return Step(outcome=DisableResult(ok=True))
        if now_s - self._asked_s < _DISABLE_WITHIN_S:
            return Step()
        return Step(outcome=motor.failure or motor.problem or _NOT_CONFIRMED)


class ClearFault(PlainAction):
    """Clears the latched fault; ends when the motor confirms it, or with the fault that stays.

    It never energises: a motor without a fault is left as it is.
    """

    needs_power = False

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._asked_s: float | None = None
        self._cleared: str | None = None
        self._had_fault = False

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Wait for the end of a disabling, ask, watch; after a fault clear another problem."""
        if self._began_s is None:
            self._began_s = now_s
        is_disabling = motor.phase is MotorPhase.DISABLING
        if self._asked_s is None and is_disabling and now_s - self._began_s < _DISABLE_WITHIN_S:
            return Step()
        if self._asked_s is None:
            self._had_fault = motor.fault is not None
            latched = motor.fault or motor.problem
            self._cleared = None if latched is None else _name_of(latched)
            if motor.latched is not None:
                self._cleared = status_name(motor.latched)
            return self._ask(now_s)
        if motor.phase is MotorPhase.DISABLED and motor.problem is not None and self._had_fault:
            self._had_fault = False
            return self._ask(now_s)
        if motor.phase is MotorPhase.DISABLED and motor.latched is None:
            return Step(outcome=motor.problem or ClearFaultResult(True, self._cleared))
        is_scanned = motor.phase is MotorPhase.UNKNOWN
        within_s = _SCAN_WITHIN_S if is_scanned else _CLEAR_WITHIN_S
        if motor.failure is None and now_s - self._asked_s < within_s:
            return Step()
        return Step(outcome=motor.failure or motor.fault or motor.problem or _NOT_CLEARED)

    def _ask(self, now_s: float) -> Step:
        self._asked_s = now_s
        return Step(request=ClearFaultRequest())


def _name_of(refusal: Refusal) -> str:
    return str(refusal.data.get("status", refusal.reason))


_NOT_CLEARED = Refusal("not_confirmed", "the motor does not confirm that its fault is cleared")
_STILL_DISABLING = Refusal("not_confirmed", "the motor is still being disabled: try again")

_NOT_CONFIRMED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled: cut its power"
)
"""The outcome if the motor answers but stays enabled."""


_ZERO_WITHIN_S = 2.0
_NOT_DISABLED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled, so its zero was not set"
)
_NO_END = Refusal(
    "not_confirmed",
    "the motor's zero was not confirmed in time: find out where the jaws are before they are moved",
)


class SetZero(PlainAction):
    """Makes the present position the zero of the motor's positions; the motor ends disabled.

    The motor continues the setting if this is ended early; `MotorView.zero` has its end.
    """

    needs_power = False

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._asked_to_disable = False
        self._asked_to_clear = False
        self._asked_s: float | None = None
        self._was_begun = False

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Disable the motor if it is not disabled, ask once for the zero, then watch.

        What the motor has latched at rest is cleared first: it may take a zero only without it.
        """
        if self._began_s is None:
            self._began_s = now_s
        if self._asked_s is not None:
            return self._watch(now_s - self._asked_s, motor)
        problem = motor.fault or motor.problem
        if problem is not None:
            return Step(outcome=problem)
        if motor.phase is MotorPhase.DISABLED and motor.latched is not None:
            is_asked, self._asked_to_clear = self._asked_to_clear, True
            if not is_asked:
                return Step(request=ClearFaultRequest())
            return Step(outcome=motor.failure)
        if motor.phase is MotorPhase.DISABLED:
            self._asked_s = now_s
            return Step(request=SetZeroRequest())
        if not self._asked_to_disable:
            self._asked_to_disable = True
            return Step(request=DisableMotor())
        waits = now_s - self._began_s < _DISABLE_WITHIN_S
        return Step(outcome=None if waits else motor.failure or _NOT_DISABLED)

    def _watch(self, asked_for_s: float, motor: MotorView) -> Step:
        """Take the end of the setting that was begun here, never that of an earlier one."""
        zero = motor.zero
        self._was_begun = self._was_begun or zero.state == "pending"
        if zero.state == "done" and self._was_begun:
            return Step(outcome=SetZeroResult(True, zero.shift_rad, zero.position_rad))
        if zero.state == "failed":
            why = None if zero.is_uncertain else motor.problem
            return Step(outcome=why or zero.failure or _NO_END)
        return Step(outcome=_NO_END if asked_for_s >= _ZERO_WITHIN_S else None)
