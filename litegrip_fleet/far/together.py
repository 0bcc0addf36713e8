"""What the gateways of one process do together, for all grippers of a machine.

They send samples of the state as one publication for each portal, and take the signs of life of a
portal's sessions in one message.
"""

import asyncio
import logging
import queue
import threading
import time
from collections.abc import Callable

import zenoh

from litegrip_fleet.wire.keys import Caller, Place
from litegrip_fleet.wire.membership import Membership
from litegrip_fleet.wire.messages import BadMessageError, Reply
from litegrip_fleet.wire.together import (
    Life,
    Sample,
    lives_in,
    packed_replies,
    packed_samples,
)

_log = logging.getLogger(__name__)

GATHER_EACH_S, GATHER_MOST_S = 0.001, 0.02
"""So long after the last publication, for each session, what comes waits for others: those of a few
sessions are not delayed, those of many cost 50 messages a second."""

LOOK_EVERY_S = 0.05
HELD_UP_S = 0.2
"""Where a look comes so late, signs of life have waited, too: they are taken before the next."""


class Publication:
    """Samples on their way to portals: the network is never waited for by the event loop.

    While it takes them as they come, none is left out. While it does not, the newest of each
    subscription replaces those before it. `sessions` have to be counted by whom they are.
    """

    def __init__(self, send: Callable[[str, bytes], None]) -> None:
        self.sessions = 0
        self._send = send
        self._waiting: list[tuple[str, Sample]] = []
        self._sent_s = 0.0
        self._is_due = False
        self._is_sending = False
        self._queue: queue.SimpleQueue[list[tuple[str, Sample]]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def add(self, key: str, sample: Sample) -> None:
        """Have a sample sent to a key: at once, or with those that come in the next moment."""
        self._waiting.append((key, sample))
        if not self._is_due:
            self._is_due = True
            loop = asyncio.get_running_loop()
            loop.call_at(max(loop.time(), self._sent_s + self._gather_s), self._go)

    @property
    def _gather_s(self) -> float:
        return min(GATHER_EACH_S * self.sessions, GATHER_MOST_S)

    def _go(self) -> None:
        loop = asyncio.get_running_loop()
        self._sent_s = loop.time()
        if self._is_sending:
            self._waiting = newest(self._waiting)
            loop.call_at(self._sent_s + GATHER_MOST_S, self._go)
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="states", daemon=True)
            self._thread.start()
        self._is_due, self._is_sending = False, True
        self._queue.put(self._waiting)
        self._waiting = []

    def _run(self) -> None:
        while True:
            by_key: dict[str, list[Sample]] = {}
            for key, sample in self._queue.get():
                by_key.setdefault(key, []).append(sample)
            try:
                for key, samples in by_key.items():
                    for payload in packed_samples(samples):
                        self._send(key, payload)
            finally:
                self._is_sending = False


def newest(waiting: list[tuple[str, Sample]]) -> list[tuple[str, Sample]]:
    """Return the last sample of each subscription, in the order of the first ones."""
    # A line names its subscription before its number: what is before that is the same for all.
    kept = {
        (one.gripper, one.session, one.line.partition(b',"seq":')[0]): (key, one)
        for key, one in waiting
    }
    return list(kept.values())


class Together:
    """All gateways of a process; `carrier` is the gripper by whose keys their messages go.

    `takers` give the reply to a sign of life at a gripper, None where there is none to give yet;
    `looks` are called again and again with the time.
    """

    def __init__(self, network: Membership, carrier: Place) -> None:
        self.carrier = carrier
        self.takers: dict[str, Callable[[Caller, Life], Reply | None]] = {}
        self.looks: list[Callable[[float], None]] = []
        self.publication = Publication(self._put)
        self._network = network
        self._looked_s = time.monotonic()
        self._is_held_up = False
        self._stop_loop: asyncio.AbstractEventLoop | None = None

    @property
    def stop_loop(self) -> asyncio.AbstractEventLoop:
        """The loop of all stops, on a thread of its own: nothing that a gateway does is before."""
        if self._stop_loop is None:
            self._stop_loop = asyncio.new_event_loop()
            threading.Thread(target=self._stop_loop.run_forever, name="stops", daemon=True).start()
        return self._stop_loop

    async def run(self) -> None:
        """Look after all sessions; until cancelled."""
        while True:
            await asyncio.sleep(LOOK_EVERY_S)
            self.look(time.monotonic())

    def look(self, now_s: float) -> None:
        """Look after all sessions; not where this process was held up, but then the next time."""
        self._is_held_up = now_s - self._looked_s > HELD_UP_S and not self._is_held_up
        self._looked_s = now_s
        if not self._is_held_up:
            for look in self.looks:
                look(now_s)

    def take(self, query: zenoh.Query, caller: Caller) -> None:
        """Take the signs of life of a user's sessions; each counts for a session of his alone."""
        payload = query.payload
        try:
            lives = lives_in(b"" if payload is None else payload.to_bytes())
        except BadMessageError:
            query.drop()
            return
        replies = []
        for life in lives:
            taker = self.takers.get(life.gripper)
            reply = None if taker is None else taker(caller, life)
            if reply is not None:
                replies.append((life, reply))
        with query:
            query.reply(query.key_expr, packed_replies(time.monotonic(), replies))

    def key(self, caller: Caller, name: str) -> str:
        """Return where the samples of a user's portal are sent, whose name for that is `name`."""
        return self.carrier.to(caller.user, name)

    def _put(self, key: str, payload: bytes) -> None:
        if (session := self._network.session) is None:
            return
        try:
            session.put(
                key,
                payload,
                congestion_control=zenoh.CongestionControl.DROP,
                # Behind what is asked and answered, in a queue of its own.
                priority=zenoh.Priority.INTERACTIVE_LOW,
                express=True,
            )
        except zenoh.ZError as error:  # replaced by another one meanwhile, and closed
            _log.debug("samples for %s are left out: %s", key, error)
