"""What a stranger on an open zenoh link can do, and what not; and how ends are closed."""

import json
import socket
import struct

import zenoh

from litegripd.io.teleop_links import TeleopLinks
from litegripd.model.teleop import LinkWish
from tests.control.reflection_pair import force_frame
from tests.io.test_teleop_links import free_port, until

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
    port, wish = free_port(socket.SOCK_STREAM), LinkWish("slave", host="127.0.0.1", reflects=True)
    leading, following = TeleopLinks(), TeleopLinks()
    try:
        leader = leading.open(LinkWish("master", port=port, reflects=True))
        until(leader, lambda: leader.status.state == "open")
        follower = following.open(LinkWish(wish.mode, host=wish.host, port=port, reflects=True))
        until(follower, lambda: follower.status.state == "open")
        with stranger(port) as session:
            heard: list[bytes] = []
            felt: list[bytes] = []
            overheard: set[bytes] = set()
            session.declare_subscriber(
                wish.topic, lambda sample: overheard.add(sample.payload.to_bytes())
            )
            false_leader = session.declare_publisher(wish.topic)
            false_follower = session.declare_publisher(wish.force_topic)

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


def test_a_leader_that_reflects_can_be_closed_and_opened_on_the_same_session() -> None:
    port = free_port(socket.SOCK_STREAM)
    links = TeleopLinks()
    try:
        for reflects in (True, False, True):
            leader = links.open(LinkWish("master", port=port, reflects=reflects))
            until(leader, lambda link=leader: link.status.state == "open")  # type: ignore[misc]
            pid = links.pid
            with stranger(port) as session:
                publisher = session.declare_publisher(LinkWish("master").force_topic)
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
