"""Turns: users first, then each user's connections; who used little is served beyond the flood."""

import contextlib
import socket
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from litegripd.io import server as server_module
from litegripd.io.server import Server
from litegripd.io.sockets import peer_of
from litegripd.rpc.sessions import Peer, Session
from tests.io.loop import Loop, line

pytestmark = pytest.mark.alone

POLITE = 1000
FLOODING = (2001, 2002, 2003)
CONNECTIONS = 20


class Users:
    """Gives each connection that is let in the user that it is to be of."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self._uid = 0

    def peer_of(self, connected: socket.socket) -> Peer:
        return replace(peer_of(connected), uid=self._uid)

    def connect(self, uid: int) -> socket.socket:
        """Connect as a user."""
        self._uid = uid
        client = self.loop.connect()
        clients = self.loop.server.clients + 1
        self.loop.until(lambda: self.loop.server.clients == clients)
        return client


class Flood:
    """Connections that are never without something to be served."""

    def __init__(self, users: Users, text: bytes) -> None:
        self._text = text
        self._sockets = [users.connect(uid) for uid in FLOODING for _ in range(CONNECTIONS)]

    def go_on(self, _now_s: float = 0.0) -> None:
        """Take what is answered and send more, as far as the kernel takes it."""
        for connected in self._sockets:
            with contextlib.suppress(BlockingIOError):
                while connected.recv(1 << 20):
                    pass
            with contextlib.suppress(BlockingIOError):
                connected.send(self._text * 50)


@pytest.fixture
def users(loop: Loop, monkeypatch: pytest.MonkeyPatch) -> Users:
    made = Users(loop)
    monkeypatch.setattr(server_module, "peer_of", made.peer_of)
    return made


def uids_served(loop: Loop) -> list[int]:
    return [session.peer.uid for session in loop.service.served]


def test_a_user_with_one_connection_is_served_as_much_as_three_with_many(
    loop: Loop, users: Users, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever is served while this busy machine runs something else is not charged for that."""
    lag_s = time.monotonic() - time.thread_time()
    clock = SimpleNamespace(monotonic=lambda: lag_s + time.thread_time())
    monkeypatch.setattr(server_module, "time", clock)
    flood = Flood(users, line("echo", 1))
    polite = users.connect(POLITE)
    flood.go_on()
    polite.send(line("echo", 2) * 40)
    loop.until(lambda: uids_served(loop).count(POLITE) == 40)
    order = uids_served(loop)
    begin = order.index(POLITE)
    gone_by = len(order[begin:]) - 40  # of the 60 connections of the three
    assert gone_by <= 2 * 40 * len(FLOODING)
    assert set(order[:begin]) <= set(FLOODING)


def test_who_comes_amid_a_flood_is_next_but_for_a_few(
    loop: Loop, users: Users, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A round of the loop serves a few, and then each of the three may be served once."""
    flood = Flood(users, line("echo", 1))
    polite = users.connect(POLITE)
    asked: list[int] = []
    handle, service = loop.service.handle, loop.service

    def handle_and_ask(
        session: Session, text: bytes, now_s: float, received_s: float | None
    ) -> None:
        if len(service.served) % 100 == 50 and session.peer.uid != POLITE:
            asked.append(len(service.served))
            polite.send(line("echo", 2))
        handle(session, text, now_s, received_s)

    monkeypatch.setattr(service, "handle", handle_and_ask)
    loop.at_tick = flood.go_on
    flood.go_on()
    loop.until(lambda: uids_served(loop).count(POLITE) >= 20)
    order = uids_served(loop)
    answered = [number for number, uid in enumerate(order) if uid == POLITE]
    waits = [answer - ask for ask, answer in zip(asked, answered, strict=False)]
    assert max(waits) <= 8


@pytest.mark.parametrize("uid", [POLITE, FLOODING[0]])
def test_one_users_connections_take_turns(loop: Loop, users: Users, uid: int) -> None:
    clients = [users.connect(uid) for _ in range(4)]
    for client in clients:
        client.send(line("echo", 1) * 25)
    loop.until(lambda: len(loop.service.served) == 100)
    order = [session.identity for session in loop.service.served]
    for begin in range(0, 100, 4):
        assert len(set(order[begin : begin + 4])) == 4


def test_who_used_little_is_served_when_a_flood_has_used_up_its_share(
    loop: Loop, users: Users, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flood's lines alone take longer than all requests have; the period is not over yet."""
    flood = Flood(users, line("echo", 1))
    polite = users.connect(POLITE)
    asked: list[int] = []
    served: list[int] = []
    service, reactor, handle = loop.service, loop.reactor, loop.service.handle
    pending_light = vars(Server)["pending_light"].fget

    def ask_late(server: Server) -> bool:
        """Ask: the share is used up now."""
        if len(asked) == len(served) < 5:
            asked.append(reactor.ticks)
            polite.send(line("echo", 1))
        return bool(pending_light(server))

    def handle_and_note(
        session: Session, text: bytes, now_s: float, received_s: float | None
    ) -> None:
        if session.peer.uid == POLITE:
            served.append(reactor.ticks)
        handle(session, text, now_s, received_s)

    monkeypatch.setattr(Server, "pending_light", property(ask_late))
    monkeypatch.setattr(service, "handle", handle_and_note)
    loop.at_tick = lambda _now_s: flood.go_on() if reactor.ticks % 10 == 0 else None
    flood.go_on()
    loop.until(lambda: len(served) == 5)
    assert sum(ask == serve for ask, serve in zip(asked, served, strict=True)) >= 2


def test_who_used_much_waits_for_the_next_period(loop: Loop, users: Users) -> None:
    client = users.connect(POLITE)
    client.send(line("echo", 1) * 3)
    loop.server.take_turn(next(iter(loop.server._connections.values())))
    before = loop.server.pending_light
    much_s = 1e6 * loop.reactor.period_s  # ticks that are lost let it fade
    loop.server._turns.charge(POLITE, much_s)
    assert (before, loop.server.pending, loop.server.pending_light) == (True, True, False)
    loop.server.serve(float("inf"), light_only=True)
    assert loop.service.served == []
    loop.read(client, 3)


def test_what_was_used_fades(loop: Loop, users: Users) -> None:
    users.connect(POLITE)
    turns, (connection,) = loop.server._turns, loop.server._connections.values()
    turns.add(connection)
    turns.charge(POLITE, loop.reactor.period_s)
    before = turns.has_light
    turns.next_period(5)
    assert (before, turns.has_light) == (False, True)


def test_who_left_nothing_behind_is_forgotten(loop: Loop, users: Users) -> None:
    for uid in range(15):
        client = users.connect(uid)
        client.send(line("echo", 1))
        loop.read(client, 1)
        client.close()
        loop.until(lambda: loop.server.clients == 0)
    loop.run(30)
    loop.connect().send(line("echo", 1))
    loop.until(lambda: len(loop.service.served) == 16)
    assert len(loop.server._turns._users) <= 5
