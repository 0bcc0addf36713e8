"""A follower whose leader is not reached says why, and how far it has come; all on real sockets."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from litegripd.model.teleop import LinkOptions, Reach
from litegripd.teleop import ends
from litegripd.teleop.ends import Reaching
from litegripd.teleop.links import TeleopLinks
from tests.io.test_teleop_links import DEADLINE_S, FRAME, free_port, until

NOBODY = "no-such-host.invalid"


@contextmanager
def linked() -> Iterator[TeleopLinks]:
    links = TeleopLinks()
    try:
        yield links
    finally:
        links.close()


def wait(condition: Callable[[], bool]) -> None:
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s
        time.sleep(0.01)


def why(found: Reach | None) -> str:
    return "" if found is None or found.why is None else found.why


def test_a_name_that_does_not_resolve_is_said_to_be_one() -> None:
    with linked() as links:
        follower = links.open(LinkOptions("slave", host=NOBODY))
        until(follower, lambda: why(follower.status.reach) != "")
        found = follower.status.reach
        assert found is not None
        assert (found.state, follower.status.state) == ("resolving", "open")
        assert found.why is not None
        assert found.why.startswith(f"the name {NOBODY} does not resolve: ")


def test_a_port_where_nobody_listens_refuses_until_a_leader_is_there_and_again_after_it() -> None:
    port = free_port(socket.SOCK_STREAM)
    with linked() as following:
        follower = following.open(LinkOptions("slave", host="127.0.0.1", port=port))
        until(follower, lambda: "nobody listens at that port" in why(follower.status.reach))
        refused = follower.status.reach
        assert refused is not None
        assert refused.state == "connecting"
        with linked() as leading:
            leader = leading.open(LinkOptions("master", port=port))
            until(leader, lambda: leader.status.state == "open")
            until(follower, lambda: follower.status.reach == Reach("connected"))
            assert leader.status.reach is None
            heard: list[bytes] = []

            def is_heard() -> bool:
                leader.publish(FRAME, 0.0)
                heard.extend(one.payload for one in follower.receive(0.0))
                return bool(heard)

            until(follower, is_heard)
        until(follower, lambda: "nobody listens" in why(follower.status.reach))
        assert follower.status.reach is not None
        assert follower.status.reach.since_s is not None
        assert refused.since_s is not None
        assert follower.status.reach.since_s > refused.since_s


def test_a_port_at_which_something_else_listens_is_no_leaders(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ends, "_PATIENCE_S", 0.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        watching = Reaching("127.0.0.1", server.getsockname()[1], lambda: False)
        wait(lambda: "is no leader's link" in why(watching.reach))
        watching.close()


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (TimeoutError("timed out"), "10.0.0.9:7 does not answer: it is off, elsewhere, or"),
        (OSError(113, "No route to host"), "10.0.0.9:7 is unreachable: No route to host"),
        (OSError(101, "Network is unreachable"), "10.0.0.9:7 is unreachable: Network is"),
        (ConnectionRefusedError(111, "x"), "10.0.0.9:7 has refused the connection"),
    ],
)
def test_each_way_of_not_being_reached_is_told_apart(
    error: OSError, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Failing(socket.socket):
        def connect(self, _address: object) -> None:
            raise error

    monkeypatch.setattr("litegripd.teleop.ends.socket.socket", Failing)
    watching = Reaching("10.0.0.9", 7, lambda: False)
    wait(lambda: why(watching.reach) != "")
    watching.close()
    assert why(watching.reach).startswith(says)


def test_what_lasts_is_told_with_its_age() -> None:
    assert Reach("connecting").problem(5.0) is None
    assert Reach("connecting", "it is off", 2.0).problem(14.4) == "it is off (for 12 s)"
