"""What `watch` shows of a gripper, kept up to date: its state, its events, who is there, how it is.

A daemon that goes is waited for. How it is shown is not known here.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator

from litegrip_client.connection import Connection
from litegrip_client.errors import ConnectError
from litegrip_client.feeds import Event, EventFeed

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.ctl.way import Way

EVENTS = 8
_LOOK_EVERY_S = 1.0
_TRY_EVERY_S = 0.5


class Scene:
    """What is known now; None for what is not. `trouble` says why no daemon answers.

    `others` is how many other clients are connected, `lease` and `health` are the daemon's answers.
    """

    def __init__(self) -> None:
        self.state: dict[str, Any] | None = None
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.others: int | None = None
        self.lease: dict[str, Any] | None = None
        self.health: dict[str, Any] | None = None
        self.trouble: str | None = None


def scenes(way: Way, connection: Connection, hz: float) -> Iterator[Scene]:
    """Return the same scene again with each state and each trouble; does not end by itself.

    Begins with a `connection` and makes another one by `way` whenever it is lost. Raises
    `LiteGripError` when a daemon is there and refuses.
    """
    scene, connected = Scene(), connection
    while True:
        try:
            yield from _connected(scene, connected, hz)
        except ConnectError as error:
            scene.trouble = error.message
        while scene.trouble is not None:
            yield scene
            time.sleep(_TRY_EVERY_S)
            try:
                connected = way.connect()
                scene.trouble = None
            except ConnectError as error:
                scene.trouble = error.message


def _connected(scene: Scene, connection: Connection, hz: float) -> Iterator[Scene]:
    with connection:
        feed = EventFeed(None)
        look_s = 0.0
        with connection.subscribe(feed), connection.subscribe_state(hz) as samples:
            scene.events.clear()
            scene.events.extend(feed.recent)
            for sample in samples:
                scene.state = sample.state
                while feed.inbox:  # filled by whoever reads the samples
                    event = feed.take()
                    if event is not None:
                        scene.events.append(event)
                if time.monotonic() >= look_s:
                    _look(scene, connection)
                    look_s = time.monotonic() + _LOOK_EVERY_S
                yield scene


def _look(scene: Scene, connection: Connection) -> None:
    """Ask for what is not sent by itself."""
    rows = connection.call("clients.list")["clients"]
    scene.others = sum(not row.get("is_me") for row in rows)
    scene.lease = connection.call("lease.get")
    scene.health = connection.call("health")
