"""The content of a calibration file as the vendor's SDK writes it, without access to a disk.

Files are interchangeable with the SDK's, so unknown keys are kept.
"""

import json
import math
import reprlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypedDict

from litegripd.model.gripper import MOTOR_TYPES, NOMINAL_RAD_TO_MM, Geometry, why_not_driven
from litegripd.model.motion_config import damping_conflict


class Saved(TypedDict):
    """Where a file was written, where the previous one is, and the new one's date (Unix time)."""

    path: str
    previous: str | None
    saved_s: float


class Dumped(TypedDict):
    """A file of the flight recorder, and what is in it."""

    path: str
    ticks: int
    seconds: float
    bytes: int


_KNOWN_NUMBERS = ("zero_position_rad", "max_position_rad", "rad_to_mm")
_GAIN_RANGES = {"kp": (1.0, 500.0), "kd": (0.0, 5.0)}
"""The upper ends are what a command frame can carry. Without stiffness nothing would be held."""

_USUAL_GAINS = {"kp": 100.0, "kd": 2.0}
"""The values used for a gain that a file leaves out, when the two are checked together."""

_MAX_NESTING = 16
"""The depth to which objects and arrays of a file may be nested. The SDK's files have one level.
With thousands, code that passes the content on would raise a `RecursionError`."""

_MEASURED = (
    "channel",
    "calibrated",
    "zero_position_rad",
    "max_position_rad",
    "travel_range_rad",
    "rad_to_mm",
)
"""The keys that a calibration sets. A rewrite keeps the file's values of all others."""

GRASP_TORQUE_THRESHOLD_NM = 0.5
"""The value in the vendor's factory file; the daemon itself does not use it."""


NOMINAL = (
    Geometry(0.114, -1.491, NOMINAL_RAD_TO_MM),
    Geometry(-1.491, 0.114, NOMINAL_RAD_TO_MM),
)
"""The figures of the templates for the two mounts (and of the factory's file, for the first). No
measurement gives exactly these, so a gripper with these figures was never measured, whatever its
file says."""


class CalibrationError(ValueError):
    """A calibration that cannot be used, and the reason."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """The content of a file: the geometry, and other values where they are given.

    `kp` (N·m/rad) and `kd` (N·m·s/rad) are the gains of the hold, None if the file has none;
    `content` is the whole file, unknown keys included. `saved_s` is when the file was written (Unix
    time); None for what is in no file, and for a template.
    """

    geometry: Geometry
    calibrated: bool = True
    channel: str | None = None
    kp_nm_rad: float | None = None
    kd_nm_s_rad: float | None = None
    content: Mapping[str, Any] = field(default_factory=dict)
    saved_s: float | None = None

    @property
    def nominal(self) -> bool:
        """True if its figures are a template's, which were measured on no gripper."""
        return self.geometry in NOMINAL

    def direction_only(self) -> "Calibration":
        """Return what a template may set: limits and scale, but no ids and no gains."""
        return Calibration(self.geometry)

    def file_content(
        self,
        *,
        channel: str,
        can_id: int,
        master_id: int | None,
        motor_type: str,
        kp_nm_rad: float,
        kd_nm_s_rad: float,
    ) -> dict[str, Any]:
        """Return the content of the SDK's file for this calibration on `channel`.

        Limits, travel, scale, `calibrated` and `channel` are this calibration's. The other keys of
        `content`, unknown ones included, keep their values. Missing ones are filled with `can_id`,
        `master_id` (left out if it is None or 0: unknown) and the gains (N·m/rad, N·m·s/rad). A
        type of motor that the daemon knows is replaced by `motor_type`.
        """
        geometry = self.geometry
        ours: dict[str, Any] = {
            "channel": channel,
            "can_id": can_id,
            "mst_id": master_id,
            "canfd_mode": False,
            "calibrated": self.calibrated,
            "zero_position_rad": geometry.closed_rad,
            "max_position_rad": geometry.open_rad,
            "travel_range_rad": geometry.travel_rad,
            "rad_to_mm": geometry.rad_to_mm,
            "motor_type": motor_type,
            "kp": kp_nm_rad if self.kp_nm_rad is None else self.kp_nm_rad,
            "kd": kd_nm_s_rad if self.kd_nm_s_rad is None else self.kd_nm_s_rad,
            "grasp_torque_threshold": GRASP_TORQUE_THRESHOLD_NM,
        }
        kept = {
            key: value
            for key, value in self.content.items()
            if key not in ours or (key not in _MEASURED and value is not None)
        }
        if kept.get("motor_type") in MOTOR_TYPES:
            del kept["motor_type"]
        if not kept.get("mst_id"):
            kept.pop("mst_id", None)
        content = ours | kept
        if not content["mst_id"]:
            del content["mst_id"]
        return content


def measured(
    before: Calibration | None, *, closed_rad: float, open_rad: float, stroke_mm: float
) -> Calibration:
    """Return the calibration for two measured stops, between which the jaws travel `stroke_mm`.

    `rad_to_mm = stroke_mm / |closed - open|`, as the SDK's `zero()` derives it. Gains and content
    of the calibration `before` are kept; the mount follows from the stops, whatever it was before.
    Raises `CalibrationError` for stops or a stroke that no gripper has.
    """
    try:
        travel_rad = Geometry(closed_rad, open_rad, 1.0).travel_rad
        geometry = Geometry(closed_rad, open_rad, stroke_mm / travel_rad)
    except ValueError as error:
        raise CalibrationError(f"the measured stops cannot be used: {error}") from None
    if before is None:
        return Calibration(geometry)
    return replace(before, geometry=geometry, calibrated=True, saved_s=None)


def to_plain(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration in a form that JSON can carry between two processes of the daemon."""
    return {
        **asdict(calibration.geometry),
        **{name: getattr(calibration, name) for name in _CARRIED},
    }


def from_plain(values: Mapping[str, Any]) -> Calibration:
    """Return the calibration that `to_plain` was given."""
    geometry = Geometry(values["closed_rad"], values["open_rad"], values["rad_to_mm"])
    return Calibration(geometry, **{name: values[name] for name in _CARRIED})


_CARRIED = ("calibrated", "channel", "kp_nm_rad", "kd_nm_s_rad", "content", "saved_s")


def parse_calibration(text: str) -> Calibration:
    """Return the calibration in a file's text; raises `CalibrationError` with the reason."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"not valid JSON: {error}") from None
    return read_content(content)


def read_content(content: object) -> Calibration:
    """Return the calibration in a file's content; raises `CalibrationError` with the reason."""
    if not isinstance(content, dict):
        raise CalibrationError("not a JSON object")
    if _is_nested_deeper(content, _MAX_NESTING):
        raise CalibrationError(f"objects and arrays nested more than {_MAX_NESTING} deep")
    closed_rad, open_rad, rad_to_mm = (_number(content, key) for key in _KNOWN_NUMBERS)
    try:
        geometry = Geometry(closed_rad, open_rad, rad_to_mm)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    _check_motor_type(content.get("motor_type"))
    kp_nm_rad, kd_nm_s_rad = _gains(content)
    return Calibration(
        geometry=geometry,
        calibrated=_typed(content, "calibrated", bool, default=True),
        channel=_typed(content, "channel", str, default=None),
        kp_nm_rad=kp_nm_rad,
        kd_nm_s_rad=kd_nm_s_rad,
        content=content,
    )


def _check_motor_type(motor_type: object) -> None:
    """Raise for a file of a motor that no daemon drives; what is no name counts as none."""
    why_not = why_not_driven(motor_type) if isinstance(motor_type, str) and motor_type else None
    if why_not is not None:
        raise CalibrationError(f"motor_type is {reprlib.repr(motor_type)}, {why_not}")


def _is_nested_deeper(value: object, levels: int) -> bool:
    if not isinstance(value, dict | list):
        return False
    inner = value.values() if isinstance(value, dict) else value
    return levels == 0 or any(_is_nested_deeper(item, levels - 1) for item in inner)


def _number(content: Mapping[str, Any], key: str) -> float:
    if key not in content:
        raise CalibrationError(f"{key} is missing")
    value = content[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{key} is {reprlib.repr(value)}, not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise CalibrationError(f"{key} is not a finite number")
    return number


def _gains(content: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Return kp and kd, each None if the file has none; raises if the two do not fit."""
    gains = {name: _gain(content, name) for name in _USUAL_GAINS}
    judged = {name: _USUAL_GAINS[name] if value is None else value for name, value in gains.items()}
    conflict = damping_conflict(judged["kp"], judged["kd"])
    if conflict is not None:
        raise CalibrationError(conflict.message)
    return gains["kp"], gains["kd"]


def _gain(content: Mapping[str, Any], key: str) -> float | None:
    if content.get(key) is None:
        return None
    value = _number(content, key)
    lowest, highest = _GAIN_RANGES[key]
    if not lowest <= value <= highest:
        raise CalibrationError(f"{key} is {value}, it must be {lowest:g} to {highest:g}")
    return value


def _typed(content: Mapping[str, Any], key: str, kind: type, default: Any) -> Any:
    value = content.get(key, default)
    if value is not default and not isinstance(value, kind):
        raise CalibrationError(f"{key} is {reprlib.repr(value)}, not of type {kind.__name__}")
    return value
