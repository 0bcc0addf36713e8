"""`LiteGrip`, with the vendor SDK's names: a gripper that a daemon drives for this program.

It only asks; whatever decides or moves is the daemon's.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from litegrip_client.actions import GripperActions
from litegrip_client.base import state_of
from litegrip_client.connection import Connection
from litegrip_client.link import Link
from litegrip_client.warn import leave

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any, overload

    from litegrip_client.lease import Lease
    from litegrip_client.motion_config import MotionConfig
    from litegrip_client.results import GripperState
    from litegrip_client.subscription import StateSample, StateSubscription


class LiteGrip(GripperActions):
    """The gripper on `channel`, as `with LiteGrip("can0") as gripper:`.

    The constructor connects to nothing. `can_id` None takes the motor that the daemon has;
    given, it must be that one. Leaving the `with` block disables the motor if this object
    enabled it, unless `disable_on_disconnect` is false: then the daemon goes on holding. Threads
    may share an object; after a fork the child makes its own.

    `mount`, "normal" or "reverse", has the daemon load the nominal calibration of that mount
    when connecting, as `load_template` does, whatever it has. `motion_config` is this object's
    own: it changes nothing for other clients.

    All that makes the gripper do something stands in `GripperActions` and its bases.
    """

    def __init__(
        self,
        channel: str = "can0",
        can_id: int | None = None,
        *,
        mount: str | None = None,
        disable_on_disconnect: bool = True,
        socket_path: str | None = None,
        motion_config: MotionConfig | None = None,
    ) -> None:
        """Raise `CommandError` for what cannot be a channel, a mount or a `MotionConfig`."""
        link = Link(channel, can_id, socket_path, disable_on_disconnect=disable_on_disconnect)
        super().__init__(link, motion_config)
        self._template: str | None = None
        if mount is not None:
            from litegrip_client.calibration_files import check_template  # noqa: PLC0415 - see above

            self._template = check_template(mount)

    # Connection

    def connect(self) -> None:
        """Connect to the daemon, unless connected, and load the constructor's `mount`, if any.

        Raises `ConnectError` when there is none (it tells how to start one), `CommandError` when
        its channel or CAN id is another or the mount cannot be loaded.
        """
        if self._link.is_open:
            return
        self._link.open()
        if self._template is None:
            return
        try:
            self.load_template(self._template)
        except BaseException:
            self._link.close()
            raise

    def disconnect(self) -> None:
        """Disconnect; disables the motor first if this object enabled it and should.

        Raises the error of the disabling; the connection is closed all the same.
        """
        self._link.close()

    def __enter__(self) -> LiteGrip:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        leave(self.disconnect, error)

    @property
    def is_connected(self) -> bool:
        """Whether calls can be made."""
        return self._link.is_open

    @property
    def channel(self) -> str:
        """The daemon's channel."""
        return self._link.channel

    @property
    def disable_on_disconnect(self) -> bool:
        """Whether the end of the connection disables the motor that this object enabled.

        Setting it counts for `disconnect`; for a crash counts what it was on `enable`.
        """
        return self._link.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._link.disable_on_disconnect = bool(value)

    @property
    def actions(self) -> GripperActions:
        """The actions by themselves, which this object has as well."""
        return self

    # The lease

    def lease(
        self,
        purpose: str | None = None,
        *,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str = "hold",
    ) -> Lease:
        """Have the gripper to oneself: `with gripper.lease("sorting", wait_s=10):`.

        `enable` does it by itself, until the end of the block of the gripper. `wait_s` is how
        long to wait for others; with `ttl_s` the lease is lost when no call is made for so long
        (a motion that lasts longer is ended). `on_lost` is what the jaws do when it is lost:
        "hold", "relax" or "disable". Raises `LeaseError` that names the owner.
        """
        from litegrip_client.lease import Lease  # noqa: PLC0415 - see the package

        wish = {"purpose": purpose, "ttl_s": ttl_s, "wait_s": wait_s, "on_lost": on_lost}
        return Lease(self._link, wish)

    def take_lease(self, why: str) -> None:
        """Take the lease from whoever has it, for good reason: it is told to the loser.

        Only from the same user, or as an admin of the daemon's configuration; else raises
        `NotPermittedError`.
        """
        self._link.take(why)

    # Stop

    def stop(self, level: str = "hold", why: str | None = None) -> GripperState:
        """Stop the gripper, whoever moves it, until `clear_stop`.

        `level` is "hold", "relax" or "disable". May be called by any thread, and by a signal
        handler while its thread waits for a motion. A software stop: no replacement for the
        switch that cuts the power.
        """
        params = {"level": level} if why is None else {"level": level, "why": why}
        connection = self._link.connection
        if connection.is_waiting_here:
            with Connection(connection.path) as another:
                return state_of(another.call("stop", params))
        return state_of(connection.call("stop", params))

    def clear_stop(self) -> GripperState:
        """Clear a stop, so that the motor may be enabled and moved again. Moves nothing."""
        return state_of(self._link.connection.call("stop.clear"))

    # Reading

    def get_state(self) -> GripperState:
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`."""
        return _state(self._link.connection.call("state.get"))

    if TYPE_CHECKING:

        @overload
        def states(
            self, hz: float = 20.0, fields: None = None
        ) -> StateSubscription[GripperState]: ...

        @overload
        def states(self, hz: float, fields: Sequence[str]) -> StateSubscription[dict[str, Any]]: ...

    def states(self, hz: float = 20.0, fields: Sequence[str] | None = None) -> Any:
        """Iterate over states, `hz` times a second (0.1 to 200), until closed.

        With `fields`, each is a dictionary of these only. A slow reader misses states, but what
        it gets is new. To be used as `with gripper.states(50) as states:`.
        """
        connection = self._link.connection
        return connection.subscribe(hz, fields, _whole if fields is None else _as_it_is)

    def health(self) -> dict[str, Any]:
        """Return the daemon's figures of its own: its verdict, the bus, the ticks, the clients."""
        return self._link.connection.call("health")

    def info(self) -> dict[str, Any]:
        """Return what does not change: versions, the motor's registers, ranges, calibration."""
        return self._link.connection.call("info.get")

    def jobs(self) -> list[dict[str, Any]]:
        """Return the running jobs and the ended ones that are still kept, of all clients."""
        jobs: list[dict[str, Any]] = self._link.connection.call("job.list")["jobs"]
        return jobs

    @property
    def mount(self) -> str | None:
        """Which way the motor is mounted, "normal" or "reverse"; None until calibrated."""
        return self.get_state().mount


def _state(data: dict[str, Any]) -> GripperState:
    from litegrip_client.results import GripperState  # noqa: PLC0415 - see above

    return GripperState.from_wire(data)


def _whole(sample: StateSample) -> GripperState:
    return _state(sample.state)


def _as_it_is(sample: StateSample) -> dict[str, Any]:
    return sample.state
