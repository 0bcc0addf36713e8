"""The clients of docs/other-languages.md, compiled and run against a daemon."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, ran

CLIENTS = Path(__file__).parents[2] / "examples" / "clients"
OBJECT_MM = 40.0


@pytest.fixture
def holding(simulated: DaemonProcess) -> DaemonProcess:
    """Return a daemon with something between its jaws."""
    with simulated.connect() as client:
        client.despite_silence("motor.enable")
        client.despite_silence("motion.open")
        client.result("sim.object", width_mm=OBJECT_MM)
        client.result("motor.disable")
    return simulated


@pytest.fixture(scope="module")
def cpp(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed: apt-get install g++")
    program = str(tmp_path_factory.mktemp("cpp") / "grasp")
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
            done = ran(*command, str(running.socket_path))
            if not any(word in done.stderr for word in ("motor_silent", "motor_fault")):
                break
        assert (done.returncode, done.stderr) == (0, "")
        assert client.result("state.get")["is_grasped"]  # also when the client has gone
    return done.stdout


def refused(running: DaemonProcess, command: list[str]) -> str:
    """Run a client while a stop is latched; return what it complains of."""
    with running.connect() as client:
        client.result("stop")
    done = ran(*command, str(running.socket_path))
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
    assert float(width_mm) == pytest.approx(OBJECT_MM, abs=1.5)
    assert len(openings) > 1
    assert all(line.startswith("opening ") for line in openings)
    assert refused(holding, javascript).endswith(" stopped\n")


def test_cpp_without_an_argument_tells_its_usage(cpp: list[str]) -> None:
    done = ran(*cpp)
    assert done.returncode == 1
    assert done.stderr.startswith("usage: grasp SOCKET")


@pytest.mark.parametrize("client", ["cpp", "javascript"])
def test_without_a_daemon(request: pytest.FixtureRequest, client: str, tmp_path: Path) -> None:
    command = request.getfixturevalue(client)
    nowhere = str(tmp_path / "none.sock")
    done = ran(*command, nowhere)
    assert done.returncode == 1
    assert nowhere in done.stderr
