"""An arm, its leader and a camera that are nowhere: what `make lerobot` puts beside the gripper.

The arm has a gripper of its own, which the composite leaves out.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from lerobot.cameras import Camera, CameraConfig
from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

JOINTS = ("shoulder.pos", "elbow.pos", "gripper.pos")


@RobotConfig.register_subclass("trial_arm")
@dataclass(kw_only=True)
class TrialArmConfig(RobotConfig):
    """`type: trial_arm`."""

    port: str
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


@TeleoperatorConfig.register_subclass("trial_arm_leader")
@dataclass(kw_only=True)
class TrialArmLeaderConfig(TeleoperatorConfig):
    """`type: trial_arm_leader`."""


@CameraConfig.register_subclass("trial_camera")
@dataclass(kw_only=True)
class TrialCameraConfig(CameraConfig):
    """`type: trial_camera`."""


class _Device:
    is_connected = False
    is_calibrated = True

    def connect(self, calibrate: bool = True) -> None:
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def calibrate(self) -> None:
        """Nothing is calibrated."""

    def configure(self) -> None:
        """Nothing is configured."""


class TrialArm(_Device, Robot):
    """Joints that are where they were sent."""

    config_class = TrialArmConfig
    name = "trial_arm"

    def __init__(self, config: TrialArmConfig) -> None:
        super().__init__(config)
        self.cameras: dict[str, Camera] = {}
        self._joints = dict.fromkeys(JOINTS, 0.0)

    @property
    def observation_features(self) -> dict[str, Any]:
        return dict.fromkeys(JOINTS, float)

    action_features = observation_features

    def get_observation(self) -> dict[str, Any]:
        return dict(self._joints)

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        assert set(action) == {"shoulder.pos", "elbow.pos"}, action
        self._joints |= {name: float(value) for name, value in action.items()}
        return action


class TrialArmLeader(_Device, Teleoperator):
    """A leader that waves."""

    config_class = TrialArmLeaderConfig
    name = "trial_arm_leader"
    feedback_features: dict[str, Any] = {}  # noqa: RUF012 - as the base class declares it

    def __init__(self, config: TrialArmLeaderConfig) -> None:
        super().__init__(config)
        self._count = 0

    @property
    def action_features(self) -> dict[str, Any]:
        return dict.fromkeys(JOINTS, float)

    def get_action(self) -> dict[str, Any]:
        self._count += 1
        return {"shoulder.pos": float(self._count), "elbow.pos": -1.0, "gripper.pos": -1.0}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """There is none."""


class TrialCamera(Camera):
    """Images that are brighter one after the other."""

    is_connected = False

    def __init__(self, config: TrialCameraConfig) -> None:
        super().__init__(config)
        self._count = 0

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        return []

    def connect(self, warmup: bool = True) -> None:
        self.is_connected = True

    def read(self) -> Any:
        self._count += 1
        return np.full((self.height, self.width, 3), self._count % 256, np.uint8)

    def async_read(self, timeout_ms: float = 200.0) -> Any:
        return self.read()

    def read_latest(self, max_age_ms: int = 500) -> Any:
        return self.read()

    def disconnect(self) -> None:
        self.is_connected = False
