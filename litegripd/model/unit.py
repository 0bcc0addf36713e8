"""Which gripper a daemon drives, as its configuration says."""

from dataclasses import dataclass

from litegripd.model.motor_types import DM4310, MotorType


@dataclass(frozen=True, slots=True)
class Unit:
    """The gripper on one channel: its motor's CAN id and type, and its whole stroke in mm.

    `bus_channel` is what its bus is opened as: the network interface, or an adapter's file.
    `mount` is the template or the calibration file that the configuration names, if it does.
    """

    channel: str = "can0"
    bus_channel: str = "can0"
    can_id: int = 0x08
    stroke_mm: float = 120.0
    mount: str | None = None
    motor_type: MotorType = DM4310
