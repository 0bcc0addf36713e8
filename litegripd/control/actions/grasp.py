"""Grasping: close until something resists, then hold it by force and watch that it stays.

The approach is `Approach`, with a torque budget; the hold is `Grip`, which goes on when this
action has ended: at the verdict or after `hold_s`, as the caller wanted.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.approach import BUDGET_NM, Approach, Verdict
from litegripd.control.gains import Gains
from litegripd.control.grip import Grip, GripSettings, HoldBy
from litegripd.control.lasting import Lasting
from litegripd.control.rest import Hold, Rest
from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import GraspOutcome, GraspResult, Progress

FELT_S = 0.1
"""So long what is there must bear the force that would drive free jaws: twice what a loss takes."""

Until: TypeAlias = Literal["held", "verdict"]


@dataclass(frozen=True, slots=True)
class GraspRequest:
    """What a caller wants of a grasp.

    `hold_s` 0 holds until told otherwise. With `width_mm` an object of another width, by more
    than `tolerance_mm`, is held all the same but not a success.
    """

    force_n: float
    speed_mm_s: float
    hold_s: float = 0.0
    until: Until = "held"
    hold_by: HoldBy = "torque"
    width_mm: float | None = None
    tolerance_mm: float = 0.0


class Grasp(PlainAction):
    """One grasp; of what is `held` already, without letting go of it to feel for it."""

    def __init__(
        self,
        request: GraspRequest,
        *,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        period_s: float,
        held: Grip | None = None,
    ) -> None:
        self._request = request
        self._geometry = geometry
        self._config = config
        self._gains = gains
        self._period_s = period_s
        self._approach = Approach(geometry, config, gains, request.speed_mm_s, period_s)
        self._grip: Grip | None = None
        self._verdict: Verdict | None = None
        self._width_mm: float | None = None
        self._held_since_s = 0.0
        self._now_s = 0.0
        self._steps = 0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None
        self._feels_n: float | None = None
        self._felt = Lasting(FELT_S)
        if held is not None:
            self._verdict = "contact"
            self._grip = held.again(self._settings(None), request.force_n)

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Close, then hold; the verdict is this tick's."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._now_s, self._feedback = now_s, feedback
        self._steps += 1
        if self._grip is None:
            command, self._verdict = self._approach.step(now_s, feedback)
            self._command_rad = command.position_rad
            if self._verdict in ("empty", "timed_out"):
                return Step(command, outcome=self._result(self._missed()))
            if self._verdict is None:
                return Step(command)
            self._grip = self._take(now_s, feedback)
            if self._request.until == "verdict":
                return Step(command, outcome=self._result(self._held()))
        elif self._width_mm is None and self._is_felt(now_s, feedback, self._grip):
            self._note_contact(now_s, feedback)
            if self._request.until == "verdict":
                command = self._grip.command(now_s, feedback)
                return Step(
                    command, outcome=self._outcome(self._grip) or self._result(self._held())
                )
        command = self._grip.command(now_s, feedback)
        self._command_rad = command.position_rad
        return Step(command, outcome=self._outcome(self._grip))

    def rest(self) -> Rest | None:
        """Go on holding what is held; jaws that have lost it still run, and are held calmly."""
        if self._grip is None:
            return None
        if self._grip.is_holding or self._feedback is None:
            return self._grip
        caught_rad = self._grip.caught_rad(self._feedback.position_rad, self._period_s)
        return Hold(caught_rad, self._gains.calmed())

    def progress(self) -> Progress | None:
        """Tell the phase, the step of the approach, and where command and jaws are."""
        if self._feedback is None:
            return None
        if self._grip is not None:
            return progress_of("hold", self._cycles(), 0, self._command_rad, self._feedback)
        total = max(round(self._approach.ramp_s / self._period_s), 1)
        step = min(self._steps, total)
        return progress_of("approach", step, total, self._command_rad, self._feedback)

    def _is_felt(self, now_s: float, feedback: Feedback, grip: Grip) -> bool:
        """Return True once it is sure that what was held is still there.

        With a force whose loss would not be noticed it may have gone long ago: then the jaws press
        for a moment as hard as a grasp that begins does, or as it takes.
        """
        if self._feels_n is None:
            opening_mm = self._geometry.opening_mm(feedback.position_rad)
            needed_n = grip.loss_detected_from_n(opening_mm) or 0.0
            if min(grip.applied_n, self._request.force_n) >= needed_n:
                return True
            self._feels_n = min(needed_n, BUDGET_NM * FORCE_PER_TORQUE_N_NM)
            grip.squeeze(max(self._feels_n, self._request.force_n))
        presses = grip.applied_n >= 0.999 * self._feels_n
        if not self._felt.step(presses, now_s):
            return False
        grip.squeeze(self._request.force_n)
        return True

    def _take(self, now_s: float, feedback: Feedback) -> Grip:
        """Go over from closing to holding, without a step in the torque."""
        self._note_contact(now_s, feedback)
        settings = self._settings(self._approach.friction.friction_nm)
        in_flight_nm = self._geometry.close_sign * feedback.torque_nm
        return Grip(settings, self._request.force_n, in_flight_nm, watched=True)

    def _note_contact(self, now_s: float, feedback: Feedback) -> None:
        self._held_since_s = now_s
        self._width_mm = self._geometry.opening_mm(feedback.position_rad)

    def _settings(self, friction_nm: float | None) -> GripSettings:
        request = self._request
        return GripSettings.of(
            self._geometry, self._config, request.speed_mm_s, request.hold_by, friction_nm
        )

    def _outcome(self, grip: Grip) -> GraspResult | None:
        if grip.is_lost:
            return self._result("object_lost")
        hold_s = self._request.hold_s
        if hold_s > 0.0 and self._held_s() >= hold_s:
            return self._result(self._held())
        return None

    def _held(self) -> GraspOutcome:
        """Tell whether what is held has the width that the caller expects."""
        expected_mm, width_mm = self._request.width_mm, self._width_mm
        if expected_mm is None or width_mm is None:
            return "object_held"
        differs = abs(width_mm - expected_mm) > self._request.tolerance_mm
        return "wrong_width" if differs else "object_held"

    def _missed(self) -> GraspOutcome:
        return "no_object" if self._verdict == "empty" else "timed_out"

    def _held_s(self) -> float:
        return 0.0 if self._grip is None else self._now_s - self._held_since_s

    def _cycles(self) -> int:
        return int(self._held_s() / self._config.hold_interval + 1e-9)

    def _result(self, outcome: GraspOutcome) -> GraspResult:
        return GraspResult(
            ok=outcome == "object_held",
            outcome=outcome,
            reached=self._verdict == "empty",
            stalled=self._verdict in ("contact", "stalled"),
            target_rad=self._approach.target_rad,
            force_n=self._request.force_n if self._grip is None else self._grip.force_n,
            cycles=self._cycles(),
            width_mm=self._width_mm,
            held_s=self._held_s(),
        )
