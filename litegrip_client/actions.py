"""The actions of a gripper, for other driver layers that are built on top.

They report by results, progress callbacks and exceptions, and print nothing. Only the probe of
the calibration prints, as in the vendor's SDK.
"""

from __future__ import annotations

from litegrip_client.calibration_actions import CalibrationActions
from litegrip_client.motion_actions import MotionActions
from litegrip_client.motor_actions import MotorActions
from litegrip_client.setpoints import SetpointActions
from litegrip_client.teleop import TeleopActions
from litegrip_client.trajectory_actions import TrajectoryActions


class GripperActions(
    MotorActions,
    MotionActions,
    SetpointActions,
    TrajectoryActions,
    TeleopActions,
    CalibrationActions,
):
    """All actions of the gripper at the other end of a link.

    Every action raises `ConnectError` without a connection. An action that moves the jaws raises
    `CommandError` (not calibrated, or a value out of its range), `BusyError` (another motion
    runs), `StoppedError` (a stop is latched, or came in between), `CancelledError` and
    `HardwareError` (the motor or the bus does not work).
    """
