"""`LiteGripCAN`: one motor of a channel, for service scripts, through the channel's daemon."""

from __future__ import annotations

import logging
import math
import time

from .._shortened import shortened
from ..can.motor import MotorParams, MotorState, MotorType
from ..exceptions import CANTimeoutError, CommandError, CommError, HardwareError
from ..gripper import LiteGrip

__all__ = ["LiteGripCAN"]

LOG = logging.getLogger("litegrip.can_bus")


@shortened
class LiteGripCAN:
    """The motor of a channel: enabled, moved and read by a script that knows no jaws.

    Angles stay inside the daemon's calibration; torques and speeds inside its bounds.
    """

    def __init__(self, channel: str = "can0", canfd_mode: bool = False) -> None:
        self.channel = channel
        self.motor: MotorState | None = None
        self._gripper = LiteGrip(channel, canfd_mode=canfd_mode)

    @property
    def is_initialized(self) -> bool:
        """True from `initialize()` or `enable()` on."""
        return self.motor is not None and self._gripper.is_enabled

    def connect(self) -> bool:
        """Connect to the channel's daemon; true. Raises `ConnectError`."""
        return self._gripper.connect()

    def disconnect(self, disable: bool = True) -> None:
        """End the connection; with `disable` the motor is disabled first."""
        self._gripper.disable_on_disconnect = disable
        self._gripper.disconnect()

    def register_gripper(
        self,
        can_id: int = 0x08,
        mst_id: int | None = None,
        motor_type: MotorType = MotorType.DM4310,
    ) -> int:
        """Name the motor; return the id of its answers. Raises `CommError` before `connect()`."""
        if not self._gripper.is_connected:
            raise CommError("not connected: call connect() first")
        found = mst_id or self._gripper.mst_id or 0x18
        self.motor = MotorState(MotorParams(MotorType(motor_type), can_id, found))
        self.update_state()
        return found

    def initialize(self, kp: float | None = None, kd: float | None = None) -> bool:
        """Enable the motor, limp; with gains it holds. True, or `HardwareError`."""
        result = self._gripper.enable()
        if not result:
            code = None if result.state is None else result.state.error_code
            raise HardwareError("the motor could not be enabled", code or None)
        if kp is None and kd is None:
            self._gripper.enter_zero_gravity()
        self.update_state()
        return True

    def enable(self) -> bool:
        """Enable the motor; false if it does not confirm."""
        return bool(self._gripper.enable())

    def disable(self) -> bool:
        """Disable the motor; true."""
        return self._gripper.disable()

    def set_zero(self) -> bool:
        """Make the present angle the motor's zero, for good; it is disabled then."""
        return self._gripper._set_zero()  # noqa: SLF001 - without enabling, unlike write_zero

    def clear_fault(self) -> bool:
        """Clear the motor's fault and enable it; true, or `HardwareError`."""
        return self._gripper.clear_fault()

    def control_mit(
        self,
        q_target: float,
        kp: float,
        kd: float,
        dq_target: float = 0.0,
        tau_feedforward: float = 0.0,
    ) -> bool:
        """Have the motor follow an angle, or make a torque: `LiteGrip.send_mit_frame`."""
        return self._gripper.send_mit_frame(q_target, kp, kd, dq_target, tau_feedforward)

    def control_mit_stream(
        self,
        q_target: float,
        kp: float,
        kd: float,
        duration_s: float,
        dq_target: float = 0.0,
        tau_feedforward: float = 0.0,
        interval_s: float = 0.005,
    ) -> bool:
        """Send such frames for a while; blocks. True if all were sent."""
        if not math.isfinite(duration_s) or not math.isfinite(interval_s) or interval_s < 0.0:
            raise CommandError(
                f"duration_s is {duration_s:g} and interval_s {interval_s:g}: finite numbers, and"
                " the interval not negative"
            )
        ends_s, sent = time.monotonic() + duration_s, True
        while time.monotonic() < ends_s:
            sent = self.control_mit(q_target, kp, kd, dq_target, tau_feedforward) and sent
            time.sleep(max(interval_s, 0.001))
        self.update_state()
        return sent

    def poll(self, timeout_s: float = 0.0) -> bool:
        """Return True if the motor has reported since the last call."""
        return self._gripper.poll(timeout_s) and self.update_state()

    def update_state(self, timeout_s: float = 0.05) -> bool:
        """Read the motor's last report; true if it is of now."""
        if self.motor is None or not self._gripper.is_connected:
            return False
        ends_s = time.monotonic() + timeout_s
        while True:
            state = self._gripper.get_state()
            self.motor.note(state)
            if not state.is_stale:
                return True
            if time.monotonic() >= ends_s:
                return False
            time.sleep(0.005)

    def refresh_status(self, timeout_s: float = 0.5) -> bool:
        """Wait for a report after this call."""
        return self._gripper.refresh_status(timeout_s) and self.update_state()

    def get_position(self) -> float:
        """Return the angle that was read last, rad."""
        return 0.0 if self.motor is None else self.motor.position

    def get_velocity(self) -> float:
        """Return the speed that was read last, rad/s."""
        return 0.0 if self.motor is None else self.motor.velocity

    def get_torque(self) -> float:
        """Return the torque that was read last, N·m."""
        return 0.0 if self.motor is None else self.motor.torque

    def get_error(self) -> int:
        """Return the status that was read last, -1 before `register_gripper()`."""
        return -1 if self.motor is None else self.motor.error

    def get_temperature(self) -> tuple[int, int]:
        """Return the temperatures of driver and coil that were read last, °C."""
        return (0, 0) if self.motor is None else (self.motor.t_mos, self.motor.t_coil)

    def read_param(self, rid: int, timeout_s: float = 0.5) -> float:
        """Read a register. Raises `CANTimeoutError` where the motor does not answer."""
        if self.motor is None:
            raise CANTimeoutError("no motor is registered: register_gripper() first")
        return self._gripper.read_param(rid, timeout_s)
