"""What the portals of one process do together, for all grippers that they make local.

They take the samples of a machine's grippers by one subscription, and say in one message which of
their clients live.
"""

import asyncio
import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

import zenoh

from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.messages import Ask, BadMessageError, Reply, packed
from litegrip_fleet.wire.network import Answered, ask, hand_over, the_newest
from litegrip_fleet.wire.together import (
    MOST_LIVES,
    Life,
    Sample,
    packed_lives,
    replies_in,
    samples_in,
)

_log = logging.getLogger(__name__)

TICK_S = 0.05
MOST_PUBLICATIONS = 256
"""So many wait for the event loop at most; older ones give way."""


class Living(Protocol):
    """A client whose life is shown; `alone_s` is when that was done by a message of its own."""

    alone_s: float

    @property
    def place(self) -> Place:
        """Its gripper."""

    @property
    def session(self) -> str:
        """The name of its session."""

    def replied(self, reply: Reply | None, sent_s: float) -> None:
        """Take the gateway's reply."""

    def show_alone(self, message: Ask) -> None:
        """Show its life by a message of its own."""


class Together:
    """All portals of a process, which are of one user and one role.

    `ticks` are called again and again with the time, and what is known by then of the states of
    processes. `takers` take a sample for a gripper, with the gripper by whose key it came.
    """

    def __init__(self, session: Callable[[], zenoh.Session | None], user: str, role: str) -> None:
        self.name = f"{secrets.token_hex(8)}-all"
        """The part of the keys where gateways send samples to, and are told who lives."""

        self.ticks: list[Callable[[float, dict[int, str | None]], None]] = []
        self.takers: dict[Place, Callable[[Sample, Place], None]] = {}
        self.is_ticking = False
        self._session = session
        self._user = user
        self._role = role
        self._heard: dict[Place, tuple[zenoh.Session, zenoh.Subscriber[Any]]] = {}
        self._waiting: deque[tuple[Place, bytes]] = deque(maxlen=MOST_PUBLICATIONS)
        self._is_due = threading.Event()
        self._living: dict[Place, list[tuple[Living, Ask]]] = {}

    async def run(self) -> None:
        """Do what is due for all portals; until cancelled."""
        while True:
            await asyncio.sleep(TICK_S)
            self.tick(time.monotonic())

    def tick(self, now_s: float) -> None:
        """Do what is due."""
        states: dict[int, str | None] = {}
        if (session := self._session()) is not None:
            for carrier in list(self._heard):
                self.listen(session, carrier)
        self.is_ticking = True
        try:
            for tick in self.ticks:
                tick(now_s, states)
        finally:
            self.is_ticking = False
        living, self._living = self._living, {}
        for carrier, those in living.items():
            self._show(carrier, those)

    # Samples --------------------------------------------------------------------------------------

    def listen(self, session: zenoh.Session, carrier: Place) -> None:
        """Have the samples taken that come by a gripper's key; again after another session's."""
        if carrier in self._heard and self._heard[carrier][0] is session:
            return
        loop = asyncio.get_running_loop()
        subscriber = session.declare_subscriber(carrier.to(self._user, self.name), the_newest())
        self._heard[carrier] = (session, subscriber)

        def take(sample: zenoh.Sample) -> None:
            self._waiting.append((carrier, sample.payload.to_bytes()))
            if not self._is_due.is_set():
                self._is_due.set()
                loop.call_soon_threadsafe(self._take)

        hand_over(subscriber, take, f"states by {carrier}")

    def _take(self) -> None:
        """Take one publication; others have their turn before the next one."""
        self._is_due.clear()
        try:
            carrier, payload = self._waiting.popleft()
        except IndexError:
            return
        if self._waiting and not self._is_due.is_set():
            self._is_due.set()
            asyncio.get_running_loop().call_soon(self._take)
        try:
            samples = samples_in(payload)
        except BadMessageError as error:
            _log.debug("%s: %s", carrier, error)
            return
        for sample in samples:
            taker = self.takers.get(Place(carrier.site, sample.gripper))
            if taker is not None:
                taker(sample, carrier)

    # Signs of life --------------------------------------------------------------------------------

    def shows(self, client: Living, carrier: Place, message: Ask) -> None:
        """Have a client's life shown, with that of others whose gateway's messages go that way."""
        self._living.setdefault(carrier, []).append((client, message))

    def _show(self, carrier: Place, living: list[tuple[Living, Ask]]) -> None:
        """Say who lives; one goes alone, each in its turn.

        Only an answer to a message of its own shows that two gateways offer its gripper.
        """
        alone = min(living, key=lambda one: one[0].alone_s)
        alone[0].show_alone(alone[1])
        others = [one for one in living if one is not alone]
        for begin in range(0, len(others), MOST_LIVES):
            self._show_many(carrier, others[begin : begin + MOST_LIVES])

    def _show_many(self, carrier: Place, living: list[tuple[Living, Ask]]) -> None:
        session = self._session()
        if session is None:
            return
        lives = [
            Life(client.place.gripper, client.session, message.got, message.at_s)
            for client, message in living
        ]
        sent_s = time.monotonic()
        key = carrier.rpc(self._user, self.name, self._role)
        future = ask(
            session,
            key,
            packed_lives(lives),
            packed(Ask("lives")),
            asyncio.get_running_loop(),
            within_s=1.0,
        )
        future.add_done_callback(lambda done: self._shown(done.result(), living, sent_s))

    def _shown(
        self, answers: list[Answered], living: list[tuple[Living, Ask]], sent_s: float
    ) -> None:
        if len(answers) > 1:  # two gateways have this gripper: each session asks for itself
            for client, message in living:
                client.show_alone(message)
            return
        for answer in answers:
            try:
                replies = replies_in(answer.payload)
            except BadMessageError as error:
                _log.debug("%s: %s", answer.key, error)
                return
            for client, _message in living:
                client.replied(replies.get((client.place.gripper, client.session)), sent_s)
