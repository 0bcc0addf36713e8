"""The clients of docs/other-languages.md, compiled and run against a daemon."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S, DaemonProcess, daemon

CLIENTS = Path(__file__).parents[2] / "examples" / "clients"
CONFIG = """
[bus]
interface = "litegrip_sim"
watchdog_s = 0.4
object_mm = 40.0
[gripper]
mount = "normal"
"""


@pytest.fixture
def holding(tmp_path: Path) -> Iterator[DaemonProcess]:
    """Return a daemon with something of 40 mm between its jaws."""
    config = tmp_path / "gripper.toml"
    config.write_text(CONFIG, encoding="utf-8")
    name = f"languages-{os.getpid()}"
    with daemon(tmp_path / "daemon", name, "--config", str(config)) as running:
        yield running


@pytest.fixture
def cpp(tmp_path: Path) -> list[str]:
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed: apt-get install g++")
    program = str(tmp_path / "grasp")
    options = ["-std=c++17", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["g++", *options, "-o", program, str(CLIENTS / "grasp.cpp")], check=True)
    return [program]


@pytest.fixture
def javascript() -> list[str]:
    if shutil.which("node") is None:
        pytest.skip("node is not installed: apt-get install nodejs")
    return ["node", str(CLIENTS / "grasp.js")]


def grasps(running: DaemonProcess, command: list[str]) -> str:
    """Run a client until it is told that the object is held; return what it prints.

    A daemon that is kept off the processor loses its simulated motor: then a user tries again.
    """
    with running.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        for _ in range(4):
            done = subprocess.run(
                [*command, str(running.socket_path)],
                capture_output=True,
                text=True,
                timeout=DEADLINE_S,
                check=False,
            )
            if not any(word in done.stderr for word in ("motor_silent", "motor_fault")):
                break
        assert (done.returncode, done.stderr) == (0, "")
        assert client.result("state.get")["is_grasped"]  # also when the client has gone
    return done.stdout


def refused(running: DaemonProcess, command: list[str]) -> str:
    """Run a client while a stop is latched; return what it complains of."""
    with running.connect() as client:
        client.result("stop")
    done = subprocess.run(
        [*command, str(running.socket_path)],
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert (done.returncode, done.stdout.count("object_held")) == (1, 0)
    return done.stderr


def test_cpp(holding: DaemonProcess, cpp: list[str]) -> None:
    result = json.loads(grasps(holding, cpp))["result"]
    assert (result["ok"], result["outcome"]) == (True, "object_held")
    assert json.loads(refused(holding, cpp))["error"]["data"]["reason"] == "stopped"


def test_javascript(holding: DaemonProcess, javascript: list[str]) -> None:
    *openings, last = grasps(holding, javascript).splitlines()
    outcome, width_mm = last.split()
    assert outcome == "object_held"
    assert float(width_mm) == pytest.approx(40.0, abs=1.5)
    assert len(openings) > 1
    assert all(line.startswith("opening ") for line in openings)
    assert refused(holding, javascript).endswith(" stopped\n")


def test_cpp_without_an_argument_tells_its_usage(cpp: list[str]) -> None:
    done = subprocess.run(cpp, capture_output=True, text=True, timeout=DEADLINE_S, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("usage: grasp SOCKET")


@pytest.mark.parametrize("client", ["cpp", "javascript"])
def test_without_a_daemon(request: pytest.FixtureRequest, client: str, tmp_path: Path) -> None:
    command = request.getfixturevalue(client)
    nowhere = str(tmp_path / "none.sock")
    done = subprocess.run(
        [*command, nowhere], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert done.returncode == 1
    assert nowhere in done.stderr
