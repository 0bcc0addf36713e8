"""A gripper's geometry, as values with the vendor SDK's names. No I/O here."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from litegrip_client.checks import pick
from litegrip_client.errors import CommandError, HardwareError


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationData:
    """A calibration, with the keys of its file; None means that the file lacks the key.

    `zero_position_rad` is the closed limit and `max_position_rad` the open one; `rad_to_mm` the
    opening per radian. `kp` (N·m/rad) and `kd` (N·m·s/rad) are the gains of the hold.
    """

    channel: str | None = None
    can_id: int | None = None
    mst_id: int | None = None
    canfd_mode: bool | None = None
    calibrated: bool = True
    zero_position_rad: float
    max_position_rad: float
    travel_range_rad: float
    rad_to_mm: float
    motor_type: str | None = None
    kp: float | None = None
    kd: float | None = None
    grasp_torque_threshold: float | None = None

    @classmethod
    def from_content(cls, content: Mapping[str, Any]) -> "CalibrationData":
        """Read a file's keys and ignore unknown ones; raises `ProtocolError`."""
        values = pick(
            content, ("zero_position_rad", "max_position_rad", "rad_to_mm"), "calibration"
        )
        travel_rad = abs(values["zero_position_rad"] - values["max_position_rad"])
        known = {name: content[name] for name in CALIBRATION_KEYS if name in content}
        return cls(**{"travel_range_rad": travel_rad, **known})

    @classmethod
    def from_result(cls, result: Mapping[str, Any]) -> "CalibrationData":
        """Read the result of measuring; raises `HardwareError` or `CommandError` if it failed."""
        if result.get("ok") is True:
            return cls.from_content(pick(result, ("content",), "calibration result")["content"])
        outcome = pick(result, ("outcome", "message"), "calibration result")["outcome"]
        kind = CommandError if outcome == "not_saved" else HardwareError
        raise kind(str(result["message"]), reason=str(outcome), data=result)

    @property
    def mount(self) -> str:
        """Return "normal" when closing increases radians, "reverse" otherwise."""
        return "normal" if self.zero_position_rad > self.max_position_rad else "reverse"


CALIBRATION_KEYS = tuple(field.name for field in fields(CalibrationData))
"""The keys of a calibration file, in the order in which files have them."""


@dataclass(frozen=True, slots=True)
class GripperConfig:
    """The gripper as the daemon drives it now; read-only.

    Unknown values are None: the limits and `rad_to_mm` until `calibrated`, `mst_id` (the id of
    the motor's answers) until the motor has answered. `kp` is N·m/rad, `kd` N·m·s/rad.
    """

    channel: str
    can_id: int
    mst_id: int | None
    motor_type: str
    calibrated: bool
    pos_closed_rad: float | None
    pos_open_rad: float | None
    rad_to_mm: float | None
    kp: float
    kd: float

    @classmethod
    def from_wire(cls, info: Mapping[str, Any]) -> "GripperConfig":
        """Read the daemon's `info`; raises `ProtocolError`."""
        whole = pick(info, ("channel", "motor", "gripper"), "description")
        motor = pick(whole["motor"], ("type", "can_id", "master_id"), "motor")
        names = ("calibrated", "closed_rad", "open_rad", "rad_to_mm", "kp", "kd")
        gripper = pick(whole["gripper"], names, "gripper")
        return cls(
            channel=whole["channel"],
            can_id=motor["can_id"],
            mst_id=motor["master_id"],
            motor_type=motor["type"],
            pos_closed_rad=gripper.pop("closed_rad"),
            pos_open_rad=gripper.pop("open_rad"),
            **gripper,
        )

    @property
    def close_sign(self) -> int | None:
        """+1 when closing increases radians, -1 otherwise; None until calibrated."""
        if self.pos_closed_rad is None or self.pos_open_rad is None:
            return None
        return 1 if self.pos_closed_rad > self.pos_open_rad else -1

    @property
    def travel_mm(self) -> float | None:
        """The calibrated stroke in mm; None until calibrated."""
        if self.pos_closed_rad is None or self.pos_open_rad is None or self.rad_to_mm is None:
            return None
        return abs(self.pos_closed_rad - self.pos_open_rad) * self.rad_to_mm
