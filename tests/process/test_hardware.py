"""The daemon on buses that fail: no adapter at all, and an SLCAN adapter that misbehaves."""

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import SLCAN, WORK_MM, Client, DaemonProcess, configured, disable
from tests.sim.simulator_process import SimulatorProcess, simulator


def test_a_channel_that_does_not_exist_is_told_and_refused(tmp_path: Path) -> None:
    config = '[gripper]\nmount = "normal"\n'
    with configured(tmp_path, "nosuch0", config) as running, running.connect() as client:
        state = client.until(lambda s: bool(s["motor"] == "silent" and s["calibrated"]))
        assert state["bus"] in ("down", "adapter_gone")  # without CAN in the kernel, and with it
        assert (state["stale"], state["mode"]) == (True, "offline")
        client.until_health(lambda _health: "CAN bus: " in running.log)
        assert running.log.count("CAN bus: ") == 1
        health = client.result("health")
        assert health["verdict"] == "degraded", "nobody uses it, and somebody must mend it"
        assert "cannot be opened" in health["reasons"][0]
        assert client.refusal("motor.enable") in ("bus_down", "motor_silent")
        assert client.refusal("motion.open") in ("bus_down", "motor_silent")
        assert client.result("health")["verdict"] == "down", "now somebody misses it"
        assert client.result("hello")["channel"] == "nosuch0"


def test_a_bus_that_is_down_from_the_start_is_in_the_log_once(tmp_path: Path) -> None:
    """By a device that is no serial port, which is "down" whatever the kernel has of CAN."""
    with slcan_daemon(tmp_path, "/dev/null") as running, running.connect() as client:
        pid, seen = client.result("hello")["pid"], set[int]()

        def is_tried_again(_health: dict[str, Any]) -> bool:
            seen.update(pumps_of(pid))
            return len(seen) > 2 and "CAN bus: " in running.log

        client.until_health(is_tried_again)
        figures = client.result("health")["bus"]
        assert (figures["state"], figures["reopened"], figures["send_failures"]) == ("down", 0, 0)
        lines = [line for line in running.log.splitlines() if "CAN bus: " in line]
        assert len(lines) == 1
        assert "CAN bus: down: cannot be opened: " in lines[0]


def test_the_journal_has_a_configuration_error_as_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, journal = tmp_path / "wrong.toml", tmp_path / "journal"
    path.write_text("[control]\nrate = 200\n", encoding="utf-8")
    for is_journal, in_front in ((False, "litegripd: "), (True, "<3>")):
        with journal.open("w+b") as file:
            status = os.fstat(file.fileno())
            stream = f"{status.st_dev}:{status.st_ino}" if is_journal else ""
            monkeypatch.setenv("JOURNAL_STREAM", stream)
            running = DaemonProcess(tmp_path, "can0", "--config", str(path), log=file.fileno())
            assert running.exit_code() == 2
        assert journal.read_text().startswith(f"{in_front}{path}: [control] rate is unknown")


@pytest.fixture(scope="module")
def adapter() -> Iterator[SimulatorProcess]:
    with simulator("--pty") as process:
        yield process


def slcan_daemon(
    folder: Path, channel: Path | str
) -> contextlib.AbstractContextManager[DaemonProcess]:
    """Return a daemon with an SLCAN adapter, to be run."""
    return configured(folder, f"{folder.name}{os.getpid()}", SLCAN.format(channel=channel))


@pytest.fixture(scope="module")
def attached(
    tmp_path_factory: pytest.TempPathFactory, adapter: SimulatorProcess
) -> Iterator[DaemonProcess]:
    with slcan_daemon(tmp_path_factory.mktemp("slcan"), adapter.first_line) as running:
        yield running


@pytest.fixture
def client(attached: DaemonProcess) -> Iterator[Client]:
    """A client of the module's daemon, with its motor off."""
    with attached.connect() as connected:
        disable(connected)
        yield connected


def pumps_of(daemon_pid: int) -> list[int]:
    """Find the pumps among the processes that the daemon has had started."""
    children = Path(f"/proc/{daemon_pid}/task/{daemon_pid}/children")
    found = []
    for pid in children.read_text(encoding="ascii").split():
        with contextlib.suppress(OSError):
            if b"pump_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                found.append(int(pid))
            found += pumps_of(int(pid))
    return found


def pump_of(daemon_pid: int) -> int:
    """Find the pump among the daemon's children."""
    (pid,) = pumps_of(daemon_pid)
    return pid


def test_the_gripper_opens_over_slcan(client: Client) -> None:
    client.enabled()
    result = client.despite_silence("motion.open", speed_mm_s=100)
    assert result["ok"], result
    assert result["state"]["opening_mm"] == pytest.approx(WORK_MM, abs=2)
    assert client.result("health")["control"]["tick_errors"] == 0


def test_an_adapter_that_stops_reading_is_survived(
    client: Client, adapter: SimulatorProcess
) -> None:
    client.enabled().despite_silence("motion.close", speed_mm_s=100)
    motion = client.send("motion.open", speed_mm_s=20)
    while client.until(lambda state: bool(state["mode"] != "holding"))["mode"] != "moving":
        client.answer(motion)  # the simulator was kept off the processor
        client.despite_silence("motor.enable")
        motion = client.send("motion.open", speed_mm_s=20)
    pid = adapter._process.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        assert client.answer(motion)["error"]["data"]["reason"] == "motor_silent"
        state = client.until(lambda state: bool(state["stale"] and state["motor"] == "silent"))
        assert state["age_s"] > 0.01
        assert client.refusal("motion.open") == "motor_silent"
        ticks = client.result("health")["control"]["ticks"]
        client.until_health(lambda h: bool(h["control"]["ticks"] > ticks + 100))
    finally:
        os.kill(pid, signal.SIGCONT)
    found = client.until(
        lambda state: bool(
            state["motor"] in ("enabled", "disabled", "fault") and not state["stale"]
        )
    )
    if found["motor"] == "enabled":  # its watchdog had no time to disarm it: held where it was
        assert found["mode"] == "holding"
    assert found["opening_mm"] < 60
    if found["motor"] != "enabled":
        assert client.despite_silence("motor.enable")["ok"]
    assert client.despite_silence("motion.open", speed_mm_s=100)["ok"]


def test_a_killed_pump_is_a_bus_that_is_down_and_up_again(client: Client) -> None:
    client.enabled()
    pid = client.result("hello")["pid"]
    pump = pump_of(pid)
    reopened = client.result("health")["bus"]["reopened"]
    os.kill(pump, signal.SIGKILL)
    client.until(lambda state: bool(state["bus"] == "down"))
    client.until_health(lambda h: bool(h["bus"]["reopened"] > reopened))
    state = client.until(
        lambda state: bool(state["bus"] == "up" and state["motor"] in ("disabled", "fault"))
    )
    assert not state["enabled"]
    assert pump_of(pid) != pump
    assert client.despite_silence("motor.enable")["ok"]
    assert client.result("health")["control"]["tick_errors"] == 0


def test_a_second_path_to_an_adapter_is_no_second_owner(tmp_path: Path) -> None:
    """Who comes second leaves the adapter alone, says why, and opens it once it is free."""
    link = tmp_path / "link"
    with contextlib.ExitStack() as stack:
        adapter = stack.enter_context(simulator("--pty"))
        link.symlink_to(adapter.first_line)
        with slcan_daemon(tmp_path / "first", adapter.first_line) as one, one.connect() as first:
            first.enabled()
            two = stack.enter_context(slcan_daemon(tmp_path / "second", link))
            second = stack.enter_context(two.connect())
            busy = f"{link} is busy: another daemon has it"
            health = second.until_health(lambda health: busy in str(health["bus"]["error"]))
            assert health["bus"]["state"] == "down"
            assert second.refusal("motor.enable") in ("bus_down", "motor_silent")
            assert first.despite_silence("motion.open", speed_mm_s=100)["ok"]
        second.until(lambda state: bool(state["bus"] == "up"))


def test_an_adapter_that_is_unplugged_while_holding_and_plugged_in_again(tmp_path: Path) -> None:
    link = tmp_path / "adapter"
    with (
        simulator("--pty", "--link", str(link)) as adapter,
        slcan_daemon(tmp_path, link) as running,
        running.connect() as client,
    ):
        client.enabled().despite_silence("motion.close", speed_mm_s=100)
        held_mm = client.until(lambda state: bool(state["mode"] == "holding"))["opening_mm"]
        adapter.write("unplug")
        state = client.until(lambda state: bool(state["bus"] == "adapter_gone"))
        assert state["stale"]
        error = client.call("motion.open")["error"]
        assert (error["data"]["reason"], error["data"]["bus"]) == ("bus_down", "adapter_gone")
        assert client.result("health")["verdict"] == "down"
        adapter.write("plug")
        state = client.until(
            lambda state: bool(state["bus"] == "up" and state["motor"] in ("disabled", "fault"))
        )
        # The stop on which they pressed springs back.
        assert state["opening_mm"] == pytest.approx(held_mm, abs=3.0)
        assert client.refusal("motion.open") in ("not_enabled", "motor_fault")
        assert client.despite_silence("motor.enable")["ok"]
        assert client.despite_silence("motion.open", speed_mm_s=100)["ok"]
        assert client.result("health")["control"]["tick_errors"] == 0
