"""A stream of set-points, for policies and teleoperation at 10 to 200 Hz: the latest one wins.

One of position moves the command towards it at no more than its speed, and presses on whatever the
jaws meet with no more than its torque. It is reached when the next one is due: jaws that hurried to
each of 50 a second would stop as often, at 0 to 150 mm/s behind a hand of 66. Its stiffness follows
from the command's present speed, so that fast streams do not end softly, within what is calm.

One of torque is a `Push`. A torque alone bounds no speed: 4 N·m bring free jaws to 3 rad/s within
1.5 ms. So it rises slowly enough for the jaws' speed to be seen, and has as much damping as lets
free jaws reach `PUSHED_RAD_S`, whatever their friction. A torque that needs more damping than is
calm on every motor is lowered as soon as the jaws run. Towards a stop it becomes that of a press,
and beyond the bounds of the travel nothing pushes further out.

A torque also ends slowly: an elastic object would throw open jaws that are let go at once. So slack
jaws, a push of 0, are damped until what they have pressed has pushed them back. When a push has
lapsed, its torque ends while the jaws are held where they were.
"""

import math
from dataclasses import dataclass, replace

from litegripd.control.detectors import Lasting
from litegripd.control.holds import FAINT_NM, RUNNING_RAD_S, Hold, Idle, Slack
from litegripd.control.limiter import (
    CALM_KD_NM_S_RAD,
    Gains,
    bounds_of,
    budgeted,
    clamp_lead,
    is_in_press_zone,
)
from litegripd.control.motions.base import PlainAction, Step
from litegripd.control.motions.move import SPEED_UP_RAD_S2
from litegripd.model.gripper import DM4310, Geometry, MotorType
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import KD_MAX_NM_S_RAD, Feedback, MitCommand, MotorView
from litegripd.model.state import StreamResult


@dataclass(frozen=True, slots=True)
class SetPoint:
    """Where to move the jaws, until when (CLOCK_MONOTONIC) this is valid, and how."""

    position_rad: float
    valid_until_s: float
    speed_rad_s: float
    torque_nm: float
    gains: Gains
    """The stiffest that the command may be."""


@dataclass(frozen=True, slots=True)
class Push:
    """With what torque to push the jaws, until when this is valid, and in what travel.

    The torque is the motor's: a positive one turns towards increasing radians. With 0 the jaws are
    slack, and need no travel.
    """

    torque_nm: float
    valid_until_s: float
    geometry: Geometry | None
    config: MotionConfig
    gains: Gains
    """Those of the hold that it leaves."""

    def most_nm(self, position_rad: float, motor_type: MotorType) -> float:
        """Return the largest torque of this push where the jaws are.

        It becomes less over `FADES_MM`: jaws on something elastic would be thrown back at an edge,
        and come again.
        """
        geometry, sign = self.geometry, math.copysign(1.0, self.torque_nm)
        if geometry is None:
            return 0.0
        towards_closed = sign == geometry.close_sign
        limit_rad = geometry.closed_rad if towards_closed else geometry.open_rad
        short_rad = sign * (limit_rad - position_rad)
        if is_in_press_zone(short_rad, geometry, self.config):
            return self.config.stop_nm
        into_mm = short_rad * geometry.rad_to_mm - self.config.press_zone_mm
        share = min(into_mm / FADES_MM, 1.0)
        return self.config.stop_nm + share * (motor_type.holding_nm - self.config.stop_nm)


PUSHED_RAD_S = 1.7
"""How fast a torque alone may drive free jaws: 90 mm/s at 52.69 mm/rad, as the search of a usual
grasp."""
RUNS_RAD_S = 1.0
"""Jaws that push on something are slower; a noisy measurement is wrong by up to 0.3 rad/s."""
RAMP_NM_S = 16.0
"""Free jaws pass `RUNS_RAD_S` with 1 N·m, 60 ms after their torque has begun to rise. Something of
10 N·m/rad that is let go opens the jaws by 1.6 rad/s."""
LEAST_KD_NM_S_RAD = 0.1
LONGEST_INTERVAL_S = 0.12
"""Set-points at longer intervals, below 8 Hz, are steps: each is reached as fast as may be."""
HELD_BACK_S = 0.05
"""For so long each step is held back a little, until the jaws have its speed."""
CALM_RAD_S = 0.95
"""Slower commands are no stiffer than one of this speed, unless the caller's is slower. With what
jaws at rest might have, 2 N·m·s/rad, some motors swung at 20 rad/s (random plants)."""
LETS_GO_S = 0.25
"""How long jaws are damped at most that are to be slack: a hand that moves them feels that."""
FADES_MM = 6.0


class Pushing:
    """Makes the commands of set-points of torque, one after the other; begins with `in_flight_nm`.

    `torque_nm` is the present torque.
    """

    def __init__(self, motor_type: MotorType, in_flight_nm: float) -> None:
        self._motor_type = motor_type
        # A rotor that is heavier by a factor bears as much more damping.
        calm_kd = CALM_KD_NM_S_RAD * motor_type.inertia_kg_m2 / DM4310.inertia_kg_m2
        self._most_kd = min(calm_kd, KD_MAX_NM_S_RAD)
        self._is_slack = abs(in_flight_nm) <= FAINT_NM
        self.torque_nm = 0.0 if self._is_slack else _within(in_flight_nm, motor_type.holding_nm)
        self._stepped_s: float | None = None
        self._seen_s = 0.0
        self._unloaded_s: float | None = None

    def step(self, now_s: float, feedback: Feedback, push: Push) -> MitCommand:
        """Return the command of this tick."""
        if push.torque_nm == 0.0:
            return self._let_go(now_s, feedback)
        self._is_slack, self._unloaded_s = False, None
        position_rad = feedback.position_rad
        most_nm = push.most_nm(position_rad, self._motor_type)
        self._ramp(now_s, feedback, _within(push.torque_nm, most_nm))
        bounds = bounds_of(push.geometry, push.config)
        furthest_rad = bounds.high_rad if self.torque_nm > 0.0 else bounds.low_rad
        if (position_rad - furthest_rad) * self.torque_nm >= 0.0:
            self.torque_nm = 0.0
            return MitCommand(position_rad, 0.0, 0.0, self._most_kd, 0.0)
        kd = max(abs(self.torque_nm) / PUSHED_RAD_S, LEAST_KD_NM_S_RAD)
        return MitCommand(position_rad, 0.0, 0.0, min(kd, self._most_kd), self.torque_nm)

    def drives(self, feedback: Feedback) -> bool:
        """Return True if the torque drives jaws that run, and so press on nothing."""
        return math.copysign(1.0, self.torque_nm) * feedback.velocity_rad_s > RUNS_RAD_S

    def fade(self, now_s: float, feedback: Feedback) -> float:
        """Return what is left of the torque, which ends: something else leads the jaws now."""
        self._ramp(now_s, feedback, 0.0)
        return self.torque_nm

    def _let_go(self, now_s: float, feedback: Feedback) -> MitCommand:
        """Return a command that lets the jaws go, and for a moment damps what pushes them back."""
        self._ramp(now_s, feedback, 0.0)
        if self.torque_nm == 0.0 and not self._is_slack:
            if self._unloaded_s is None:
                self._unloaded_s = now_s
            is_slow = abs(feedback.velocity_rad_s) <= RUNNING_RAD_S
            self._is_slack = is_slow or now_s - self._unloaded_s >= LETS_GO_S
        if self._is_slack:
            return Slack().command(now_s, feedback)
        return MitCommand(feedback.position_rad, 0.0, 0.0, self._most_kd, self.torque_nm)

    def _ramp(self, now_s: float, feedback: Feedback, wanted_nm: float) -> None:
        """Move the torque towards the wanted one; no old measurement lets it rise.

        Jaws that run are driven by no more than what their damping bounds.
        """
        elapsed_s = 0.0 if self._stepped_s is None else max(now_s - self._stepped_s, 0.0)
        is_new, self._seen_s = feedback.at_s != self._seen_s, feedback.at_s
        self._stepped_s, before_nm = now_s, self.torque_nm
        torque_nm = before_nm + _within(wanted_nm - before_nm, RAMP_NM_S * elapsed_s)
        if abs(torque_nm) > abs(before_nm) and not is_new:
            torque_nm = before_nm
        self.torque_nm = torque_nm
        if self.drives(feedback):
            self.torque_nm = _within(torque_nm, self._most_kd * PUSHED_RAD_S)


def _within(value: float, most: float) -> float:
    return min(max(value, -most), most)


class Stream(PlainAction):
    """Follows set-points until the latest one has expired.

    Then it holds: with the last pressure after one of position, without any after a push.
    """

    def __init__(self, motor_type: MotorType, period_s: float) -> None:
        self._motor_type = motor_type
        self._period_s = period_s
        self._point: SetPoint | Push | None = None
        self._set_points = 0
        self._reference: tuple[float, float] | None = None
        self._velocity_rad_s = 0.0
        self._is_new = False
        self._came_s = -math.inf
        self._pace_rad_s = math.inf
        self._held_back = Lasting(HELD_BACK_S)
        self._hold: Hold | None = None
        self._pushing: Pushing | None = None
        self._feedback: Feedback | None = None

    def set(self, point: SetPoint | Push) -> None:
        """Follow another set-point from the next tick on."""
        self._point, self.by_force = point, isinstance(point, Push)
        self._set_points += 1
        self._is_new = True

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Return the next command towards the set-point."""
        feedback, point = motor.feedback, self._point
        if feedback is None or point is None:
            return Step()
        self._feedback, self.is_held_back = feedback, False
        if now_s >= point.valid_until_s:
            return self._lapsed(now_s, feedback, point)
        if isinstance(point, SetPoint):
            command = self._towards(now_s, feedback, point)
            if self._pushing is not None:  # what is left of a push before it
                torque_nm = self._pushing.fade(now_s, feedback)
                command = replace(command, torque_nm=torque_nm)
                if torque_nm == 0.0:
                    self._pushing = None
            return Step(command)
        self._reference, self._velocity_rad_s, self._hold = None, 0.0, None
        self._held_back.reset()
        if self._pushing is None:
            self._pushing = Pushing(self._motor_type, feedback.torque_nm)
        return Step(self._pushing.step(now_s, feedback, point))

    def _towards(self, now_s: float, feedback: Feedback, point: SetPoint) -> MitCommand:
        was_s, was_rad = self._reference or (now_s, feedback.position_rad)
        if self._is_new:
            self._is_new = False
            self._pace_rad_s = self._pace(now_s, abs(point.position_rad - was_rad))
        most_rad_s = point.speed_rad_s
        if self._pushing is not None:  # what it has pressed pushes the jaws back as well
            most_rad_s = min(most_rad_s, CALM_RAD_S)
        elapsed_s = max(now_s - was_s, 0.0)
        faster_rad_s = abs(self._velocity_rad_s) + SPEED_UP_RAD_S2 * elapsed_s
        step_rad = min(most_rad_s, self._pace_rad_s, faster_rad_s) * elapsed_s
        wanted_rad = was_rad + _within(point.position_rad - was_rad, step_rad)
        velocity_rad_s = (wanted_rad - was_rad) / elapsed_s if elapsed_s > 0.0 else 0.0
        self._velocity_rad_s = velocity_rad_s
        speed_rad_s = max(abs(velocity_rad_s), min(point.speed_rad_s, CALM_RAD_S))
        gains, lead_rad = budgeted(point.torque_nm, speed_rad_s, point.gains, self._period_s)
        reference_rad = clamp_lead(wanted_rad, feedback.position_rad, lead_rad)
        is_short = self._pace_rad_s > most_rad_s and wanted_rad != point.position_rad
        is_short = is_short and reference_rad == wanted_rad  # else something is in the way
        self.is_held_back = self._held_back.step(is_short, now_s)
        self._reference = (now_s, reference_rad)
        self._hold = Hold(reference_rad, gains, point.torque_nm)
        return gains.at(reference_rad, velocity_rad_s)

    def _pace(self, now_s: float, way_rad: float) -> float:
        """Return the speed with which a new set-point is reached when the next one is due."""
        before_s, self._came_s = self._came_s, now_s
        interval_s = now_s - before_s
        return way_rad / interval_s if 0.0 < interval_s <= LONGEST_INTERVAL_S else math.inf

    def _lapsed(self, now_s: float, feedback: Feedback, point: SetPoint | Push) -> Step:
        """Return the outcome, once the torque of a push on something has ended."""
        pushing = self._pushing
        if isinstance(point, SetPoint) or pushing is None:
            pass
        elif pushing.drives(feedback):
            self._hold = None  # they are caught
        elif pushing.torque_nm != 0.0:
            self._hold = self._hold or Hold(feedback.position_rad, point.gains)
            torque_nm = pushing.fade(now_s, feedback)
            command = point.gains.catching().at(self._hold.position_rad)
            return Step(replace(command, torque_nm=torque_nm))
        return Step(outcome=StreamResult(self._set_points))

    def idle_after(self) -> Idle | None:
        """Return the hold that presses as in the latest tick; None for jaws that are not held.

        That of a push presses as it did, until it is eased: without its torque at once, what it has
        pressed would throw the jaws back.
        """
        point, pushing, feedback = self._point, self._pushing, self._feedback
        if self._hold is not None or not isinstance(point, Push) or feedback is None:
            return self._hold
        if pushing is None or pushing.torque_nm == 0.0 or pushing.drives(feedback):
            return None
        lead_rad = pushing.torque_nm / point.gains.usual().kp_nm_rad
        return Hold(feedback.position_rad + lead_rad, point.gains)
