"""The whole daemon with the simulated gripper: clients in other processes, and their ends."""

import contextlib
import ctypes.util
import os
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.image
import pytest

from tests.process.daemon_process import (
    DEADLINE_S,
    SIMULATED,
    Client,
    DaemonProcess,
    configured,
    daemon,
    kill_and_wait,
    line_of,
    spawn,
)

READER = """
import json, socket, sys
s = socket.socket(socket.AF_UNIX); s.settimeout(30); s.connect(sys.argv[1])
f = s.makefile("rb")
print("ready", flush=True)
sys.stdin.readline()
for number in range(300):
    s.sendall(b'{"jsonrpc":"2.0","id":%d,"method":"state.get"}\\n' % number)
    answer = json.loads(f.readline())
    assert answer["id"] == number, answer
    state = answer["result"]
    assert state["bus"] == "up" and state["enabled"], state
    assert -0.1 < state["openness"] < 1.1, state
print("fine", flush=True)
"""
OPENER = """
import json, socket, sys
s = socket.socket(socket.AF_UNIX); s.settimeout(30); s.connect(sys.argv[1])
f = s.makefile("rb")
def call(method, **params):
    request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
    s.sendall(json.dumps(request).encode() + b"\\n")
    while "id" not in (answer := json.loads(f.readline())):
        print("moving", flush=True)
    return answer
assert "result" in call("lease.acquire", on_lost=sys.argv[2])
assert call("motor.enable")["result"]["ok"]
if sys.argv[3] == "move":
    call("motion.open", speed_mm_s=20, progress=True)
print("enabled", flush=True)
f.readline()
"""


def test_ten_processes_read_while_one_opens(own: DaemonProcess) -> None:
    with own.connect() as client:
        client.enabled().result("motion.close")
        readers = [spawn(READER, str(own.socket_path)) for _ in range(10)]
        try:
            for reader in readers:
                assert line_of(reader) == "ready"
            motion = client.send("motion.open", speed_mm_s=60)
            for reader in readers:
                assert reader.stdin is not None
                reader.stdin.write("go\n")
                reader.stdin.flush()
            assert [line_of(reader) for reader in readers] == ["fine"] * 10
            assert client.answer(motion)["result"]["ok"]
        finally:
            for reader in readers:
                with reader:
                    reader.kill()
        health = client.result("health")
        assert health["control"]["tick_errors"] == 0
        assert health["rpc"]["requests"] > 3000
        client.result("calibration.templates")  # by now the helper has written the log
        assert "motor: disabling -> disabled" not in own.log


def test_a_client_killed_in_its_motion_leaves_the_jaws_held(simulated: DaemonProcess) -> None:
    with simulated.connect() as watcher:
        watcher.enabled().result("motion.close")
        opener = spawn(OPENER, str(simulated.socket_path), "hold", "move")
        with opener:
            assert line_of(opener) == "moving"
            moving = watcher.until(lambda state: bool(state["opening_mm"] > 5))
            before = watcher.result("health")
            kill_and_wait(opener)
        held = watcher.until(lambda state: bool(state["mode"] == "holding"))
        assert held["enabled"]
        job = watcher.result("job.get", job=moving["job"]["job"])
        assert job["state"] == "cancelled"
        assert job["error"]["data"]["reason"] == "client_lost"
        after = watcher.until_health(
            lambda h: bool(h["motor"]["commands"] > before["motor"]["commands"] + 100)
        )
        assert after["motor"]["withheld_commands"] == before["motor"]["withheld_commands"]
        passed = after["control"]["ticks"] - before["control"]["ticks"]
        lost = after["control"]["lost_ticks"] - before["control"]["lost_ticks"]
        commands = after["motor"]["commands"] - before["motor"]["commands"]
        assert abs(commands - (passed - lost)) <= 2  # one command in every tick that there was
        still = watcher.result("state.get")
        assert still["mode"] == "holding"
        assert still["opening_mm"] == pytest.approx(held["opening_mm"], abs=2)
        assert still["opening_mm"] < 100
        with simulated.connect() as following:
            assert following.result("motion.open", speed_mm_s=100)["ok"]


@pytest.mark.parametrize("kind", ["idle", "move"])
def test_a_killed_client_that_asked_for_it_disables_the_motor(
    simulated: DaemonProcess, kind: str
) -> None:
    with simulated.connect() as watcher:
        watcher.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        opener = spawn(OPENER, str(simulated.socket_path), "disable", kind)
        with opener:
            assert line_of(opener) == ("enabled" if kind == "idle" else "moving")
            assert watcher.result("state.get")["enabled"]
            kill_and_wait(opener)
        watcher.until(lambda state: bool(state["status"] == "disabled" and not state["enabled"]))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_while_moving_disables_the_motor_and_answers_who_waits(
    tmp_path: Path, number: signal.Signals
) -> None:
    with (
        daemon(tmp_path, f"sim-{os.getpid()}", "--simulate") as running,
        running.connect() as mover,
    ):
        mover.enabled()
        motion = mover.send("motion.open", speed_mm_s=20)
        mover.until(lambda state: bool(state["mode"] == "moving"))
        running.process.send_signal(number)
        assert mover.answer(motion)["error"]["data"]["reason"] == "shutting_down"
        parting = mover.read()
        assert parting["id"] is None
        assert parting["error"]["data"]["motor_off"] is True
        assert mover.read() == {}
        assert running.exit_code() == 0
        assert "ended; the motor is off (disabled)" in running.log
        assert "shutting_down" in running.log or "is about to end" in running.log
        assert not running.socket_path.exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_until_the_very_end_leave_it_an_orderly_one(
    tmp_path: Path, number: signal.Signals
) -> None:
    """Of who presses Ctrl-C again and again, or a supervisor that asks twice."""
    with daemon(tmp_path, f"sim-{os.getpid()}", "--simulate") as running:
        with running.connect() as client:
            client.result("hello")
        while running.process.poll() is None:
            running.process.send_signal(number)
        assert running.exit_code() == 0
        assert "the motor is off" in running.log


def test_a_stop_that_is_sent_by_a_dying_client_is_in_force(simulated: DaemonProcess) -> None:
    with simulated.connect() as mover:
        mover.enabled()
        motion = mover.send("motion.open", speed_mm_s=20)
        mover.until(lambda state: bool(state["mode"] == "moving"))
        with simulated.connect() as stopper:
            stopper.send("stop")
        assert mover.answer(motion)["error"]["data"]["reason"] == "stopped"
        assert mover.refusal("motion.close") == "stopped"
        mover.result("stop.clear")


@pytest.mark.local_only("it looks at the daemon's own socket")
def test_a_channel_has_one_daemon(simulated: DaemonProcess, tmp_path: Path) -> None:
    with simulated.connect() as client:
        channel = client.result("hello")["channel"]
    second = DaemonProcess(tmp_path, channel, "--simulate", "--socket", "other.sock")
    assert second.exit_code() == 3
    assert f"pid {simulated.process.pid}" in second.log
    third = DaemonProcess(
        tmp_path, "simother", "--simulate", "--socket", str(simulated.socket_path)
    )
    assert third.exit_code() == 3
    assert re.search(
        rf"the process with pid {simulated.process.pid} of uid \d+ listens on", third.log
    )


def test_after_a_kill_a_new_daemon_takes_the_place(tmp_path: Path) -> None:
    arguments = (f"sim-{os.getpid()}", "--simulate", "--socket", str(tmp_path / "rpc.sock"))
    first = DaemonProcess(tmp_path, *arguments)
    try:
        with first.connect() as client:
            helper = client.until_health(lambda h: bool(h["helper"]["pid"]))["helper"]["pid"]
        pidfd = os.pidfd_open(helper)
    finally:
        first.kill()
    try:
        assert select.select([pidfd], [], [], 30.0)[0], "the helper outlives its daemon"
    finally:
        os.close(pidfd)
    assert first.socket_path.exists()
    with daemon(tmp_path, *arguments[:2]) as second, second.connect() as client:
        assert client.result("hello")["pid"] == second.process.pid


def test_a_killed_helper_is_started_again(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        first = client.until_health(lambda h: bool(h["helper"]["pid"]))["helper"]
        os.kill(first["pid"], signal.SIGKILL)
        deaths = first["deaths"] + 1
        figures = client.until_health(
            lambda h: bool(h["helper"]["deaths"] == deaths and h["helper"]["pid"])
        )
        assert figures["helper"]["pid"] != first["pid"]
        assert client.result("state.get")["mode"] == "holding"
        assert figures["control"]["tick_errors"] == 0


def test_the_first_request_after_the_start_finds_motor_and_calibration(tmp_path: Path) -> None:
    """A client that is let in is not told that the daemon is still looking around."""
    path = tmp_path / "s"
    command = [sys.executable, "-m", "litegripd.app.main", "first", "--simulate"]
    with (
        subprocess.Popen([*command, "--socket", str(path)], stderr=subprocess.PIPE) as daemon,
        contextlib.ExitStack() as at_the_end,
    ):
        at_the_end.callback(daemon.kill)  # or a failure here would wait for its end for ever
        ends_s = time.monotonic() + DEADLINE_S
        client: Client | None = None
        while client is None and time.monotonic() < ends_s:
            with contextlib.suppress(OSError):
                client = Client(path)
        assert client is not None
        with client:
            assert client.result("motor.enable")["ok"]
            assert client.result("state.get")["calibrated"]
        daemon.send_signal(signal.SIGTERM)
        _, log = daemon.communicate(timeout=DEADLINE_S)
    assert daemon.returncode == 0, log


FORKER = """
import json, os, socket, sys
s = socket.socket(socket.AF_UNIX); s.settimeout(30); s.connect(sys.argv[1])
f = s.makefile("rb")
for method, params in (("lease.acquire", {"on_lost": "relax"}), ("motor.enable", {})):
    s.sendall(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode())
    s.sendall(b"\\n")
    assert "result" in json.loads(f.readline())
if os.fork() == 0:
    sys.stdin.readline()  # keeps the socket until the test lets it go
    os._exit(0)
print("forked", flush=True)
os._exit(0)
"""


def test_a_process_that_ends_loses_its_lease_though_a_child_keeps_the_socket(
    simulated: DaemonProcess,
) -> None:
    with simulated.connect() as watcher:
        watcher.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        process = spawn(FORKER, str(simulated.socket_path))
        assert line_of(process) == "forked"
        try:
            watcher.until(lambda state: bool(state["mode"] == "relaxed"))
            assert watcher.result("lease.get")["owner"] is None
            assert len(watcher.result("clients.list")["clients"]) == 2
        finally:
            assert process.stdin is not None
            process.stdin.close()
            assert process.stdout is not None
            process.stdout.close()
            process.wait(DEADLINE_S)


def test_a_daemon_on_mujoco_holds_the_cube_of_its_scene(tmp_path: Path) -> None:
    config = SIMULATED.replace("watchdog_s", 'mechanics = "mujoco"\nwatchdog_s')
    with configured(tmp_path, f"mujoco-{os.getpid()}", config) as own, own.connect() as client:
        client.enabled()
        assert client.result("motion.open")["ok"]
        assert client.result("motion.move", opening_mm=50.0)["ok"]
        assert client.result("state.get")["opening_mm"] == pytest.approx(50.0, abs=0.5)
        grasp = client.result("motion.grasp", force_n=10.0, until="verdict")
        assert (grasp["ok"], grasp["outcome"]) == (True, "object_held")
        assert grasp["width_mm"] == pytest.approx(30.0, abs=0.5)
        assert client.result("health")["control"]["tick_errors"] == 0


@pytest.mark.skipif(ctypes.util.find_library("EGL") is None, reason="libEGL is missing (Mesa)")
def test_a_picture_of_the_scene_shows_its_cube(tmp_path: Path) -> None:
    view = Path(__file__).parents[2] / "examples" / "mujoco_view.py"
    file = tmp_path / "scene.png"
    arguments = ("--simulate", "mujoco")
    with daemon(tmp_path, f"seen-{os.getpid()}", *arguments) as own, own.connect() as client:
        client.result("hello")
        command = [sys.executable, str(view), "--socket", str(own.socket_path)]
        environment = {**os.environ, "MUJOCO_GL": "egl"}
        command += ["--picture", str(file)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    picture = matplotlib.image.imread(file)
    assert picture.shape == (640, 960, 3)
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    assert 2000 < int(((red > 0.7) & (green < 0.6) & (blue < 0.3)).sum()) < 20_000  # orange
