"""Grasping: close until something resists, then hold it by force and watch that it stays.

`Approach` closes with a torque budget: the friction that it measures on the way, and a share of the
set force. Its command never pushes jaws that are stopped with more, whatever has stopped them and
however old the feedback is. The lead bounds the position part, and the commanded speed bounds the
damping part. (Jaws that are thrown back, or shot forward, are braked harder.) A ramp of full
stiffness would reach 3.2 N·m 50 ms after it has met an object of 250 N·m/rad.

An object feels the budget less the friction, and before that the impact of the rotor, which no
command prevents: speed·√(inertia·stiffness), a mass that meets a spring. So a small force closes
slowly.

The hold is `Grip`. It continues after this action has ended: at the verdict or after `hold_s`, as
the caller chose.
"""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.control.detectors import Lasting, SpeedWindow, StallDetector
from litegripd.control.holds import (
    CREEPING,
    LARGEST,
    FrictionGauge,
    Grip,
    GripSettings,
    Hold,
    HoldBy,
    Idle,
)
from litegripd.control.limiter import (
    CALM_KD_NM_S_RAD,
    CATCHING_GAINS,
    DEFAULT_GAINS,
    Gains,
    budgeted,
    clamp_lead,
)
from litegripd.control.motions.base import PlainAction, Step, gives_up_after_s, progress_of
from litegripd.model.gripper import DM4310, Geometry, MotorType
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from litegripd.model.motor import KP_MAX_NM_RAD, Feedback, MitCommand, MotorView
from litegripd.model.state import GraspOutcome, GraspResult, Progress

Verdict: TypeAlias = Literal["contact", "stalled", "empty", "timed_out"]

TOUCH_SHARE = 0.9
"""The share of the set force that jaws press with before they hold (vendor's newest sources)."""
FIRM_NM = (0.9, 1.45)
"""What gets standing jaws off, beside the usual friction, and near the closed stop, where they
stick by up to 1.4 N·m: the first value for every force, up to the second one for a large force. Of
300 empty grasps of random grippers none stuck with the second, two in a hundred with the first."""
BUDGET_NM = DM4310.coulomb_nm + FIRM_NM[0]
"""The budget of a small force until friction is measured. A little more than the 0.95 N·m by which
the closing side may stick, and less than 1.3 times the 0.94 N·m with which open and close press."""
BREAKAWAY, SPARE_NM = 2.15, 0.05
"""Jaws that a thump has stopped must move again: standing ones are held by up to twice the friction
of travelling ones. The rest is for errors of what was measured."""
SLACK_MM = 1.0
"""Friction counts after this way: until then the motor may just take up its backlash."""

IMPACT_SHARE, STIFF_NM_RAD = 1.2, 250.0
"""The impact on an object of this stiffness, as a share of the set force: no approach is faster.
It is 9.5 mm/s for 1 N and 47 for 5 N with the gripper that ships; the vendor's newest sources have
13 (at 74.8 mm/rad) and 50."""
LEAST_SPEED_MM_S = 5.0
"""No force closes slower: a slower command would stick and slip."""
STICK_FROM_RAD, STICK_SPEED_MM_S = 0.19, 60.0
"""From so far before the closed stop (10 mm) the jaws run up to this speed, as far as the caller
allows it: what sticks there holds slow jaws only."""

CONTACT_S = 0.08
"""How long all signs of a contact must last. A thump on the way, or a jaw that sticks, is over
by then. The lead takes about 15 ms to build up first."""
CONTACT_SPEED_SHARE = 0.5
"""Jaws below this share of their speed are held up. A smaller share would detect something soft
and damped late: it slows the jaws down only as they compress it."""
CONTACT_RAD_S = 0.33
"""Faster jaws are not held up, whatever their speed should be: viscous friction takes most of the
budget of a motor with a large gear, and its jaws never get as fast as they are asked to."""
CONTACT_TORQUE_SHARE = 0.5
"""Of what the budget has beyond the friction."""
STANDS_RAD_S = 0.07
"""Jaws that have not run freely yet must be slower than this (3.7 mm/s) to be held up: with much
friction, or a weight on them, they creep."""
RAN_RAD = 0.006
"""Jaws that were fast enough for this distance (0.3 mm) have run freely."""
FIRMER_NM_S = 8.0
"""Jaws that stand where they may stick are pressed harder at this rate, up to the larger torque of
`FIRM_NM`: within `CONTACT_S`, and so slowly that a soft object still counts as a contact."""
SAGS_RAD = 0.004
"""A weight that opens the jaws by this much while they press is no object between them."""
STANDS_S = 0.02
"""The time over which positions show that the jaws stand, whatever speed is reported."""
SLOWEST_RAD_S = 0.02  # feedback counts velocity in steps of 0.015 rad/s


class Approach:
    """Closes from where the jaws are to `margin` inside the closed stop, for a force to come.

    The command is a ramp in time, of `speed_mm_s` or as fast as suits the force. When its lead is
    used up, the ramp restarts from there, so that jaws which come free continue at their speed and
    do not catch up. `way_nm` is what the jaws took while they closed just before.
    """

    def __init__(
        self,
        geometry: Geometry,
        config: MotionConfig,
        speed_mm_s: float,
        force_nm: float,
        period_s: float,
        *,
        motor_type: MotorType = DM4310,
        way_nm: float | None = None,
    ) -> None:
        self._sign = geometry.close_sign
        self._way_nm = way_nm
        self.target_rad = geometry.closed_rad - self._sign * config.margin * geometry.travel_rad
        self._sticks_from_rad = geometry.closed_rad - self._sign * STICK_FROM_RAD
        gentle_rad_s = IMPACT_SHARE * force_nm / math.sqrt(motor_type.inertia_kg_m2 * STIFF_NM_RAD)
        most_rad_s = geometry.to_rad(speed_mm_s)
        self.speed_rad_s = min(most_rad_s, max(gentle_rad_s, geometry.to_rad(LEAST_SPEED_MM_S)))
        run_up_rad_s = min(most_rad_s, geometry.to_rad(STICK_SPEED_MM_S))
        self._stick_rad_s = max(self.speed_rad_s, run_up_rad_s)
        self._touch_nm = TOUCH_SHARE * force_nm
        self._usual_nm = motor_type.coulomb_nm
        self._slack_rad = geometry.to_rad(SLACK_MM)
        self._config = config
        self._period_s = period_s
        self._stall = StallDetector(config, self.speed_rad_s)
        self._began_s: float | None = None
        self._began_rad = 0.0
        self._was_s, self._was_rad = 0.0, 0.0
        self._kp: float | None = None
        self.ramp_s = 0.0
        """How long the way to the target takes; known once begun."""
        self._arrived_s: float | None = None
        self._ran = False
        self._load_nm: float | None = None
        self._firm_nm = FIRM_NM[0]
        self._asked_nm = 0.0
        self.is_fed = True
        """True unless the motor reports less than half of what it is asked for."""
        self._slow = Lasting(CONTACT_S)
        self._contact = Lasting(CONTACT_S)
        self._window = SpeedWindow(STANDS_S)
        self.friction = FrictionGauge(motor_type)

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, Verdict | None]:
        """Return the command, and the verdict on what the jaws have met."""
        position_rad = feedback.position_rad
        if self._began_s is None:
            self._began_s, self._began_rad = now_s, position_rad
            self._was_s, self._was_rad = now_s, position_rad
            self.ramp_s = max(self._short_rad(position_rad), 0.0) / self.speed_rad_s
        command, held_back = self._command(now_s, position_rad)
        return command, self._judge(now_s, feedback, held_back)

    def _short_rad(self, position_rad: float) -> float:
        return (self.target_rad - position_rad) * self._sign

    def _moved_rad(self, position_rad: float) -> float:
        return (position_rad - self._began_rad) * self._sign

    def _sticks(self, position_rad: float) -> bool:
        """Return True near the closed stop, where jaws may stick by far more than elsewhere."""
        return (position_rad - self._sticks_from_rad) * self._sign > 0.0

    def _speed_at(self, position_rad: float) -> float:
        return self._stick_rad_s if self._sticks(position_rad) else self.speed_rad_s

    def _budget_nm(self, position_rad: float, firm_nm: float) -> float:
        """Return the largest torque on jaws that stand here; `firm_nm` is for where they stick."""
        load_nm, most_nm = self._load_nm, LARGEST * self._usual_nm  # jaws with more may stand
        if load_nm is None or self._sticks(position_rad):
            return (self._usual_nm if load_nm is None else min(load_nm, most_nm)) + firm_nm
        # Torques are reported at the end of a period, when the lead is shortest. The motor's filter
        # leaves a tenth (200 Hz) to a sixth (100 Hz) of this saw-tooth below its mean.
        ripple_nm = 0.25 * MOVING_KP_NM_RAD * self.speed_rad_s * self._period_s
        least_nm = (BREAKAWAY - 1.0) * load_nm + SPARE_NM + ripple_nm
        return min(load_nm, most_nm) + min(max(self._touch_nm, least_nm), FIRM_NM[0])

    def _command(self, now_s: float, position_rad: float) -> tuple[MitCommand, bool]:
        """Return the command, and True if the jaws hold it back.

        The ramp has arrived once the jaws have, too. Jaws that stick short of the end would stay
        there for a ramp that stands, with nothing between them.
        """
        speed_rad_s = self._speed_at(position_rad)
        budget_nm = self._budget_nm(position_rad, self._firm_nm)
        velocity_rad_s = self._sign * speed_rad_s
        wanted_rad = self._was_rad + velocity_rad_s * (now_s - self._was_s)
        is_near = self._short_rad(position_rad) <= self._config.reach_tol
        arrived = is_near and self._short_rad(wanted_rad) <= 0.0
        if arrived:
            # Soft gains would leave the jaws stuck short of the end. More damping would brake fast
            # jaws to a stop in front of it, where they stick.
            kp = min(max(MOVING_KP_NM_RAD, budget_nm / self._config.reach_tol), KP_MAX_NM_RAD)
            gains, lead_rad = Gains(kp, CALM_KD_NM_S_RAD), budget_nm / kp
            wanted_rad, velocity_rad_s = self.target_rad, 0.0
            if self._arrived_s is None:
                self._arrived_s = now_s
        else:
            gains, lead_rad = budgeted(budget_nm, speed_rad_s, DEFAULT_GAINS, self._period_s)
            if self._kp is not None:  # softer gains need a longer lead for the same torque
                ahead_rad = (wanted_rad - position_rad) * self._kp / gains.kp_nm_rad
                wanted_rad = position_rad + ahead_rad
            self._kp = gains.kp_nm_rad
        command_rad = clamp_lead(wanted_rad, position_rad, lead_rad)
        is_clamped = (wanted_rad - command_rad) * self._sign > 0.0
        self._was_s, self._was_rad = now_s, command_rad if is_clamped else wanted_rad
        lead_nm = gains.kp_nm_rad * (command_rad - position_rad)
        self._asked_nm = self._sign * (lead_nm + gains.kd_nm_s_rad * velocity_rad_s)
        held_back = self._asked_nm >= 0.999 * self._budget_nm(position_rad, FIRM_NM[0])
        return gains.at(command_rad, velocity_rad_s), held_back

    def _judge(self, now_s: float, feedback: Feedback, held_back: bool) -> Verdict | None:
        """Return what the jaws have met, once it is certain.

        Within `reach_tol` of the end of their way the closing side may stick, so nothing that
        resists there counts as an object.
        """
        position_rad = feedback.position_rad
        if self._arrived_s is not None and self._short_rad(position_rad) <= self._config.reach_tol:
            self._slow.reset()
            self._contact.reset()
            return "empty" if now_s - self._arrived_s >= self._config.settle_s else None
        touches = self._touches(now_s, feedback, held_back)
        # Jaws that just turn round after a thump, or wait for the ramp after a shove, do not stall.
        stalls = self._stall.add(now_s, position_rad) and self._slow.has_lasted(now_s)
        if (touches or stalls) and self._is_something(feedback, stalls=stalls):
            return "contact" if touches else "stalled"
        began_s = now_s if self._began_s is None else self._began_s
        late_s = gives_up_after_s(self.ramp_s)
        return "timed_out" if now_s - began_s > late_s else None

    def _touches(self, now_s: float, feedback: Feedback, held_back: bool) -> bool:
        """Return True once the jaws have stood against something that takes the torque.

        It takes more than the way has taken. Jaws that are thrown back do not stand. A noisy speed
        does not hide that they stand: either the reported speed or the way of the last `STANDS_S`
        may show it.
        """
        position_rad, torque_nm = feedback.position_rad, self._sign * feedback.torque_nm
        self.is_fed = torque_nm >= CONTACT_TORQUE_SHARE * self._asked_nm
        mean_rad_s = self._window.add(now_s, position_rad)
        speed_rad_s = self._speed_at(position_rad)
        moved_rad = self._moved_rad(position_rad)
        if mean_rad_s is not None:
            share = self._sign * mean_rad_s / speed_rad_s
            self._ran = self._ran or (share >= CONTACT_SPEED_SHARE and moved_rad > RAN_RAD)
            if moved_rad > self._slack_rad:
                self.friction.add(now_s, share, torque_nm)
                load_nm = self.friction.load_nm
                self._load_nm = None if load_nm is None else max(load_nm, 0.0)
        slow_rad_s = min(CONTACT_SPEED_SHARE * speed_rad_s, CONTACT_RAD_S)
        if not self._ran:
            slow_rad_s = min(slow_rad_s, STANDS_RAD_S)
        slow_rad_s = max(slow_rad_s, SLOWEST_RAD_S)
        slow = abs(feedback.velocity_rad_s) < slow_rad_s
        slow = slow or (mean_rad_s is not None and abs(mean_rad_s) < slow_rad_s)
        self._slow.step(slow and held_back, now_s)
        creep_rad_s = STANDS_RAD_S
        if not self._ran:  # with a load, jaws may creep from the start
            creep_rad_s = max(STANDS_RAD_S, CREEPING * speed_rad_s)
        if held_back and mean_rad_s is not None and abs(mean_rad_s) < creep_rad_s:
            most_nm = min(max(self._touch_nm, FIRM_NM[0]), FIRM_NM[1])
            self._firm_nm = min(self._firm_nm + FIRMER_NM_S * self._period_s, most_nm)
        friction_nm = self._load_nm or 0.0
        beyond_nm = self._budget_nm(position_rad, FIRM_NM[0]) - friction_nm
        presses = torque_nm >= friction_nm + CONTACT_TORQUE_SHARE * beyond_nm
        return self._contact.step(slow and held_back and presses, now_s)

    def _is_something(self, feedback: Feedback, *, stalls: bool) -> bool:
        """Return True if what has stopped the jaws is no load that they have had from the start.

        Jaws that have run, or whose friction is known, have met it on their way. Others must stand
        for the whole window of a stall. They do not go back to come again: that would let go of
        what may be between them.
        """
        if self._ran or self._load_nm is not None:
            return True
        if not stalls:
            return False
        is_steady = self._moved_rad(feedback.position_rad) > -SAGS_RAD
        return is_steady or self._would_go(feedback)

    def _would_go(self, feedback: Feedback) -> bool:
        """Return True if the torque would move the jaws along a way as they have come just before.

        An elastic object, which another motion has pressed harder, pushes them back as a weight
        does. But no load that the way had holds them here. Near the closed stop, they may stick.
        """
        if self._way_nm is None or self._sticks(feedback.position_rad):
            return False
        torque_nm = min(self._sign * feedback.torque_nm, self._asked_nm)
        return torque_nm >= BREAKAWAY * self._way_nm + SPARE_NM


FELT_S = 0.1
"""How long an object must bear twice the force that drives free jaws."""

Until: TypeAlias = Literal["held", "verdict"]


@dataclass(frozen=True, slots=True)
class GraspRequest:
    """The options of a grasp.

    `hold_s` 0 holds without an end. With `width_mm`, an object that differs by more than
    `tolerance_mm` is held as well, but is no success.
    """

    force_n: float
    speed_mm_s: float
    hold_s: float = 0.0
    until: Until = "held"
    hold_by: HoldBy = "torque"
    width_mm: float | None = None
    tolerance_mm: float = 0.0


class Grasp(PlainAction):
    """One grasp; an object that is `held` already is not released to feel for it."""

    def __init__(
        self,
        request: GraspRequest,
        *,
        geometry: Geometry,
        config: MotionConfig,
        period_s: float,
        motor_type: MotorType,
        held: Grip | None = None,
        way_nm: float | None = None,
    ) -> None:
        self._request = request
        self._geometry = geometry
        self._config = config
        self._period_s = period_s
        self._motor_type = motor_type
        self._approach = Approach(
            geometry,
            config,
            request.speed_mm_s,
            geometry.torque_nm(request.force_n),
            period_s,
            motor_type=motor_type,
            way_nm=way_nm,
        )
        self._grip: Grip | None = None
        self._verdict: Verdict | None = None
        self._width_mm: float | None = None
        self._held_since_s = 0.0
        self._now_s = 0.0
        self._steps = 0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None
        self._is_short = False
        self._feels_n: float | None = None
        self._felt = Lasting(FELT_S)
        speed_mm_s = self._approach.speed_rad_s * geometry.rad_to_mm
        self._speed_mm_s = None if held is not None else speed_mm_s
        if held is not None:
            self._verdict = "contact"
            self._grip = held.again(self._settings(None), request.force_n)

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Close, then hold; the verdict is this tick's."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._now_s, self._feedback, self._is_short = now_s, feedback, motor.is_short is True
        self._steps += 1
        if self._grip is None:
            command, self._verdict = self._approach.step(now_s, feedback)
            self._command_rad = command.position_rad
            if self._verdict in ("empty", "timed_out"):
                return Step(command, outcome=self._result(self._missed()))
            if self._verdict is None or motor.is_short is None:  # soon it is certain
                return Step(command)
            # Jaws that creep by little torque are not judged where they stand.
            self._is_short = self._is_short or not self._approach.is_fed
            self._grip = self._take(now_s, feedback)
            self._grip.is_doubtful = self._is_short
            if self._request.until == "verdict" or self._is_short:
                command = self._grip.command(now_s, feedback)
                return Step(command, outcome=self._result(self._held()))
        elif self._width_mm is None and self._is_felt(now_s, feedback, self._grip):
            self._note_contact(now_s, feedback)
            if self._request.until == "verdict" or self._is_short:
                command = self._grip.command(now_s, feedback)
                return Step(
                    command, outcome=self._outcome(self._grip) or self._result(self._held())
                )
        command = self._grip.command(now_s, feedback)
        self._command_rad = command.position_rad
        return Step(command, outcome=self._outcome(self._grip))

    def idle_after(self) -> Idle | None:
        """Keep holding the object; after its loss, hold the running jaws calmly."""
        if self._grip is None:
            return None
        if self._grip.is_holding or self._feedback is None:
            return self._grip
        caught_rad = self._grip.caught_rad(self._feedback.position_rad, self._period_s)
        return Hold(caught_rad, CATCHING_GAINS)

    def progress(self) -> Progress | None:
        """Return the phase, the step of the approach, and where command and jaws are."""
        if self._feedback is None:
            return None
        if self._grip is not None:
            return progress_of("hold", self._cycles(), 0, self._command_rad, self._feedback)
        total = max(round(self._approach.ramp_s / self._period_s), 1)
        step = min(self._steps, total)
        return progress_of("approach", step, total, self._command_rad, self._feedback)

    def _is_felt(self, now_s: float, feedback: Feedback, grip: Grip) -> bool:
        """Return True once it is certain that the held object is still there.

        If its loss would not be noticed with the present force, it may be gone. Then the jaws press
        for a moment as hard as at the beginning of a grasp, or as hard as it takes.
        """
        if self._feels_n is None:
            opening_mm = self._geometry.opening_mm(feedback.position_rad)
            needed_n = grip.loss_detected_from_n(opening_mm) or 0.0
            if min(grip.applied_n, self._request.force_n) >= needed_n:
                return True
            self._feels_n = min(needed_n, BUDGET_NM * self._geometry.nm_to_n)
            grip.squeeze(max(self._feels_n, self._request.force_n))
        presses = grip.applied_n >= 0.999 * self._feels_n
        if not self._felt.step(presses, now_s):
            return False
        grip.squeeze(self._request.force_n)
        return True

    def _take(self, now_s: float, feedback: Feedback) -> Grip:
        """Change from closing to holding, without a step in the torque."""
        self._note_contact(now_s, feedback)
        settings = self._settings(self._approach.friction.friction_nm)
        in_flight_nm = self._geometry.close_sign * feedback.torque_nm
        force_n = self._request.force_n
        grip = Grip(settings, force_n, in_flight_nm, self._motor_type, watched=True)
        grip.meets()
        return grip

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
        """Return the outcome by what the motor makes, and by the width that the caller expects."""
        if self._is_short:
            return "motor_weak"
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
            speed_mm_s=self._speed_mm_s,
        )
