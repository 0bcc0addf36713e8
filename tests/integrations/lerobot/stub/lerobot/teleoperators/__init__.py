"""Teleoperators."""

import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from draccus import ChoiceRegistry
from lerobot import made as make_teleoperator_from_config

__all__ = ["Teleoperator", "TeleoperatorConfig", "make_teleoperator_from_config"]


@dataclass(kw_only=True)
class TeleoperatorConfig(ChoiceRegistry):
    """What each teleoperator has."""

    choices: ClassVar[dict[str, type]] = {}

    id: str | None = None
    calibration_dir: Path | None = None


class Teleoperator(abc.ABC):
    """A teleoperator; without one of these methods it cannot be made."""

    config_class: type[TeleoperatorConfig]
    name: str

    def __init__(self, config: TeleoperatorConfig) -> None:
        self.id = config.id

    @property
    @abc.abstractmethod
    def action_features(self) -> dict[str, Any]:
        """What an action has."""

    @property
    @abc.abstractmethod
    def feedback_features(self) -> dict[str, Any]:
        """What feedback has."""

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
    def get_action(self) -> dict[str, Any]:
        """Return an action."""

    @abc.abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Send feedback."""

    @abc.abstractmethod
    def disconnect(self) -> None:
        """Disconnect."""
