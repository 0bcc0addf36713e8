"""What LeRobot asks of robots and of teleoperators alike: a gripper's part, and an arm's beside it.

Both classes stand before LeRobot's base class, and are what is abstract there.
"""

from __future__ import annotations

from typing import Any

from lerobot.robots import Robot
from lerobot.teleoperators import Teleoperator

from lerobot_robot_litegrip.watched import WatchedGripper


class GripperDevice:
    """A robot or teleoperator that is a gripper."""

    gripper: WatchedGripper

    @property
    def action_features(self) -> dict[str, type]:
        """Where to go, and how hard to press on what is in the way."""
        return self.gripper.action_features

    @property
    def is_connected(self) -> bool:
        """True if the gripper can be asked."""
        return self.gripper.is_connected

    @property
    def is_calibrated(self) -> bool:
        """True if the daemon knows the travel."""
        return self.gripper.is_calibrated

    def connect(self, calibrate: bool = True) -> None:
        """Connect and enable. With `calibrate` ask to calibrate a gripper that is not.

        Without, such a gripper stays disabled: for `lerobot-calibrate`. Raises what its `start`
        raises; nothing is left connected then.
        """
        try:
            self.gripper.connect()
            if calibrate and not self.is_calibrated:
                self.calibrate()
            self.prepare()
            if calibrate or self.is_calibrated:
                self.configure()
        except BaseException:
            self.disconnect()
            raise

    def prepare(self) -> None:
        """Get ready what else there is, before the motor is enabled."""

    def configure(self) -> None:
        """Enable the motor, and have the jaws follow or be slack, or the daemon teleoperate."""
        self.gripper.start()

    def calibrate(self) -> None:
        """Ask, then probe both stops; the daemon saves what it finds."""
        self.gripper.calibrate()

    def disconnect(self) -> None:
        """Disconnect the gripper."""
        self.gripper.disconnect()


class BesideArm(GripperDevice):
    """Such a gripper at an arm, whose part comes first."""

    arm: Robot | Teleoperator

    @property
    def action_features(self) -> dict[str, type]:
        """The arm's and the gripper's."""
        return {**without_gripper(self.arm.action_features), **super().action_features}

    @property
    def is_connected(self) -> bool:
        """True if both are."""
        return self.arm.is_connected and super().is_connected

    @property
    def is_calibrated(self) -> bool:
        """True if both are."""
        return self.arm.is_calibrated and super().is_calibrated

    def connect(self, calibrate: bool = True) -> None:
        """Connect both; neither stays connected when one cannot be."""
        self.arm.connect(calibrate)
        super().connect(calibrate)

    def calibrate(self) -> None:
        """Calibrate the arm in its way, then ask for the gripper."""
        self.arm.calibrate()
        super().calibrate()

    def disconnect(self) -> None:
        """Disconnect both."""
        try:
            super().disconnect()
        finally:
            if self.arm.is_connected:
                self.arm.disconnect()


def without_gripper(values: dict[str, Any]) -> dict[str, Any]:
    """Return an arm's values without those of the gripper that it has by itself."""
    return {name: value for name, value in values.items() if not name.startswith("gripper.")}
