"""Programs of the SDK for real: with `as_sdk`, as processes with threads and sockets."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, begin_again, configured, ran
from tests.process.teleop_pair import CONFIG

PROGRAMS = Path(__file__).parents[1] / "sdk" / "programs"
ROOT = Path(__file__).parents[2]
NAMES = (f"a{os.getpid()}", f"b{os.getpid()}")
TRIES = 4
"""A daemon that is kept off the processor loses its simulated motor: then a user tries again."""


@contextlib.contextmanager
def gripper(folder: Path, name: str, mount: str = "normal") -> Iterator[DaemonProcess]:
    """Run a daemon whose socket a program finds by the channel's name."""
    found = folder / "litegripd" / f"{name}.sock"
    found.parent.mkdir(exist_ok=True)
    found.symlink_to(folder / name / "rpc.sock")
    with configured(folder / name, name, CONFIG.format(mount=mount)) as running:
        with running.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled"))
        yield running


def run(folder: Path, program: str, *arguments: str, answers: str = "") -> str:
    """Run a program as a user does; return what it printed."""
    environment = {
        **os.environ,
        "XDG_RUNTIME_DIR": str(folder),
        "HOME": str(folder),
        "PYTHONPATH": str(ROOT),
    }
    environment.pop("LITEGRIPD_SOCKET", None)
    command = [sys.executable, "-m", "litegrip_client.as_sdk", str(PROGRAMS / f"{program}.py")]
    said = ""
    for _ in range(TRIES):
        done = ran(*command, *arguments, within_s=100, env=environment, input=answers)
        said = done.stdout + done.stderr
        if done.returncode == 0:
            return done.stdout
    raise AssertionError(said)


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which programs find the daemons, and keep what they save."""
    return tmp_path_factory.mktemp("places")


@pytest.fixture(scope="module")
def shared(places: Path) -> Iterator[DaemonProcess]:
    with gripper(places, NAMES[0]) as running:
        yield running


@pytest.fixture
def one(shared: DaemonProcess) -> DaemonProcess:
    """Return the module's daemon as it was at its beginning."""
    begin_again(shared)
    return shared


def test_strokes_and_a_taught_motion(one: DaemonProcess, places: Path) -> None:
    out = run(places, "stroke", "--channel", NAMES[0], "--speed", "100", "--kp", "90")
    assert out.count("True") >= 4
    out = run(places, "taught", "--channel", NAMES[0], "--record", "0.5", "--save", "still")
    assert out.endswith(" still.lgt\n")
    assert "True" in run(places, "taught", "--channel", NAMES[0], "--play", "still")


def test_a_force_of_40_n(one: DaemonProcess, places: Path) -> None:
    with one.connect() as client:
        client.result("sim.object", width_mm=40.0)
    out = run(places, "hold_force", "--channel", NAMES[0], "--force", "40", "--hold-s", "2")
    assert out.startswith("2.0 s")


def test_a_grasp_and_what_serves_a_motor(one: DaemonProcess, places: Path) -> None:
    out = run(places, "grasp", "--channel", NAMES[0], "--hold-s", "1", "--skip-loaded")
    assert "empty True True False 5 5" in out
    run(places, "service", "open", "--channel", NAMES[0])
    with one.connect() as client:
        client.result("sim.object", width_mm=30.0)
    arguments = ("--channel", NAMES[0], "--hold-s", "1", "--skip-empty")
    assert "loaded True False True 5 5" in run(places, "grasp", *arguments, answers="\n")
    for what in ("status", "release"):
        out = run(places, "service", what, "--channel", NAMES[0], "--duration", "0.3")
        assert "mst 0x18" in out


def test_a_bench_program_with_an_emergency_stop(one: DaemonProcess, places: Path) -> None:
    out = run(places, "bench_window", NAMES[0], str(places / "saved.json"))
    assert "enabled False failed 0" in out
    assert int(out.partition(" reports")[0].splitlines()[-1]) > 300
    assert "saved True" in out
    assert "force True" in out


def test_a_node(one: DaemonProcess, places: Path) -> None:
    out = run(places, "node", NAMES[0])
    assert out.splitlines() == ["idle False", "there True False", "slack False"]


def test_a_mirror(one: DaemonProcess, places: Path) -> None:
    out = run(places, "mirror", NAMES[0])
    assert out.splitlines() == ["from factory_calibration.json True", "held True", "there True"]


def test_two_grippers_in_one_process(one: DaemonProcess, places: Path) -> None:
    with gripper(places, NAMES[1], "reverse"):
        strokes, _, reads = run(places, "two_at_once", *NAMES).rpartition(" ")
        assert strokes == "[True, True] True"
        assert int(reads) > 100
        assert "100 frames" in run(places, "hand_and_twin", *NAMES)


def test_a_fake_leader(one: DaemonProcess, places: Path) -> None:
    out = run(places, "follow", "--channel", NAMES[0], "--mode", "slave", "--fake-leader")
    *_, last, final = out.splitlines()
    assert final.startswith("frames ")
    assert int(final.split()[1]) > 50
    assert final.endswith("fault ''")
    assert float(last.split()[1]) >= 0.0
