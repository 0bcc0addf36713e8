"""`LiteGrip`, with the vendor SDK's names: a gripper that a daemon drives for this program.

It only asks; whatever decides or moves is the daemon's.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from litegrip_client.actions import GripperActions
from litegrip_client.blocking import wait
from litegrip_client.link import Link

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any, overload

    from litegrip_client.lease import Lease
    from litegrip_client.motion_config import MotionConfig
    from litegrip_client.results import GripperState
    from litegrip_client.subscription import EventSubscription, Subscription


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
        from litegrip_client.core.gripper import Gripper  # noqa: PLC0415 - see above

        self._link = Link(channel, can_id, socket_path, disable_on_disconnect=disable_on_disconnect)
        super().__init__(Gripper(self._link, mount, motion_config))

    # Connection

    def connect(self) -> None:
        """Connect to the daemon, unless connected, and load the constructor's `mount`, if any.

        Raises `ConnectError` when there is none (it tells how to start one), `CommandError` when
        its channel or CAN id is another or the mount cannot be loaded.
        """
        wait(self._core.connect())

    def disconnect(self) -> None:
        """Disconnect; disables the motor first if this object enabled it and should.

        Raises the error of the disabling; the connection is closed all the same.
        """
        wait(self._core.disconnect())

    def __enter__(self) -> LiteGrip:
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        wait(self._core.__aexit__(kind, error, trace))

    @property
    def is_connected(self) -> bool:
        """True if calls can be made."""
        return self._core.is_connected

    @property
    def channel(self) -> str:
        """The daemon's channel."""
        return self._core.channel

    @property
    def disable_on_disconnect(self) -> bool:
        """True if the end of the connection disables the motor that this object enabled.

        Setting it counts for `disconnect`; for a crash counts what it was on `enable`.
        """
        return self._core.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._core.disable_on_disconnect = value

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
        "hold", "relax" or "disable"; when it is taken over, the taker says. Raises `LeaseError`
        that names the owner. After a loss all that moves, and `disable`, raises `LeaseError`
        (`lease_lost`), until `lease` or `enable` asks for the gripper again.
        """
        from litegrip_client.lease import Lease  # noqa: PLC0415 - see the package

        return Lease(self._core.lease(purpose, ttl_s=ttl_s, wait_s=wait_s, on_lost=on_lost))

    def take_lease(self, why: str, *, jaws: str = "hold") -> None:
        """Take the lease from whoever has it, for good reason: it is told to the loser.

        Its motion ends; the jaws then keep what they hold, or do what `jaws` says: "relax" (go
        slack) or "disable".

        Only from the same user, or as an admin of the daemon's configuration; else raises
        `NotPermittedError`.
        """
        wait(self._core.take_lease(why, jaws=jaws))

    # Stop

    def stop(self, level: str = "hold", why: str | None = None) -> GripperState:
        """Stop the gripper, whoever moves it, until `clear_stop`.

        `level` is "hold", "relax" or "disable". May be called by any thread, and by a signal
        handler while its thread waits for a motion. It goes by the daemon's socket for stops,
        which no flood of requests delays, else as any other request; a reason is cut to 80
        characters there. A software stop: no replacement for the switch that cuts the power.
        """
        return wait(self._core.stop(level, why))

    def clear_stop(self) -> GripperState:
        """Clear a stop, so that the motor may be enabled and moved again. Moves nothing.

        Raises `StoppedError` (`sent_before_stop`) for a stop of which nothing had told this object:
        look at the state, and clear again.
        """
        return wait(self._core.clear_stop())

    # Reading

    def get_state(self) -> GripperState:
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`."""
        return wait(self._core.get_state())

    if TYPE_CHECKING:

        @overload
        def states(
            self, hz: float = 20.0, fields: None = None, batch: int = 1
        ) -> Subscription[GripperState]: ...

        @overload
        def states(
            self, hz: float, fields: Sequence[str], batch: int = 1
        ) -> Subscription[dict[str, Any]]: ...

    def states(self, hz: float = 20.0, fields: Sequence[str] | None = None, batch: int = 1) -> Any:
        """Iterate over states, `hz` times a second (0.1 to 200), until closed.

        With `fields`, each is a dictionary of these only. A slow reader misses states, but what
        it gets is new. To be used as `with gripper.states(50) as states:`.

        A `batch` of up to 50 spares both sides the work of single messages, for who wants every
        state of 200 Hz and not at once: they come one by one, but as late as the last of a batch.
        """
        from litegrip_client import samples  # noqa: PLC0415 - see above

        connection = self._link.connection
        if fields is None:
            feed = samples.StateFeed(hz, None, samples.whole_state, batch=batch)
            return connection.subscribe(feed)
        return connection.subscribe(samples.StateFeed(hz, fields, samples.some_fields, batch=batch))

    def events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Iterate over what happens from now on (jobs, stops, faults, ...), until closed.

        Each is an `Event`; with `kinds` only these come ("job_ended", "object_lost", ...), without
        it all but "refused". None is missed; who leaves thousands unread gets a `ConnectError`.
        `recent` of what this returns has the last ones from before. To be used as
        `with gripper.events() as events:`.
        """
        return self._link.connection.subscribe_events(kinds)

    def health(self) -> dict[str, Any]:
        """Return the daemon's figures of its own: its verdict, the bus, the ticks, the clients."""
        return wait(self._core.health())

    def info(self) -> dict[str, Any]:
        """Return what does not change: versions, the motor's registers, ranges, calibration."""
        return wait(self._core.info())

    def jobs(self) -> list[dict[str, Any]]:
        """Return the running jobs and the ended ones that are still kept, of all clients."""
        return wait(self._core.jobs())

    @property
    def mount(self) -> str | None:
        """Which way the motor is mounted, "normal" or "reverse"; None until calibrated."""
        return wait(self._core.mount())
