"""A machine on which every start of a program takes 0.3 s: the jaws feel nothing of it."""

import contextlib
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import Client, DaemonProcess
from tests.process.slow_exec import SlowExec, UnavailableError, slow_exec

DELAY_S = 0.3
WATCHDOG_S = 0.25
"""Of the motor, which lets go when it hears nothing for so long."""

CONFIG = f"""
[bus]
interface = "litegrip_sim"
watchdog_s = {WATCHDOG_S}
[gripper]
mount = "normal"
"""


@contextlib.contextmanager
def daemon_on(machine: SlowExec, folder: Path) -> Iterator[DaemonProcess]:
    config = folder / "slow.toml"
    config.write_text(CONFIG, encoding="utf-8")
    arguments = (f"slow-{os.getpid()}", "--config", str(config), "--socket")
    running = DaemonProcess(folder, *arguments, str(folder / "rpc.sock"), program=machine.program)
    try:
        try:
            machine.begin()
        except UnavailableError as error:
            pytest.skip(str(error))
        yield running
        machine.delay_s = 0.0
        running.end()
    finally:
        running.kill()


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def pid_of(client: Client, what: str, before: int | None = None) -> int:
    """Wait until a process of the daemon runs that is not the one before."""
    health = client.until_health(lambda h: h[what]["pid"] not in (None, before))
    pid: int = health[what]["pid"]
    return pid


def holding(client: Client) -> dict[str, Any]:
    client.enabled()
    assert client.despite_silence("motion.close")["ok"]
    health: dict[str, Any] = client.result("health")["control"]
    return health


def assert_held(client: Client, before: dict[str, Any]) -> None:
    """A gap as long as a start would have lost 60 ticks, and the motor."""
    lost = client.result("health")["control"]["lost_ticks"] - before["lost_ticks"]
    state = client.result("state.get")
    assert (state["enabled"], state["motor"]) == (True, "enabled"), state
    assert lost < WATCHDOG_S * 200, f"{lost} ticks were lost"


def test_a_helper_that_dies_while_jaws_hold(tmp_path: Path) -> None:
    with (
        slow_exec(tmp_path) as machine,
        daemon_on(machine, tmp_path) as running,
        running.connect() as client,
    ):
        helper = pid_of(client, "helper")
        before = holding(client)
        machine.delay_s = DELAY_S
        for _ in range(3):
            count = machine.count
            kill(helper)
            helper = pid_of(client, "helper", helper)
            assert machine.count > count
            assert client.result("calibration.templates")
            assert_held(client, before)


def test_a_spawner_and_then_the_helper_that_die_while_jaws_hold(tmp_path: Path) -> None:
    with (
        slow_exec(tmp_path) as machine,
        daemon_on(machine, tmp_path) as running,
        running.connect() as client,
    ):
        helper, spawner = pid_of(client, "helper"), pid_of(client, "spawner")
        before = holding(client)
        machine.delay_s = DELAY_S
        kill(spawner)
        spawner = pid_of(client, "spawner", spawner)
        kill(helper)
        pid_of(client, "helper", helper)
        assert_held(client, before)
        assert client.result("health")["spawner"]["deaths"] == 1


def test_a_link_process_that_starts_while_jaws_hold(tmp_path: Path) -> None:
    with (
        slow_exec(tmp_path) as machine,
        daemon_on(machine, tmp_path) as running,
        running.connect() as client,
    ):
        pid_of(client, "helper")
        before = holding(client)
        machine.delay_s = DELAY_S
        client.result("teleop.start", mode="master", link="udp", host="127.0.0.1", port=9)
        pid_of(client, "teleop")
        assert_held(client, before)
        client.result("teleop.stop")


def test_the_first_client_finds_the_calibration_however_slow_the_helper_starts(
    tmp_path: Path,
) -> None:
    with slow_exec(tmp_path) as machine:
        machine.delay_s = 0.8
        with daemon_on(machine, tmp_path) as running, running.connect() as client:
            assert client.result("calibration.get")["calibrated"]
