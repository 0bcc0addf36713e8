"""A gripper's geometry and its conversions, with the vendor SDK's names. No I/O here."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from litegrip_client.values.checks import UnsetFloat, number, pick
from litegrip_client.values.errors import CommandError, HardwareError
from litegrip_client.values.fields import (
    NM_TO_N,
    RAD_TO_MM,
    STROKE_MM,
    CalibrationNames,
    ConfigNames,
)
from litegrip_client.values.tracebacks import shortened

NOMINAL_CLOSED_RAD = 0.0
NOMINAL_OPEN_RAD = -1.651026
NOMINAL_RAD_TO_MM = 52.69
"""The template of a normal mount."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationData(CalibrationNames):
    """A calibration, with the keys of its file; None means that the file lacks the key.

    `zero_position_rad` is the closed limit and `max_position_rad` the open one; `rad_to_mm` the
    opening per radian. `work_stroke_mm` is the opening to which `open` goes, 0 or None for the open
    stop; `nm_to_n` the squeezing force per torque. `kp` (N·m/rad) and `kd` (N·m·s/rad) are the
    gains of the hold. Without arguments it is the nominal geometry of a normal mount, not
    `calibrated`. `calibration_time` is the Unix time at which this object was made of a
    measurement, else None.
    """

    channel: str | None = None
    can_id: int | None = None
    mst_id: int | None = None
    canfd_mode: bool | None = None
    calibrated: bool = False
    zero_position_rad: float = NOMINAL_CLOSED_RAD
    max_position_rad: float = NOMINAL_OPEN_RAD
    travel_range_rad: float = NOMINAL_CLOSED_RAD - NOMINAL_OPEN_RAD
    rad_to_mm: float = NOMINAL_RAD_TO_MM
    work_stroke_mm: float | None = None
    nm_to_n: float | None = None
    motor_type: str | None = None
    kp: float | None = None
    kd: float | None = None
    grasp_torque_threshold: float | None = None
    calibration_time: float | None = None

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> "CalibrationData":
        """Read a file's keys and ignore unknown ones; raises `ProtocolError`."""
        values = pick(
            content, ("zero_position_rad", "max_position_rad", "rad_to_mm"), "calibration"
        )
        travel_rad = abs(values["zero_position_rad"] - values["max_position_rad"])
        known = {name: content[name] for name in CALIBRATION_KEYS if name in content}
        return cls(**{"travel_range_rad": travel_rad, "calibrated": True, **known})

    @classmethod
    def from_result(cls, result: Mapping[str, Any]) -> "CalibrationData":
        """Read the result of measuring; raises `HardwareError` or `CommandError` if it failed."""
        if result.get("ok") is True:
            content = pick(result, ("content",), "calibration result")["content"]
            return replace(cls.from_content(content), calibration_time=time.time())
        outcome = pick(result, ("outcome", "message"), "calibration result")["outcome"]
        kind = CommandError if outcome == "not_saved" else HardwareError
        raise kind(str(result["message"]), reason=str(outcome), data=result)

    @property
    def mount(self) -> str:
        """Return "normal" when closing increases radians, "reverse" otherwise."""
        return "normal" if self.zero_position_rad > self.max_position_rad else "reverse"


CALIBRATION_KEYS = tuple(
    one.name for one in fields(CalibrationData) if one.name != "calibration_time"
)
"""The keys of a calibration file, in the order in which files have them."""


class ReadOnlyError(CommandError, AttributeError):
    """The daemon's configuration cannot be set from here."""


@shortened
@dataclass(slots=True)
class GripperConfig(ConfigNames):
    """The gripper as the daemon drives it, or as a program expects it.

    `gripper.config` is the daemon's: assigning to its fields raises `CommandError`, except for
    `max_stroke_mm`. That is how far the jaws open, as a caliper measures it: what `zero` and the
    other calibrations of this program use. Until it is assigned it is the daemon's. An object that
    a program makes, for `LiteGrip(config=...)`, says what the daemon's gripper must be: a field
    that is None, or was not set, is not compared. Its `max_stroke_mm` counts as one assigned.

    Unknown values are None: the limits and `rad_to_mm` until `calibrated`, `mst_id` (the id of
    the motor's answers) until the motor has answered. `kp` is N·m/rad, `kd` N·m·s/rad.
    `work_stroke_mm` is the opening to which `open` goes, 0.0 for the open stop. `nm_to_n` is the
    squeezing force per torque of the motor, N per N·m: approximate.
    """

    channel: str = "can0"
    can_id: int = 0x08
    mst_id: int | None = None
    motor_type: str = "DM4310"
    calibrated: bool = False
    pos_closed_rad: float | None = None
    pos_open_rad: float | None = None
    rad_to_mm: float | None = None
    kp: float = 100.0
    kd: float = 2.0
    canfd_mode: bool = False
    grasp_torque_threshold: float = 0.5
    max_stroke_mm: float = UnsetFloat(STROKE_MM)
    work_stroke_mm: float = 0.0
    nm_to_n: float = NM_TO_N
    own: "GripperConfig | None" = field(default=None, repr=False, compare=False)

    @classmethod
    def from_wire(
        cls, info: Mapping[str, Any], own: "GripperConfig | None" = None
    ) -> "GripperConfig":
        """Read the daemon's `info`; raises `ProtocolError`.

        `own` is the program's object, which has what the program assigned, and gets what it will.
        """
        whole = pick(info, ("channel", "motor", "gripper"), "description")
        motor = pick(whole["motor"], ("type", "can_id", "master_id"), "motor")
        names = ("calibrated", "closed_rad", "open_rad", "rad_to_mm", "kp", "kd")
        found = whole["gripper"]
        gripper = pick(found, names, "gripper")
        own = cls() if own is None else own
        stroke_mm = own.assigned_stroke_mm
        return cls(
            channel=whole["channel"],
            can_id=motor["can_id"],
            mst_id=motor["master_id"],
            motor_type=motor["type"],
            pos_closed_rad=gripper.pop("closed_rad"),
            pos_open_rad=gripper.pop("open_rad"),
            max_stroke_mm=UnsetFloat(found.get("stroke_mm", STROKE_MM))
            if stroke_mm is None
            else stroke_mm,
            work_stroke_mm=found.get("work_stroke_mm") or 0.0,
            nm_to_n=found.get("nm_to_n") or NM_TO_N,
            own=own,
            **gripper,
        )

    @property
    def is_read(self) -> bool:
        """True if it is the daemon's."""
        return self.own is not None

    @property
    def assigned_stroke_mm(self) -> float | None:
        """`max_stroke_mm` if the program has set it, else None."""
        return None if isinstance(self.max_stroke_mm, UnsetFloat) else self.max_stroke_mm

    if not TYPE_CHECKING:  # with it, a type checker would allow any name

        def __setattr__(self, name, value):
            """Set a field, unless the object is the daemon's: then the program's own may be set."""
            if name in _OWN and not isinstance(value, UnsetFloat):
                value = number(name, value)
            if not self._is_settable(name):
                raise self._no_attribute(name)
            own = getattr(self, "own", None)
            if own is not None:
                if name not in _OWN:
                    raise ReadOnlyError(
                        f"config.{name} cannot be set: it is the daemon's, for all its clients",
                        reason="unsupported",
                        data={
                            "parameter": name,
                            "hint": "gains and limits are the calibration file's"
                            " (load_calibration); a single motion takes kp and kd",
                        },
                    )
                setattr(own, name, value)
            object.__setattr__(self, _OTHER_NAMES.get(name, name), value)


_OWN = ("max_stroke_mm",)
"""Fields that are the program's own, and no daemon's."""
_OTHER_NAMES = {"can_channel": "channel"}


class UnitConversion:
    """Newtons at the jaws and newton metres at the motor; millimetres and radians."""

    N_TO_NM = 0.1
    """N·m per N (the vendor's figure): approximate, since the force depends on the fingers."""

    NM_TO_N = NM_TO_N
    """N per N·m."""

    RAD_TO_MM = RAD_TO_MM
    """mm of opening per radian, of the vendor's uncalibrated gripper; calibrated ones differ."""

    MM_TO_RAD = 1.0 / RAD_TO_MM

    @classmethod
    def n_to_nm(cls, force_n: float) -> float:
        """Return the motor's torque for a squeezing force."""
        return force_n * cls.N_TO_NM

    @classmethod
    def nm_to_n(cls, torque_nm: float) -> float:
        """Return the squeezing force of a closing torque."""
        return torque_nm / cls.N_TO_NM

    @staticmethod
    def mm_to_rad(distance_mm: float, rad_to_mm: float) -> float:
        """Return how far the motor turns for a distance of the jaws, without direction."""
        return distance_mm / rad_to_mm

    @staticmethod
    def rad_to_mm(angle_rad: float, rad_to_mm: float) -> float:
        """Return how far the jaws move when the motor turns, without direction."""
        return angle_rad * rad_to_mm
