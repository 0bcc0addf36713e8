"""Closing with a torque budget until something resists: the first half of a grasp.

Its command never pushes jaws that are stopped with more than `BUDGET_NM`, whatever has stopped them
and however old the feedback is: the position part is bounded by the lead, the damping part by the
speed commanded. (Jaws that are thrown back, or shot forward, are braked harder.) A ramp of full
stiffness reaches 3.2 N·m 50 ms after it has met an object of 250 N·m/rad.
"""

from typing import Literal, TypeAlias

from litegripd.control.budget import budgeted
from litegripd.control.friction import FrictionGauge
from litegripd.control.gains import Gains
from litegripd.control.lasting import Lasting
from litegripd.control.lead import led
from litegripd.control.speed_window import SpeedWindow
from litegripd.control.stall import StallDetector
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

Verdict: TypeAlias = Literal["contact", "stalled", "empty", "timed_out"]

BUDGET_NM = 1.05
"""A little more than the 0.95 N·m by which the closing side may stick, and within 1.3 times the
0.94 N·m with which open and close press."""
CONTACT_S = 0.08
"""So long all signs of a contact must last: a thump on the way, or a jaw that sticks, is over by
then. The lead takes about 15 ms to build up before."""
CONTACT_SPEED_SHARE = 0.5
"""Slower than this share of their speed the jaws are held up. With less, something soft and damped
that they meet slowly would take its time: they slow down as they compress it."""
CONTACT_TORQUE_SHARE = 0.5
STANDS_S = 0.02
"""Over so long the positions show whether the jaws stand, whatever speed is reported."""
KP_MAX_NM_RAD = 500.0  # what a command frame can carry
SLOWEST_RAD_S = 0.02  # feedback counts velocity in steps of 0.015 rad/s

_GIVE_UP_FACTOR = 2.0
_GIVE_UP_EXTRA_S = 2.0


class Approach:
    """Closes from where the jaws are to `margin` inside the closed stop.

    The command is a ramp in time. Where the lead is used up the ramp begins anew from there, so
    that jaws which come free go on at their speed instead of catching up.
    """

    def __init__(
        self,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        speed_mm_s: float,
        period_s: float,
    ) -> None:
        self._sign = geometry.close_sign
        self.target_rad = geometry.closed_rad - self._sign * config.margin * geometry.travel_rad
        self.speed_rad_s = geometry.to_rad(speed_mm_s)
        self._config = config
        self._moving, self._lead_rad = budgeted(BUDGET_NM, self.speed_rad_s, gains, period_s)
        # Soft gains would leave the jaws stuck short of the end, in front of nothing.
        kp = min(max(gains.kp_nm_rad, BUDGET_NM / config.reach_tol), KP_MAX_NM_RAD)
        self._arrived = Gains(kp, gains.kd_nm_s_rad)
        self._arrived_lead_rad = BUDGET_NM / kp
        self._stall = StallDetector(config, self.speed_rad_s)
        self._began_s: float | None = None
        self._anchor = (0.0, 0.0)
        self._ramp_s = 0.0
        self._arrived_s: float | None = None
        self._slow = Lasting(CONTACT_S)
        self._contact = Lasting(CONTACT_S)
        self._window = SpeedWindow(STANDS_S)
        self.friction = FrictionGauge()

    @property
    def ramp_s(self) -> float:
        """How long the way to the target takes, once begun."""
        return self._ramp_s

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, Verdict | None]:
        """Lead the jaws on, and judge what they have met."""
        position_rad = feedback.position_rad
        if self._began_s is None:
            self._began_s = now_s
            self._anchor = (now_s, position_rad)
            self._ramp_s = max(self._short_rad(position_rad), 0.0) / self.speed_rad_s
        command, held_back = self._command(now_s, position_rad)
        return command, self._judge(now_s, feedback, held_back)

    def _short_rad(self, position_rad: float) -> float:
        return (self.target_rad - position_rad) * self._sign

    def _command(self, now_s: float, position_rad: float) -> tuple[MitCommand, bool]:
        """Return the command, and whether the jaws hold it back."""
        anchor_s, anchor_rad = self._anchor
        velocity_rad_s = self._sign * self.speed_rad_s
        wanted_rad = anchor_rad + velocity_rad_s * (now_s - anchor_s)
        arrived = self._short_rad(wanted_rad) <= 0.0
        lead_rad = self._arrived_lead_rad if arrived else self._lead_rad
        if arrived:
            wanted_rad = self.target_rad
        command_rad = led(wanted_rad, position_rad, lead_rad)
        held_back = (wanted_rad - command_rad) * self._sign > 0.0
        if arrived:
            if self._arrived_s is None:
                self._arrived_s = now_s
            return self._arrived.at(command_rad), held_back
        if held_back:
            self._anchor = (now_s, command_rad)
        return self._moving.at(command_rad, velocity_rad_s), held_back

    def _judge(self, now_s: float, feedback: Feedback, held_back: bool) -> Verdict | None:
        """Say what the jaws have met, once it is sure.

        Within `reach_tol` of the end of their way, where the closing side may stick, nothing that
        resists counts as an object.
        """
        position_rad = feedback.position_rad
        if self._arrived_s is not None and self._short_rad(position_rad) <= self._config.reach_tol:
            self._slow.reset()
            self._contact.reset()
            return "empty" if now_s - self._arrived_s >= self._config.settle_s else None
        if self._touches(now_s, feedback, held_back):
            return "contact"
        stalled = self._stall.add(now_s, position_rad)
        if stalled and self._slow.has_lasted(now_s):
            return "stalled"  # and not just turning round where a thump has thrown them
        began_s = now_s if self._began_s is None else self._began_s
        late_s = _GIVE_UP_FACTOR * self._ramp_s + _GIVE_UP_EXTRA_S
        return "timed_out" if now_s - began_s > late_s else None

    def _touches(self, now_s: float, feedback: Feedback, held_back: bool) -> bool:
        """Return True once the jaws have stood against something that takes the torque.

        Thrown back, they do not stand. A noisy speed does not hide that they do: either the
        reported speed or the way of the last `STANDS_S` may show it.
        """
        mean_rad_s = self._window.add(now_s, feedback.position_rad)
        slow_rad_s = max(CONTACT_SPEED_SHARE * self.speed_rad_s, SLOWEST_RAD_S)
        slow = abs(feedback.velocity_rad_s) < slow_rad_s
        slow = slow or (mean_rad_s is not None and abs(mean_rad_s) < slow_rad_s)
        torque_nm = self._sign * feedback.torque_nm
        if mean_rad_s is not None:
            share = self._sign * mean_rad_s / self.speed_rad_s
            self.friction.add(now_s, share, torque_nm)
        self._slow.step(slow, now_s)
        pressing = torque_nm >= CONTACT_TORQUE_SHARE * BUDGET_NM
        return self._contact.step(slow and held_back and pressing, now_s)
