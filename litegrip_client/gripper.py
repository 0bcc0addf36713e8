"""`LiteGrip`, with the vendor SDK's names: a gripper that a daemon drives for this program.

It only asks; whatever decides or moves is the daemon's.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

from litegrip_client.actions import GripperActions, ProgressCallback
from litegrip_client.connection import Connection
from litegrip_client.errors import LiteGripError
from litegrip_client.link import Link
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any, overload

    from litegrip_client.results import EnableResult, GripperState, MoveResult
    from litegrip_client.subscription import StateSample, StateSubscription


class LiteGrip:
    """The gripper on `channel`, as `with LiteGrip("can0") as gripper:`.

    The constructor connects to nothing. `can_id` None takes the motor that the daemon has;
    given, it must be that one. Leaving the `with` block disables the motor if this object
    enabled it, unless `disable_on_disconnect` is false: then the daemon goes on holding. Threads
    may share an object; after a fork the child makes its own.
    """

    def __init__(
        self,
        channel: str = "can0",
        can_id: int | None = None,
        *,
        disable_on_disconnect: bool = True,
        socket_path: str | None = None,
    ) -> None:
        """Raise `CommandError` for what cannot be a channel."""
        self._link = Link(channel, can_id, socket_path, disable_on_disconnect=disable_on_disconnect)
        self._actions = GripperActions(self._link)

    # Connection

    def connect(self) -> None:
        """Connect to the daemon, unless connected.

        Raises `ConnectError` when there is none (it tells how to start one), `CommandError` when
        its channel or CAN id is another.
        """
        self._link.open()

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
        if error is None:
            self.disconnect()
            return
        try:
            self.disconnect()
        except LiteGripError as second:
            warn(f"on leaving after {type(error).__name__}: {second}")

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

    # Motor and motions

    @property
    def actions(self) -> GripperActions:
        """The low-level actions that the methods here forward to."""
        return self._actions

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor: see `GripperActions.enable`."""
        return self._actions.enable(retries)

    def disable(self) -> bool:
        """Disable the motor: see `GripperActions.disable`."""
        return self._actions.disable()

    def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the stop: see `GripperActions.open`."""
        return self._actions.open(speed_mm_s, progress=progress)

    def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the stop: see `GripperActions.close`."""
        return self._actions.close(speed_mm_s, progress=progress)

    def hold(self) -> GripperState:
        """Hold the measured position from now on."""
        connection = self._link.connection
        return _state_of(connection.run(connection.prepare_guarded("motion.hold", {})))

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
                return _state_of(another.call("stop", params))
        return _state_of(connection.call("stop", params))

    def clear_stop(self) -> GripperState:
        """Clear a stop, so that the motor may be enabled and moved again. Moves nothing."""
        return _state_of(self._link.connection.call("stop.clear"))

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


def _state_of(result: dict[str, Any]) -> GripperState:
    return _state(result.get("state", {}))


def _whole(sample: StateSample) -> GripperState:
    return _state(sample.state)


def _as_it_is(sample: StateSample) -> dict[str, Any]:
    return sample.state
