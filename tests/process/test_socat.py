"""The lines for socat of docs/shell.md, as they stand there, against a simulated gripper."""

import contextlib
import json
import os
import select
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, ran

pytestmark = pytest.mark.skipif(
    shutil.which("socat") is None, reason="socat is not installed: apt-get install socat"
)

PAGE = (Path(__file__).parents[2] / "docs" / "shell.md").read_text(encoding="utf-8")
PLACE = "/run/litegripd/can0"
LINES = [line for line in PAGE.splitlines() if "| socat" in line]


def command(running: DaemonProcess, *words: str) -> str:
    """Return the one line of the page with these words, for the socket of this daemon."""
    (found,) = [line for line in LINES if all(word in line for word in words)]
    assert found.count(PLACE) == 1
    return found.replace(PLACE, str(running.socket_path.with_suffix("")))


def run(running: DaemonProcess, *words: str) -> dict[str, Any]:
    """Run a line of the page in a shell; return what it prints, one line of JSON."""
    done = ran("sh", "-c", command(running, *words))
    assert (done.returncode, done.stderr) == (0, "")
    (line,) = done.stdout.splitlines()
    message: dict[str, Any] = json.loads(line)
    return message


@contextlib.contextmanager
def printing(running: DaemonProcess, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Let a line of the page print until Ctrl-C, which all processes of the shell get."""
    with subprocess.Popen(
        ["sh", "-c", command(running, *words)], stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            os.killpg(process.pid, signal.SIGINT)


def next_line(process: "subprocess.Popen[bytes]") -> dict[str, Any]:
    """Return the next line that a process prints, which must come byte by byte in time."""
    assert process.stdout is not None
    line = b""
    while not line.endswith(b"\n"):
        assert select.select([process.stdout], [], [], DEADLINE_S)[0], line
        byte = os.read(process.stdout.fileno(), 1)
        assert byte, line
        line += byte
    message: dict[str, Any] = json.loads(line)
    return message


def assert_stopped(client: Client, motion: int) -> None:
    """A motion was ended by a stop, which holds the jaws and is latched."""
    assert client.answer(motion)["error"]["data"]["reason"] == "stopped"
    assert client.result("state.get")["mode"] == "holding"
    assert client.refusal("motion.close") == "stopped"


def test_every_line_of_the_page_is_run_here() -> None:
    words = ("state.get", "motor.enable", "motion.open", '"stop"', "stop.clear", "subscribe")
    tried = [line for line in LINES for word in (*words, "can0.stop.sock") if word in line]
    assert tried == LINES
    assert len(LINES) == len(words) + 1
    assert PAGE.count("socat -") + PAGE.count("socat STDIO") == len(LINES)


def test_state_enable_and_a_motion(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        told = run(simulated, "state.get")
        assert (told["id"], told["result"]["mode"]) == (1, "disabled")
        client.despite_silence("motor.enable")
        client.despite_silence("motion.close", speed_mm_s=100)
        client.result("motor.disable")
        told = run(simulated, "motor.enable")
        assert (told["id"], told["result"]["ok"]) == (2, True)
        told = run(simulated, "motion.open")
        result = told["result"]  # the template's work stroke ends it before the stop
        assert (told["id"], result["ok"], result["outcome"]) == (3, True, "reached")
        assert client.result("state.get")["openness"] > 0.9


def test_a_stop_as_a_method_and_by_the_stop_socket(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled().despite_silence("motion.close", speed_mm_s=100)
        motion = client.send("motion.open", speed_mm_s=5)
        client.until(lambda state: bool(state["mode"] == "moving"))
        before = client.result("state.get")["stop_generation"]
        told = run(simulated, '"stop"')
        assert (told["id"], told["result"]["level"]) == (4, "hold")
        assert_stopped(client, motion)
        assert client.result("state.get")["stop"]["why"] == "lunch"
        told = run(simulated, "stop.clear")
        assert (told["id"], told["result"]["generation"]) == (5, before + 1)
        motion = client.send("motion.open", speed_mm_s=5)
        client.until(lambda state: bool(state["mode"] == "moving"))
        told = run(simulated, "can0.stop.sock")
        assert told["result"] == {"level": "hold", "generation": before + 2, "motor": "enabled"}
        assert_stopped(client, motion)


def test_the_state_again_and_again_until_it_is_interrupted(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        client.enabled()
        clients = client.result("health")["rpc"]["clients"]
        with printing(simulated, "state.subscribe") as watching:
            told = next_line(watching)
            assert (told["id"], told["result"]["state"]["mode"]) == (6, "holding")
            samples = [next_line(watching) for _ in range(3)]
            assert {sample["method"] for sample in samples} == {"state.sample"}
            sequence = [sample["params"]["seq"] for sample in samples]
            assert sequence == sorted(set(sequence))
            assert samples[-1]["params"]["state"]["enabled"] is True
            assert client.result("health")["rpc"]["clients"] == clients + 1
        client.until_health(lambda health: bool(health["rpc"]["clients"] == clients))
