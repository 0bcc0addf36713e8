"""What the jaws do when something between the operator and the gripper ends, hangs or is cut off.

When it happens is measured by `python -m bench.fleet.faults`; here, that it does.
"""

import signal
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest

from tests.process.daemon_process import Client, DaemonProcess, line_of, spawn
from tests.process.fleet.fleet_process import Fleet, reach

FLEET = {"ttl_s": 1.0}
OPERATOR = """
import json, socket, sys
connected = socket.socket(socket.AF_UNIX)
connected.connect(sys.argv[1])
lines = connected.makefile("rb")
def ask(number, method, **params):
    request = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
    connected.sendall(json.dumps(request).encode() + b"\\n")
def result(number, method, **params):
    ask(number, method, **params)
    while (answer := json.loads(lines.readline())).get("id") != number:
        pass
    assert "result" in answer, answer
result(1, "lease.acquire", on_lost="relax")
result(2, "motor.enable")
result(3, "motion.close")
ask(4, "motion.open", speed_mm_s=10, progress=True)
while json.loads(lines.readline()).get("method") != "job.progress":
    pass
print("moving", flush=True)
sys.stdin.readline()
ask(5, "motion.close", if_busy="replace")
print("asked", flush=True)
while line := lines.readline():
    last = line
print(last.decode(), flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def operator(lab: Fleet, gripper: DaemonProcess) -> "Iterator[subprocess.Popen[str]]":
    """A program on the operator's machine that has the lease, and moves the jaws."""
    with gripper.connect() as local:
        local.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
    process = spawn(OPERATOR, str(lab.socket_path()))
    assert line_of(process) == "moving"
    yield process
    process.kill()
    process.communicate()


def say(process: "subprocess.Popen[str]") -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def relaxed(state: dict[str, Any]) -> bool:
    return bool(state["mode"] == "relaxed")


def stays_relaxed(local: Client, samples: int = 200) -> None:
    """Watch for as many samples, at 200 Hz, that nothing moves by command."""
    local.result("state.subscribe", hz=200, fields=["mode"])
    while samples:
        message = local.read()
        if message.get("method") == "state.sample":
            assert message["params"]["state"]["mode"] == "relaxed"
            samples -= 1


PARTS = ("portal", "gateway", "router")


@pytest.mark.parametrize("part", PARTS)
def test_when_a_part_is_killed_on_lost_follows(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]", part: str
) -> None:
    with gripper.connect() as local:
        lab.parts[part].kill()
        local.until(relaxed)
        assert local.result("lease.get")["owner"] is None


@pytest.mark.parametrize("part", PARTS)
def test_when_a_part_is_frozen_on_lost_follows_and_nothing_comes_after(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]", part: str
) -> None:
    with gripper.connect() as local:
        lab.parts[part].freeze()
        say(operator)  # a motion that is sent before anything is known to be wrong
        assert line_of(operator) == "asked"
        local.until(relaxed)
        lab.parts[part].thaw()
        stays_relaxed(local)


def test_an_operators_program_that_is_killed_loses_what_it_had(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]"
) -> None:
    with gripper.connect() as local:
        operator.kill()
        local.until(relaxed)


def test_an_operators_program_that_is_frozen_loses_what_it_had(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]"
) -> None:
    with gripper.connect() as local:
        say(operator)
        assert line_of(operator) == "asked"
        local.until(lambda state: bool(state["mode"] == "moving"))
        operator.send_signal(signal.SIGSTOP)
        local.until(relaxed)
        operator.send_signal(signal.SIGCONT)
        stays_relaxed(local)


def test_whoever_is_cut_off_is_told_and_gets_in_again(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]"
) -> None:
    lab.router.restart()
    told = line_after(operator)
    assert '"unreachable"' in told
    lab.router.until_says("listening at")
    with gripper.connect() as local:
        local.until(relaxed)
    with reach(lab) as client:
        assert client.result("state.get")["mode"] == "relaxed"


def line_after(operator: "subprocess.Popen[str]") -> str:
    """Let the operator ask, and return what it is told at last."""
    say(operator)
    assert line_of(operator) == "asked"
    return line_of(operator)


def test_a_stop_that_nobody_confirms_is_said_to_be_so(lab: Fleet) -> None:
    lab.router.freeze()
    stop_path = lab.socket_path().with_suffix(".stop.sock")
    with Client(stop_path) as client:
        client.send("stop", level="hold")
        error = client.read()["error"]
    assert error["data"]["reason"] == "unreachable"
    assert "not confirmed" in error["message"]
    assert "power" in error["message"]
    lab.router.thaw()


def test_a_stop_is_confirmed_while_another_part_is_not_there(
    lab: Fleet, gripper: DaemonProcess, operator: "subprocess.Popen[str]"
) -> None:
    lab.portal.kill()  # of one operator; another one stops from elsewhere
    stop_path = lab.socket_path().with_suffix(".stop.sock")
    stop_path.unlink()
    lab.start_portal("op1", "operator", ["left"], 1.0)
    with Client(stop_path) as client:
        assert client.result("stop", level="disable", why="a test")["level"] == "disable"
    with gripper.connect() as local:
        stop = local.until(lambda state: state["stop"] is not None)["stop"]
        assert (stop["by"], stop["why"]) == ("op1@lab via gateway", "a test")
