"""What all actions of a gripper have in common: the link, the tunables, and how a motion is run.

This module must not know single motions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

from litegrip_client.core.link import Link
from litegrip_client.core.motions import Motion
from litegrip_client.errors import CommandError
from litegrip_client.motion_config import MotionConfig
from litegrip_client.results import GripperState, MoveProgress

if TYPE_CHECKING:
    from litegrip_client.core.setpoints import SetpointStream

ProgressCallback: TypeAlias = Callable[[MoveProgress], None]
"""Called where the call was made, at most 20 times a second."""


class ActionBase:
    """Runs the motions of one object over its link, with its tunables."""

    def __init__(self, link: Link, motion_config: MotionConfig | None = None) -> None:
        """Raise `CommandError` for what is no `MotionConfig`."""
        self._link = link
        self._frames: SetpointStream | None = None
        self.motion_config = MotionConfig() if motion_config is None else motion_config

    @property
    def motion_config(self) -> MotionConfig:
        """The tunables of this object's motions: what was set in them is sent with each call."""
        return self._motion_config

    @motion_config.setter
    def motion_config(self, value: MotionConfig) -> None:
        if not isinstance(value, MotionConfig):
            raise CommandError(
                f"motion_config is {value!r:.60}, it must be a MotionConfig",
                reason="invalid_params",
                data={"parameter": "motion_config"},
            )
        self._motion_config = value

    def _configured(self, params: dict[str, Any]) -> dict[str, Any]:
        """Add the tunables that were set to the parameters of a call."""
        config = self._motion_config.to_wire()
        return {**params, "config": config} if config else params

    async def _run(
        self, method: str, params: dict[str, Any], progress: ProgressCallback | None
    ) -> dict[str, Any]:
        """Wait for a motion's result; whatever else ends the waiting cancels the motion."""

        def report(data: dict[str, Any]) -> None:
            if progress is not None:
                progress(MoveProgress.from_wire(data))

        await self._end_frames()
        return await Motion(self._link.wire, method, params, report).run()

    async def _command(
        self, method: str, params: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call that is answered soon, and that must never act after a stop."""
        await self._end_frames()
        wire = self._link.wire
        return await wire.run(wire.prepare_guarded(method, params), timeout_s)

    async def _end_frames(self) -> None:
        """Let no set-point of `send_mit_frame` stand in the way of what comes next."""
        if self._frames is not None:
            frames, self._frames = self._frames, None
            await frames.close()


def state_of(result: dict[str, Any]) -> GripperState:
    """Return the state that comes with a result."""
    return GripperState.from_wire(result.get("state", {}))
