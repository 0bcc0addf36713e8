"""A follower whose leader is not reached says why, and how far it has come; all on real sockets."""

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import pytest

from litegripd.model.teleop import LinkOptions, Reach, TeleopMode
from litegripd.teleop import ends
from litegripd.teleop.ends import Reaching
from litegripd.teleop.links import TeleopLinks
from tests.io.test_teleop_links import DEADLINE_S, FRAME, free_port, until

try:
    socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    HAS_IPV6 = True
except OSError:
    HAS_IPV6 = False

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


either = pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1",
        pytest.param(
            "::1", marks=pytest.mark.skipif(not HAS_IPV6, reason="this machine has no ::1")
        ),
    ],
)


def shown(host: str) -> str:
    return f"[{host}]" if ":" in host else host


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


@either
def test_a_port_where_nobody_listens_refuses_until_a_leader_is_there_and_again_after_it(
    host: str,
) -> None:
    port = free_port(socket.SOCK_STREAM)
    with linked() as following:
        follower = following.open(LinkOptions("slave", host=host, port=port))
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


def test_a_machine_that_drops_what_comes_does_not_answer_until_it_lets_it_through(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As behind a firewall: a full queue drops what asks for a connection, and refuses nobody."""
    monkeypatch.setattr(ends, "_CONNECT_WITHIN_S", 0.2)
    with ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0), backlog=0))
        where, waiting = server.getsockname(), list[socket.socket]()
        while True:
            waiting.append(stack.enter_context(socket.socket()))
            waiting[-1].settimeout(0.2)
            if waiting[-1].connect_ex(where) != 0:
                break
        watching = Reaching("127.0.0.1", where[1], lambda: False)
        stack.callback(watching.close)
        wait(lambda: "does not answer: it is off, elsewhere, or behind" in why(watching.reach))
        assert watching.reach.state == "connecting"
        server.listen(100)
        server.setblocking(False)

        def is_let_through() -> bool:
            with suppress(BlockingIOError):
                stack.enter_context(server.accept()[0])
            return watching.reach == Reach("connecting")

        wait(is_let_through)


def test_what_lasts_is_told_with_its_age() -> None:
    assert Reach("connecting").problem(5.0) is None
    assert Reach("connecting", "it is off", 2.0).problem(14.4) == "it is off (for 12 s)"


# UDP ----------------------------------------------------------------------------------------------


@either
def test_a_udp_leader_says_that_nobody_listens_until_a_follower_is_there(host: str) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with linked() as leading:
        leader = leading.open(LinkOptions("master", "udp", host, port))

        def is_refused() -> bool:
            leader.publish(FRAME, 0.0)
            return "nobody listens at that port" in why(leader.status.reach)

        until(leader, is_refused)
        found = leader.status.reach
        assert found is not None
        assert (found.state, leader.status.state) == ("sending", "open")
        assert why(found).startswith(f"{shown(host)}:{port} refuses")
        with linked() as following:
            follower = following.open(LinkOptions("slave", "udp", None, port))
            until(follower, lambda: follower.status.reach == Reach("bound"))
            arrived: list[object] = []

            def is_reached() -> bool:
                leader.publish(FRAME, 0.0)
                arrived.extend(follower.receive(0.0))
                return leader.status.reach == Reach("sending") and bool(arrived)

            until(leader, is_reached)
            until(follower, lambda: follower.status.reach == Reach("frames"))


def test_no_frame_is_lost_to_a_refusal_of_another_follower() -> None:
    nobody = free_port(socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as follower:
        follower.bind(("127.0.0.1", 0))
        follower.settimeout(DEADLINE_S)
        hosts = f"127.0.0.1:{nobody},127.0.0.1:{follower.getsockname()[1]}"
        leader = ends.UdpLeader(LinkOptions("master", "udp", hosts, 1), deliver, refuse)
        for number in range(50):
            leader.publish(bytes([number]))
            assert follower.recv(10) == bytes([number])
        assert f"127.0.0.1:{nobody} refuses" in why(leader.reach)
        leader.close()


def deliver(_payload: bytes, _source: str) -> None:
    pass


def refuse() -> None:
    pass


def test_a_udp_follower_that_hears_nobody_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port(socket.SOCK_DGRAM)
    monkeypatch.setattr(ends, "_SILENT_AFTER_S", 0.2)
    follower = ends.UdpFollower(
        LinkOptions("slave", "udp", "127.0.0.2", port, bind="127.0.0.1"), deliver, refuse
    )
    assert follower.reach == Reach("bound")
    wait(lambda: why(follower.reach) == f"no frame comes to UDP port {port} from 127.0.0.2")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as leader:
        leader.bind(("127.0.0.1", 0))
        leader.sendto(FRAME, ("127.0.0.1", port))
        wait(lambda: f"port {port} from 127.0.0.1, and none from 127.0.0.2" in why(follower.reach))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as leader:
        leader.bind(("127.0.0.2", 0))
        leader.sendto(FRAME, ("127.0.0.1", port))
        wait(lambda: follower.reach.state == "frames")
    wait(lambda: why(follower.reach).startswith("no frame comes"))
    follower.close()
    corrected = LinkOptions("slave", "udp", "127.0.0.1", port, bind="127.0.0.1")
    follower = ends.UdpFollower(corrected, deliver, refuse)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as leader:
        leader.bind(("127.0.0.1", 0))
        leader.sendto(FRAME, ("127.0.0.1", port))
        wait(lambda: follower.reach.state == "frames")
    follower.close()


@either
@pytest.mark.parametrize("wanted", [None, "same"])
def test_a_udp_follower_hears_a_leader_of_either_kind_and_answers_it(
    host: str, wanted: str | None
) -> None:
    """Whoever names no address of its own listens at all of them."""
    port = free_port(socket.SOCK_DGRAM)
    heard: list[tuple[bytes, str]] = []
    follower = ends.UdpFollower(
        LinkOptions("slave", "udp", wanted and host, port),
        lambda payload, source: heard.append((payload, source)),
        refuse,
    )
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as leader:
        leader.bind((host, 0))
        leader.settimeout(DEADLINE_S)
        leader.sendto(FRAME, (host, port))
        wait(lambda: follower.reach == Reach("frames"))
        source = f"{shown(host)}:{leader.getsockname()[1]}"
        assert heard == [(FRAME, source)]
        follower.reply(b"force", source)
        assert leader.recv(10) == b"force"
    follower.close()


@pytest.mark.skipif(not HAS_IPV6, reason="this machine has no ::1")
def test_a_udp_follower_says_who_else_sends_over_ipv6(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port(socket.SOCK_DGRAM)
    monkeypatch.setattr(ends, "_SILENT_AFTER_S", 0.2)
    follower = ends.UdpFollower(LinkOptions("slave", "udp", "::1", port), deliver, refuse)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as leader:
        says = f"port {port} from 127.0.0.1, and none from ::1"

        def is_said() -> bool:
            leader.sendto(FRAME, ("127.0.0.1", port))
            return says in why(follower.reach)

        wait(is_said)
    follower.close()


@either
def test_a_udp_leader_that_feels_forces_hears_its_follower(host: str) -> None:
    port, arrived = free_port(socket.SOCK_DGRAM), list[tuple[bytes, str]]()
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    options = LinkOptions("master", "udp", host, port, reflects=True)
    leader = ends.UdpLeader(options, lambda *one: arrived.append(one), refuse)
    with socket.socket(family, socket.SOCK_DGRAM) as follower:
        follower.bind((host, port))
        follower.settimeout(DEADLINE_S)
        leader.publish(FRAME)
        _, address = follower.recvfrom(1000)
        follower.sendto(b"force", address)
        wait(lambda: arrived == [(b"force", f"{shown(host)}:{port}")])
    leader.close()


@pytest.mark.parametrize("mode", ["master", "slave"])
def test_a_name_that_does_not_resolve_is_named_over_udp_too(mode: TeleopMode) -> None:
    with linked() as links:
        end = links.open(LinkOptions(mode, "udp", NOBODY))
        until(end, lambda: end.status.state == "failed")
        assert str(end.status.error).startswith(f"the name {NOBODY} does not resolve: ")
