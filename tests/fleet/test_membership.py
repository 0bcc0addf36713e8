"""A part that a router keeps out, though it lets others in, comes by another id."""

import logging
import socket
import threading
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from litegrip_fleet.admin.guests import MOST_OF_ONE, MOST_WITHOUT_A_ROW, Guests
from litegrip_fleet.wire.membership import OUT_FOR_S, OWN_TURN_S, Membership
from litegrip_fleet.wire.network import Network, NetworkError, cut

STEP_S = 0.1
OUT, IN = False, True


class Session:
    """A session that a router lets in or not."""

    def __init__(self) -> None:
        self.is_in = True
        self.closed = threading.Event()
        self.info = SimpleNamespace(routers_zid=lambda: ["router"] if self.is_in else [])

    def close(self) -> None:
        self.closed.set()


class Scene:
    """A membership whose sessions are let in when the test says so."""

    def __init__(self) -> None:
        self.opened: list[Future[zenoh.Session]] = []
        self.now_s = 0.0
        self.member = Membership(Network(["tls/router:1"]), self._open)
        self.first = self.let_in(0)
        assert self.member.session is cast(Any, self.first)

    def _open(self, _network: Network) -> "Future[zenoh.Session]":
        self.opened.append(Future())
        return self.opened[-1]

    def let_in(self, number: int) -> Session:
        session = Session()
        self.opened[number].set_result(cast(Any, session))
        return session

    def go(self, for_s: float, is_there: bool) -> None:
        for _ in range(round(for_s / STEP_S)):
            self.member.look(self.now_s, is_there=is_there)
            self.now_s += STEP_S


def test_who_is_let_in_again_keeps_the_session() -> None:
    scene = Scene()
    scene.go(OUT_FOR_S, OUT)
    assert len(scene.opened) == 1
    scene.go(5.0, IN)
    assert len(scene.opened) == 1
    assert scene.member.kept_out == 0


def test_who_is_kept_out_comes_by_another_id(caplog: pytest.LogCaptureFixture) -> None:
    scene = Scene()
    scene.go(OUT_FOR_S + 2 * STEP_S, OUT)
    other = scene.let_in(1)
    scene.go(OWN_TURN_S, OUT)
    assert scene.member.session is cast(Any, scene.first)  # the own one has its turn
    assert "another id" not in caplog.text
    scene.go(2 * STEP_S, OUT)
    assert scene.member.session is cast(Any, other)
    assert scene.first.closed.wait(10.0)
    assert not other.closed.is_set()
    assert scene.member.kept_out == 1
    assert "did not let us in for 2." in caplog.text
    scene.go(1.0, IN)
    scene.go(OUT_FOR_S + 2 * STEP_S, OUT)
    assert len(scene.opened) == 3  # and again


def test_the_own_id_that_is_let_in_late_stays() -> None:
    scene = Scene()
    scene.go(OUT_FOR_S + 2 * STEP_S, OUT)
    other = scene.let_in(1)
    scene.go(OWN_TURN_S - STEP_S, OUT)
    scene.go(STEP_S, IN)
    assert scene.member.session is cast(Any, scene.first)
    assert other.closed.wait(10.0)
    assert scene.member.kept_out == 0


def test_another_session_that_is_opened_too_late_is_closed() -> None:
    scene = Scene()
    scene.go(60.0, OUT)
    assert len(scene.opened) == 2  # one, however long nobody answers
    scene.go(STEP_S, IN)
    assert scene.let_in(1).closed.wait(10.0)


def test_another_session_that_cannot_be_opened_or_is_lost_is_tried_again() -> None:
    scene = Scene()
    scene.go(OUT_FOR_S + 2 * STEP_S, OUT)
    scene.opened[1].set_exception(NetworkError("no"))
    scene.go(2 * STEP_S, OUT)
    lost = scene.let_in(2)
    lost.is_in = False
    scene.go(OWN_TURN_S + 2 * STEP_S, OUT)
    assert lost.closed.wait(10.0)
    assert scene.member.session is cast(Any, scene.first)
    assert len(scene.opened) == 4


def test_nobody_is_tried_for_who_was_never_let_in() -> None:
    opened: list[Future[zenoh.Session]] = []

    def open_one(_network: Network) -> "Future[zenoh.Session]":
        opened.append(Future())
        return opened[-1]

    member = Membership(Network(), open_one)
    for step in range(100):
        member.look(step * 1.0, is_there=False)
    assert len(opened) == 1
    assert member.session is None


# The router ---------------------------------------------------------------------------------------


def test_guests_who_have_no_business_at_the_router_are_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    guests = Guests({"op1"}, {"robot1"})
    guests.came("op1", "a")
    guests.came("robot1", "b")
    guests.came("robot1", "b")
    assert caplog.messages == []
    guests.came("former", "c")
    assert [message.split(":")[0] for message in caplog.messages] == ["former is in no table"]
    caplog.clear()
    guests.came("op1", "b")
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("op1 has connected with the id of robot1")


def test_the_ids_of_a_gateway_that_comes_again_and_again_are_not_all_kept(
    caplog: pytest.LogCaptureFixture,
) -> None:
    guests = Guests({"op1"}, {"robot1"})
    for number in range(1000):
        guests.came("robot1", str(number))
    guests.came("op1", "0")
    assert caplog.messages == []
    guests.came("op1", "999")
    assert len(caplog.messages) == 1


def test_one_certificate_does_not_take_the_room_of_others() -> None:
    guests = Guests({"op1", "op2"}, {"robot1"})
    first = [("op1", f"op1 {number}") for number in range(MOST_OF_ONE)]
    others = [("op2", "op2"), ("robot1", "robot1")]
    assert guests.without_room([*first, *others]) == []
    assert guests.without_room([("op1", "late"), *first, *others]) == ["late"]
    assert guests.without_room([("op1", "late"), *first[1:], *others]) == []  # one has gone
    assert guests.without_room([first[0], ("op1", "late"), *first[1:]]) == [first[0][1]]
    strangers = [("former", f"{number}") for number in range(10)]
    assert len(guests.without_room(strangers)) == 10 - MOST_WITHOUT_A_ROW


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_peer_is_cut_off_and_no_other(host: str) -> None:
    with socket.create_server(
        (host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET
    ) as server:
        port = server.getsockname()[1]
        near = [socket.create_connection((host, port)) for _ in range(3)]
        far = [server.accept()[0] for _ in near]
    addresses = [f"tls/[{host}]:{one.getsockname()[1]}" for one in near]
    if ":" not in host:
        addresses = [one.replace("[", "").replace("]", "") for one in addresses]
    cut([addresses[0], addresses[2]])
    near[1].setblocking(False)
    assert (near[0].recv(1), near[2].recv(1)) == (b"", b"")
    with pytest.raises(BlockingIOError):
        near[1].recv(1)
    for one in (*near, *far):
        one.close()
