"""Whole daemons and the ready byte: over zenoh with a script, and over a link that a program has.

The script knows the wire alone: two keys, 32 bytes one way and one byte the other.
"""

import contextlib
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.teleop_pair import free_port, gripper, until
from tests.process.test_teleop import KEY, is_at, peer, say

READY_KEY = "litearm/v4/gripA/gripper_ready"
NOT_READY, READY = b"\x00", b"\x01"


def test_a_script_hears_when_a_follower_is_ready_and_that_it_ends(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        port = free_port()
        with peer(listen=port) as session:
            heard = session.declare_subscriber(READY_KEY, zenoh.handlers.FifoChannel(10_000))
            publisher = session.declare_publisher(KEY)
            client.result("teleop.start", mode="slave", host="127.0.0.1", port=port)

            def is_ready(status: dict[str, object]) -> bool:
                say(publisher.put, 0.5)
                return bool(status["ready"])

            assert heard.recv().payload.to_bytes() == NOT_READY
            until(client, is_ready)
            while heard.recv().payload.to_bytes() != READY:
                say(publisher.put, 0.5)
            assert is_at(client, 0.5)
            ended = client.result("teleop.stop")
            assert ended["ready_pubs"] > 1
            assert not ended["ready"]
            said = [heard.recv().payload.to_bytes()]
            while said[-1] != NOT_READY:
                said.append(heard.recv().payload.to_bytes())
            assert set(said) <= {NOT_READY, READY}


def test_a_script_that_is_ready_lets_a_leaders_jaws_go(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        port = free_port()
        client.result("teleop.start", mode="master", port=port, ready_timeout_s=0)
        with peer(connect=port) as session:
            frames = session.declare_subscriber(KEY, zenoh.handlers.RingChannel(400))
            publisher = session.declare_publisher(READY_KEY)
            assert len(frames.recv().payload.to_bytes()) == 32  # from the beginning on
            until(client, lambda s: publisher.put(NOT_READY) or bool(s["ready_rx"] > 3))
            status = client.result("teleop.status")
            assert (status["phase"], status["ready"]) == ("waiting", False)
            until(client, lambda s: publisher.put(b"\x01\x01") or bool(s["rejected"] > 3))
            assert client.result("teleop.status")["phase"] == "waiting"
            until(client, lambda s: publisher.put(READY) or bool(s["ready"]))
            assert client.result("teleop.status")["phase"] == "leading"


@contextlib.contextmanager
def carried(one: Client, other: Client) -> Iterator[None]:
    """Carry what each of two connections is to send to the other one, as a program does."""

    def carry(reading: Client, writing: Client) -> None:
        with contextlib.suppress(OSError, ValueError):
            while message := reading.read():
                if message.get("method") == "teleop.send":
                    line = {**message, "method": "teleop.receive"}
                    writing.socket.sendall(json.dumps(line).encode() + b"\n")

    ways = ((one, other), (other, one))
    threads = [threading.Thread(target=carry, args=way) for way in ways]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for client in (one, other):
            client.socket.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join(DEADLINE_S)


def test_two_daemons_over_a_link_that_a_program_carries(tmp_path: Path) -> None:
    with (
        gripper(tmp_path / "l", "lead", by_hand=True) as leading,
        gripper(tmp_path / "f", "follow", "reverse") as following,
        leading.connect() as leader,
        following.connect() as follower,
        leading.connect() as at_leader,
        following.connect() as at_follower,
    ):
        for client, mode in ((leader, "master"), (follower, "slave")):
            client.enabled().result("teleop.start", mode=mode, link="client", ready_timeout_s=0)
        with carried(leader, follower):
            until(at_leader, lambda s: bool(s["phase"] == "leading" and s["frames"] > 200))
            status = until(at_follower, lambda s: bool(s["phase"] == "following"))
            assert (status["rejected"], status["matching"]) == (0, None)
        for client in (at_leader, at_follower):
            status = until(client, lambda s: not s["active"])
            assert "went away" in status["fault"]
            assert client.result("state.get")["mode"] == "holding"
            assert client.result("health")["control"]["tick_errors"] == 0


@pytest.mark.local_only("by a portal the flood is the gateway's to bound")
def test_a_flood_over_a_link_of_a_clients_own_costs_no_tick(simulated: DaemonProcess) -> None:
    with simulated.connect() as client, simulated.connect() as watching:
        client.enabled().result("teleop.start", mode="slave", link="client")
        params = {"topic": KEY, "payload": "00" * 40}
        line = json.dumps({"jsonrpc": "2.0", "method": "teleop.receive", "params": params})
        ends_s = time.monotonic() + 1.0
        while time.monotonic() < ends_s:
            client.socket.sendall((line + "\n").encode() * 200)
        status = until(watching, lambda s: bool(s["rejected"] > 100))
        assert (status["frames"], status["phase"]) == (0, "waiting")
        assert watching.result("health")["control"]["tick_errors"] == 0
        assert watching.result("state.get")["enabled"]
