"""The base of a gripper's actions for threads: the core that they wait for."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from litegrip_client.core.base import ProgressCallback
    from litegrip_client.core.gripper import Gripper
    from litegrip_client.motion_config import MotionConfig

__all__ = ["ActionBase", "ProgressCallback"]


class ActionBase:
    """Waits for what the core does, with the tunables of one object."""

    def __init__(self, core: Gripper) -> None:
        self._core = core

    @property
    def motion_config(self) -> MotionConfig:
        """The tunables of this object's motions: what was set in them is sent with each call."""
        return self._core.motion_config

    @motion_config.setter
    def motion_config(self, value: MotionConfig) -> None:
        self._core.motion_config = value
