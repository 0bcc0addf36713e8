"""What the portals of one process do together, for all grippers that they make local.

They hear what gateways send by one subscription, and say in one message which of their clients
live.
"""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable, Coroutine
from typing import Any, Protocol

import zenoh

from litegrip_fleet.wire.keys import Place, place_in
from litegrip_fleet.wire.messages import Ask, BadMessageError, Reply, packed
from litegrip_fleet.wire.network import MOST_WAITING, Answered, Ring, ask, hand_over, the_newest
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
    processes. `takers` take a sample for a gripper, with the gripper by whose key it came; `pushed`
    take what is sent to one session of a gripper.
    """

    def __init__(self, session: Callable[[], zenoh.Session | None], user: str, role: str) -> None:
        self.identity = secrets.token_hex(8)
        """The begin of all sessions' names: so one subscription hears what is sent to them."""

        self.name = f"{self.identity}-all"
        """The part of the keys where gateways send samples to, and are told who lives."""

        self.heard_by: zenoh.Session | None = None
        """The network's session that hears what is sent to those of the clients."""

        self.ticks: list[Callable[[float, dict[int, str | None]], None]] = []
        self.takers: dict[Place, Callable[[Sample, Place], None]] = {}
        self.pushed: dict[Place, Callable[[zenoh.Sample], Coroutine[Any, Any, None]]] = {}
        self.is_ticking = False
        self._session = session
        self._user = user
        self._role = role
        self._subscriber: zenoh.Subscriber[Any] | None = None
        self._living: dict[Place, list[tuple[Living, Ask]]] = {}

    async def run(self) -> None:
        """Do what is due for all portals; until cancelled."""
        while True:
            await asyncio.sleep(TICK_S)
            self.tick(time.monotonic())

    def tick(self, now_s: float) -> None:
        """Do what is due."""
        states: dict[int, str | None] = {}
        session = self._session()
        if session is not None and session is not self.heard_by:
            self._listen(session)  # before a session needs it: the router has to hear of it
        self.is_ticking = True
        try:
            for tick in self.ticks:
                tick(now_s, states)
        finally:
            self.is_ticking = False
        living, self._living = self._living, {}
        for carrier, those in living.items():
            self._show(carrier, those)

    # What gateways send ---------------------------------------------------------------------------

    def _listen(self, session: zenoh.Session) -> None:
        """Have all taken that gateways send, by this session of the network's."""
        loop = asyncio.get_running_loop()
        publications = Ring(loop, self._take, MOST_PUBLICATIONS)
        pushes = {place: Ring(loop, take, MOST_WAITING) for place, take in self.pushed.items()}
        key = Place("*", "*").to(self._user, f"{self.identity}-$*")
        self.heard_by, self._subscriber = session, session.declare_subscriber(key, the_newest())

        def take(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            place = place_in(key)
            if place is not None and key.endswith(self.name):
                publications.put((place, sample.payload.to_bytes()))
            elif place in pushes:
                pushes[place].put(sample)

        hand_over(self._subscriber, take, "what gateways send")

    async def _take(self, publication: tuple[Place, bytes]) -> None:
        """Take the samples of a publication, which came by the key of a gripper."""
        carrier, payload = publication
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
