"""Links through their own process: what opens, what fails, what comes, and how it ends."""

import os
import select
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from queue import SimpleQueue

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.io.helper.child import Child
from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus, Reach
from litegripd.teleop.link import (
    Link,
    OpenLink,
    pack_arrival,
    pack_open,
    pack_status,
    unpack_arrival,
    unpack_open,
    unpack_status,
)
from litegripd.teleop.links import ProcessLink, TeleopLinks
from litegripd.teleop.process import Flood, Station

DEADLINE_S = 30.0
FRAME = struct.pack(">4d", 0.25, 30.0, 0.0, 1.0)

OPTIONS = st.builds(
    LinkOptions,
    st.sampled_from(["master", "slave"]),
    st.sampled_from(["zenoh", "udp", "client", "none"]),
    st.none() | st.text(max_size=20),
    st.integers(1, 65_535),
    st.text(max_size=20),
)


@given(st.integers(0, 2**32 - 1), OPTIONS, st.none() | st.text(max_size=20))
def test_orders_are_the_same_after_their_journey(
    generation: int, options: LinkOptions, file: str | None
) -> None:
    order = OpenLink(generation, options, file)
    assert unpack_open(pack_open(order)[1:]) == order


@given(
    st.integers(0, 2**32 - 1),
    st.builds(
        Arrival,
        st.binary(max_size=33),
        st.floats(allow_nan=False),
        st.text(st.characters(codec="ascii"), max_size=64),
    ),
)
def test_arrivals_are_the_same_after_their_journey(generation: int, arrival: Arrival) -> None:
    assert unpack_arrival(pack_arrival(generation, arrival)[1:]) == (generation, arrival)


def test_a_long_payload_stays_too_long_for_a_frame() -> None:
    _, arrival = unpack_arrival(pack_arrival(1, Arrival(bytes(5000), 0.0, "x" * 500))[1:])
    assert len(arrival.payload) == 41


def test_states_are_the_same_after_their_journey() -> None:
    for status in (
        LinkStatus(),
        LinkStatus("failed", "why", None, 3),
        LinkStatus("open", None, True, 0, False),
        LinkStatus("open", reach=Reach("connecting", "it is off", 2.5)),
        LinkStatus("open", reach=Reach("connected")),
    ):
        assert unpack_status(pack_status(7, status)[1:]) == (7, status)


def test_a_flood_does_not_pass() -> None:
    flood = Flood()
    flood.passes(100.0)
    passed = sum(flood.passes(100.0 + 1e-5 * number) for number in range(100_000))
    assert passed == pytest.approx(1500, abs=40)
    assert flood.dropped == 100_000 - passed
    flood = Flood()
    assert all(flood.passes(100.0 + 1e-3 * number) for number in range(5000))


class FullAtFirst(socket.socket):
    """A daemon's socket that has no room for the first packet; it keeps what it takes."""

    tried = 0

    def __init__(self) -> None:
        super().__init__(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.taken: SimpleQueue[bytes] = SimpleQueue()

    def send(self, packet: bytes, _flags: int = 0) -> int:  # type: ignore[override]
        self.tried += 1
        if self.tried == 1:
            raise BlockingIOError
        self.taken.put(packet)
        return len(packet)


def test_a_state_that_meets_a_full_socket_is_told_when_there_is_room() -> None:
    with FullAtFirst() as peer, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used:
        used.bind(("", 0))
        station = Station(peer)
        threading.Thread(target=station.work, daemon=True).start()
        station.request(OpenLink(5, LinkOptions("slave", "udp", port=used.getsockname()[1])))
        generation, status = unpack_status(peer.taken.get(timeout=DEADLINE_S)[1:])
        assert (generation, status.state) == (5, "failed")
        station.request(None)


@pytest.fixture
def links() -> Iterator[TeleopLinks]:
    links = TeleopLinks()
    yield links
    links.close()
    assert links.pid is None


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


def until(link: Link, condition: Callable[[], bool]) -> list[Arrival]:
    """Use a link, as a tick does, until a condition holds."""
    arrived: list[Arrival] = []
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, link.status
        arrived += link.receive(time.monotonic())
        if isinstance(link, ProcessLink):
            link._links.poll(time.monotonic())
    return arrived


def test_nothing_is_started_before_a_link_is_used(links: TeleopLinks) -> None:
    links.open(LinkOptions("master", "none")).receive(0.0)
    links.poll(time.monotonic())
    assert links.pid is None
    link = links.open(LinkOptions("slave", "udp", port=free_port(socket.SOCK_DGRAM)))
    assert links.pid is None
    assert link.status == LinkStatus("opening")
    link.receive(time.monotonic())
    assert links.pid is None
    links.poll(time.monotonic())
    assert links.pid is not None


def test_datagrams_come_with_their_sender_and_their_time(links: TeleopLinks) -> None:
    port = free_port(socket.SOCK_DGRAM)
    link = links.open(LinkOptions("slave", "udp", port=port))
    until(link, lambda: link.status.state == "open")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.bind(("127.0.0.1", 0))
        sent_s = time.monotonic()
        sending.sendto(FRAME, ("127.0.0.1", port))
        sending.sendto(bytes(1000), ("127.0.0.1", port))
        source = f"127.0.0.1:{sending.getsockname()[1]}"
        arrived: list[Arrival] = []
        ends_s = time.monotonic() + DEADLINE_S
        while len(arrived) < 2:
            assert time.monotonic() < ends_s
            arrived += link.receive(time.monotonic())
    assert [arrival.source for arrival in arrived] == [source] * 2
    assert arrived[0].payload == FRAME
    assert len(arrived[1].payload) == 41
    assert sent_s <= arrived[0].at_s <= time.monotonic()


def test_over_udp_no_follower_says_whether_it_is_ready(links: TeleopLinks) -> None:
    port = free_port(socket.SOCK_DGRAM)
    leader = links.open(LinkOptions("master", "udp", "127.0.0.1", port, reflects=True))
    until(leader, lambda: leader.status.state == "open")
    assert not leader.tell(b"\x01", 0.0)
    leader.close()
    follower = links.open(LinkOptions("slave", "udp", None, port))
    until(follower, lambda: follower.status.state == "open")
    assert not follower.tell(b"\x01", 0.0)


@pytest.mark.parametrize("reflects", [False, True])
def test_a_leader_over_zenoh_hears_whether_its_follower_is_ready(reflects: bool) -> None:
    port, leading, following = free_port(socket.SOCK_STREAM), TeleopLinks(), TeleopLinks()
    try:
        leader = leading.open(LinkOptions("master", port=port, reflects=reflects))
        until(leader, lambda: leader.status.state == "open")
        options = LinkOptions("slave", host="127.0.0.1", port=port, reflects=reflects)
        follower = following.open(options)
        assert not follower.tell(b"\x01", 0.0)  # it is not open yet
        until(follower, lambda: follower.status.state == "open")
        heard: list[bytes] = []
        told_s = [0.0]

        def is_heard() -> bool:
            if time.monotonic() >= told_s[0] + 0.02:
                told_s[0] = time.monotonic()
                follower.tell(b"\x01", 0.0)
            heard.extend(arrival.payload for arrival in leader.receive(0.0))
            return len(heard) > 5

        until(follower, is_heard)
        follower.tell(b"\x00", 0.0)
        follower.close()  # what was said before is still sent

        def is_over() -> bool:
            heard.extend(arrival.payload for arrival in leader.receive(0.0))
            return heard[-1] == b"\x00"

        until(follower, is_over)
        assert set(heard) == {b"\x00", b"\x01"}
    finally:
        leading.close()
        following.close()


def test_a_follower_with_a_host_listens_to_nobody_else(links: TeleopLinks) -> None:
    port = free_port(socket.SOCK_DGRAM)
    link = links.open(LinkOptions("slave", "udp", "127.0.0.2", port))
    until(link, lambda: link.status.state == "open")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.sendto(FRAME, ("127.0.0.1", port))
        assert until(link, lambda: link.status.dropped == 1) == []


def test_a_follower_listens_at_the_address_that_it_is_given(links: TeleopLinks) -> None:
    port = free_port(socket.SOCK_DGRAM)
    link = links.open(LinkOptions("slave", "udp", port=port, bind="127.0.0.3"))
    until(link, lambda: link.status.state == "open")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))  # that address is still free
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        sending.sendto(FRAME, ("127.0.0.3", port))
        arrived: list[Arrival] = []
        ends_s = time.monotonic() + DEADLINE_S
        while not arrived:
            assert time.monotonic() < ends_s
            arrived += link.receive(time.monotonic())
    assert arrived[0].payload == FRAME


def test_an_address_of_another_machine_is_none_to_listen_at(links: TeleopLinks) -> None:
    link = links.open(LinkOptions("slave", "udp", bind="192.0.2.1"))
    until(link, lambda: link.status.state == "failed")
    assert "assign requested address" in str(link.status.error)


def in_use(port: int) -> str:
    return (
        f"port {port} is in use, by another program or by the daemon of another channel (one that"
        " has led keeps its port): give another --port at both ends, or restart that daemon"
    )


def test_a_port_that_is_taken_is_told_and_tried_again(links: TeleopLinks) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = int(taken.getsockname()[1])
        link = links.open(LinkOptions("slave", "udp", port=port))
        until(link, lambda: link.status.state == "failed")
        assert link.status.error == in_use(port)
    until(link, lambda: link.status.state == "open")
    assert link.status.error is None


def test_a_zenoh_port_that_is_taken_is_told(links: TeleopLinks) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as taken:
        taken.bind(("", 0))
        taken.listen()
        port = int(taken.getsockname()[1])
        link = links.open(LinkOptions("master", "zenoh", port=port))
        until(link, lambda: link.status.state == "failed")
        assert link.status.error == in_use(port)
        assert not link.publish(FRAME, 0.0)


def test_an_unknown_host_is_told(links: TeleopLinks) -> None:
    link = links.open(LinkOptions("master", "udp", "no.such.host.invalid"))
    until(link, lambda: link.status.state == "failed")
    assert link.status.error


def test_a_zenoh_configuration_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    links = TeleopLinks(str(tmp_path / "missing.json5"))
    try:
        link = links.open(LinkOptions("master", port=free_port(socket.SOCK_STREAM)))
        until(link, lambda: link.status.state == "failed")
        assert link.status.error == "No such file or directory (os error 2)"
    finally:
        links.close()


def test_what_the_link_before_still_tells_is_not_for_the_next_one(links: TeleopLinks) -> None:
    ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
    first = links.open(LinkOptions("slave", "udp", port=ports[0]))
    until(first, lambda: first.status.state == "open")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        for _ in range(20):
            sending.sendto(FRAME, ("127.0.0.1", ports[0]))
    first.close()
    second = links.open(LinkOptions("slave", "udp", port=ports[1]))
    assert until(second, lambda: second.status.state == "open") == []


def test_closing_gives_the_port_back(links: TeleopLinks) -> None:
    port = free_port(socket.SOCK_DGRAM)
    for _ in range(3):
        link = links.open(LinkOptions("slave", "udp", port=port))
        until(link, lambda link=link: link.status.state == "open")  # type: ignore[misc]
        link.close()
    ends_s = time.monotonic() + DEADLINE_S
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        while True:
            try:
                probe.bind(("", port))
            except OSError:
                assert time.monotonic() < ends_s
                continue
            return


def test_a_process_that_dies_without_a_link_is_not_started_again(links: TeleopLinks) -> None:
    link = links.open(LinkOptions("slave", "udp", port=free_port(socket.SOCK_DGRAM)))
    until(link, lambda: link.status.state == "open")
    link.close()
    child = links._child
    assert child is not None
    assert child.pid is not None
    os.kill(child.pid, signal.SIGKILL)
    ends_s = time.monotonic() + DEADLINE_S
    while links.deaths == 0:
        assert time.monotonic() < ends_s
        links.poll(time.monotonic())
    links.poll(time.monotonic() + 60.0)
    assert links.pid is None


def test_a_process_that_cannot_be_started_is_told_and_tried_again() -> None:
    starts: list[float] = []

    def start(module: str, arguments: Sequence[str]) -> Child:
        starts.append(0.0)
        raise OSError(12, "Cannot allocate memory")

    links = TeleopLinks(start=start)
    link = links.open(LinkOptions("slave", "udp"))
    for tick in range(400):
        links.poll(1000.0 + 0.005 * tick)
        link.receive(1000.0 + 0.005 * tick)
    assert len(starts) == 4  # every half second
    assert link.status.state == "failed"
    assert "Cannot allocate memory" in (link.status.error or "")


def test_the_process_ends_with_the_daemon(
    links: TeleopLinks, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = links.open(LinkOptions("master", "zenoh", port=free_port(socket.SOCK_STREAM)))
    until(link, lambda: link.status.state == "open")
    child = links._child
    assert child is not None
    child.socket.close()
    assert child.pidfd is not None
    assert select.select([child.pidfd], [], [], DEADLINE_S)[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (LinkOptions("master"), ("listens for anybody", "17448", "without encryption")),
        (LinkOptions("slave", host="a"), ("follows a:17448", "without encryption")),
        (LinkOptions("slave", "udp"), ("these jaws", "send to port 17448")),
        (LinkOptions("master", "udp", "b"), ("between here and b:17448", "the follower's jaws")),
    ],
)
def test_who_else_may_take_part_is_told(options: LinkOptions, words: tuple[str, ...]) -> None:
    told = TeleopLinks().warning(options)
    assert told is not None
    assert all(word in told for word in words)


def test_there_is_nothing_to_warn_of_inside_the_process_or_behind_tls() -> None:
    assert TeleopLinks().warning(LinkOptions("master", "none")) is None
    assert TeleopLinks("/etc/zenoh.json5").warning(LinkOptions("master")) is None
    assert TeleopLinks("/etc/zenoh.json5").warning(LinkOptions("slave", "udp")) is not None
