"""`LiteGrip`, with the vendor SDK's names: a gripper that a daemon drives for this program.

It only sends requests; the daemon decides and moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from litegrip_client.actions import GripperActions
from litegrip_client.blocking import wait
from litegrip_client.link import Link

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Any, overload

    from litegrip_client.lease import Lease
    from litegrip_client.motion_config import MotionConfig
    from litegrip_client.results import GripperState
    from litegrip_client.subscription import EventSubscription, Subscription


class LiteGrip(GripperActions):
    """The gripper on `channel`, as `with LiteGrip("can0") as gripper:`.

    The constructor does not connect. `can_id` must be the id of the daemon's motor; None accepts
    any. The end of the `with` block disables the motor if this object enabled it. If
    `disable_on_disconnect` is false, the daemon continues to hold instead. Threads may share an
    object; a child process must make its own after a fork.

    With `mount` "normal" or "reverse" the daemon loads the nominal calibration of that mount on
    connecting, as `load_template` does. It replaces the calibration in use. `motion_config`
    belongs to this object: it changes nothing for other clients.

    `GripperActions` and its bases describe all actions.
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

        Raises `ConnectError` when no daemon answers (its hint says how to start one). Raises
        `CommandError` when the daemon has another channel or CAN id, or cannot load the mount.
        """
        wait(self._core.connect())

    def disconnect(self) -> None:
        """Disconnect; first disable the motor if this object enabled it.

        The motor stays enabled if `disable_on_disconnect` is false. Raises the error of
        disabling, but closes the connection in any case.
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

        `disconnect` uses the present value; after a crash the value at `enable` counts.
        """
        return self._core.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._core.disable_on_disconnect = value

    @property
    def actions(self) -> GripperActions:
        """The actions without the connection; this object has them, too."""
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
        """Take the lease, for exclusive control: `with gripper.lease("sorting", wait_s=10):`.

        `enable` takes the lease automatically, until the end of the gripper's `with` block.
        `wait_s` is how long to wait for another owner. With `ttl_s` the lease is lost when no
        call is made for that time; a longer motion is ended. `on_lost` is what the jaws do when
        the lease is lost: "hold", "relax" or "disable". In a take-over, the new owner decides.
        Raises `LeaseError`, which names the owner. After a loss, `disable` and every motion raise
        `LeaseError` (`lease_lost`) until `lease` or `enable` takes the lease again.
        """
        from litegrip_client.lease import Lease  # noqa: PLC0415 - see the package

        return Lease(self._core.lease(purpose, ttl_s=ttl_s, wait_s=wait_s, on_lost=on_lost))

    def take_lease(self, why: str, *, jaws: str = "hold") -> None:
        """Take the lease from its present owner; the owner is notified of the reason `why`.

        The owner's motion ends. The jaws then keep what they hold, or follow `jaws`: "relax" (no
        torque) or "disable".

        Raises `NotPermittedError` unless the owner is the same user, or this user is an admin in
        the daemon's configuration.
        """
        wait(self._core.take_lease(why, jaws=jaws))

    # Stop

    def stop(self, level: str = "hold", why: str | None = None) -> GripperState:
        """Stop the gripper, whichever client moves it, until `clear_stop`.

        `level` is "hold", "relax" or "disable". Any thread may call it, and also a signal
        handler while its thread waits for a motion. The stop uses the daemon's stop socket, which
        other requests cannot delay; there a reason is cut to 80 characters. Without that socket it
        is sent as a usual request. This is a software stop: it does not replace the switch that
        cuts the power.
        """
        return wait(self._core.stop(level, why))

    def clear_stop(self) -> GripperState:
        """Clear a stop: the motor may then be enabled and moved again. Moves nothing.

        Raises `StoppedError` (`sent_before_stop`) for a stop that this object did not know of:
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

        With `fields`, each item is a dictionary of these only. A slow reader misses states, but
        always gets new ones. Use it as `with gripper.states(50) as states:`.

        A `batch` of up to 50 states per message costs both sides less work: use it to get every
        state of 200 Hz. The states still come one by one, but not before the last of a batch.
        """
        from litegrip_client import samples  # noqa: PLC0415 - see above

        connection = self._link.connection
        if fields is None:
            feed = samples.StateFeed(hz, None, samples.whole_state, batch=batch)
            return connection.subscribe(feed)
        return connection.subscribe(samples.StateFeed(hz, fields, samples.some_fields, batch=batch))

    def events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Iterate over events from now on (jobs, stops, faults, ...), until closed.

        Each item is an `Event`. With `kinds` only these come ("job_ended", "object_lost", ...);
        without it all but "refused" come. None is lost, but a reader that leaves thousands unread
        gets a `ConnectError`. `recent` of the returned object has the latest earlier events. Use
        it as `with gripper.events() as events:`.
        """
        return self._link.connection.subscribe_events(kinds)

    def health(self) -> dict[str, Any]:
        """Return the daemon's health: its verdict, the bus, the ticks, the clients."""
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
