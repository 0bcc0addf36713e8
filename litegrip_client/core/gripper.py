"""A gripper that a daemon drives for this program: everything but how to wait for the daemon.

It only sends requests; the daemon decides and moves.
"""

from __future__ import annotations

from types import TracebackType

from litegrip_client.core.base import state_of
from litegrip_client.core.calibration_actions import CalibrationActions
from litegrip_client.core.link import ACTION_TIMEOUT_S, Link
from litegrip_client.core.motion_actions import MotionActions
from litegrip_client.core.motor_actions import MotorActions
from litegrip_client.core.setpoints import SetpointActions
from litegrip_client.core.stopping import stop
from litegrip_client.core.teleop import TeleopActions
from litegrip_client.core.trajectory_actions import TrajectoryActions
from litegrip_client.results import GripperState
from litegrip_client.warn import leave

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: what is seldom needed takes its time to import
    from typing import Any

    from litegrip_client.core.lease import Lease
    from litegrip_client.core.wire import Wire
    from litegrip_client.motion_config import MotionConfig


class GripperActions(
    MotorActions,
    MotionActions,
    SetpointActions,
    TrajectoryActions,
    TeleopActions,
    CalibrationActions,
):
    """All actions of the gripper at the other end of a link."""


class Gripper(GripperActions):
    """The actions, the connection, the lease, the stop, and what can be asked."""

    def __init__(self, link: Link, mount: str | None, motion_config: MotionConfig | None) -> None:
        """Raise `CommandError` for what cannot be a mount or a `MotionConfig`."""
        super().__init__(link, motion_config)
        self._template: str | None = None
        if mount is not None:
            from litegrip_client.calibration_files import check_template  # noqa: PLC0415 - see above

            self._template = check_template(mount)

    # Connection

    async def connect(self) -> None:
        """Connect to the daemon, unless connected, and load the constructor's `mount`, if any."""
        await self._link.open(self._begin)

    async def _begin(self, wire: Wire) -> None:
        if self._template is not None:
            call = wire.prepare_guarded("calibration.load", {"template": self._template})
            await wire.run(call, ACTION_TIMEOUT_S)

    async def disconnect(self) -> None:
        """Disconnect; first disable the motor if this object enabled it and should disable it."""
        await self._link.close()

    async def __aenter__(self) -> Any:
        await self.connect()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await leave(self.disconnect, error)

    @property
    def is_connected(self) -> bool:
        """True if calls can be made."""
        return self._link.is_open

    @property
    def channel(self) -> str:
        """The daemon's channel."""
        return self._link.channel

    @property
    def disable_on_disconnect(self) -> bool:
        """True if the end of the connection disables the motor that this object enabled."""
        return self._link.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._link.disable_on_disconnect = bool(value)

    # The lease

    def lease(
        self,
        purpose: str | None = None,
        *,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str = "hold",
    ) -> Lease:
        """Take the lease: `async with gripper.lease("sorting", wait_s=10):`."""
        from litegrip_client.core.lease import Lease  # noqa: PLC0415 - see above

        wish = {"purpose": purpose, "ttl_s": ttl_s, "wait_s": wait_s, "on_lost": on_lost}
        return Lease(self._link, wish)

    async def take_lease(self, why: str, *, jaws: str = "hold") -> None:
        """Take the lease from its present owner; the owner is notified of the reason `why`.

        The owner's motion ends. The jaws then keep what they hold, or follow `jaws`: "relax" (no
        torque) or "disable".
        """
        await self._link.take(why, jaws)

    # Stop

    async def stop(self, level: str = "hold", why: str | None = None) -> GripperState:
        """Stop the gripper for all clients until `clear_stop`: "hold", "relax" or "disable"."""
        params = {"level": level} if why is None else {"level": level, "why": why}
        return state_of(await stop(self._link, params))

    async def clear_stop(self) -> GripperState:
        """Clear a stop: the motor may then be enabled and moved again. Moves nothing.

        Raises `StoppedError` (`sent_before_stop`) for a stop that this object did not know of:
        look at the state, and clear again.
        """
        wire = self._link.wire
        return state_of(await wire.run(wire.prepare_guarded("stop.clear", {})))

    # Reading

    async def get_state(self) -> GripperState:
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`."""
        return GripperState.from_wire(await self._link.wire.call("state.get"))

    async def health(self) -> dict[str, Any]:
        """Return the daemon's health: its verdict, the bus, the ticks, the clients."""
        from litegrip_client.voices import in_python  # noqa: PLC0415 - see above

        figures = await self._link.wire.call("health")
        reasons = figures.get("reasons", ())
        return {**figures, "reasons": [in_python(str(reason)) for reason in reasons]}

    async def info(self) -> dict[str, Any]:
        """Return what does not change: versions, the motor's registers, ranges, calibration."""
        return await self._link.wire.call("info.get")

    async def jobs(self) -> list[dict[str, Any]]:
        """Return the running jobs and the ended ones that are still kept, of all clients."""
        jobs: list[dict[str, Any]] = (await self._link.wire.call("job.list"))["jobs"]
        return jobs

    async def mount(self) -> str | None:
        """Return which way the motor is mounted, "normal" or "reverse"; None until calibrated."""
        return (await self.get_state()).mount
