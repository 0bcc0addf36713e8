"""Teleoperators: a gripper that a hand moves, alone or as the hand of any arm's leader."""

from __future__ import annotations

from typing import Any

import draccus
from lerobot.teleoperators import (
    Teleoperator,
    TeleoperatorConfig,
    make_teleoperator_from_config,
)

from lerobot_robot_litegrip.config import (
    LeaderSettings,
    LiteGripLeaderConfig,
    LiteGripLeaderWithArmConfig,
    settings_of_arm,
)
from lerobot_robot_litegrip.follower import without_gripper
from lerobot_robot_litegrip.mapping import POS, TORQUE, action_of
from lerobot_robot_litegrip.watched import WatchedGripper


class Leader(WatchedGripper):
    """A gripper whose jaws are slack; in mode "daemon" they push back what is gripped."""

    def __init__(self, settings: LeaderSettings) -> None:
        super().__init__(settings)
        self._leads = settings

    def start(self) -> None:
        """Enable, and have the jaws slack; in mode "daemon" they hold until a follower is there.

        A daemon that leads already goes on: then nothing is enabled here, nor disabled at the end.
        """
        if self._leads.mode == "stream":
            self.enable()
            self._gripper.zero_gravity()
        elif not self.teleoperates("master"):
            self.enable()
            self._gripper.teleop_start(
                "master",
                port=self._leads.teleop_port,
                reflect_n=self._leads.reflect_n or None,
            )
        self.begin()

    def lead(self) -> dict[str, float]:
        """Return where the hand has the jaws. Raises `StaleFiguresError` and `StoppedError`.

        In mode "daemon" it raises `TeleopNotActiveError` once teleoperation has ended.
        """
        if self._leads.mode == "daemon":
            self.refuse_end_of_teleoperation()
        else:
            self.refuse_stop()
        return action_of(self.fresh().state, self._leads.torque_nm)


class LiteGripLeader(Teleoperator):
    """`--teleop.type=litegrip_leader`."""

    config_class: type[TeleoperatorConfig] = LiteGripLeaderConfig
    name = "litegrip_leader"

    def __init__(self, config: LiteGripLeaderConfig | LiteGripLeaderWithArmConfig) -> None:
        super().__init__(config)
        self.config = config
        self.leader = Leader(config)

    @property
    def action_features(self) -> dict[str, type]:
        """Where the jaws are, and how hard the follower may press."""
        return {POS: float, TORQUE: float}

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: forces are reflected by the daemons, 100 times a second, in mode "daemon"."""
        return {}

    @property
    def is_connected(self) -> bool:
        """True if the gripper can be asked."""
        return self.leader.is_connected

    @property
    def is_calibrated(self) -> bool:
        """True if the daemon knows the travel."""
        return self.leader.is_calibrated

    def connect(self, calibrate: bool = True) -> None:
        """Connect and enable. With `calibrate` ask to calibrate a gripper that is not.

        Without, such a gripper stays disabled: for `lerobot-calibrate`. Raises what
        `Leader.start` raises; nothing is left connected then.
        """
        try:
            self.leader.connect()
            if calibrate and not self.is_calibrated:
                self.calibrate()
            if calibrate or self.is_calibrated:
                self.configure()
        except BaseException:
            self.disconnect()
            raise

    def configure(self) -> None:
        """Enable the motor, and have the jaws slack, or the daemon lead."""
        self.leader.start()

    def calibrate(self) -> None:
        """Ask, then probe both stops; the daemon saves what it finds."""
        self.leader.calibrate()

    def get_action(self) -> dict[str, Any]:
        """Return where the jaws are by now, within what a follower can do."""
        return dict(self.leader.lead())

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: there are no `feedback_features`."""

    def disconnect(self) -> None:
        """Disconnect the gripper."""
        self.leader.disconnect()


class LiteGripLeaderWithArm(LiteGripLeader):
    """`--teleop.type=litegrip_leader_with_arm`: without what the arm says of its gripper."""

    config_class = LiteGripLeaderWithArmConfig
    name = "litegrip_leader_with_arm"

    def __init__(self, config: LiteGripLeaderWithArmConfig) -> None:
        super().__init__(config)
        arm = settings_of_arm(config.arm, "so101_leader")
        self.arm: Teleoperator = make_teleoperator_from_config(
            draccus.decode(TeleoperatorConfig, arm)
        )

    @property
    def action_features(self) -> dict[str, type]:
        """The arm's and the gripper's."""
        return {**without_gripper(self.arm.action_features), **super().action_features}

    @property
    def feedback_features(self) -> dict[str, type]:
        """The arm's."""
        return without_gripper(self.arm.feedback_features)

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

    def get_action(self) -> dict[str, Any]:
        """Return the arm's action and the gripper's."""
        return {**without_gripper(self.arm.get_action()), **super().get_action()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Send the arm its feedback."""
        self.arm.send_feedback(feedback)

    def disconnect(self) -> None:
        """Disconnect both."""
        try:
            super().disconnect()
        finally:
            if self.arm.is_connected:
                self.arm.disconnect()
