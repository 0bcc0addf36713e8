"""The LiteGrip gripper for LeRobot, through its daemon: docs/lerobot.md describes it.

LeRobot imports this package at the start of each of its commands, and finds a robot's class beside
its configuration, by the name without `Config`.
"""

from lerobot_robot_litegrip.config import (
    LiteGripFollowerConfig,
    LiteGripLeaderConfig,
    LiteGripLeaderWithArmConfig,
    LiteGripSceneCameraConfig,
    LiteGripWithArmConfig,
)
from lerobot_robot_litegrip.follower import LiteGripFollower, LiteGripWithArm
from lerobot_robot_litegrip.leader import LiteGripLeader, LiteGripLeaderWithArm
from lerobot_robot_litegrip.scene_camera import LiteGripSceneCamera

__all__ = [
    "LiteGripFollower",
    "LiteGripFollowerConfig",
    "LiteGripLeader",
    "LiteGripLeaderConfig",
    "LiteGripLeaderWithArm",
    "LiteGripLeaderWithArmConfig",
    "LiteGripSceneCamera",
    "LiteGripSceneCameraConfig",
    "LiteGripWithArm",
    "LiteGripWithArmConfig",
]
