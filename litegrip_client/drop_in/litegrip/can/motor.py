"""Types of motors, and what a motor has last reported."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from .protocol import ControlMode, MotorLimits, get_motor_limits

if TYPE_CHECKING:
    from ..models import GripperState

__all__ = ["MotorParams", "MotorState", "MotorType"]


class MotorType(IntEnum):
    """The maker's motors, by the numbers of its own drivers. The daemon says which it drives."""

    DM3507 = 0
    DM4310 = 1
    DM4310_48V = 2
    DM4340 = 3
    DM4340_48V = 4
    DM6006 = 5
    DM6248P = 6
    DM8006 = 7
    DM8009 = 8
    DM10010L = 9
    DM10010 = 10
    DMH3510 = 11
    DMH6215 = 12
    DMS3519 = 13
    DMG6220 = 14


@dataclass
class MotorParams:
    """A motor on the bus; without `limits` it gets those of its type."""

    motor_type: MotorType = MotorType.DM4310
    can_id: int = 0x08
    mst_id: int = 0x18
    control_mode: ControlMode = ControlMode.MIT_MODE
    limits: MotorLimits | None = None

    def __post_init__(self) -> None:
        if self.limits is None:
            self.limits = get_motor_limits(int(self.motor_type))


class MotorState:
    """What a motor has last reported: rad, rad/s, N·m, °C. It is read, never written.

    `rx_count` counts the reports that were seen.
    """

    def __init__(self, params: MotorParams | None = None) -> None:
        self._params = MotorParams() if params is None else params
        self._state: GripperState | None = None
        self.rx_count = 0

    def note(self, state: GripperState) -> None:
        """Take a newer report."""
        if self._state is None or state.timestamp != self._state.timestamp:
            self.rx_count += 1
        self._state = state

    @property
    def can_id(self) -> int:
        """The id of its commands."""
        return self._params.can_id

    @property
    def mst_id(self) -> int:
        """The id of its answers."""
        return self._params.mst_id

    @property
    def control_mode(self) -> ControlMode:
        """The mode in which it is driven."""
        return self._params.control_mode

    @property
    def motor_type(self) -> MotorType:
        """Its type."""
        return self._params.motor_type

    @property
    def limits(self) -> MotorLimits | None:
        """The ranges of its frames."""
        return self._params.limits

    @property
    def position(self) -> float:
        """Its angle, rad."""
        return 0.0 if self._state is None else self._state.position_rad

    @property
    def velocity(self) -> float:
        """Its speed, rad/s."""
        return 0.0 if self._state is None else self._state.velocity_rad_s

    @property
    def torque(self) -> float:
        """Its torque, N·m."""
        return 0.0 if self._state is None else self._state.torque_nm

    @property
    def error(self) -> int:
        """Its status: 0 disabled, 1 enabled, else a fault."""
        return 0 if self._state is None else self._state.error_code

    @property
    def t_mos(self) -> int:
        """The driver's temperature, °C."""
        return 0 if self._state is None else self._state.temperature_mos

    @property
    def t_coil(self) -> int:
        """The coil's temperature, °C."""
        return 0 if self._state is None else self._state.temperature_coil

    @property
    def is_enabled(self) -> bool:
        """True if it says that it is enabled."""
        return self.error == 1

    @property
    def is_fault(self) -> bool:
        """True if it reports a fault."""
        return self.error not in (0, 1)

    @property
    def last_update(self) -> float:
        """When it last reported, Unix time; 0.0 before."""
        return 0.0 if self._state is None else self._state.timestamp

    @property
    def has_data(self) -> bool:
        """True if it has reported."""
        return self._state is not None and self._state.has_data

    @property
    def data_age_s(self) -> float:
        """How old its last report is; infinite before."""
        return float("inf") if self._state is None else self._state.data_age_s
