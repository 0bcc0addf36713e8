"""Cameras."""

import abc
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from draccus import ChoiceRegistry
from lerobot import made


@dataclass(kw_only=True)
class CameraConfig(ChoiceRegistry):
    """What each camera has."""

    choices: ClassVar[dict[str, type]] = {}

    fps: int | None = None
    width: int | None = None
    height: int | None = None


class Camera(abc.ABC):
    """A camera."""

    def __init__(self, config: CameraConfig) -> None:
        self.fps, self.width, self.height = config.fps, config.width, config.height

    @staticmethod
    @abc.abstractmethod
    def find_cameras() -> list[dict[str, Any]]:
        """List those that are there."""

    @property
    @abc.abstractmethod
    def is_connected(self) -> bool:
        """True if it can be asked."""

    @abc.abstractmethod
    def connect(self, warmup: bool = True) -> None:
        """Connect."""

    @abc.abstractmethod
    def read(self) -> Any:
        """Take an image."""

    @abc.abstractmethod
    def async_read(self, timeout_ms: float = ...) -> Any:
        """Return the newest image that was not returned before."""

    @abc.abstractmethod
    def read_latest(self, max_age_ms: int = ...) -> Any:
        """Return the newest image, even again; LeRobot says that it will demand this one."""

    @abc.abstractmethod
    def disconnect(self) -> None:
        """Disconnect."""


def make_cameras_from_configs(camera_configs: Mapping[str, CameraConfig]) -> dict[str, Camera]:
    """Make cameras."""
    return {name: made(config) for name, config in camera_configs.items()}
