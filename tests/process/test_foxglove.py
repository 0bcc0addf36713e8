"""`litegrip-foxglove` as a process, met by a client that speaks Foxglove's WebSocket protocol."""

import json
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from typing import Any, NamedTuple

import pytest
from websockets.sync.client import ClientConnection, connect

from litegrip_client.testing import SimulatedDaemon, simulated
from litegrip_client.values.foxglove import EVENT, JOINTS, TICK

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")

from litegrip_foxglove.watch import MOST_AGE_S

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
DEADLINE_S = 20.0


class Shown(NamedTuple):
    """One message on a topic, with its time of the day."""

    kind: str
    at_ns: int
    content: dict[str, Any]


class Viewer:
    """What Foxglove does: it reads what is offered, subscribes to all of it, and receives."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.server = self._said()
        self.topics: dict[str, dict[str, Any]] = {}
        self.statuses: list[dict[str, Any]] = []

    def _said(self) -> dict[str, Any]:
        said: dict[str, Any] = json.loads(self._socket.recv(DEADLINE_S))
        return said

    def subscribe(self, count: int) -> None:
        while len(self.topics) < count:
            said = self._said()
            assert said["op"] == "advertise"
            self.topics |= {channel["topic"]: channel for channel in said["channels"]}
        wanted = [
            {"id": 100 + channel["id"], "channelId": channel["id"]}
            for channel in self.topics.values()
        ]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def receive(self) -> Shown | None:
        """Return the next message; None for a status, which is kept."""
        received = self._socket.recv(DEADLINE_S)
        if isinstance(received, str):
            self.statuses.append(json.loads(received))
            return None
        code, subscription, at_ns = struct.unpack_from("<BIQ", received)
        assert code == MESSAGE_DATA
        (topic,) = (
            name for name, channel in self.topics.items() if 100 + channel["id"] == subscription
        )
        return Shown(topic.rpartition("/")[2], at_ns, json.loads(received[13:]))

    def until(self, is_it: Callable[[Shown], bool]) -> list[Shown]:
        """Receive until something is shown; return all that was, the awaited one last."""
        shown: list[Shown] = []
        while not (shown and is_it(shown[-1])):
            one = self.receive()
            if one is not None:
                shown.append(one)
        return shown


@contextmanager
def viewed(daemon: SimulatedDaemon) -> Iterator[Viewer]:
    """Run the program for a daemon; yield who looks at it. It ends well, or the test fails."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    environment["LITEGRIPD_SOCKET"] = daemon.socket_path
    command = [sys.executable, "-m", "litegrip_foxglove.main", daemon.channel, "--port", "0"]
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as program:
        try:
            assert program.stdout is not None
            address = program.stdout.readline().split()[0]
            with connect(address, subprotocols=[SUBPROTOCOL]) as socket:  # type: ignore[list-item]
                assert socket.subprotocol == SUBPROTOCOL
                yield Viewer(socket)
            program.terminate()
            assert program.wait(DEADLINE_S) == 0
        finally:
            program.kill()


def opening_is(opening_mm: float) -> Callable[[Shown], bool]:
    return lambda one: (
        one.kind == "tick" and abs(one.content.get("opening_mm", -9.0) - opening_mm) < 0.5
    )


def test_a_viewer_is_offered_the_topics_of_dumps_and_sees_the_jaws_move() -> None:
    with simulated() as daemon, viewed(daemon) as viewer:
        assert viewer.server["op"] == "serverInfo"
        assert viewer.server["capabilities"] == [], "a viewer might send something"
        viewer.subscribe(3)
        for topic in (TICK, EVENT, JOINTS):
            offered = viewer.topics[topic.name(daemon.channel)]
            assert (offered["encoding"], offered["schemaName"]) == ("json", topic.schema["title"])
            assert json.loads(offered["schema"]) == topic.schema
        # A disabled motor reports less often than states are shown.
        first = viewer.until(lambda one: one.kind == "tick")[-1]
        slow = viewer.until(lambda one: one.kind == "tick" and one.at_ns > first.at_ns + 10**9)
        stamps = [one.at_ns for one in slow if one.kind == "joints"]
        assert len(stamps) > 3
        assert min(two - one for one, two in pairwise(stamps)) > 2_000_000, "shown twice"
        with daemon.gripper() as gripper:
            gripper.enable()
            gripper.goto(30.0)
            ended = viewer.until(lambda one: "move done" in one.content.get("message", ""))[-1]
            assert (ended.content["name"], ended.content["level"]) == ("job_ended", 2)
            viewer.until(opening_is(30.0))  # where it stands now
            last = viewer.until(lambda one: one.kind == "joints")[-1].content["joints"]
            assert [joint["name"] for joint in last] == [
                "motor",
                "gripper_slide_joint_left",
                "gripper_slide_joint_right",
            ]
            assert last[1]["position"] == pytest.approx(0.042726 - 0.015, abs=0.001)


def test_figures_of_a_silent_motor_are_not_shown_as_those_of_now() -> None:
    with simulated() as daemon, viewed(daemon) as viewer:
        viewer.subscribe(3)
        viewer.until(lambda one: one.kind == "joints")
        daemon.fault("silent")
        shown = viewer.until(lambda one: one.kind == "tick" and "position_rad" not in one.content)
        assert max(one.content.get("age_s", 0.0) for one in shown) <= MOST_AGE_S
        first = shown[-1]
        later = viewer.until(
            lambda one: one.kind == "tick" and one.at_ns > first.at_ns + 300_000_000
        )
        assert {one.kind for one in later} <= {"tick", "event"}
        assert not any("position_rad" in one.content for one in later)
        daemon.reset()
        viewer.until(lambda one: one.kind == "joints")


def test_a_viewer_that_leaves_does_not_touch_the_motor() -> None:
    with simulated() as daemon, daemon.gripper() as gripper:
        gripper.enable()
        with viewed(daemon) as viewer:
            viewer.subscribe(3)
            viewer.until(opening_is(60.0))
        assert gripper.get_state().enabled


def test_a_daemon_that_is_gone_is_told() -> None:
    with ExitStack() as running:
        daemon = running.enter_context(simulated())
        with viewed(daemon) as viewer:
            viewer.subscribe(3)
            viewer.until(lambda one: one.kind == "tick")
            running.close()
            while not viewer.statuses:
                viewer.receive()
    (status,) = viewer.statuses
    assert (status["op"], status["level"], status["id"]) == ("status", 1, daemon.channel)
    assert status["message"].startswith(f"{daemon.channel}: ")


def test_a_port_that_is_taken_is_said() -> None:
    with simulated() as daemon, viewed(daemon) as viewer:
        viewer.subscribe(3)
        port = str(viewer._socket.remote_address[1])
        done = subprocess.run(
            [sys.executable, "-m", "litegrip_foxglove.main", "can0", "--port", port],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("litegrip-foxglove: ")
    assert "Traceback" not in done.stderr
