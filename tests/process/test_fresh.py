"""Only what is fresh moves the jaws, and only users share the time: whole daemons, other users."""

import contextlib
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from tests.process.daemon_process import (
    DEADLINE_S,
    SIMULATED,
    Client,
    DaemonProcess,
    daemon_for_all,
    kill_and_wait,
    line_of,
)

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can become other users")

MOVER, *OBSERVERS = (30_001, 30_002, 30_003, 30_004)
CONFIG = f'{SIMULATED}operators = [{MOVER}]\ndefault = "observer"\n'
READS = 280
SPEED_MM_S = 20.0
LEFT_BEHIND = 1500  # set-points
FAR_MM, NEAR_MM = 72.0, 15.0
LITTLE_MM = 15.0
"""A quarter of the way that what is left behind would have the jaws go."""
TICKS = 500  # time for half of that way

STREAM = """
import json, os, socket, sys
path, uid, count, id_from, *points = sys.argv[1:]
os.setgroups([]); os.setgid(int(uid)); os.setuid(int(uid))
s = socket.socket(socket.AF_UNIX); s.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
s.connect(path)
begin, end, speed = map(float, points)
def line(number):
    opening = begin + (end - begin) * number / int(count)
    params = {"opening_mm": opening, "valid_s": 0.2, "speed_mm_s": speed}
    request = {"jsonrpc": "2.0", "method": "stream.set", "params": params}
    if number % 2 >= int(id_from): request["id"] = number
    return json.dumps(request).encode() + b"\\n"
s.sendall(b"".join(map(line, range(int(count)))))
print("sent", flush=True)
sys.stdin.read()
"""


@pytest.fixture(scope="module")
def running() -> Iterator[DaemonProcess]:
    with daemon_for_all(f"fresh-{os.getpid()}", CONFIG) as process:
        yield process


def stop_path(daemon: DaemonProcess) -> Path:
    return daemon.socket_path.with_suffix(".stop.sock")


@contextlib.contextmanager
def spawned(command: list[str]) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        kill_and_wait(process)
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                stream.close()


@contextlib.contextmanager
def flood(running: DaemonProcess, *uids: int, connections: int = 62) -> Iterator[None]:
    """Let other users ask without end, by many connections each."""
    with contextlib.ExitStack() as stack:
        for uid in uids:
            where = [str(running.socket_path), str(connections), str(uid)]
            command = [sys.executable, "-m", "bench.hostile.flood", *where]
            assert line_of(stack.enter_context(spawned(command))) == "on"
        yield


def ready_at(client: Client, opening: float) -> None:
    known = ("disabled", "enabled", "fault")
    client.until(lambda state: bool(state["calibrated"] and state["motor"] in known))
    if client.result("state.get")["stop"] is not None:
        client.result("stop.clear")
    assert client.despite_silence("motor.enable")["ok"]
    assert client.despite_silence("motion.move", opening_mm=opening)["ok"]


def test_a_clear_and_a_motion_that_were_sent_before_a_stop_never_undo_it(
    running: DaemonProcess,
) -> None:
    """One write of many reads, a clear and a motion; a stop of another user comes meanwhile."""
    stop = (
        "import os, socket, sys\n"
        "os.setgroups([]); os.setgid(30002); os.setuid(30002)\n"
        "s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1])\n"
        "print('on', flush=True)\n"
        "for _ in sys.stdin:\n"
        "    s.sendall(b'hold\\n'); s.recv(4096); print('stopped', flush=True)\n"
    )
    command = [sys.executable, "-c", stop, str(stop_path(running))]
    with running.connect() as watcher, spawned(command) as stopper:
        assert stopper.stdin is not None
        ready_at(watcher, NEAR_MM)
        assert line_of(stopper) == "on"
        for _ in range(6):
            with running.connect() as client:
                numbers = range(1, READS + 1)
                requests: list[dict[str, object]] = [
                    *({"id": number, "method": "state.get"} for number in numbers),
                    {"id": "clear", "method": "stop.clear"},
                    {"id": "move", "method": "motion.open", "params": {"wait": False}},
                ]
                lines = [json.dumps({"jsonrpc": "2.0", **one}).encode() for one in requests]
                client.socket.sendall(b"\n".join(lines) + b"\n")
                stopper.stdin.write("\n")
                answers: dict[object, dict[str, object]] = {}
                while len(answers) < len(requests):
                    message = client.read()
                    answers[message["id"]] = message
                assert line_of(stopper) == "stopped"
                assert watcher.result("state.get")["stop"] is not None, answers["clear"]
            watcher.until(lambda state: state["mode"] == "holding")
            ready_at(watcher, NEAR_MM)


def test_what_lay_unread_in_the_kernel_when_a_stop_came_does_not_undo_it(
    running: DaemonProcess,
) -> None:
    with running.connect() as client, running.connect() as watcher:
        client.result("state.get")
        running.process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, running.process.pid, os.WSTOPPED)
        try:
            numbers = [client.send(method) for method in ("stop.clear", "motor.enable")]
            with socket.socket(socket.AF_UNIX) as stopper:
                stopper.connect(str(stop_path(running)))
                stopper.sendall(b"hold\n")
        finally:
            running.process.send_signal(signal.SIGCONT)
        reasons = [client.answer(number)["error"]["data"]["reason"] for number in numbers]
        assert reasons == ["sent_before_stop"] * 2
        assert watcher.result("state.get")["stop"] is not None
        client.result("stop.clear")


@pytest.mark.parametrize("ids", [9, 1], ids=["without ids", "half of them with ids"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_set_points_of_a_client_that_is_dead_or_stopped_move_nothing(
    running: DaemonProcess, end: signal.Signals, ids: int
) -> None:
    """While another user floods, so that every turn takes long."""
    with running.connect() as watcher:
        ready_at(watcher, FAR_MM)
        where = [str(running.socket_path), str(MOVER), str(LEFT_BEHIND), str(ids)]
        way = [str(FAR_MM), str(NEAR_MM), str(SPEED_MM_S)]
        with (
            flood(running, OBSERVERS[0]),
            spawned([sys.executable, "-c", STREAM, *where, *way]) as streamer,
        ):
            assert line_of(streamer) == "sent"
            streamer.send_signal(end)
            if end == signal.SIGKILL:
                streamer.wait(DEADLINE_S)
            seq = watcher.result("state.get")["seq"]
            watcher.until(lambda state: bool(state["seq"] > seq + TICKS))
            state = watcher.until(lambda state: bool(state["mode"] == "holding"))
            assert state["opening_mm"] == pytest.approx(FAR_MM, abs=LITTLE_MM)


def test_a_stop_that_a_client_left_behind_is_in_force_its_motion_is_not(
    running: DaemonProcess,
) -> None:
    with running.connect() as watcher, flood(running, OBSERVERS[0]):
        ready_at(watcher, FAR_MM)
        with running.connect() as client:
            for method in ("motion.close", "stop", "motion.close"):
                client.send(method)
        watcher.until(lambda state: state["stop"] is not None)
        state = watcher.until(lambda state: bool(state["mode"] == "holding"))
        assert state["opening_mm"] == pytest.approx(FAR_MM, abs=LITTLE_MM)


def test_a_renewal_behind_a_stream_is_served_with_its_newest_set_point(
    running: DaemonProcess,
) -> None:
    with running.connect() as client, flood(running, *OBSERVERS):
        ready_at(client, NEAR_MM)
        client.result("lease.acquire", ttl_s=30.0)
        params = {"opening_mm": NEAR_MM + 1.0}
        point = json.dumps({"jsonrpc": "2.0", "method": "stream.set", "params": params})
        before = client.result("clients.list")["clients"]
        (me,) = [one for one in before if one["is_me"]]
        client.socket.sendall(f"{point}\n".encode() * LEFT_BEHIND)
        client.result("lease.renew")
        (me_after,) = [one for one in client.result("clients.list")["clients"] if one["is_me"]]
        assert me_after["requests"] - me["requests"] < LEFT_BEHIND / 4


@pytest.mark.alone
def test_three_flooding_users_with_many_connections_are_three_to_wait_for(
    running: DaemonProcess,
) -> None:
    """Counted in requests that are served between two of one who has a single connection.

    All of his are there from the begin: how seldom a busy machine lets him run does not count.
    """
    with running.connect() as client:
        with flood(running, *OBSERVERS):
            asked = [client.send("health") for _ in range(60)]
            served = [client.answer(one)["result"]["rpc"]["requests"] for one in asked]
        between = [later - earlier for earlier, later in pairwise(served)]
        assert statistics.median(between) < 3 * 62 / 2
