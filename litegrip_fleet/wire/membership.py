"""A part's place on the network, which another cannot keep it out of.

A router lets an id in once, whoever comes with it first. Each answer tells its gateway's id (zenoh
1.10 has no way to leave it out), so anybody with a certificate of the authority can wait with it
for a gap: a freeze, a router that restarts. Whoever is kept out so comes by another id.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Callable
from concurrent import futures

import zenoh

from litegrip_client.values.repeats import REPEATS
from litegrip_fleet.wire.network import (
    CONNECT_WITHIN_S,
    RETRY_EVERY_MS,
    Network,
    NetworkError,
    close,
    opening,
)

_log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.2
OUT_FOR_S = 0.5
"""Who has no router for so long tries by another id, too."""

OWN_TURN_S = 1.5e-3 * RETRY_EVERY_MS
"""So long the own id may come later than the other: by then zenoh has tried it again."""


class Membership:
    """One part's session on the network, replaced by another where a router keeps it out.

    `session` is there once a router has let it in. `run` looks after it until it is cancelled.
    """

    def __init__(
        self,
        network: Network,
        open_one: Callable[[Network], "futures.Future[zenoh.Session]"] = opening,
    ) -> None:
        self.begun = open_one(network)
        """Done with the first session."""

        self.kept_out = 0
        """How often a router kept its id out, and let another in."""

        self._network = network
        self._open_one = open_one
        self._session: zenoh.Session | None = None
        self._other: futures.Future[zenoh.Session] | None = None
        self._other_since_s: float | None = None
        self._out_since_s: float | None = None

    @property
    def session(self) -> zenoh.Session | None:
        """The session now, None before the first."""
        if self._session is None and self.begun.done() and self.begun.exception() is None:
            self._session = self.begun.result()
        return self._session

    async def run(self) -> None:
        """Log whether a router lets this part in, and come by another id where none does."""
        where = ", ".join(self._network.connect)
        begun_s, was_there = time.monotonic(), None
        while True:
            now_s, is_there = time.monotonic(), _is_let_in(self.session)
            if is_there and not was_there:
                _log.info("connected to a router (%s)", where, extra={REPEATS: True})
                was_there = True
            elif not is_there and was_there:
                _log.warning("the connection to the router is lost (%s): trying again", where)
                was_there = False
            elif was_there is None and now_s - begun_s > CONNECT_WITHIN_S:
                _log.warning("no router answers at %s: trying again", where)
                was_there = False
            self.look(now_s, is_there=is_there)
            await asyncio.sleep(LOOK_EVERY_S)

    def look(self, now_s: float, *, is_there: bool) -> None:
        """Try by another id where the own one is out; `is_there`: a router lets it in."""
        if is_there:
            self._out_since_s = None
            self._leave_other()
            return
        if self.session is None:  # nobody knows the first id
            return
        if self._out_since_s is None:
            self._out_since_s = now_s
        if self._other is None:
            if now_s - self._out_since_s >= OUT_FOR_S:
                self._other = self._open_one(self._network)
        elif self._other.done():
            self._judge(self._other, now_s, self._out_since_s)

    def close(self) -> None:
        """Leave the network."""
        self._leave_other()
        if (session := self.session) is not None:
            close(session)

    def _judge(
        self, other: "futures.Future[zenoh.Session]", now_s: float, out_since_s: float
    ) -> None:
        """Take the other session, if the own one has had its turn since that was let in."""
        if other.exception() is not None or not _is_let_in(other.result()):
            self._leave_other()
            return
        if self._other_since_s is None:
            self._other_since_s = now_s
        if now_s - self._other_since_s < OWN_TURN_S:
            return
        former, self._session = self._session, other.result()
        self._other = self._other_since_s = self._out_since_s = None
        self.kept_out += 1
        _log.error(
            "the router did not let us in for %.1f s, and lets us in by another id: it seems that"
            " somebody else is connected with ours, by a certificate of the same authority; the"
            " router's log says whose",
            now_s - out_since_s,
        )
        if former is not None:
            _close_aside(former)

    def _leave_other(self) -> None:
        other, self._other, self._other_since_s = self._other, None, None
        if other is not None:
            other.add_done_callback(_close_if_open)


def _is_let_in(session: zenoh.Session | None) -> bool:
    return session is not None and bool(session.info.routers_zid())


def _close_if_open(connecting: "futures.Future[zenoh.Session]") -> None:
    try:
        _close_aside(connecting.result())
    except NetworkError as error:
        _log.debug("no other session was opened: %s", error)


def _close_aside(session: zenoh.Session) -> None:
    """Close a session on a thread that nobody waits for: it may take long."""
    threading.Thread(target=close, args=(session,), name="close", daemon=True).start()
