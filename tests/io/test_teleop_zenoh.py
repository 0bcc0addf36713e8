"""What a stranger on an open zenoh link can do, and what not; and how ends are closed."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from litegripd.model.teleop import LinkKind, LinkOptions
from litegripd.teleop.links import TeleopLinks
from tests.control.reflection_pair import force_frame
from tests.io.test_teleop_links import DEADLINE_S, free_port, until

FRAME = struct.pack(">4d", 0.25, 30.0, 0.0, 1.0)
FORGED = struct.pack(">4d", 0.0, 0.0, 0.0, 2.0)


def stranger(port: int) -> zenoh.Session:
    """Connect to a leader as anybody may who reaches its port."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def test_frames_that_a_stranger_gives_the_leader_are_not_passed_on_to_followers() -> None:
    """A stranger on an open link hears frames, and is heard as a follower: not as a leader."""
    port, options = (
        free_port(socket.SOCK_STREAM),
        LinkOptions("slave", host="127.0.0.1", reflects=True),
    )
    leading, following = TeleopLinks(), TeleopLinks()
    try:
        leader = leading.open(LinkOptions("master", port=port, reflects=True))
        until(leader, lambda: leader.status.state == "open")
        follower = following.open(
            LinkOptions(options.mode, host=options.host, port=port, reflects=True)
        )
        until(follower, lambda: follower.status.state == "open")
        with stranger(port) as session:
            heard: list[bytes] = []
            felt: list[bytes] = []
            overheard: set[bytes] = set()
            session.declare_subscriber(
                options.topic, lambda sample: overheard.add(sample.payload.to_bytes())
            )
            false_leader = session.declare_publisher(options.topic)
            false_follower = session.declare_publisher(options.force_topic)

            def is_heard() -> bool:
                leader.publish(FRAME, 0.0)
                false_leader.put(FORGED)
                false_follower.put(force_frame(9.0, 1.0, 1.0))
                heard.extend(arrival.payload for arrival in follower.receive(0.0))
                felt.extend(arrival.payload for arrival in leader.receive(0.0))
                return len(heard) > 300 and len(felt) > 20 and FRAME in overheard

            until(follower, is_heard)
            assert set(heard) == {FRAME}
            assert set(felt) == {force_frame(9.0, 1.0, 1.0)}
        assert leader.status.is_protected is False
    finally:
        leading.close()
        following.close()


MAPPED = """
import os, sys
from pathlib import Path
from litegripd.model.teleop import LinkOptions
from litegripd.teleop.ends import ZenohFollower, ZenohLeaders
file, port = sys.argv[1], int(sys.argv[2])
leader = ZenohLeaders().open(LinkOptions("master", port=port), file, print)
follower = ZenohFollower(LinkOptions("slave", host="127.0.0.1", port=port), file, print)
print([line for line in Path("/proc/self/maps").read_text().splitlines() if "/dev/shm/" in line])
follower.close()
leader.close()
sys.stdout.flush()
os._exit(0)
"""
"""Ends at once, as the process of the links does: Python's end is no place for zenoh's threads."""


def test_no_end_shares_memory_though_its_file_asks_for_it(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text('{"transport": {"shared_memory": {"enabled": true, "mode": "init"}}}')
    port = str(free_port(socket.SOCK_STREAM))
    done = subprocess.run(
        [sys.executable, "-c", MAPPED, str(file), port],
        capture_output=True,
        text=True,
        check=True,
        timeout=DEADLINE_S,
    )
    assert done.stdout == "[]\n"


def test_a_leader_that_reflects_can_be_closed_and_opened_on_the_same_session() -> None:
    port = free_port(socket.SOCK_STREAM)
    links = TeleopLinks()
    try:
        for reflects in (True, False, True):
            leader = links.open(LinkOptions("master", port=port, reflects=reflects))
            until(leader, lambda link=leader: link.status.state == "open")  # type: ignore[misc]
            pid = links.pid
            with stranger(port) as session:
                publisher = session.declare_publisher(LinkOptions("master").force_topic)
                felt: list[bytes] = []

                def is_felt(link=leader, put=publisher.put, felt=felt) -> bool:  # type: ignore[no-untyped-def]
                    put(bytes(40))
                    felt.extend(arrival.payload for arrival in link.receive(0.0))
                    return len(felt) > 5

                if reflects:
                    until(leader, is_felt)
                else:
                    assert [is_felt() for _ in range(100)] == [False] * 100
            leader.close()
            assert links.pid == pid
        assert links.deaths == 0
    finally:
        links.close()


def is_open(links: TeleopLinks) -> bool | None:
    return links.is_open_to_network


def keep_polling(links: TeleopLinks, condition: Callable[[], bool]) -> None:
    """Let ticks without a link pass until a condition holds."""
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s
        links.poll(time.monotonic())


def test_a_leaders_session_that_stays_open_is_told_until_it_is_gone() -> None:
    port = free_port(socket.SOCK_STREAM)
    links = TeleopLinks()
    try:
        leader = links.open(LinkOptions("master", port=port))
        until(leader, lambda: leader.status.state == "open")
        leader.close()
        links.poll(time.monotonic())
        with socket.create_connection(("127.0.0.1", port)):
            assert is_open(links) is True
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as taken:
            taken.bind(("", 0))
            taken.listen()
            other = links.open(LinkOptions("master", port=taken.getsockname()[1]))
            assert is_open(links) is True
            until(other, lambda: other.status.state == "failed")
            assert is_open(links) is None
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection(("127.0.0.1", port))
            other.close()
        again = links.open(LinkOptions("master", port=port))
        until(again, lambda: again.status.state == "open")
        again.close()
        assert links.pid is not None
        os.kill(links.pid, signal.SIGKILL)
        keep_polling(links, lambda: links.pid is None)
        assert is_open(links) is None
    finally:
        links.close()


@pytest.mark.parametrize("followed_by", [None, "udp"])
def test_a_leader_that_is_closed_while_it_opens_may_be_open_nevertheless(
    followed_by: LinkKind | None,
) -> None:
    links = TeleopLinks()
    try:
        leader = links.open(LinkOptions("master", port=free_port(socket.SOCK_STREAM)))
        until(leader, lambda: leader.is_requested)  # type: ignore[attr-defined]
        leader.close()
        if followed_by is not None:
            options = LinkOptions("slave", followed_by, port=free_port(socket.SOCK_DGRAM))
            other = links.open(options)
            until(other, lambda: other.status.state == "open")
            other.close()
        keep_polling(links, lambda: links.is_open_to_network is True)
    finally:
        links.close()
