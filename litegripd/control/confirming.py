"""Confirming a stop: strokes with a run-up, until two in a row end at the same place.

That place is then pressed on: jaws that only stick come loose, and it was no stop.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.control.pressing import Pressing
from litegripd.control.stroke import Stroke
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

Confirmed: TypeAlias = Literal["confirmed", "stuck", "not_found", "apart"]
"""`stuck`: the jaws did not get going; `not_found`: they did not stop; `apart`: nowhere twice."""

MOST_STROKES = 4
RUN_UP_MM = 25.0
"""Past the zone in which slow jaws stick, some 15 mm, and far enough to be at speed before it."""
RUN_UP_WITHIN_S = 1.5
SPEED_RANGE_MM_S = (25.0, 100.0)
"""Slower jaws may stick where a `close` from afar passes; faster ones would only hit harder."""


@dataclass(frozen=True, slots=True)
class StrokePlan:
    """What all strokes of a calibration have in common."""

    config: MotionConfig
    rad_to_mm: float

    @property
    def speed_rad_s(self) -> float:
        """The configured speed, within what a stroke can use."""
        low, high = SPEED_RANGE_MM_S
        return min(max(self.config.speed_mm_s, low), high) / self.rad_to_mm

    def stroke(self, sign: int) -> Stroke:
        """Return a stroke towards one side."""
        return Stroke(sign, self.config, self.speed_rad_s)


class Confirming:
    """Strokes towards one side (`sign` of the motor's radians), the first from where the jaws are.

    `stop_rad` is where the latest find is, at first the probe's.
    """

    def __init__(self, sign: int, found_rad: float, plan: StrokePlan) -> None:
        self.stop_rad = found_rad
        self.friction_nm = 0.0
        self._sign = sign
        self._plan = plan
        self._stroke = plan.stroke(sign)
        self._strokes = 1
        self._backing_since_s: float | None = None
        self._pressing: Pressing | None = None

    @property
    def iterations(self) -> int:
        """The number of the present stroke."""
        return self._strokes

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, Confirmed | None]:
        """Go on with the stroke, with the way back that the next one needs, or with the press."""
        if self._pressing is not None:
            return self._press(self._pressing, now_s, feedback)
        command, verdict = self._stroke.step(now_s, feedback)
        if self._backing_since_s is not None:
            if self._has_backed_off(now_s, feedback, self._backing_since_s) or verdict is not None:
                self._backing_since_s = None
                self._stroke = self._plan.stroke(self._sign)
            return command, None
        if verdict is None:
            return command, None
        if verdict != "at_stop":
            return command, verdict
        self.friction_nm = max(self.friction_nm, self._stroke.friction_nm or 0.0)
        config, here_rad = self._plan.config, feedback.position_rad
        if abs(here_rad - self.stop_rad) <= config.stop_tol:
            self._pressing = Pressing(self._sign, here_rad, self.friction_nm, config)
            return command, None
        return command, self._again(now_s, feedback)

    def _press(
        self, pressing: Pressing, now_s: float, feedback: Feedback
    ) -> tuple[MitCommand, Confirmed | None]:
        command, verdict = pressing.step(now_s, feedback)
        if verdict is None:
            return command, None
        self._pressing = None
        if verdict == "held":
            return command, "confirmed"
        return command, verdict if verdict == "not_found" else self._again(now_s, feedback)

    def _again(self, now_s: float, feedback: Feedback) -> Confirmed | None:
        """Take the stop to be here, and begin the way back for another stroke, if there is one."""
        self.stop_rad = feedback.position_rad
        if self._strokes >= MOST_STROKES:
            return "apart"
        self._strokes += 1
        self._backing_since_s = now_s
        self._stroke = self._plan.stroke(-self._sign)
        return None

    def _has_backed_off(self, now_s: float, feedback: Feedback, since_s: float) -> bool:
        """Whether there is enough of a run-up, or no time for more of it."""
        backed_rad = (self.stop_rad - feedback.position_rad) * self._sign
        is_far = backed_rad >= RUN_UP_MM / self._plan.rad_to_mm
        return is_far or now_s - since_s >= RUN_UP_WITHIN_S
