"""Robots."""

import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from draccus import ChoiceRegistry
from lerobot import made as make_robot_from_config

__all__ = ["Robot", "RobotConfig", "make_robot_from_config"]


@dataclass(kw_only=True)
class RobotConfig(ChoiceRegistry):
    """What each robot has."""

    choices: ClassVar[dict[str, type]] = {}

    id: str | None = None
    calibration_dir: Path | None = None

    def __post_init__(self) -> None:
        for camera in getattr(self, "cameras", {}).values():
            if None in (camera.width, camera.height, camera.fps):
                raise ValueError("a camera needs width, height and fps")


class Robot(abc.ABC):
    """A robot; without one of these methods it cannot be made."""

    config_class: type[RobotConfig]
    name: str

    def __init__(self, config: RobotConfig) -> None:
        self.id = config.id

    @property
    @abc.abstractmethod
    def observation_features(self) -> dict[str, Any]:
        """What an observation has."""

    @property
    @abc.abstractmethod
    def action_features(self) -> dict[str, Any]:
        """What an action has."""

    @property
    @abc.abstractmethod
    def is_connected(self) -> bool:
        """True if it can be asked."""

    @abc.abstractmethod
    def connect(self, calibrate: bool = True) -> None:
        """Connect."""

    @property
    @abc.abstractmethod
    def is_calibrated(self) -> bool:
        """True if it is."""

    @abc.abstractmethod
    def calibrate(self) -> None:
        """Calibrate."""

    @abc.abstractmethod
    def configure(self) -> None:
        """Configure."""

    @abc.abstractmethod
    def get_observation(self) -> dict[str, Any]:
        """Return an observation."""

    @abc.abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send an action; return what was sent."""

    @abc.abstractmethod
    def disconnect(self) -> None:
        """Disconnect."""
