"""A hold survives a restart of the daemon: real processes, an adapter that is opened only once."""

import contextlib
import os
import re
import select
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from litegripd.app.systemd import MANAGER_WITHIN_S
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.restarting import (
    RATE_HZ,
    Restartable,
    held,
    holds,
    is_of_silence,
    restartable,
    wait_for_end,
)

RESTARTS = 8
"""A busy machine may delay one or the other of them, but not all."""


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Restartable]:
    with restartable(tmp_path) as running:
        yield running


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Restartable]:
    with restartable(tmp_path_factory.mktemp("line")) as running:
        yield running


@pytest.fixture
def lasting(line: Restartable) -> Restartable:
    """The newest of a line of daemons, with the first configuration, enabled, stopped by nobody."""
    line.configure()
    with line.connect() as client:
        line.pid = client.result("hello")["pid"]  # whatever the test before has missed
        if client.result("state.get")["stop"] is not None:
            client.result("stop.clear")
        client.despite_silence("motor.enable")
    return line


def undisturbed_restart(daemon: Restartable) -> tuple[dict[str, object], dict[str, object]]:
    """Restart while the object is held; return the state before and after.

    A restart in which this machine has kept the simulator from answering tells nothing: the hold by
    force is lost by that, restart or not. Then the next one counts.
    """
    ends_s = time.monotonic() + 2.5 * DEADLINE_S
    while time.monotonic() < ends_s:
        with daemon.connect() as client:
            held(client)
            client.result("calibration.templates")  # by now the helper has written the log
            mark, pid = len(daemon.log), daemon.pid
            before = client.result("state.get")
            answer = daemon.restart(client) if holds(before) else {}
        if "result" not in answer:
            assert not answer or is_of_silence(answer), answer
            continue
        wait_for_end(pid)
        with daemon.connect() as client:
            after = client.result("state.get")
            assert client.result("hello")["pid"] == daemon.pid
            client.result("calibration.templates")
        if not daemon.disturbed_since(mark):
            return before, after
    raise AssertionError("this machine is too busy: the simulator never answered all the while")


@pytest.mark.alone  # what delays the simulator ends the hold
def test_pose_and_force_are_held_and_the_motor_is_never_disabled(
    daemon: Restartable, tmp_path: Path
) -> None:
    first = daemon.pid
    before, after = undisturbed_restart(daemon)
    assert daemon.first.exit_code() == 0
    assert daemon.pid != first
    assert holds(before), before
    assert holds(after), after
    assert after["opening_mm"] == pytest.approx(before["opening_mm"], abs=0.2)
    assert after["requested_torque_nm"] == pytest.approx(0.8, abs=0.01)
    assert after["seq"] > before["seq"]  # type: ignore[operator]
    assert re.search(r"took over \d+\.\d ms after the last command", daemon.log)
    with daemon.connect() as client:
        jobs = client.result("job.list")["jobs"]
        assert [job["kind"] for job in jobs][-1] == "grasp"
        assert client.result("health")["control"]["tick_errors"] == 0
    other = tmp_path / "other"
    other.mkdir()
    rival = DaemonProcess(
        other, daemon.channel, "--config", str(daemon.config), "--socket", str(other / "s")
    )
    assert rival.exit_code() == 3
    assert f"pid {daemon.pid}" in rival.log
    os.kill(daemon.pid, signal.SIGTERM)
    wait_for_end(daemon.pid)
    assert re.search(r"ended; the motor is off", daemon.log)
    assert not daemon.first.socket_path.exists()


def restarted(running: Restartable) -> dict[str, Any]:
    """Restart a daemon, and again what this busy machine lets fail; return the result."""
    with running.connect() as client:
        return running.restart_at_last(client)


def test_the_successor_takes_over_with_no_gap_over_two_periods(lasting: Restartable) -> None:
    """The best of a few counts: what the successor itself is late by, all of them are."""
    gaps_s: list[float] = []
    while not gaps_s or min(gaps_s) > 2.0 / RATE_HZ:
        assert len(gaps_s) < RESTARTS, gaps_s
        with lasting.connect() as client:
            client.despite_silence("motor.enable")
        before = lasting.pid
        gaps_s.append(restarted(lasting)["gap_s"])
        wait_for_end(before)
    assert min(gaps_s) > 0.0, "the gap is told"


def test_a_configuration_that_does_not_fit_leaves_everything_as_it_was(
    lasting: Restartable,
) -> None:
    first = lasting.pid
    good = lasting.config.read_text(encoding="utf-8")
    wrong = {
        good + "rate = 5\n": "[control] rate is unknown",
        good + "[motor]\ncan_id = 9\n": "another [motor]",
        good.replace('"normal"', '"reverse"'): "another [gripper]",
    }
    with lasting.connect() as client:
        for content, told in wrong.items():
            lasting.config.write_text(content, encoding="utf-8")
            error = lasting.restart_despite_silence(client)["error"]
            assert error["data"]["reason"] == "restart_failed", error
            assert told in error["message"]
            assert client.result("hello")["pid"] == first
            with lasting.connect() as another:
                assert another.result("hello")["client"] > 1
        lasting.config.write_text(good.replace("100", "200"), encoding="utf-8")
        client.until(lambda state: bool(state["bus"] == "up" and not state["stale"]))
        assert lasting.restart_at_last(client)["pid"] != first
    with lasting.connect() as client:
        assert client.result("hello")["limits"]["rate_hz"] == 200


def begin_restart(asker: Client, client: Client) -> tuple[int, int]:
    """Ask for a restart; return the request, and the successor, which is a child of the helper."""
    health = client.until_health(lambda health: health["helper"]["pid"] is not None)
    helper = health["helper"]["pid"]
    children = Path(f"/proc/{helper}/task/{helper}/children")
    ends_s = time.monotonic() + DEADLINE_S
    number = asker.send("daemon.restart", hold_through_restart=True)
    while not (found := children.read_text(encoding="ascii").split()):
        assert time.monotonic() < ends_s, "no successor is started"
        if select.select([asker.socket], [], [], 0.0)[0]:  # this machine is too busy just now
            assert is_of_silence(asker.answer(number)), asker.answers[number]
            number = asker.send("daemon.restart", hold_through_restart=True)
        client.let_a_tick_pass()
    return number, int(found[0])


def test_a_successor_that_is_killed_leaves_everything_as_it_was(lasting: Restartable) -> None:
    first = lasting.pid
    with lasting.connect() as client, lasting.connect() as asker:
        number, successor = begin_restart(asker, client)
        os.kill(successor, signal.SIGKILL)
        error = asker.answer(number)["error"]
        assert error["data"]["reason"] == "restart_failed"
        assert "ended before it was ready" in error["message"]
        assert client.refusal("daemon.restart", hold_through_restart=False) == "invalid_params"
        assert client.result("hello")["pid"] == first
        ticks = client.result("health")["control"]["ticks"]
        client.until_health(lambda health: bool(health["control"]["ticks"] > ticks + 20))
        client.until(lambda state: bool(state["motor"] in ("enabled", "fault", "disabled")))
    with lasting.connect() as late:
        assert late.result("state.get")["bus"] == "up"


def test_no_stop_is_lost_on_the_way_from_one_to_the_other(lasting: Restartable) -> None:
    """Every stop that was answered is latched afterwards, whoever of the two has answered it."""
    first = lasting.pid
    with lasting.connect() as asker, lasting.connect() as stopper:
        asker.send("daemon.restart", hold_through_restart=True)
        generation = 0
        try:
            while True:
                if select.select([asker.socket], [], [], 0)[0] and (told := asker.read()):
                    if "result" in told:
                        lasting.pid = told["result"]["pid"]
                    else:  # this machine is too busy just now
                        assert is_of_silence(told), told
                        asker.send("daemon.restart", hold_through_restart=True)
                number = stopper.send("stop", level="hold", why="a test")
                while number not in stopper.answers and (message := stopper.read()):
                    if message.get("id") is not None:
                        stopper.answers[message["id"]] = message
                if number not in stopper.answers:
                    break
                generation = stopper.answers[number]["result"]["generation"]
        except (BrokenPipeError, ConnectionResetError):
            pass  # the first daemon has ended
        while message := asker.read():
            if "result" in message:
                lasting.pid = message["result"]["pid"]
    with lasting.connect() as client:
        assert client.result("hello")["pid"] == lasting.pid != first
        state = client.until(lambda state: bool(state["stop"] is not None))
        assert generation > 0
        assert state["stop_generation"] >= generation


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """The end at which a service manager hears what its services tell it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(DEADLINE_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listening


@pytest.mark.parametrize("number", [signal.SIGUSR1, signal.SIGTERM])
def test_a_signal_to_the_old_daemon_is_passed_on_to_its_end(
    tmp_path: Path, manager: socket.socket, number: signal.Signals
) -> None:
    """The service manager takes its time, and so the old daemon is still there."""
    with restartable(tmp_path) as running:
        restarted(running)
        assert running.first.process.poll() is None
        running.first.process.send_signal(number)
        if number == signal.SIGTERM:
            wait_for_end(running.pid)
            assert "ended; the motor is off" in running.log
        else:
            with running.connect() as client:
                client.until(lambda state: bool(state["stop"] is not None))
        assert running.first.exit_code() == 0


def test_the_service_manager_is_told_who_the_daemon_is(
    tmp_path: Path, manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "4000000")

    def told(wanted: bytes) -> bytes:
        """Return the next message of a sort; the status comes in between."""
        while not (message := manager.recv(1000)).startswith(wanted):
            assert message.startswith((b"STATUS=", b"WATCHDOG=1")), message
        return message

    with restartable(tmp_path) as running:
        assert told(b"READY") == b"READY=1"
        restarted(running)
        assert told(b"MAINPID") == f"MAINPID={running.pid}".encode()
        message, (barrier,), _flags, _address = socket.recv_fds(manager, 100, 1)
        assert message == b"BARRIER=1"
        os.close(barrier)
        assert running.first.exit_code() == 0
        while select.select([manager], [], [], 0)[0]:
            manager.recv(1000)
        assert told(b"WATCHDOG=1"), "the successor feeds it now"


def leave_no_room(manager: socket.socket) -> None:
    """Wait until the daemon is ready; then others tell so much that nothing more can be told."""
    while manager.recv(1000) != b"READY=1":
        pass
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while other.sendto(b"STATUS=of others", manager.getsockname()):
                pass


def test_the_service_manager_is_told_so_also_where_it_has_not_read_for_long(
    tmp_path: Path, manager: socket.socket
) -> None:
    """Who does not know the successor would end it together with the old daemon."""
    with restartable(tmp_path) as running:
        leave_no_room(manager)
        restarted(running)
        with running.connect() as client:
            assert client.result("hello")["pid"] == running.pid, "clients do not wait for that"
        with pytest.raises(subprocess.TimeoutExpired):
            running.first.process.wait(MANAGER_WITHIN_S + 0.5)
        told = [manager.recv(1000)]
        while not told[-1].startswith(b"BARRIER"):
            told.append(manager.recv(1000))
        assert f"MAINPID={running.pid}".encode() in told
        assert running.first.exit_code() == 0


def test_an_old_daemon_does_not_outlast_its_successor(
    tmp_path: Path, manager: socket.socket
) -> None:
    with restartable(tmp_path) as running:
        leave_no_room(manager)
        restarted(running)
        assert running.first.process.poll() is None
        running.first.process.send_signal(signal.SIGTERM)
        wait_for_end(running.pid)
        assert running.first.exit_code() == 0


def test_what_lives_in_the_process_is_not_held_through_a_restart(
    simulated: DaemonProcess,
) -> None:
    with simulated.connect() as client:
        client.enabled()
        answer = client.call("daemon.restart", hold_through_restart=True)["error"]
        assert answer["data"]["reason"] == "restart_failed"
        assert "litegrip_sim lives and ends with this process" in answer["message"]
