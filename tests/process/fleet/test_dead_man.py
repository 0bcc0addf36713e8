"""The dead man's switch with real parts: who has to be there, and what happens when he is not."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import Client, DaemonProcess, begin_again, line_of, ran, spawn
from tests.process.fleet.fleet_process import Fleet, fleet

SUPERVISOR = """
import json, socket, sys
answer = {}
while "result" not in answer:  # the gateway may not be connected yet
    connected = socket.socket(socket.AF_UNIX)
    connected.connect(sys.argv[1])
    lines = connected.makefile("rb")
    connected.sendall(b'{"jsonrpc": "2.0", "id": 1, "method": "hello"}\\n')
    answer = json.loads(lines.readline())
print(answer["result"]["role"], flush=True)
lines.read()
"""
WHY = "viewer is silent, and has to be present"
WATCHED: dict[str, Any] = {"user": "viewer", "role": "observer", "ttl_s": 1.0}
SWITCH = 'stop_when_silent = ["viewer"]'
FLEET: dict[str, Any] = {**WATCHED, "options": SWITCH}
"""The portal's user, an observer, has to be there."""


@pytest.fixture
def lab(site: Fleet, shared: DaemonProcess) -> Fleet:
    """Return the module's fleet with a gateway that has heard of nobody yet."""
    site.mend()
    site.gateway.kill()
    begin_again(shared)  # which a gateway that misses somebody would stop
    site.gateway.restart()
    site.gateway.until_says("lab.left: ")
    return site


@pytest.fixture
def gripper(lab: Fleet, shared: DaemonProcess) -> DaemonProcess:
    return shared


@pytest.fixture
def supervisor(lab: Fleet) -> "Iterator[subprocess.Popen[str]]":
    """A program of his, connected."""
    process = connected(lab)
    yield process
    process.kill()
    process.communicate()


def connected(lab: Fleet) -> "subprocess.Popen[str]":
    process = spawn(SUPERVISOR, str(lab.socket_path()))
    assert line_of(process) == "observer"
    lab.gateway.until_says("present: viewer")
    return process


def is_stopped(state: dict[str, Any]) -> bool:
    return state["stop"] is not None


def released(local: Client) -> None:
    """Clear the stop, and see that none follows: a hundred samples at 200 Hz without one."""
    local.until(is_stopped)
    local.result("stop.clear")
    local.result("state.subscribe", hz=200, fields=["stop"])
    samples = 0
    while samples < 100:
        message = local.read()
        if message.get("method") == "state.sample":
            assert message["params"]["state"]["stop"] is None
            samples += 1


def test_until_he_is_there_the_gripper_is_stopped_and_says_why(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    with gripper.connect() as local:
        stop = local.until(is_stopped)["stop"]
        assert (stop["level"], stop["why"]) == ("hold", WHY)
        assert "while one of these is silent: viewer" in lab.gateway.log
        assert f"lab.left: stopped (hold): {WHY}" in lab.gateway.log
        process = connected(lab)
        assert is_stopped(local.result("state.get"))  # nothing is cleared by itself
        released(local)
        process.kill()
        process.communicate()


def test_what_is_cleared_while_he_is_silent_is_stopped_again(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    with gripper.connect() as local:
        before = local.until(is_stopped)["stop"]["since_s"]
        for _ in range(5):
            local.call("stop.clear")
            after = local.until(is_stopped)["stop"]
            assert after["since_s"] > before
            assert after["why"] == WHY
            before = after["since_s"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_supervisor_who_is_killed_or_frozen_is_silent(
    lab: Fleet, gripper: DaemonProcess, supervisor: "subprocess.Popen[str]", number: signal.Signals
) -> None:
    with gripper.connect() as local:
        released(local)
        supervisor.send_signal(number)
        assert local.until(is_stopped)["stop"]["why"] == WHY
        supervisor.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("part", ["portal", "router"])
@pytest.mark.parametrize("act", ["kill", "freeze"])
def test_a_supervisor_behind_a_part_that_fails_is_silent(
    lab: Fleet,
    gripper: DaemonProcess,
    supervisor: "subprocess.Popen[str]",
    part: str,
    act: str,
) -> None:
    with gripper.connect() as local:
        released(local)
        getattr(lab.parts[part], act)()
        assert local.until(is_stopped)["stop"]["why"] == WHY
        if act == "freeze":
            lab.parts[part].thaw()


def test_a_gateway_that_was_frozen_stops_for_the_silence_that_it_slept_through(
    lab: Fleet, gripper: DaemonProcess, supervisor: "subprocess.Popen[str]"
) -> None:
    with gripper.connect() as local:
        released(local)
        lab.gateway.freeze()
        supervisor.wait(30.0)  # the portal lets it go: its time to live is up
        assert not is_stopped(local.result("state.get"))
        lab.gateway.thaw()
        local.until(is_stopped)


def test_without_any_router_the_gripper_is_stopped(lab: Fleet, gripper: DaemonProcess) -> None:
    lab.router.kill()
    lab.gateway.kill()
    with gripper.connect() as local:
        local.until(is_stopped)
        local.result("stop.clear")
        lab.gateway.restart()
        assert local.until(is_stopped)["stop"]["why"] == WHY


def test_a_daemon_that_comes_later_is_stopped_as_soon_as_it_is_there(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    with gripper.connect() as local:
        local.until(is_stopped)
        local.result("stop.clear")
        gripper.process.send_signal(signal.SIGSTOP)
        lab.gateway.restart()
        lab.gateway.until_says("lab.left is NOT stopped, although viewer is silent")
        gripper.process.send_signal(signal.SIGCONT)
        assert local.until(is_stopped)["stop"]["why"] == WHY


def test_each_gateway_has_to_hear_of_him_itself(lab: Fleet, gripper: DaemonProcess) -> None:
    """A second gateway of the same daemon, where he has no session."""
    process = connected(lab)
    with gripper.connect() as local:
        released(local)
        lab.start_gateway({"again": gripper.socket_path}, name="other", options=SWITCH)
        assert local.until(is_stopped)["stop"]["why"] == WHY
        other = lab.parts["other"]
        other.until_says("lab.again: stopped (hold)")
        assert "lab.left: stopped" not in lab.gateway.log.partition("present: viewer")[2]
        lab.parts.pop("other").kill()
        released(local)
    process.kill()
    process.communicate()


def test_one_of_two_who_is_silent_is_enough_and_each_gripper_is_stopped(
    tmp_path: Path, certificates: Path, lab: Fleet, gripper: DaemonProcess
) -> None:
    lab.gateway.kill()  # another one is at work here
    switch = 'stop_when_silent = ["viewer", "op2"]\nstop_level = "relax"'
    sockets = {"left": gripper.socket_path, "right": tmp_path / "none.sock"}
    with (
        fleet(tmp_path / "two", certificates, sockets, **WATCHED, options=switch) as two,
        gripper.connect() as local,
    ):
        first = local.until(is_stopped)["stop"]
        assert first["why"] == "viewer and op2 are silent, and have to be present"
        assert first["level"] == "relax"
        process = spawn(SUPERVISOR, str(two.socket_path()))
        two.gateway.until_says("\nsilent: op2")
        local.result("stop.clear")
        stop = local.until(is_stopped)["stop"]
        assert stop["why"] == "op2 is silent, and has to be present"
        two.gateway.until_says("lab.right is NOT stopped, although")
        process.kill()
        process.communicate()


def test_who_is_silent_is_listed(lab: Fleet, supervisor: "subprocess.Popen[str]") -> None:
    rows = json.loads(listed(lab, "--json"))
    assert [row["silent"] for row in rows] == [[]]
    assert "silent" not in listed(lab)
    supervisor.kill()
    lab.gateway.until_says("\nsilent: viewer")
    rows = json.loads(listed(lab, "--json"))
    assert [row["silent"] for row in rows] == [["viewer"]]
    assert "lab.left  stopped while silent: viewer\n" in listed(lab)


def listed(lab: Fleet, *options: str) -> str:
    config = str(lab.portal.config_path)
    command = [sys.executable, "-m", "litegrip_fleet", "--config", config, "list", *options]
    done = ran(*command, within_s=30.0)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
