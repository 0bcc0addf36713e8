"""The content of a calibration file as the vendor's SDK writes it, without access to a disk.

Files are interchangeable with the SDK's, so unknown keys are kept.
"""

import reprlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal, TypeAlias, TypedDict

from litegrip_client.values import strict_json
from litegripd.model.gripper import (
    FORCE_PER_TORQUE_N_NM,
    LARGEST_LIMIT_RAD,
    MOTOR_TYPES,
    NM_TO_N_RANGE,
    NUMBERED_TYPES,
    RAD_TO_MM_RANGE,
    SPAN_INSET_MM,
    SUPERSEDED_STROKE_MM,
    Geometry,
    why_not_driven,
)
from litegripd.model.motor import KD_MAX_NM_S_RAD, KP_MAX_NM_RAD
from litegripd.model.sentence import sentence


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
_GAIN_RANGES = {"kp": (1.0, KP_MAX_NM_RAD), "kd": (0.0, KD_MAX_NM_S_RAD)}
"""The upper ends are what a command frame can carry. Without stiffness nothing would be held. Any
damping will do, none too: a hold has its own (`SwingGuard.bound`), and what follows set-points has
what its stiffness needs (`Gains.following`)."""

_ALLOWED = {
    **dict.fromkeys(_KNOWN_NUMBERS[:2], f"-{LARGEST_LIMIT_RAD:g} to {LARGEST_LIMIT_RAD:g}"),
    "rad_to_mm": "{:g} to {:.9g}".format(*RAD_TO_MM_RANGE),
    "nm_to_n": "{:g} to {:g}".format(*NM_TO_N_RANGE),
    "work_stroke_mm": "the opening to which open goes, in mm, or 0 for the open stop",
    **{key: f"{low:g} to {high:g}" for key, (low, high) in _GAIN_RANGES.items()},
}
"""What the numbers that count must be, for the message about one that is not finite."""

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
    "nm_to_n",
)
"""The keys that a calibration sets. A rewrite keeps the file's values of all others."""

_MARKS = ("can_id", "mst_id", "canfd_mode", "motor_type")
"""The keys that say of which motor a calibration is."""

GRASP_TORQUE_THRESHOLD_NM = 0.5
"""The value in the vendor's factory file; the daemon itself does not use it."""


NOMINAL = (
    Geometry(0.0, -1.651026, 52.69),
    Geometry(-1.651026, 0.0, 52.69),
)
"""The figures of the templates for the two mounts (and of the factory's file, for the first)."""
SUPERSEDED = (
    Geometry(0.114, -1.491, 74.8),
    Geometry(-1.491, 0.114, 74.8),
)
"""Those of earlier versions, on 120 mm; files on users' disks have them."""
SEEN_TRAVEL_RAD = (1.27, 1.9)
"""The travels that a gripper of the family may have; 1.314 to 1.840 rad were seen."""
PLAUSIBLE_TRAVEL = (0.8, 1.25)
"""The range of a travel as a share of one that was measured before. Outside it something was
between the jaws, or a stop was not one."""

SCALE_TOLERANCE = 0.15
"""By how much the travel in mm may differ from the configured stroke."""
SUPERSEDED_TOLERANCE = 0.02
"""By how much a travel may differ from 120 mm to count as one of an earlier version."""
USUAL_RAD_TO_MM = (45.0, 80.0)
"""Scales of grippers that were seen: 46.7 to 74.8 mm/rad."""


class CalibrationError(ValueError):
    """A calibration that cannot be used, and the reason."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """The content of a file: the geometry, and other values where they are given.

    `kp` (N·m/rad) and `kd` (N·m·s/rad) are the gains of the hold, None if the file has none;
    `work_stroke_mm` is how far `open` goes, 0 for the open stop; `content` is the whole file,
    unknown keys included. `saved_s` is when the file was written (Unix time); None for what is in
    no file, and for a template.
    """

    geometry: Geometry
    calibrated: bool = True
    channel: str | None = None
    kp_nm_rad: float | None = None
    kd_nm_s_rad: float | None = None
    work_stroke_mm: float = 0.0
    content: Mapping[str, Any] = field(default_factory=dict)
    saved_s: float | None = None

    @property
    def nominal(self) -> bool:
        """True if its limits are a template's, which were measured on no gripper."""
        limits = (self.geometry.closed_rad, self.geometry.open_rad)
        return limits in ((other.closed_rad, other.open_rad) for other in NOMINAL + SUPERSEDED)

    @property
    def work_opening_mm(self) -> float | None:
        """The opening to which `open` goes, None if that is the open stop."""
        work_mm = self.work_stroke_mm
        return work_mm if 0.0 < work_mm < self.geometry.travel_mm else None

    @property
    def is_superseded(self) -> bool:
        """True if its scale is that of an earlier version, which took the travel for 120 mm."""
        share = self.geometry.travel_mm / SUPERSEDED_STROKE_MM
        return abs(share - 1.0) <= SUPERSEDED_TOLERANCE

    def direction_only(self) -> "Calibration":
        """Return what a template may set: limits, scale and work stroke, but no ids and gains."""
        return Calibration(self.geometry, work_stroke_mm=self.work_stroke_mm)

    def with_force_of(self, before: "Calibration") -> "Calibration":
        """Return this calibration with the force per torque of another one of this gripper."""
        geometry = replace(self.geometry, nm_to_n=before.geometry.nm_to_n)
        return replace(self, geometry=geometry)

    def rescaled(self, stroke_mm: float) -> "Calibration":
        """Return this calibration for jaws that open `stroke_mm`; the limits stay.

        Raises `ValueError` for a stroke that no gripper has.
        """
        if stroke_mm <= 0.0:
            raise ValueError(f"the stroke is {stroke_mm:g} mm, it must be above 0")
        geometry = replace(
            self.geometry, rad_to_mm=(stroke_mm + SPAN_INSET_MM) / self.geometry.travel_rad
        )
        return replace(self, geometry=geometry, saved_s=None)

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
            "work_stroke_mm": self.work_stroke_mm,
            "nm_to_n": geometry.nm_to_n,
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
        if not content["work_stroke_mm"]:
            del content["work_stroke_mm"]
        if geometry.nm_to_n == FORCE_PER_TORQUE_N_NM and "nm_to_n" not in self.content:
            del content["nm_to_n"]
        return content


def measured(
    before: Calibration | None, *, closed_rad: float, open_rad: float, stroke_mm: float
) -> Calibration:
    """Return the calibration for two measured stops of jaws that open `stroke_mm`.

    `rad_to_mm = (stroke_mm + 1.0) / |closed - open|`, as the SDK's `zero()` derives it. All else of
    the calibration `before` is kept, but for the marks of a motor, which are this gripper's from
    now on; the mount follows from the stops, whatever it was before.
    Raises `CalibrationError` for stops or a stroke that no gripper has.
    """
    nm_to_n = FORCE_PER_TORQUE_N_NM if before is None else before.geometry.nm_to_n
    try:
        limits = Geometry(closed_rad, open_rad, 1.0, nm_to_n)
        found = Calibration(limits) if before is None else replace(before, geometry=limits)
        content = {key: value for key, value in found.content.items() if key not in _MARKS}
        found = replace(found, content=content)
        return replace(found.rescaled(stroke_mm), calibrated=True)
    except ValueError as error:
        raise CalibrationError(f"the measured stops cannot be used: {error}") from None


def plausible_travel_rad(before: Calibration) -> tuple[float, float]:
    """Return the travels (rad) that another measurement of this gripper may find."""
    if before.nominal:
        return SEEN_TRAVEL_RAD
    low, high = PLAUSIBLE_TRAVEL
    return low * before.geometry.travel_rad, high * before.geometry.travel_rad


def fits_stroke(travel_mm: float, stroke_mm: float) -> bool:
    """Return whether limits `travel_mm` apart may be those of jaws that open `stroke_mm`."""
    return abs(travel_mm / (stroke_mm + SPAN_INSET_MM) - 1.0) <= SCALE_TOLERANCE


def of_stroke(calibration: Calibration, stroke_mm: float) -> Calibration:
    """Return a calibration as it counts for jaws that open `stroke_mm`.

    The scale of a template was measured on no gripper: with another stroke than the usual one it
    follows from that. All others are as they are.
    """
    geometry = calibration.geometry
    is_template = replace(geometry, nm_to_n=FORCE_PER_TORQUE_N_NM) in NOMINAL
    is_off = not fits_stroke(geometry.travel_mm, stroke_mm)
    return calibration.rescaled(stroke_mm) if is_template and is_off else calibration


def out_of_range(calibration: Calibration, position_rad: float) -> str | None:
    """Return why a motor that reports up to ±`position_rad` (register PMAX) reaches no limit."""
    geometry = calibration.geometry
    furthest_rad = max(abs(geometry.closed_rad), abs(geometry.open_rad))
    if furthest_rad <= position_rad:
        return None
    return (
        f"a limit is {furthest_rad:g} rad, and the motor reports at most ±{position_rad:g} rad:"
        " limits are radians, not degrees (divide those by 57.3), or measure again"
    )


def unfitting(calibration: Calibration, stroke_mm: float, position_rad: float) -> str | None:
    """Return why a calibration cannot be that of a gripper that opens `stroke_mm`, or None.

    The motor reports positions of up to ±`position_rad`. A wrong scale makes every length, speed
    and force wrong. The scale of earlier versions passes: `scale_warning` warns of it.
    """
    geometry, beyond = calibration.geometry, out_of_range(calibration, position_rad)
    if beyond is not None:
        return beyond
    span_mm = stroke_mm + SPAN_INSET_MM
    if fits_stroke(geometry.travel_mm, stroke_mm) or calibration.is_superseded:
        return None
    return sentence(
        "its limits are {travel_rad:.4g} rad apart, with {rad_to_mm:.4g} mm/rad that is"
        " {travel_mm:.4g} mm of travel, and the configured stroke is {stroke_mm:g} mm ({span_mm:g}"
        " between the limits): they may differ by {tolerance:.0%}. Measure how far the jaws open"
        " (caliper). If the file is wrong, correct its rad_to_mm ({fitting:.4g} for these limits),"
        " or measure again ({calibration.zero with a mount}). If the stroke is wrong, set stroke_mm"
        " in [gripper]",
        travel_rad=geometry.travel_rad,
        rad_to_mm=geometry.rad_to_mm,
        travel_mm=geometry.travel_mm,
        stroke_mm=stroke_mm,
        span_mm=span_mm,
        tolerance=SCALE_TOLERANCE,
        fitting=span_mm / geometry.travel_rad,
    )


ScaleDoubt: TypeAlias = Literal["superseded", "unusual"]
"""Why the scale of a calibration in use is probably wrong: it is that of an earlier version, or
unlike that of any gripper that was seen."""


def scale_doubt(calibration: Calibration, stroke_mm: float) -> ScaleDoubt | None:
    """Return why a scale is probably wrong though it is used, or None."""
    geometry, low_high = calibration.geometry, USUAL_RAD_TO_MM
    if calibration.is_superseded and not fits_stroke(geometry.travel_mm, stroke_mm):
        return "superseded"
    return None if low_high[0] <= geometry.rad_to_mm <= low_high[1] else "unusual"


def scale_warning(calibration: Calibration, stroke_mm: float) -> str | None:
    """Return a warning that a scale is probably wrong, with the remedy; or None."""
    geometry, doubt = calibration.geometry, scale_doubt(calibration, stroke_mm)
    if doubt is None:
        return None
    if doubt == "superseded":
        return sentence(
            "the calibration takes the jaws' travel for {travel_mm:.4g} mm, as earlier versions"
            " did; by the configuration they open {stroke_mm:g} mm, so every length and speed in mm"
            " reads {factor:.2f} times too large: {calibration.rescale} corrects it, without"
            " another measurement",
            travel_mm=geometry.travel_mm,
            stroke_mm=stroke_mm,
            factor=geometry.travel_mm / (stroke_mm + SPAN_INSET_MM),
        )
    low, high = USUAL_RAD_TO_MM
    return sentence(
        "the calibration has {rad_to_mm:.4g} mm/rad, and grippers of {low:g} to {high:g} mm/rad"
        " were seen: its limits are probably wrong, so measure the travel again"
        " ({calibration.zero}). If a caliper says that the jaws do not open {stroke_mm:g} mm, give"
        " what it says: {calibration.rescale with stroke_mm}",
        rad_to_mm=geometry.rad_to_mm,
        low=low,
        high=high,
        stroke_mm=stroke_mm,
    )


def work_stroke_warning(calibration: Calibration) -> str | None:
    """Return a warning that `open` is to go beyond the travel, or None."""
    work_mm, travel_mm = calibration.work_stroke_mm, calibration.geometry.travel_mm
    if work_mm < travel_mm:
        return None
    return (
        f"work_stroke_mm is {work_mm:g}, beyond the {travel_mm:.1f} mm of travel, so that open goes"
        " to the stop: write a smaller one into the calibration's file, or 0 for the stop"
    )


def foreign_warning(
    calibration: Calibration, *, channel: str, can_id: int, master_id: int | None, motor_type: str
) -> str | None:
    """Return a warning that a calibration is probably another gripper's, by its marks; or None.

    `channel`, `can_id`, `master_id` (None: not known yet) and `motor_type` are this gripper's. It
    is a warning and no refusal. Ids are settings of a motor, which may be changed with the jaws as
    they are; the SDK never reads `motor_type` and `canfd_mode`; and all units leave the maker with
    0x08, so that ids that agree prove nothing, either. A template's type says nothing of a motor.
    """
    told, marks = calibration.content, []
    if calibration.channel not in (None, channel):
        marks.append(f"channel {reprlib.repr(calibration.channel)}, and this is {channel}")
    file_id, file_master = _id(told, "can_id"), _id(told, "mst_id")
    if file_id not in (None, can_id):
        marks.append(f"can_id {_shown_id(file_id)}, and this motor is 0x{can_id:02X}")
    if file_master and master_id and file_master != master_id:
        marks.append(
            f"mst_id {_shown_id(file_master)}, and this motor answers on 0x{master_id:02X}"
        )
    if str(told.get("canfd_mode")).lower() in ("true", "1"):
        marks.append("canfd_mode (CAN FD), and this motor is driven by classic CAN")
    file_type = _type_name(told)
    if file_type not in (None, motor_type) and not calibration.nominal:
        marks.append(f"motor_type {reprlib.repr(file_type)}, and this motor is a {motor_type}")
    if not marks:
        return None
    return sentence(
        "the calibration is probably another gripper's: it has {marks}. Its limits, and the"
        " direction in which it closes, may be wrong here: measure again ({calibration.zero}), or"
        " load this gripper's own. If it is this gripper's, correct those keys in the file",
        marks="; ".join(marks),
    )


def _id(content: Mapping[str, Any], key: str) -> int | str | None:
    """Return the id under a key, also one written as text, "0x08"; as it is if it is none."""
    value = content.get(key)
    if value in (None, ""):
        return None
    try:
        return int(value, 0) if isinstance(value, str) else int(value)
    except (TypeError, ValueError):
        return reprlib.repr(value)


def _shown_id(value: int | str) -> str:
    return value if isinstance(value, str) else f"0x{value:02X}"


def _type_name(content: Mapping[str, Any]) -> str | None:
    """Return the type of motor that a file has, also by the maker's number; None if it has none."""
    value = content.get("motor_type")
    if isinstance(value, int) and not isinstance(value, bool):
        return NUMBERED_TYPES[value] if 0 <= value < len(NUMBERED_TYPES) else str(value)
    return value if isinstance(value, str) and value else None


def to_plain(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration in a form that JSON can carry between two processes of the daemon."""
    return {
        **asdict(calibration.geometry),
        **{name: getattr(calibration, name) for name in _CARRIED},
    }


def from_plain(values: Mapping[str, Any]) -> Calibration:
    """Return the calibration that `to_plain` was given."""
    geometry = Geometry(**{field.name: values[field.name] for field in fields(Geometry)})
    return Calibration(geometry, **{name: values[name] for name in _CARRIED})


_CARRIED = tuple(field.name for field in fields(Calibration) if field.name != "geometry")


def parse_calibration(text: str) -> Calibration:
    """Return the calibration in a file's text; raises `CalibrationError` with the reason."""
    try:
        content = strict_json.decode_file(text, _ALLOWED)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    return read_content(content)


def read_content(content: object) -> Calibration:
    """Return the calibration in a file's content; raises `CalibrationError` with the reason."""
    if not isinstance(content, dict):
        raise CalibrationError("not a JSON object")
    if _is_nested_deeper(content, _MAX_NESTING):
        raise CalibrationError(f"objects and arrays nested more than {_MAX_NESTING} deep")
    try:
        strict_json.check_numbers(content, _ALLOWED)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    closed_rad, open_rad, rad_to_mm = (_number(content, key) for key in _KNOWN_NUMBERS)
    nm_to_n = _optional(content, "nm_to_n", FORCE_PER_TORQUE_N_NM)
    work_stroke_mm = _optional(content, "work_stroke_mm", 0.0)
    if work_stroke_mm < 0.0:
        raise CalibrationError(
            f"work_stroke_mm is {work_stroke_mm:g}, it must be {_ALLOWED['work_stroke_mm']}"
        )
    try:
        geometry = Geometry(closed_rad, open_rad, rad_to_mm, nm_to_n)
    except ValueError as error:
        raise CalibrationError(str(error)) from None
    motor_type = _type_name(content)
    why_not = None if motor_type is None else why_not_driven(motor_type)
    if why_not is not None:
        raise CalibrationError(f"motor_type is {reprlib.repr(motor_type)}, {why_not}")
    return Calibration(
        geometry=geometry,
        calibrated=_typed(content, "calibrated", bool, default=True),
        channel=_typed(content, "channel", str, default=None),
        kp_nm_rad=_gain(content, "kp"),
        kd_nm_s_rad=_gain(content, "kd"),
        work_stroke_mm=work_stroke_mm,
        content=content,
    )


GIVEN_KEYS = (*_KNOWN_NUMBERS, "work_stroke_mm", "kp", "kd")
"""What a request may bring for its own motion. All else in a file is of the gripper or its bus, and
a motion changes neither."""


def read_given(content: Mapping[str, Any]) -> Calibration:
    """Return the calibration that a request brings for its own motion.

    Raises `KeyError` with a key that no request may bring, else as `read_content`.
    """
    unknown = next((key for key in content if key not in GIVEN_KEYS), None)
    if unknown is not None:
        raise KeyError(unknown)
    return read_content(content)


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
    return float(value)


def _optional(content: Mapping[str, Any], key: str, default: float) -> float:
    return default if content.get(key) is None else _number(content, key)


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
