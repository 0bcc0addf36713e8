"""Following a stream of set-points, for policies and tele-operation at 10 to 200 Hz.

The latest set-point wins. The command moves towards it at no more than its speed, and presses on
whatever the jaws meet with no more than its torque.
"""

from dataclasses import dataclass

from litegripd.control.gains import Gains, budgeted, clamp_lead
from litegripd.control.holds import Hold, Idle
from litegripd.control.motions.base import PlainAction, Step
from litegripd.model.motor import MotorView
from litegripd.model.results import StreamResult


@dataclass(frozen=True, slots=True)
class SetPoint:
    """Where to move the jaws, until when (CLOCK_MONOTONIC) this is valid, and how."""

    position_rad: float
    valid_until_s: float
    speed_rad_s: float
    torque_nm: float
    gains: Gains
    """The stiffest that the command may be."""


class Stream(PlainAction):
    """Follows set-points until the latest one has expired; then holds with the last pressure."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._point: SetPoint | None = None
        self._set_points = 0
        self._reference: tuple[float, float] | None = None
        self._hold: Hold | None = None

    def set(self, point: SetPoint) -> None:
        """Follow another set-point from the next tick on."""
        self._point = point
        self._set_points += 1

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Return the next command towards the set-point."""
        feedback, point = motor.feedback, self._point
        if feedback is None or point is None:
            return Step()
        if now_s >= point.valid_until_s:
            return Step(outcome=StreamResult(self._set_points))
        gains, lead_rad = budgeted(point.torque_nm, point.speed_rad_s, point.gains, self._period_s)
        was_s, was_rad = self._reference or (now_s, feedback.position_rad)
        elapsed_s = max(now_s - was_s, 0.0)
        step_rad = point.speed_rad_s * elapsed_s
        wanted_rad = was_rad + min(max(point.position_rad - was_rad, -step_rad), step_rad)
        reference_rad = clamp_lead(wanted_rad, feedback.position_rad, lead_rad)
        velocity_rad_s = (wanted_rad - was_rad) / elapsed_s if elapsed_s > 0.0 else 0.0
        self._reference = (now_s, reference_rad)
        self._hold = Hold(reference_rad, gains)
        return Step(gains.at(reference_rad, velocity_rad_s))

    def idle_after(self) -> Idle | None:
        """Return the hold that presses as in the latest tick."""
        return self._hold
