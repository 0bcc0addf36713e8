"""Whole daemons that lead and follow: over zenoh, over a bad network, and with frames by scripts.

The scripts know the wire alone: the endpoint, the key, and four big-endian float64.
"""

import contextlib
import json
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

from litegripd.model.calibration import NOMINAL
from litegripd.model.motion_config import MOVING_KP_NM_RAD, MotionConfig
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.teleop_pair import (
    LossyProxy,
    Samples,
    children,
    free_port,
    gripper,
    network_sockets,
    start,
    until,
)

KEY = "litearm/v4/gripA/gripper_teleop"
QUICK = {"speed_mm_s": 130}
CAP_RAD = MotionConfig().travel_nm / MOVING_KP_NM_RAD
TRAVEL_MM = NOMINAL[0].travel_mm


@contextlib.contextmanager
def peer(listen: int | None = None, connect: int | None = None) -> Iterator[zenoh.Session]:
    """Open a session as the other stacks do."""
    config = zenoh.Config()
    endpoints = {"listen": listen, "connect": connect}
    for name, port in endpoints.items():
        tcp = [] if port is None else [f"tcp/127.0.0.1:{port}"]
        config.insert_json5(f"{name}/endpoints", json.dumps(tcp))
    for name in ("multicast", "gossip"):
        config.insert_json5(f"scouting/{name}/enabled", "false")
    config.insert_json5("mode", '"peer"')
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


def say(put: Callable[[bytes], object], openness: float) -> None:
    put(struct.pack(">dddd", openness, TRAVEL_MM * openness, 0.0, time.monotonic()))


def say_until(
    put: Callable[[bytes], object], openness: float, condition: Callable[[], bool]
) -> None:
    """Send frames until something has come of them."""
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s
        say(put, openness)


def is_at(client: Client, openness: float) -> bool:
    measured = client.result("state.get")["openness"]
    return bool(abs(measured - openness) < 0.02)


def largest_lead_rad(samples: Samples) -> float:
    return max(abs(row[2] - row[1]) for row in samples.rows if row[2] is not None)


def swing(client: Client, at_least_mm: float) -> None:
    """Wait until the jaws have gone as far as this."""
    seen: list[float] = []

    def has_swung(state: dict[str, Any]) -> bool:
        seen.append(state["opening_mm"])
        return max(seen) - min(seen) >= at_least_mm

    client.until(has_swung)


def begin_to_lead(leading: DaemonProcess, **params: object) -> None:
    with leading.connect() as leader:
        leader.enabled().result("teleop.start", mode="master", detach=True, **params)


def nothing_but_one_connection(leading: DaemonProcess, following: DaemonProcess, port: int) -> None:
    """No discovery: the leader listens at its port, the follower at none."""
    module = "litegripd.teleop.process"
    own = network_sockets(children(leading.process.pid)[module])
    either = "tcp6" if socket.has_dualstack_ipv6() else "tcp"
    assert own == {(either, port, "listens"), (either, port, "connected")}
    others = network_sockets(children(following.process.pid)[module])
    assert [(protocol, state) for protocol, _, state in others] == [("tcp", "connected")]


def test_two_daemons_over_zenoh_and_a_leader_that_goes_and_comes_back(tmp_path: Path) -> None:
    port = free_port()
    with (
        gripper(tmp_path / "f", "follow", "reverse") as following,
        following.connect() as follower,
        Samples(following) as samples,
    ):
        follower.enabled()
        follower.result("teleop.start", mode="slave", host="127.0.0.1", port=port, config=QUICK)
        leading = start(tmp_path / "l", "lead", by_hand=True)
        try:
            begin_to_lead(leading, port=port)
            until(follower, lambda s: bool(s["phase"] == "following"))
            swing(follower, 30.0)
            nothing_but_one_connection(leading, following, port)
            with leading.connect() as leader:
                assert leader.result("teleop.status")["matching"] is True
                assert leader.result("teleop.stop")["send_failed"] == 0
                assert until(follower, lambda s: bool(s["stale"]))["active"]
                leader.result("teleop.start", mode="master", port=port, detach=True)
            until(follower, lambda s: bool(s["phase"] == "following"))
        finally:
            leading.kill()
        until(follower, lambda s: bool(s["stale"]))
        leading = start(tmp_path / "l", "lead", by_hand=True)
        try:
            begin_to_lead(leading, port=port)
            until(follower, lambda s: bool(s["phase"] == "following"))
            leading.end()
        finally:
            leading.kill()
        assert follower.result("health")["control"]["tick_errors"] == 0
        assert not follower.result("teleop.stop")["active"]
        assert follower.result("state.get")["mode"] == "holding"
    assert largest_lead_rad(samples) <= CAP_RAD + 1e-9


def test_over_a_network_that_loses_delays_and_reorders(tmp_path: Path) -> None:
    """A third of the datagrams lost, the others up to 100 ms late, and a cut of 1.5 seconds."""
    port = free_port(socket.SOCK_DGRAM)
    with (
        gripper(tmp_path / "f", "follow") as following,
        following.connect() as follower,
        gripper(tmp_path / "l", "lead", "reverse", by_hand=True) as leading,
        LossyProxy(port, loss=0.3, jitter_s=0.1, seed=7) as network,
        Samples(following) as samples,
    ):
        follower.enabled()
        follower.result("teleop.start", mode="slave", link="udp", port=port, config=QUICK)
        begin_to_lead(leading, link="udp", host="127.0.0.1", port=network.port)
        until(follower, lambda s: bool(s["phase"] == "following"))
        swing(follower, 30.0)
        network.is_cut = True
        until(follower, lambda s: bool(s["stale"]))
        began = follower.result("teleop.status")["frames"]
        held = follower.result("state.get")["opening_mm"]
        until(follower, lambda s: bool(s["last_frame_age_ms"] > 1500.0))
        assert follower.result("state.get")["opening_mm"] == pytest.approx(held, abs=1.0)
        network.is_cut = False
        until(follower, lambda s: bool(s["phase"] == "following" and s["frames"] > began))
        swing(follower, 30.0)
        status = follower.result("teleop.status")
        assert status["out_of_order"] > 50
        assert status["rejected"] == status["other_leaders"] == 0
        assert network.lost > 100
    assert largest_lead_rad(samples) <= CAP_RAD + 1e-9


def test_frames_of_a_script_are_followed_and_ours_are_read_by_one(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        port = free_port()
        client.result("teleop.start", mode="slave", host="127.0.0.1", port=port)
        with peer(listen=port) as session:
            publisher = session.declare_publisher(KEY)
            nan = struct.pack(">dddd", math.nan, 0.0, 0.0, 0.0)
            until(client, lambda s: publisher.put(nan) or bool(s["rejected"]))
            assert client.result("teleop.status")["frames"] == 0
            say_until(publisher.put, 0.5, lambda: is_at(client, 0.5))
        until(client, lambda s: bool(s["stale"]))
        client.result("teleop.stop")
        port = free_port()
        client.result("teleop.start", mode="master", port=port)
        with peer(connect=port) as session:
            frames = session.declare_subscriber(KEY, zenoh.handlers.RingChannel(400))
            until(client, lambda s: bool(s["matching"] and s["frames"] > 100))
            payloads = [frames.recv().payload.to_bytes() for _ in range(50)]
        assert {len(payload) for payload in payloads} == {32}
        values = [struct.unpack(">4d", payload) for payload in payloads]
        assert all(openness == pytest.approx(0.5, abs=0.02) for openness, *_ in values)
        assert all(mm == pytest.approx(0.5 * TRAVEL_MM, abs=1.8) for _, mm, *_ in values)
        times = [at_s for *_, at_s in values]
        assert times == sorted(set(times))


def test_a_leader_that_is_not_there_is_told_by_status_and_health(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        port = free_port()
        client.result("teleop.start", mode="slave", host="127.0.0.1", port=port)
        status = until(client, lambda s: bool(s["link_state"] == "open"))
        assert (status["phase"], status["frames"]) == ("waiting", 0)
        assert (status["host"], status["port"]) == ("127.0.0.1", port)
        told = f"teleoperation: nothing heard yet from a leader at 127.0.0.1, port {port}"

        def is_told(_status: dict[str, Any]) -> bool:
            health = client.result("health")
            is_said = any(reason.startswith(told) for reason in health["reasons"])
            return is_said and bool(health["verdict"] == "degraded")

        until(client, is_told)
        client.result("teleop.stop")
        assert not any(told in reason for reason in client.result("health")["reasons"])


@pytest.mark.parametrize("link", ["udp", "zenoh"])
def test_noise_on_a_link_harms_nobody(simulated: DaemonProcess, link: str) -> None:
    """Payloads of any length and content, as fast as a script can, and then a leader again."""
    dice = random.Random(11)
    port = free_port(socket.SOCK_DGRAM if link == "udp" else socket.SOCK_STREAM)
    with simulated.connect() as client, contextlib.ExitStack() as stack:
        client.enabled()
        client.result("teleop.start", mode="slave", link=link, port=port, host="127.0.0.1")
        before = client.result("state.get")["openness"]
        if link == "udp":
            sending = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            sending.connect(("127.0.0.1", port))
            put = quiet(sending.send)
        else:
            put = stack.enter_context(peer(listen=port)).declare_publisher(KEY).put

        def has_heard(status: dict[str, Any]) -> bool:
            for _ in range(300):
                put(dice.randbytes(dice.choice((0, 1, 31, 33, 64, 1400, 5000))))
                values = dice.choices((math.nan, math.inf, 0.0, 1e308), k=3)
                put(struct.pack(">dddd", *values, math.nan))
            return bool(status["rejected"] > 500)

        status = until(client, has_heard)
        assert status["frames"] == 0
        assert client.result("state.get")["openness"] == pytest.approx(before, abs=0.01)
        say_until(put, 0.6, lambda: is_at(client, 0.6))
        health = client.result("health")
        assert health["control"]["tick_errors"] == 0
        assert client.result("teleop.status")["link_state"] == "open"


def quiet(send: Callable[[bytes], object]) -> Callable[[bytes], object]:
    """Send what may not be listened to yet."""

    def put(payload: bytes) -> None:
        with contextlib.suppress(ConnectionRefusedError):
            send(payload)

    return put


def test_a_killed_link_process_is_started_again(own: DaemonProcess) -> None:
    port = free_port(socket.SOCK_DGRAM)
    with (
        own.connect() as client,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending,
    ):
        client.enabled()
        assert "litegripd.teleop.process" not in children(own.process.pid)
        sending.connect(("127.0.0.1", port))
        client.result("teleop.start", mode="slave", link="udp", port=port)
        put = quiet(sending.send)
        say_until(put, 0.55, lambda: is_at(client, 0.55))
        os.kill(children(own.process.pid)["litegripd.teleop.process"], signal.SIGKILL)
        status = until(client, lambda s: bool(s["link_state"] == "failed"))
        assert "died" in status["link_error"]
        say_until(put, 0.6, lambda: is_at(client, 0.6))
        assert client.result("health")["control"]["tick_errors"] == 0
