"""Calibrating without a stroke: marks set by hand, and the motor's own zero.

By hand the jaws are slack, and a person marks where the two stops are: the marks alone say which
way closing runs. The motor's own zero is set while it is disabled, and watched until the position
confirms it. The jaws do not move. What the positions of a calibration mean is changed by it: the
result says by how much.
"""

from dataclasses import replace
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.calibration import Saving
from litegripd.control.holds import Slack
from litegripd.control.limiter import Bounds, probe_bounds
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import DisableMotor, Feedback, MotorPhase, MotorView
from litegripd.model.motor import SetZero as SetZeroRequest
from litegripd.model.results import Progress, SetZeroResult

Side: TypeAlias = Literal["closed", "open"]


class CalibrateByHand(PlainAction):
    """Lets the jaws go until `finish`; then saves what was marked."""

    def __init__(self, config: MotionConfig) -> None:
        self.bounds: Bounds | None = probe_bounds(config)
        self.marks: dict[Side, float] = {}
        self._saving: Saving | None = None
        self._feedback: Feedback | None = None

    def mark(self, side: Side) -> Refusal | None:
        """Take the measured position as one of the stops."""
        if self._feedback is None or self._saving is not None:
            return Refusal("busy", "the calibration is not ready for a mark: try again")
        self.marks[side] = self._feedback.position_rad
        return None

    def finish(self, saving: Saving) -> Refusal | None:
        """Begin to save; both stops must be marked."""
        if self._saving is not None:
            return Refusal("busy", "the calibration is being saved already: wait for its end")
        missing = [side for side in ("closed", "open") if side not in self.marks]
        if missing:
            text = f"{' and '.join(missing)} not marked yet: push the jaws there and mark it"
            return Refusal("out_of_limits", text)
        failure = saving.begin(self.marks["closed"], self.marks["open"], plausible=False)
        if failure is not None:
            return Refusal("out_of_limits", f"{failure.message}; mark them again")
        self._saving = saving
        return None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Keep the jaws slack."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        command = Slack().command(now_s, feedback)
        if self._saving is None:
            return Step(command)
        return replace(self._saving.step(now_s, motor), command=command)

    def progress(self) -> Progress | None:
        """Return how many stops are marked, and where the jaws are."""
        if self._feedback is None:
            return None
        phase = "by_hand" if self._saving is None else "saving"
        here_rad = self._feedback.position_rad
        return progress_of(phase, len(self.marks), 2, here_rad, self._feedback)


_DISABLE_WITHIN_S = 1.0
_GIVES_UP_S = 2.0
_NOT_CONFIRMED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled, so its zero was not set"
)
_NO_END = Refusal(
    "not_confirmed",
    "the motor's zero was not confirmed in time: find out where the jaws are before they are moved",
)


class SetZero(PlainAction):
    """Makes the present position the zero of the motor's positions; the motor ends disabled.

    What the motor does goes on when this is ended early: `MotorView.zero` tells how it ended.
    """

    needs_power = False

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._asked_to_disable = False
        self._asked_s: float | None = None
        self._was_begun = False

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Disable the motor unless it is disabled, ask once for the zero, then watch."""
        if self._began_s is None:
            self._began_s = now_s
        if self._asked_s is not None:
            return self._watch(now_s - self._asked_s, motor)
        problem = motor.fault or motor.problem
        if problem is not None:
            return Step(outcome=problem)
        if motor.phase is MotorPhase.DISABLED:
            self._asked_s = now_s
            return Step(request=SetZeroRequest())
        if not self._asked_to_disable:
            self._asked_to_disable = True
            return Step(request=DisableMotor())
        waits = now_s - self._began_s < _DISABLE_WITHIN_S
        return Step(outcome=None if waits else motor.failure or _NOT_CONFIRMED)

    def _watch(self, asked_for_s: float, motor: MotorView) -> Step:
        """Take the end of what was begun here, never that of an earlier setting."""
        zero = motor.zero
        self._was_begun = self._was_begun or zero.state == "pending"
        if zero.state == "done" and self._was_begun:
            return Step(outcome=SetZeroResult(True, zero.shift_rad, zero.position_rad))
        if zero.state == "failed":
            why = None if zero.is_uncertain else motor.problem
            return Step(outcome=why or zero.failure or _NO_END)
        return Step(outcome=_NO_END if asked_for_s >= _GIVES_UP_S else None)
