"""Moves: to a position, and to a stop, which is pressed gently.

`MoveTo` goes to a position inside the travel, at a speed: a ramp with velocity feed-forward. Moves
may be slow. Static friction holds slow jaws for longer than a stall window. So on the way they
count as stalled only if the ramp is ahead of them by more than friction can hold.

`MoveToStop` opens and closes: a ramp past the calibrated stop, which the mechanical stop ends. The
command is a ramp in time. Its lead over the measured position is limited: by `max_lead_mm` on the
way, enough to break static friction, and by `stop_lead_mm` within `press_zone_mm` of the stop, so
that the jaws press gently. The lead of a `MoveTo` has the same limits. They mean torques
(`motion_config.py`): a calibration's gains and scale change nothing.

A ramp waits for jaws that are held up: when its lead is used up, it begins again from there, and
the command has the damping that catches running jaws on every motor. Jaws that come free, or that
a late tick has left behind, go on as at the beginning of the move, and do not catch up.

Damping turns the velocity of the command into torque as soon as something stops the jaws. So the
torque of lead and velocity together is bounded: kp times the lead, and at most `_FED_SHARE` more
while the ramp lasts.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from litegripd.control.detectors import StallDetector, TorqueGuard
from litegripd.control.limiter import (
    DEFAULT_GAINS,
    Gains,
    bounds_of,
    clamp_lead,
    is_in_press_zone,
    lead_within,
)
from litegripd.control.motions.base import PlainAction, Step, gives_up_after_s, progress_of
from litegripd.model.gripper import FASTEST_RAD_S, Geometry
from litegripd.model.motion_config import MOVING_KD_NM_S_RAD, MOVING_KP_NM_RAD, MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.state import MoveOutcome, MoveResult, Progress

SPEED_UP_S = 0.04
"""A velocity that is fed forward at once throws light jaws beyond it, by a third: the motor's own
measurement of the speed comes late. With 20 ms they exceed 150 mm/s by 17, with 40 ms by 11."""
SPEED_UP_RAD_S2 = FASTEST_RAD_S / SPEED_UP_S
"""The acceleration of what follows set-points or a path: it may be told to be fast at once, too."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """From `start_rad` at `began_s` to `target_rad` at `speed_rad_s` (above 0).

    It gains its speed in `SPEED_UP_S`, and ends without slowing down.
    """

    began_s: float
    start_rad: float
    target_rad: float
    speed_rad_s: float

    @property
    def duration_s(self) -> float:
        """The time from start to target."""
        distance_rad = abs(self.target_rad - self.start_rad)
        if distance_rad < 0.5 * self.speed_rad_s * SPEED_UP_S:
            return math.sqrt(2.0 * distance_rad * SPEED_UP_S / self.speed_rad_s)
        return distance_rad / self.speed_rad_s + 0.5 * SPEED_UP_S

    def is_over(self, now_s: float) -> bool:
        """Return True if the ramp commands the target."""
        return now_s - self.began_s >= self.duration_s

    def at(self, now_s: float) -> tuple[float, float]:
        """Return the position (rad) and the velocity (rad/s) to be commanded."""
        if self.is_over(now_s):
            return self.target_rad, 0.0
        speed_rad_s = self.speed_rad_s if self.target_rad > self.start_rad else -self.speed_rad_s
        elapsed_s = now_s - self.began_s
        if elapsed_s >= SPEED_UP_S:
            moved_s, velocity_rad_s = elapsed_s - 0.5 * SPEED_UP_S, speed_rad_s
        else:
            share = elapsed_s / SPEED_UP_S
            moved_s, velocity_rad_s = 0.5 * elapsed_s * share, speed_rad_s * share
        return self.start_rad + speed_rad_s * moved_s, velocity_rad_s

    def again(self, now_s: float, from_rad: float) -> "Ramp":
        """Return the ramp that leads from here to the same target, from a standstill."""
        return replace(self, began_s=now_s, start_rad=from_rad)


def common_speed(velocity_rad_s: float, feedback: Feedback | None, period_s: float) -> float:
    """Return how fast the jaws may be by now that follow a command: at its own speed at most.

    Jaws that something soft has slowed down need no lead for what they travel meanwhile. With that
    of the command's speed they would be thrown, at up to 246 mm/s, when it gives way.
    """
    if feedback is None:
        return 0.0
    sign = math.copysign(1.0, velocity_rad_s)
    gained_rad_s = SPEED_UP_RAD_S2 * period_s
    return min(abs(velocity_rad_s), max(sign * feedback.velocity_rad_s, 0.0) + gained_rad_s)


_FED_SHARE = 0.4
"""The largest share of the lead's torque that the velocity adds on the way. With a quarter, free
jaws that begin at 150 mm/s overshoot to 174 mm/s; with 0.6, what holds them up feels too much."""
FRICTION_NM = 1.1
"""More than what holds the jaws: the closing side may stick with 0.95 N·m (field measurements)."""


class MoveTo(PlainAction):
    """One move to `target_rad`; ends when the jaws have settled there, or stall on the way.

    `travel_nm` is the largest torque of its lead on the way, however stiff its gains are. The
    result names the stop `limit_rad`, or if None the one ahead.
    """

    def __init__(
        self,
        target_rad: float,
        speed_rad_s: float,
        *,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        travel_nm: float,
        period_s: float,
        limit_rad: float | None = None,
    ) -> None:
        self._target_rad = target_rad
        self._named_limit_rad = limit_rad
        self._speed_rad_s = speed_rad_s
        self._geometry = geometry
        self._config = config
        self._gains = gains.reaching()
        self._travel_nm = travel_nm
        self._period_s = period_s
        self._stall: StallDetector | None = None
        self._planned: Ramp | None = None
        self._ramp: Ramp | None = None
        self._steps = 0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Return the command, and the outcome once the jaws have arrived or stalled."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        position_rad = feedback.position_rad
        if self._ramp is None:
            self._ramp = Ramp(now_s, position_rad, self._target_rad, self._speed_rad_s)
            self._planned = self._ramp
        self._steps += 1
        self._feedback = feedback
        ramp_rad, velocity_rad_s = self._ramp.at(now_s)
        push_nm = self._push_nm(position_rad, self._ramp)
        gains, lead_rad = lead_within(
            push_nm,
            self._gains,
            common_speed(velocity_rad_s, feedback, self._period_s),
            self._period_s,
        )
        self._command_rad = clamp_lead(ramp_rad, position_rad, lead_rad)
        # Jaws so far behind the ramp are held by more than friction.
        held_nm = self._gains.kp_nm_rad * abs(ramp_rad - position_rad)
        is_behind = held_nm >= min(FRICTION_NM, self._travel_nm)
        outcome = self._judge(now_s, position_rad, self._ramp, is_behind=is_behind)
        if self._command_rad != ramp_rad:
            velocity_rad_s = 0.0  # kd·dq would add to the torque that is bounded
            gains, lead_rad = lead_within(push_nm, self._gains.catching(), 0.0, self._period_s)
            self._command_rad = clamp_lead(ramp_rad, position_rad, lead_rad)
            if not self._is_there(position_rad):  # where friction holds them, the ramp ends
                self._ramp = self._ramp.again(now_s, self._command_rad)
        kd = gains.kd_nm_s_rad
        if velocity_rad_s != 0.0:
            kd = min(kd, _FED_SHARE * self._travel_nm / abs(velocity_rad_s))
        return Step(
            Gains(gains.kp_nm_rad, kd).at(self._command_rad, velocity_rad_s),
            outcome=None if outcome is None else self._result(outcome, position_rad, self._ramp),
        )

    def progress(self) -> Progress | None:
        """Return the phase, the step, and where command and jaws are."""
        if self._feedback is None or self._planned is None:
            return None
        total_steps = max(round(self._planned.duration_s / self._period_s), 1)
        phase = "ramp" if self._steps < total_steps else "settle"
        step = min(self._steps, total_steps)
        return progress_of(phase, step, total_steps, self._command_rad, self._feedback)

    def _push_nm(self, position_rad: float, ramp: Ramp) -> float:
        """Return the torque by which the command may lead: less at the stop that lies ahead."""
        short_rad = abs(self._limit_rad(ramp) - position_rad)
        presses = is_in_press_zone(short_rad, self._geometry, self._config)
        return self._config.stop_nm if presses else self._travel_nm

    def _limit_rad(self, ramp: Ramp) -> float:
        """Return the calibrated stop that lies ahead."""
        geometry = self._geometry
        closing = (ramp.target_rad - ramp.start_rad) * geometry.close_sign > 0.0
        return geometry.closed_rad if closing else geometry.open_rad

    def _judge(
        self, now_s: float, position_rad: float, ramp: Ramp, *, is_behind: bool
    ) -> MoveOutcome | None:
        past_ramp_s = now_s - ramp.began_s - ramp.duration_s
        if self._is_there(position_rad):
            return "reached" if past_ramp_s >= self._config.settle_s else None
        if not is_behind and past_ramp_s < 0.0:
            self._stall = None
        else:
            self._stall = self._stall or StallDetector(self._config, self._speed_rad_s)
            if self._stall.add(now_s, position_rad):
                return "blocked"
        planned = self._planned or ramp
        taken_s = now_s - planned.began_s
        return "timed_out" if taken_s > gives_up_after_s(planned.duration_s) else None

    def _is_there(self, position_rad: float) -> bool:
        """Return True if the jaws are where they are to go."""
        return abs(self._target_rad - position_rad) <= self._config.reach_tol

    def _result(self, outcome: MoveOutcome, position_rad: float, ramp: Ramp) -> MoveResult:
        named_rad = self._named_limit_rad
        return MoveResult(
            ok=outcome == "reached",
            outcome=outcome,
            reached=self._is_there(position_rad),
            stalled=outcome == "blocked",
            protected=False,
            target_rad=self._target_rad,
            limit_rad=self._limit_rad(ramp) if named_rad is None else named_rad,
            final_command_rad=self._command_rad,
            steps=self._steps,
        )


Direction: TypeAlias = Literal["open", "close"]
Phase: TypeAlias = Literal["ramp", "press", "settle", "release"]

_RUN_IN_BUDGET = 1.1
"""Times the torque of the press, near the stop and not at it: slow jaws would stick there."""
_RUN_IN_SHARES = (0.55, 0.85)
"""Shares of it from the velocity: more, the further the jaws are ahead of their measurement."""
_RELEASING_GAINS = Gains(0.0, MOVING_KD_NM_S_RAD)
"""They let go of what the jaws press. Without damping, an object of 10 N·m/rad would throw the jaws
open at 470 mm/s; with it, at 150."""
_STALE_PERIODS = 1.5
_LOOK_AHEAD_PERIODS = 2.0
"""How old a measurement may be when its command arrives; the jaws are that much nearer."""


class MoveToStop(PlainAction):
    """One `open` or `close` at `speed_mm_s`; `travel_nm` is the largest torque of its lead.

    Phases: `ramp`, until the command has reached the target past the stop; `press`, until the jaws
    stall; `settle`, some pressing without a check, because still jaws are expected. A stall short
    of the stop ends the move at once. A jam that yields slowly ends it after some time without
    force (`release`).
    """

    def __init__(
        self,
        direction: Direction,
        speed_mm_s: float,
        *,
        geometry: Geometry,
        config: MotionConfig,
        travel_nm: float,
        period_s: float,
    ) -> None:
        self.bounds = bounds_of(geometry, config)
        closing = direction == "close"
        self._sign = geometry.close_sign if closing else -geometry.close_sign
        self._limit_rad = geometry.closed_rad if closing else geometry.open_rad
        overshoot_rad = config.press_overshoot * geometry.travel_rad
        self.target_rad = self._limit_rad + self._sign * overshoot_rad
        self._speed_rad_s = geometry.to_rad(speed_mm_s)
        self._geometry = geometry
        self._config = config
        self._travel_nm = travel_nm
        self._period_s = period_s
        self._phase: Phase = "ramp"
        self._phase_began_s = 0.0
        self._stall = StallDetector(config, self._speed_rad_s)
        self._guard = TorqueGuard(config, self._speed_rad_s)
        self._stalled = False
        self._is_near_stop = False
        self._planned: Ramp | None = None
        self._ramp: Ramp | None = None
        self._steps = 0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Return the command, and the outcome once the move has ended."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        if self._ramp is None:
            # It starts where the jaws are; past the target, they do not go back.
            is_past = (self.target_rad - feedback.position_rad) * self._sign < 0.0
            start_rad = self.target_rad if is_past else feedback.position_rad
            self._planned = self._ramp = Ramp(now_s, start_rad, self.target_rad, self._speed_rad_s)
            self._phase_began_s = now_s
        self._steps += 1
        self._feedback = feedback
        ramp_rad, velocity_rad_s = self._ramp.at(now_s)
        self._command_rad = self._capped(ramp_rad, velocity_rad_s, feedback)
        outcome = self._judge(now_s, feedback, self._ramp)
        if self._command_rad != ramp_rad and not self._is_near_stop:
            velocity_rad_s = 0.0  # kd·dq would add to the torque that is bounded
            self._command_rad = self._capped(ramp_rad, velocity_rad_s, feedback)
            self._ramp = self._ramp.again(now_s, self._command_rad)
        command = self._lead_command(velocity_rad_s, ramp_rad, feedback.position_rad)
        self._command_rad = command.position_rad
        if self._phase == "release":
            command = _RELEASING_GAINS.at(feedback.position_rad)
        return Step(command, outcome=None if outcome is None else self._result(outcome))

    def progress(self) -> Progress | None:
        """Return the phase, the step, and where command and jaws are."""
        if self._feedback is None or self._planned is None:
            return None
        total_steps = max(round(self._planned.duration_s / self._period_s), 1)
        step = min(self._steps, total_steps)
        return progress_of(self._phase, step, total_steps, self._command_rad, self._feedback)

    def _capped(self, command_rad: float, velocity_rad_s: float, feedback: Feedback) -> float:
        """Limit the lead to what is allowed where the jaws will be when the command arrives."""
        speed_rad_s = self._speed_rad_s
        if not self._is_near_stop:  # otherwise a loss of speed does not matter
            speed_rad_s = min(max(feedback.velocity_rad_s * self._sign, 0.0), speed_rad_s)
        ahead_rad = speed_rad_s * _LOOK_AHEAD_PERIODS * self._period_s
        short_rad = self._short_rad(feedback.position_rad) - ahead_rad
        self._is_near_stop = is_in_press_zone(short_rad, self._geometry, self._config)
        _, lead_rad = self._lead(velocity_rad_s, feedback.position_rad)
        return clamp_lead(command_rad, feedback.position_rad, lead_rad)

    def _lead(self, velocity_rad_s: float, position_rad: float) -> tuple[Gains, float]:
        """Return stiffness and largest lead where the jaws are."""
        if self._is_near_stop:
            push_nm = self._config.stop_nm
            if not self._is_home(position_rad):
                push_nm *= _RUN_IN_BUDGET
            return DEFAULT_GAINS, push_nm / MOVING_KP_NM_RAD
        speed_rad_s = common_speed(velocity_rad_s, self._feedback, self._period_s)
        return lead_within(self._travel_nm, DEFAULT_GAINS, speed_rad_s, self._period_s)

    def _lead_command(
        self, velocity_rad_s: float, ramp_rad: float, position_rad: float
    ) -> MitCommand:
        """Return the command for a velocity (rad/s), with gains that keep it within its torque."""
        gains, lead_rad = self._lead(velocity_rad_s, position_rad)
        kp, kd = gains.kp_nm_rad, gains.kd_nm_s_rad
        if velocity_rad_s == 0.0 and not self._is_near_stop:
            gains = gains.catching()
        if self._phase in ("press", "settle") or velocity_rad_s == 0.0:
            return gains.at(self._command_rad)
        if self._is_near_stop:
            # The velocity stays: without it damping would brake jaws that must stay fast here.
            budget_nm = _RUN_IN_BUDGET * self._config.stop_nm
            least, most = _RUN_IN_SHARES
            stale_rad = self._speed_rad_s * _STALE_PERIODS * self._period_s
            share = min(max(stale_rad / lead_rad, least), most)
            kd = min(kd, share * budget_nm / self._speed_rad_s)
            softer = min(kp, (budget_nm - kd * self._speed_rad_s) / lead_rad)
            wanted_rad = position_rad + (ramp_rad - position_rad) * kp / softer  # the same torque
            return Gains(softer, kd).at(
                clamp_lead(wanted_rad, position_rad, lead_rad), velocity_rad_s
            )
        kd = min(kd, _FED_SHARE * self._travel_nm / self._speed_rad_s)
        return Gains(kp, kd).at(self._command_rad, velocity_rad_s)

    def _short_rad(self, position_rad: float) -> float:
        """Return how far the jaws still are from the calibrated stop; negative beyond it."""
        return (self._limit_rad - position_rad) * self._sign

    def _judge(self, now_s: float, feedback: Feedback, ramp: Ramp) -> MoveOutcome | None:
        """Begin the next phase, or return how the move ended."""
        position_rad = feedback.position_rad
        in_phase_s = now_s - self._phase_began_s
        if self._phase == "release":
            return "protected" if in_phase_s >= self._config.stop_release_s else None
        if self._phase == "settle":
            if in_phase_s < self._config.settle_s:
                return None
            return "pressed_home" if self._is_home(position_rad) else "blocked"
        if self._phase == "press" and self._has_reached_target(position_rad):
            return "no_stop"
        if self._is_jammed(now_s, feedback):
            self._stalled = True
            self._enter("release", now_s)
        elif self._stall.add(now_s, position_rad):
            self._stalled = True
            if not self._is_home(position_rad):
                return "blocked"
            self._enter("settle", now_s)
        elif self._phase == "ramp" and ramp.is_over(now_s):
            self._enter("press", now_s)
        elif in_phase_s > gives_up_after_s((self._planned or ramp).duration_s):
            return "timed_out"
        return None

    def _is_jammed(self, now_s: float, feedback: Feedback) -> bool:
        """Return True if something takes the torque before the stop."""
        if self._is_near_stop:
            self._guard.reset()
            return False
        return self._guard.add(now_s, feedback.position_rad, feedback.torque_nm)

    def _enter(self, phase: Phase, now_s: float) -> None:
        self._phase = phase
        self._phase_began_s = now_s

    def _is_home(self, position_rad: float) -> bool:
        """Return True if the jaws are at the calibrated stop; beyond it, nothing is in the way."""
        return self._short_rad(position_rad) <= self._config.stop_tol

    def _has_reached_target(self, position_rad: float) -> bool:
        """Return True if the jaws came as far past the stop as commanded, and met none."""
        return (self.target_rad - position_rad) * self._sign <= self._config.reach_tol

    def _result(self, outcome: MoveOutcome) -> MoveResult:
        position_rad = self._command_rad if self._feedback is None else self._feedback.position_rad
        return MoveResult(
            ok=outcome == "pressed_home",
            outcome=outcome,
            reached=self._has_reached_target(position_rad),
            stalled=self._stalled,
            protected=outcome == "protected",
            target_rad=self.target_rad,
            limit_rad=self._limit_rad,
            final_command_rad=self._command_rad,
            steps=self._steps,
        )
