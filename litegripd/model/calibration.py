"""A calibration file as the vendor's SDK writes it: parsing and checking, without a disk.

Files are interchangeable with the SDK's, so unknown keys are kept.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from litegripd.model.geometry import Geometry

_KNOWN_NUMBERS = ("zero_position_rad", "max_position_rad", "rad_to_mm")
_GAIN_RANGES = {"kp": 500.0, "kd": 5.0}  # what a command frame can carry


class CalibrationError(ValueError):
    """A calibration that cannot be used, and why."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a file says: the geometry, and the rest where it is given.

    `kp` (N·m/rad) and `kd` (N·m·s/rad) are the gains of the hold, None where the file has none;
    `content` is the whole file, unknown keys included.
    """

    geometry: Geometry
    calibrated: bool = True
    channel: str | None = None
    kp_nm_rad: float | None = None
    kd_nm_s_rad: float | None = None
    content: Mapping[str, Any] = field(default_factory=dict)

    def direction_only(self) -> "Calibration":
        """Return what a template may bring: limits and scale, but no ids and no gains."""
        return Calibration(self.geometry)


def parse_calibration(text: str) -> Calibration:
    """Read a calibration file's text; raises `CalibrationError` with the reason."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise CalibrationError("not a JSON object")
    closed_rad, open_rad, rad_to_mm = (_number(content, key) for key in _KNOWN_NUMBERS)
    try:
        geometry = Geometry(closed_rad, open_rad, rad_to_mm)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    return Calibration(
        geometry=geometry,
        calibrated=_typed(content, "calibrated", bool, default=True),
        channel=_typed(content, "channel", str, default=None),
        kp_nm_rad=_gain(content, "kp"),
        kd_nm_s_rad=_gain(content, "kd"),
        content=content,
    )


def _number(content: Mapping[str, Any], key: str) -> float:
    if key not in content:
        raise CalibrationError(f"{key} is missing")
    value = content[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{key} is {value!r}, not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise CalibrationError(f"{key} is not a finite number")
    return number


def _gain(content: Mapping[str, Any], key: str) -> float | None:
    if content.get(key) is None:
        return None
    value = _number(content, key)
    highest = _GAIN_RANGES[key]
    if not 0.0 <= value <= highest:
        raise CalibrationError(f"{key} is {value}, it must be 0 to {highest:g}")
    return value


def _typed(content: Mapping[str, Any], key: str, kind: type, default: Any) -> Any:
    value = content.get(key, default)
    if value is not default and not isinstance(value, kind):
        raise CalibrationError(f"{key} is {value!r}, not of type {kind.__name__}")
    return value
