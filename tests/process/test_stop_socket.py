"""The stop socket and SIGUSR1 of a whole daemon: in force in the next tick, whatever goes on."""

import contextlib
import json
import os
import signal
import socket
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, spawned

FLOODING_CLIENTS = 8
FLOOD = """
import socket, sys
s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1])
lines = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\\n' * 100
print("on", flush=True)
while True:
    s.sendall(lines); answers = 0
    while answers < 100: answers += s.recv(1 << 20).count(b"\\n")
"""
PERIOD_S = 0.005
ROUNDS = 6
FIELDS = ["mode", "command_rad"]


def stop_path(daemon: DaemonProcess) -> Path:
    return daemon.socket_path.with_suffix(".stop.sock")


def connect(path: Path) -> socket.socket:
    connected = socket.socket(socket.AF_UNIX)
    connected.settimeout(DEADLINE_S)
    try:
        connected.connect(str(path))
    except OSError:
        connected.close()
        raise
    return connected


@contextlib.contextmanager
def flood(path: Path) -> Iterator[None]:
    """Let processes ask as much as the daemon answers."""
    with contextlib.ExitStack() as stack:
        for _ in range(FLOODING_CLIENTS):
            stack.enter_context(spawned(FLOOD, str(path), says="on"))
        yield


@dataclass(frozen=True, slots=True)
class Sample:
    """What the motor was told in one tick."""

    monotonic_s: float
    mode: str
    command_rad: float


class Watcher:
    """A client that is sent every tick's command."""

    def __init__(self, client: Client) -> None:
        self._client = client
        client.result("state.subscribe", hz=200, fields=FIELDS)

    def sample(self) -> Sample:
        while (message := self._client.read()).get("method") != "state.sample":
            assert message, "the daemon has closed the connection"
        params = message["params"]
        return Sample(params["monotonic_s"], *(params["state"][name] for name in FIELDS))

    def until_moving(self) -> None:
        """Read until the command has moved for a while."""
        ends_s = time.monotonic() + DEADLINE_S
        commands: set[float] = set()
        while len(commands) < 20:
            sample = self.sample()
            if sample.mode == "moving":
                commands.add(sample.command_rad)
            assert time.monotonic() < ends_s, sample

    def since(self, since_s: float, count: int) -> list[Sample]:
        """Return samples of ticks that began after a time."""
        samples: list[Sample] = []
        while len(samples) < count:
            sample = self.sample()
            if sample.monotonic_s > since_s:
                samples.append(sample)
        return samples


def assert_held(samples: list[Sample]) -> None:
    """From the first tick on the same position is commanded."""
    assert {sample.mode for sample in samples} == {"holding"}
    assert {sample.command_rad for sample in samples} == {samples[0].command_rad}


def stop_line(**params: Any) -> bytes:
    request = {"jsonrpc": "2.0", "id": "s", "method": "stop", "params": params}
    return json.dumps(request).encode() + b"\n"


def moving(mover: Client) -> int:
    """Begin a motion of many seconds; return its request."""
    mover.enabled().result("motion.close")
    request = mover.send("motion.open", speed_mm_s=15)
    mover.until(lambda state: bool(state["mode"] == "moving"))
    return request


@pytest.mark.local_only("it looks at the daemon's own stop socket")
def test_a_stop_has_the_name_that_the_program_gives_itself(simulated: DaemonProcess) -> None:
    """Its jobs and its lease have it, too; without a connection it is that of the process."""
    with simulated.connect() as program, connect(stop_path(simulated)) as stopper:
        program.result("hello", client="sorting.py")
        stopper.sendall(stop_line())
        assert json.loads(stopper.recv(4096))["result"]["level"] == "hold"
        by = program.result("state.get")["stop"]["by"]
        assert by == "sorting.py"
        program.result("stop.clear")
    with simulated.connect() as other, connect(stop_path(simulated)) as stopper:
        other_name = other.result("clients.list")["clients"][-1]["program"]
        stopper.sendall(stop_line())
        stopper.recv(4096)
        assert other.result("state.get")["stop"]["by"] == other_name
        assert other_name != "sorting.py"
        other.result("stop.clear")


@pytest.mark.local_only("a stop takes the network's time, and not one tick")
@pytest.mark.parametrize("flooded", [False, True], ids=["alone", "flooded"])
def test_the_next_command_after_a_stop_holds(simulated: DaemonProcess, flooded: bool) -> None:
    """At whatever time within a period it is sent: the first tick that begins later holds."""
    with simulated.connect() as mover, simulated.connect() as second:
        mover.enabled().result("motion.close")
        watcher = Watcher(second)
        before = mover.result("state.get")["stop_generation"]
        around = flood(simulated.socket_path) if flooded else contextlib.nullcontext()
        with around, connect(stop_path(simulated)) as stopper:
            for number in range(1, ROUNDS + 1):
                motion = mover.send("motion.open", speed_mm_s=15)
                watcher.until_moving()
                stopper.sendall(stop_line())
                sent_s = time.monotonic()
                assert_held(watcher.since(sent_s, 20))
                assert json.loads(stopper.recv(4096)) == {
                    "jsonrpc": "2.0",
                    "id": "s",
                    "result": {"level": "hold", "generation": before + number, "motor": "enabled"},
                }
                assert mover.answer(motion)["error"]["data"]["reason"] == "stopped"
                mover.result("stop.clear")
        assert mover.despite_silence("motion.open", speed_mm_s=100)["ok"]
        assert mover.result("health")["control"]["tick_errors"] == 0


def test_who_stopped_and_why_is_told_to_everybody_whom_the_stop_refuses(
    simulated: DaemonProcess,
) -> None:
    with simulated.connect() as client, connect(stop_path(simulated)) as stopper:
        client.enabled()
        before_s = time.monotonic()
        stopper.sendall(stop_line(why="a finger"))
        stopper.recv(4096)
        stop = client.result("state.get")["stop"]
        assert (stop["level"], stop["why"]) == ("hold", "a finger")
        assert before_s <= stop["since_s"] <= time.monotonic()
        error = client.call("motion.open")["error"]
        assert error["data"]["reason"] == "stopped"
        who = simulated.remote_as or f"(pid {os.getpid()})"
        assert who in error["message"]
        assert "is latched: a finger" in error["message"]


def test_hello_names_the_socket(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        for method in ("hello", "info.get"):
            assert client.result(method)["stop_socket"] == str(stop_path(simulated).absolute())


def test_sigusr1_holds(simulated: DaemonProcess) -> None:
    with simulated.connect() as mover, simulated.connect() as second:
        with flood(simulated.socket_path):  # which takes long to begin on a busy machine
            motion = moving(mover)
            watcher = Watcher(second)
            watcher.until_moving()
            simulated.process.send_signal(signal.SIGUSR1)
            # The kernel gives it to the process in its own time, though in microseconds.
            assert_held(watcher.since(time.monotonic() + PERIOD_S, 50))
        assert mover.answer(motion)["error"]["data"]["reason"] == "stopped"
        stop = mover.result("state.get")["stop"]
        assert (stop["level"], stop["by"]) == ("hold", "signal SIGUSR1")
        assert "a stop (hold) by signal SIGUSR1" in simulated.log


def test_a_signal_to_all_processes_of_the_daemon_ends_none(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        helper = client.until_health(lambda h: bool(h["helper"]["pid"]))["helper"]["pid"]
        for pid in (helper, simulated.process.pid):
            os.kill(pid, signal.SIGUSR1)
        client.until(lambda state: state["stop"] is not None)
        assert client.result("calibration.templates")  # the helper's work
        figures = client.result("health")["helper"]
        assert figures == {"pid": helper, "deaths": 0, "refused": 0, "waiting": 0}


@pytest.mark.parametrize(
    ("said", "level", "mode"),
    [
        (b"hold\n", "hold", "holding"),
        (b"relax\n", "relax", "relaxed"),
        (b"disable", "disable", "disabled"),
        (b"help\n", "hold", "holding"),
        (b"\n", "hold", "holding"),
    ],
)
def test_bare_text_as_echo_and_socat_send_it(
    simulated: DaemonProcess, said: bytes, level: str, mode: str
) -> None:
    with simulated.connect() as mover:
        motion = moving(mover)
        generation = mover.result("state.get")["stop_generation"] + 1
        with connect(stop_path(simulated)) as stopper:
            stopper.sendall(said)
            stopper.shutdown(socket.SHUT_WR)
            with stopper.makefile("rb") as lines:
                (answer,) = lines.readlines()
        result = json.loads(answer)["result"]
        assert result.pop("motor") in ("enabled", "disabling")
        assert result == {"level": level, "generation": generation}
        assert mover.answer(motion)["error"]["data"]["reason"] == "stopped"
        mover.until(lambda state: bool(state["mode"] == mode))
        assert mover.refusal("motion.close") == "stopped"
        assert mover.refusal("motor.enable") == "stopped"


def test_a_level_can_only_be_raised_until_it_is_cleared(simulated: DaemonProcess) -> None:
    with simulated.connect() as client, connect(stop_path(simulated)) as stopper:
        before = client.enabled().result("state.get")["stop_generation"]
        for level, latched in (("relax", "relax"), ("hold", "relax"), ("disable", "disable")):
            stopper.sendall(stop_line(level=level))
            assert json.loads(stopper.recv(4096))["result"]["level"] == latched
        assert client.result("stop.clear")["generation"] == before + 3
        client.until(lambda state: bool(state["motor"] == "disabled"))
        assert client.despite_silence("motor.enable")["ok"]


def test_a_stop_is_taken_before_the_first_client_is(tmp_path: Path) -> None:
    running = DaemonProcess(
        tmp_path, f"sim-{os.getpid()}", "--simulate", "--socket", str(tmp_path / "rpc.sock")
    )
    try:
        path = stop_path(running)
        ends_s = time.monotonic() + DEADLINE_S
        stopper: socket.socket | None = None
        while stopper is None:
            assert time.monotonic() < ends_s, running.log
            with contextlib.suppress(FileNotFoundError, ConnectionRefusedError):
                stopper = connect(path)
            running.wait_a_moment()
        with stopper:
            stopper.sendall(b"hold\n")
            with running.connect() as client:
                assert client.refusal("motor.enable") in ("stopped", "sent_before_stop")
        assert stat.S_IMODE(path.stat().st_mode) == 0o660
        running.end()
        assert not path.exists()
    finally:
        running.kill()


def test_a_flood_of_stops_delays_no_tick_and_no_stronger_stop(own: DaemonProcess) -> None:
    path = stop_path(own)
    with own.connect() as client, contextlib.ExitStack() as stack:
        client.enabled()
        for _ in range(2):
            program = FLOOD.replace('{"jsonrpc":"2.0","id":1,"method":"state.get"}', "hold")
            stack.enter_context(spawned(program, str(path), says="on"))
        client.until(lambda state: bool(state["stop_generation"] > 1000))
        with connect(path) as stopper:
            stopper.sendall(b"disable\n")
            assert json.loads(stopper.recv(4096))["result"]["level"] == "disable"
        client.until(lambda state: bool(state["motor"] == "disabled"))
        health = client.result("health")
        assert health["control"]["tick_errors"] == 0
        # One that has come before yet another stop clears nothing.
        ends_s = time.monotonic() + DEADLINE_S
        while "error" in (answer := client.call("stop.clear")):
            assert answer["error"]["data"]["reason"] == "sent_before_stop"
            assert time.monotonic() < ends_s
        told = client.result("events.subscribe", kinds=["stop", "stop_cleared"])["events"]
        levels = [event["data"]["level"] for event in told if event["kind"] == "stop"]
        assert levels[:2] == ["hold", "disable"]
        cleared = next(event for event in told if event["kind"] == "stop_cleared")
        assert cleared["data"]["repeats"] > 1000
    assert own.log.count("a stop (") < 10  # the flood goes on after the clearing
