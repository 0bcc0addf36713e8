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
from lerobot_robot_litegrip.device import BesideArm, GripperDevice, without_gripper
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

    @property
    def action_features(self) -> dict[str, type]:
        """Where the jaws are, and how hard the follower may press."""
        return {POS: float, TORQUE: float}


class LiteGripLeader(GripperDevice, Teleoperator):
    """`--teleop.type=litegrip_leader`."""

    config_class: type[TeleoperatorConfig] = LiteGripLeaderConfig
    name = "litegrip_leader"

    def __init__(self, config: LiteGripLeaderConfig | LiteGripLeaderWithArmConfig) -> None:
        super().__init__(config)
        self.config = config
        self.gripper: Leader = Leader(config)

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: forces are reflected by the daemons, 100 times a second, in mode "daemon"."""
        return {}

    def get_action(self) -> dict[str, Any]:
        """Return where the jaws are by now, within what a follower can do."""
        return dict(self.gripper.lead())

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: there are no `feedback_features`."""


class LiteGripLeaderWithArm(BesideArm, LiteGripLeader):
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
    def feedback_features(self) -> dict[str, type]:
        """The arm's."""
        return without_gripper(self.arm.feedback_features)

    def get_action(self) -> dict[str, Any]:
        """Return the arm's action and the gripper's."""
        return {**without_gripper(self.arm.get_action()), **super().get_action()}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Send the arm its feedback."""
        self.arm.send_feedback(feedback)
