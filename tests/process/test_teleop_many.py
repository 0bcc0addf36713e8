"""One leader and several followers as processes, and a hand that feels them; frames by scripts."""

import contextlib
import math
import os
import random
import signal
import socket
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.control.reflection_pair import FORCE, force_frame
from tests.process.by_portal import Met
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.teleop_pair import Samples, children, free_port, gripper, until
from tests.process.test_teleop import CAP_RAD, KEY, QUICK, largest_lead_rad, peer, swing

FORCE_KEY = f"{KEY}_force"
LINK_PROCESS = "litegripd.teleop.process"


def follow(client: Client, link: str, port: int) -> None:
    host = {"host": "127.0.0.1"}
    client.enabled().result(
        "teleop.start", mode="slave", link=link, port=port, reflect=True, config=QUICK, **host
    )


@pytest.mark.parametrize("link", ["zenoh", "udp"])
def test_two_followers_of_one_leader_are_followed_and_felt(
    met: Met, tmp_path: Path, link: str
) -> None:
    kind = socket.SOCK_DGRAM if link == "udp" else socket.SOCK_STREAM
    ports = [free_port(kind), free_port(kind)]
    used = ports if link == "udp" else [ports[0]] * 2
    leads: dict[str, Any] = {"mode": "master", "link": link, "reflect_n": 3, "port": ports[0]}
    if link == "udp":
        leads["host"] = f"127.0.0.1, 127.0.0.1:{ports[1]}"
    with (
        gripper(tmp_path / "l", "lead", by_hand=True) as leading,
        gripper(tmp_path / "a", "first") as first,
        gripper(tmp_path / "b", "second", "reverse") as second,
        met(leading, first, second),
        leading.connect() as leader,
        first.connect() as one,
        second.connect() as other,
        Samples(first) as samples,
    ):
        follow(one, link, used[0])
        follow(other, link, used[1])
        leader.enabled().result("teleop.start", **leads)
        for client in (one, other):
            until(client, lambda s: bool(s["phase"] == "following"))
            swing(client, 30.0)
        status = until(leader, lambda s: bool(s["followers"] == 2))
        assert status["round_trip_ms"] < 200.0
        assert status["rejected"] == 0
        assert math.isfinite(status["reflected_n"])
        assert abs(status["reflected_n"]) <= 3.0
        health = leader.result("health")["teleop"]
        assert (health["is_running"], health["open_to_network"]) == (True, True)
        assert (health["link"], health["deaths"]) == ("open", 0)
        other.result("teleop.stop")
        until(leader, lambda s: bool(s["followers"] == 1))
        swing(one, 30.0)
        for client in (leader, one, other):
            assert client.result("health")["control"]["tick_errors"] == 0
    assert largest_lead_rad(samples) <= CAP_RAD + 1e-9


class Script:
    """A follower by hand: it knows the page on teleoperation alone."""

    def __init__(self, receive: Callable[[], bytes], send: Callable[[bytes], object]) -> None:
        self.receive, self.send = receive, send

    def echo_s(self) -> float:
        """Return the time in the leader's next frame."""
        return float(struct.unpack(">4d", self.receive())[3])


@contextlib.contextmanager
def script(link: str, port: int) -> Iterator[Script]:
    if link == "zenoh":
        with peer(connect=port) as session:
            frames = session.declare_subscriber(KEY, zenoh.handlers.RingChannel(4))
            publisher = session.declare_publisher(FORCE_KEY)

            def receive() -> bytes:
                return frames.recv().payload.to_bytes()

            yield Script(receive, publisher.put)
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.settimeout(DEADLINE_S)
        own.bind(("127.0.0.1", port))
        leader = own.recvfrom(100)[1]
        yield Script(lambda: own.recv(100), lambda payload: own.sendto(payload, leader))


def leads_by(link: str, port: int) -> dict[str, Any]:
    params: dict[str, Any] = {"mode": "master", "link": link, "port": port}
    return {**params, "host": "127.0.0.1"} if link == "udp" else params


@pytest.mark.parametrize("link", ["udp", "zenoh"])
def test_noise_on_the_way_back_harms_no_hand_and_a_script_is_felt(
    simulated: DaemonProcess, link: str
) -> None:
    dice = random.Random(13)
    port = free_port(socket.SOCK_DGRAM if link == "udp" else socket.SOCK_STREAM)
    with simulated.connect() as client:
        client.enabled()
        client.result("teleop.start", **leads_by(link, port), reflect_n=4, reflect_gain=1)
        before = client.result("state.get")["opening_mm"]
        with script(link, port) as follower:

            def has_heard(status: dict[str, Any]) -> bool:
                now_s = time.monotonic()
                for _ in range(200):
                    follower.send(dice.randbytes(dice.choice((0, 1, 31, 32, 39, 40, 41, 5000))))
                    values = dice.choices((math.nan, math.inf, 0.0, -1e308, now_s), k=2)
                    follower.send(force_frame(math.nan, values[0], values[1]))
                    follower.send(force_frame(1e308, values[0], now_s + 1e3))
                return bool(status["rejected"] > 500 and status["late"] > 100)

            status = until(client, has_heard)
            assert (status["followers"], status["reflected_n"]) == (0, 0.0)
            assert client.result("state.get")["opening_mm"] == pytest.approx(before, abs=0.1)

            def is_felt(status: dict[str, Any]) -> bool:
                follower.send(force_frame(-1e308, time.monotonic(), follower.echo_s()))
                assert abs(status["reflected_n"]) <= 4.0
                return bool(status["followers"] == 1 and status["reflected_n"] < -1.0)

            until(client, is_felt)
        until(client, lambda s: bool(s["followers"] == 0 and s["reflected_n"] == 0.0))
        assert client.result("health")["control"]["tick_errors"] == 0
        assert client.result("teleop.stop")["active"] is False


@pytest.mark.parametrize("link", ["udp", "zenoh"])
def test_forces_are_read_by_a_script_that_leads(simulated: DaemonProcess, link: str) -> None:
    port = free_port(socket.SOCK_DGRAM if link == "udp" else socket.SOCK_STREAM)
    with contextlib.ExitStack() as stack, simulated.connect() as client:
        client.enabled()
        told: list[bytes] = []
        client.result(
            "teleop.start", mode="slave", link=link, port=port, host="127.0.0.1", reflect=True
        )
        if link == "udp":
            own = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            own.connect(("127.0.0.1", port))

            def exchange(payload: bytes) -> None:
                with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
                    own.send(payload)
                    told.append(own.recv(100, socket.MSG_DONTWAIT))
        else:
            session = stack.enter_context(peer(listen=port))
            forces = session.declare_subscriber(FORCE_KEY, zenoh.handlers.RingChannel(64))
            publisher = session.declare_publisher(KEY)

            def exchange(payload: bytes) -> None:
                publisher.put(payload)
                sample = forces.try_recv()
                if sample is not None:
                    told.append(sample.payload.to_bytes())

        def has_told(_status: dict[str, Any]) -> bool:
            exchange(struct.pack(">dddd", 0.5, 60.0, 0.0, time.monotonic()))
            return len(told) > 20

        until(client, has_told)
        epoch = client.result("hello")["epoch"]
        for payload in told:
            magic, sender, force_n, timestamp_s, echo_s = FORCE.unpack(payload)
            assert (magic, sender) == (b"LGFORCE1", int(epoch, 16))
            assert abs(force_n) < 60.0
            assert 0.0 <= time.monotonic() - timestamp_s < DEADLINE_S
            assert 0.0 <= time.monotonic() - echo_s < DEADLINE_S


def test_a_killed_link_process_of_a_leader_lets_go_of_the_hand(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with (
        gripper(tmp_path / "l", "lead", by_hand=True) as leading,
        gripper(tmp_path / "f", "follow") as following,
        leading.connect() as leader,
        following.connect() as follower,
    ):
        follow(follower, "udp", port)
        leader.enabled().result("teleop.start", **leads_by("udp", port), reflect_n=4)
        until(leader, lambda s: bool(s["followers"] == 1))
        process = children(leading.process.pid)[LINK_PROCESS]
        leader.until_health(lambda h: bool(h["teleop"]["is_running"]))
        os.kill(process, signal.SIGKILL)
        leader.until_health(lambda h: bool(h["teleop"]["deaths"] == 1))
        until(leader, lambda s: bool(s["followers"] == 0 and s["reflected_n"] == 0.0))
        until(leader, lambda s: bool(s["followers"] == 1))
        assert leader.result("health")["teleop"]["link"] == "open"
