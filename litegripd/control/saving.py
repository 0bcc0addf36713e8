"""The end of a calibration: judged, written to disk by the helper process, then in use."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from litegripd.control.actions.base import Adopted, Step
from litegripd.control.gains import Gains
from litegripd.model.calibration import NOMINAL, Calibration, CalibrationError, measured
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.motor import MotorView
from litegripd.model.results import ZeroOutcome, ZeroResult
from litegripd.model.unit import Unit

PLAUSIBLE_TRAVEL = (0.8, 1.25)
"""Of the travel known before: something between the jaws, or a stop that was not one, else."""

SAVE_WITHIN_S = 10.0


class Saving:
    """Makes the calibration of two measured stops the gripper's own, saved unless `keep` is false.

    `step` gives the errand once, and the outcome when it is done.
    """

    def __init__(
        self,
        before: Calibration | None,
        unit: Unit,
        gains: Gains,
        *,
        keep: bool,
    ) -> None:
        self._before = before
        self._unit = unit
        self._gains = gains
        self._keep = keep
        self._calibration: Calibration | None = None
        self._saved: ErrandResult | None = None
        self._began_s: float | None = None
        self._content: dict[str, Any] = {}

    @property
    def rad_to_mm(self) -> float:
        """The scale known before, or the nominal one: for speeds and run-ups, not to be saved."""
        known = NOMINAL[0] if self._before is None else self._before.geometry
        return known.rad_to_mm

    @property
    def kp_nm_rad(self) -> float:
        """The stiffness that the motions have."""
        return self._gains.kp_nm_rad

    def begin(self, closed_rad: float, open_rad: float, *, plausible: bool) -> ZeroResult | None:
        """Take the stops; return how it ended already, where they cannot be right.

        `plausible` asks for a travel that is like the one known before.
        """
        try:
            found = measured(
                self._before,
                closed_rad=closed_rad,
                open_rad=open_rad,
                stroke_mm=self._unit.stroke_mm,
            )
        except CalibrationError as error:
            return failed("implausible_travel", str(error))
        known_rad = None if self._before is None else self._before.geometry.travel_rad
        travel_rad = found.geometry.travel_rad
        low, high = PLAUSIBLE_TRAVEL
        if plausible and known_rad and not low <= travel_rad / known_rad <= high:
            return failed(
                "implausible_travel",
                f"the stops are {travel_rad:.3f} rad apart, by the calibration before it was"
                f" {known_rad:.3f}: clear the jaws' way and try again, or calibrate by hand",
            )
        self._calibration = found
        return None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Have it written, wait for that, and adopt it."""
        calibration = self._calibration
        if calibration is None:
            return Step(outcome=failed("not_found", "no stops were measured"))
        if self._began_s is None:
            self._began_s = now_s
            self._content = content_of(calibration, self._unit, self._gains, motor)
            if self._keep:
                return Step(errand=save_errand(self._unit, self._content, self._note))
        if not self._keep:
            return _adopt(calibration, self._content, None)
        if self._saved is None:
            if now_s - self._began_s < SAVE_WITHIN_S:
                return Step()
            return Step(outcome=failed("not_saved", f"not written within {SAVE_WITHIN_S:g} s"))
        if self._saved.error is not None or not isinstance(self._saved.value, dict):
            return Step(outcome=failed("not_saved", f"not saved: {self._saved.error}"))
        value = self._saved.value
        stored = replace(calibration, saved_s=float(value["saved_s"]))
        return _adopt(stored, self._content, str(value["path"]))

    def _note(self, result: ErrandResult) -> None:
        self._saved = result


def content_of(
    calibration: Calibration, unit: Unit, gains: Gains, motor: MotorView
) -> dict[str, Any]:
    """Return what the file of this gripper holds for a calibration."""
    return calibration.file_content(
        channel=unit.channel,
        can_id=unit.can_id,
        master_id=None if motor.identity is None else motor.identity.master_id,
        kp_nm_rad=gains.kp_nm_rad,
        kd_nm_s_rad=gains.kd_nm_s_rad,
    )


def save_errand(
    unit: Unit, content: Mapping[str, Any], on_result: Callable[[ErrandResult], None]
) -> Errand:
    """Return the errand that writes the daemon's own calibration file."""
    return Errand("calibration.save", {"channel": unit.channel, "content": content}, on_result)


def failed(outcome: ZeroOutcome, message: str) -> ZeroResult:
    """Return a result that says why there is no new calibration."""
    return ZeroResult(False, outcome, None, None, None, None, None, None, message)


def _adopt(calibration: Calibration, content: dict[str, Any], path: str | None) -> Step:
    geometry = calibration.geometry
    in_use = replace(calibration, channel=str(content["channel"]), content=content)
    result = ZeroResult(
        ok=True,
        outcome="measured",
        closed_rad=geometry.closed_rad,
        open_rad=geometry.open_rad,
        travel_rad=geometry.travel_rad,
        rad_to_mm=geometry.rad_to_mm,
        content=content,
        path=path,
        message=None,
    )
    return Step(outcome=result, adopted=Adopted(in_use, path))
