"""The gripper that a daemon drives, as the configuration describes it."""

from dataclasses import dataclass

from litegripd.model.motor_types import DM4310, MotorType


@dataclass(frozen=True, slots=True)
class GripperId:
    """The gripper on one channel: its motor's CAN id and type, and its whole stroke in mm.

    `bus_channel` is the network interface or the adapter's file by which its bus is opened. `mount`
    is the template or the calibration file that the configuration names, None if it names none.
    """

    channel: str = "can0"
    bus_channel: str = "can0"
    can_id: int = 0x08
    stroke_mm: float = 120.0
    mount: str | None = None
    motor_type: MotorType = DM4310
