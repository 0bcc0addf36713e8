"""`LiteGrip`, with the vendor SDK's names: a gripper that a daemon drives for this program.

It only sends requests; the daemon decides and moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from litegrip_client.threads.actions import GripperActions
from litegrip_client.threads.blocking import BlockingSession
from litegrip_client.threads.sdk_gripper import SdkGripper
from litegrip_client.values.tracebacks import shortened

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Any, NoReturn, overload

    from litegrip_client.line.feeds import EventSubscription, Subscription
    from litegrip_client.line.latest import Latest
    from litegrip_client.values.calibration import GripperConfig
    from litegrip_client.values.motion_config import MotionConfig
    from litegrip_client.values.results import GripperState
    from litegrip_client.values.terms import Voice


@shortened
class LiteGrip(SdkGripper):
    """The gripper on `channel`, as `with LiteGrip("can0") as gripper:`.

    Without a `channel` it is that of LITEGRIP_CHANNEL in the environment, else that of the daemon
    at `socket_path` or LITEGRIPD_SOCKET, else can0. The constructor does not connect. `can_id`
    must be the id of the daemon's motor; None accepts any. The end of the `with` block disables
    the motor if this object enabled it. If `disable_on_disconnect` is false, the daemon continues
    to hold instead. Threads may share an object; a child process must make its own after a fork.

    With `mount` "normal" or "reverse" the daemon loads the nominal calibration of that mount on
    connecting, as `load_template` does. It replaces the calibration in use. `motion_config`
    belongs to this object: it changes nothing for other clients.

    `mst_id`, `motor_type` and `config` say what the daemon's gripper must be; `connect` raises
    `CommandError` for another one. They change nothing; only `config.max_stroke_mm` is used by
    `zero` and the other calibrations of this object. `canfd_mode` must be false: the motor
    speaks classic CAN.

    Errors, `health` and warnings name calls of this class: "clear it with gripper.clear_stop()".
    A program whose user has other words gives a `voice`, a function of a method of the protocol, a
    parameter, and the method that was asked. It returns the user's words, or None to leave the
    protocol's: `voice=lambda method, parameter, asked: {"stop.clear": "~/clear"}.get(method)`.
    None never means a call of this class, which such a user cannot make. What a voice raises is
    logged, once, and leaves the protocol's words as well.

    `GripperActions` describes all actions.
    """

    def __init__(
        self,
        channel: str | None = None,
        can_id: int | None = None,
        *,
        mount: str | None = None,
        disable_on_disconnect: bool = True,
        socket_path: str | None = None,
        motion_config: MotionConfig | None = None,
        mst_id: int | None = None,
        canfd_mode: bool | None = None,
        motor_type: str | None = None,
        config: GripperConfig | None = None,
        voice: Voice | None = None,
    ) -> None:
        """Raise `CommandError` for what cannot be a channel, a mount or a `MotionConfig`."""
        from litegrip_client.core.gripper import Gripper  # noqa: PLC0415 - see above
        from litegrip_client.values.results import GripperState  # noqa: PLC0415 - see above

        # Loops make this one call, so it goes without the core's coroutines.
        self._read_state = GripperState.from_wire
        expected: dict[str, Any] = {}
        if any(given is not None for given in (config, mst_id, canfd_mode, motor_type)):
            from litegrip_client.core import expected as sdk  # noqa: PLC0415 - seldom needed

            channel, can_id, expected = sdk.expectations(
                channel, can_id, mst_id, canfd_mode, motor_type, config
            )
        self._session = BlockingSession(
            channel,
            can_id,
            socket_path,
            disable_on_disconnect=disable_on_disconnect,
            expected=expected,
            voice=voice,
        )
        super().__init__(Gripper(self._session, mount, motion_config, config))

    def __enter__(self) -> LiteGrip:
        self.connect()
        return self

    def __repr__(self) -> str:
        what = "connected" if self.is_connected else "not connected"
        return f"<LiteGrip {self.channel}, {what}>"

    if not TYPE_CHECKING:  # else a type checker would find every name here

        def __getattr__(self, name: str) -> NoReturn:
            from litegrip_client.core.gripper import no_member  # noqa: PLC0415 - an error

            raise no_member(self, name)

        def __setattr__(self, name: str, value: object) -> None:
            """Refuse a name that nothing here reads; a subclass may have others."""
            if type(self) is LiteGrip and name[0] != "_" and not hasattr(LiteGrip, name):
                from litegrip_client.core.gripper import no_member  # noqa: PLC0415 - an error

                raise no_member(self, name, is_assigned=True)
            super().__setattr__(name, value)

        def __aenter__(self) -> NoReturn:
            """Name the class that was meant."""
            text = "LiteGrip is for threads: `with`; for `async with`: litegrip_client.aio.LiteGrip"
            raise TypeError(text)

        __aexit__ = __aenter__

    @property
    def actions(self) -> GripperActions:
        """The actions without the connection; this object has them, too."""
        return self

    def get_state(self, wait: bool = True) -> GripperState:  # noqa: ARG002 - the vendor's
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`.

        `wait` makes no difference: the daemon asks the motor in every period, also while nobody
        calls, so the state is as new as one that was waited for.
        """
        return self._read_state(self._session.connection.call("state.get"))

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

        With `fields`, each item is a dictionary of these only. A slow reader misses states,
        and gets some that are 0.5 s old: `age_s` of a state is its age when it was taken. `dropped`
        counts what it missed, and what the daemon had no time to send (`health` has its late
        ticks). For the newest of all there is `latest`. Use it as
        `with gripper.states(50) as states:`.

        A `batch` of up to 50 states per message is for a data set: every state of 200 Hz comes, one
        by one, but not before the last of a batch. While the reader is busy they wait, for a second
        and more.
        """
        from litegrip_client.line import feeds  # noqa: PLC0415 - see above

        connection = self._session.connection
        kept_s = feeds.KEPT_S if batch == 1 else math.inf
        if fields is None:
            feed = feeds.StateFeed(hz, None, feeds.whole_state, kept_s, batch)
            return connection.subscribe(feed)
        return connection.subscribe(feeds.StateFeed(hz, fields, feeds.some_fields, kept_s, batch))

    def events(self, kinds: Sequence[str] | None = None) -> EventSubscription:
        """Iterate over events from now on (jobs, stops, faults, ...), until closed.

        Each item is an `Event`. With `kinds` only these come ("job_ended", "object_lost", ...);
        without it all but "refused" come. None is lost, but a reader that leaves thousands unread
        gets a `ConnectError`. `recent` of the returned object has the latest earlier events. Use
        it as `with gripper.events() as events:`.
        """
        return self._session.connection.subscribe_events(kinds)

    def latest(self, hz: float = 50.0) -> Latest:
        """Keep the newest state at hand, `hz` times a second (0.1 to 200), until closed.

        Its `state` never waits, nor asks the daemon: for a loop of its own rate. Use it as
        `with gripper.latest() as latest:`.
        """
        from litegrip_client.line.latest import Latest, NewestFeed  # noqa: PLC0415 - see above

        feed = NewestFeed(hz)
        self._session.connection.begin(feed)
        return Latest(self._session.connection, feed)
