"""Moving to a position inside the travel, at a speed: a ramp with velocity feed-forward.

The lead over the measured position is capped as in opening and closing, with the same two tiers.
Moves may be slow. Static friction holds slow jaws for longer than a stall window, so on the way
they count as stalled only while the ramp is ahead of them by more than friction can hold.
"""

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.gains import Gains
from litegripd.control.lead import lead_cap_rad, led
from litegripd.control.ramp import Ramp
from litegripd.control.stall import StallDetector
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import MoveOutcome, MoveResult, Progress

FRICTION_NM = 1.1
"""More than holds the jaws: the closing side may stick with 0.95 N·m (field measurements)."""

_GIVE_UP_EXTRA_S = 2.0


class MoveTo(PlainAction):
    """One move to `target_rad`; ends when the jaws have settled there, or stall on the way."""

    def __init__(
        self,
        target_rad: float,
        speed_rad_s: float,
        *,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        period_s: float,
    ) -> None:
        self._target_rad = target_rad
        self._speed_rad_s = speed_rad_s
        self._geometry = geometry
        self._config = config
        self._gains = gains
        self._period_s = period_s
        self._stall: StallDetector | None = None
        self._ramp: Ramp | None = None
        self._steps = 0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Lead the jaws on, and judge where they are."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        position_rad = feedback.position_rad
        if self._ramp is None:
            self._ramp = Ramp(now_s, position_rad, self._target_rad, self._speed_rad_s)
        self._steps += 1
        self._feedback = feedback
        ramp_rad, velocity_rad_s = self._ramp.at(now_s)
        lead_rad = self._lead_rad(position_rad, self._ramp)
        self._command_rad = led(ramp_rad, position_rad, lead_rad)
        if self._command_rad != ramp_rad:
            velocity_rad_s = 0.0  # kd·dq would add to the torque that the cap is to bound
        is_behind = self._is_behind(abs(ramp_rad - position_rad))
        outcome = self._judge(now_s, position_rad, self._ramp, is_behind=is_behind)
        return Step(
            self._gains.at(self._command_rad, velocity_rad_s),
            outcome=None if outcome is None else self._result(outcome, position_rad, self._ramp),
        )

    def progress(self) -> Progress | None:
        """Tell the phase, the step, and where command and jaws are."""
        if self._feedback is None or self._ramp is None:
            return None
        total_steps = max(round(self._ramp.duration_s / self._period_s), 1)
        phase = "ramp" if self._steps < total_steps else "settle"
        step = min(self._steps, total_steps)
        return progress_of(phase, step, total_steps, self._command_rad, self._feedback)

    def _lead_rad(self, position_rad: float, ramp: Ramp) -> float:
        """Return how far the command may lead: less at the stop that lies ahead."""
        short_rad = abs(self._limit_rad(ramp) - position_rad)
        return lead_cap_rad(short_rad, self._geometry, self._config)

    def _limit_rad(self, ramp: Ramp) -> float:
        """Return the calibrated stop that lies ahead."""
        geometry = self._geometry
        closing = (ramp.target_rad - ramp.start_rad) * geometry.close_sign > 0.0
        return geometry.closed_rad if closing else geometry.open_rad

    def _is_behind(self, distance_rad: float) -> bool:
        """Whether jaws so far from the ramp are held by more than friction."""
        held_nm = self._gains.kp_nm_rad * distance_rad
        return held_nm >= FRICTION_NM or distance_rad >= self._geometry.to_rad(
            self._config.max_lead_mm
        )

    def _judge(
        self, now_s: float, position_rad: float, ramp: Ramp, *, is_behind: bool
    ) -> MoveOutcome | None:
        past_ramp_s = now_s - ramp.began_s - ramp.duration_s
        if abs(self._target_rad - position_rad) <= self._config.reach_tol:
            return "reached" if past_ramp_s >= self._config.settle_s else None
        if not is_behind and past_ramp_s < 0.0:
            self._stall = None
        else:
            self._stall = self._stall or StallDetector(self._config, self._speed_rad_s)
            if self._stall.add(now_s, position_rad):
                return "blocked"
        return "timed_out" if past_ramp_s > ramp.duration_s + _GIVE_UP_EXTRA_S else None

    def _result(self, outcome: MoveOutcome, position_rad: float, ramp: Ramp) -> MoveResult:
        return MoveResult(
            ok=outcome == "reached",
            outcome=outcome,
            reached=abs(self._target_rad - position_rad) <= self._config.reach_tol,
            stalled=outcome == "blocked",
            protected=False,
            target_rad=self._target_rad,
            limit_rad=self._limit_rad(ramp),
            final_command_rad=self._command_rad,
            steps=self._steps,
        )
