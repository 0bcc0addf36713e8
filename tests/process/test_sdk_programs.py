"""Programs of the SDK for real: with `as_sdk`, as processes with threads and sockets."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DaemonProcess, daemon
from tests.process.teleop_pair import CONFIG

PROGRAMS = Path(__file__).parents[1] / "sdk" / "programs"
ROOT = Path(__file__).parents[2]
NAMES = (f"a{os.getpid()}", f"b{os.getpid()}")
TRIES = 4
"""A daemon that is kept off the processor loses its simulated motor: then a user tries again."""


@contextlib.contextmanager
def gripper(folder: Path, name: str, mount: str = "normal") -> Iterator[DaemonProcess]:
    """Run a daemon whose socket a program finds by the channel's name."""
    config = folder / f"{name}.toml"
    config.write_text(CONFIG.format(mount=mount), encoding="utf-8")
    found = folder / "litegripd" / f"{name}.sock"
    found.parent.mkdir(exist_ok=True)
    found.symlink_to(folder / name / "rpc.sock")
    with daemon(folder / name, name, "--config", str(config)) as running:
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
        done = subprocess.run(
            [*command, *arguments],
            env=environment,
            input=answers,
            capture_output=True,
            text=True,
            timeout=100,
            check=False,
        )
        said = done.stdout + done.stderr
        if done.returncode == 0:
            return done.stdout
    raise AssertionError(said)


@pytest.fixture
def one(tmp_path: Path) -> Iterator[DaemonProcess]:
    with gripper(tmp_path, NAMES[0]) as running:
        yield running


def test_strokes_and_a_taught_motion(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "stroke", "--channel", NAMES[0], "--speed", "100", "--kp", "90")
    assert out.count("True") >= 4
    out = run(tmp_path, "taught", "--channel", NAMES[0], "--record", "0.5", "--save", "still")
    assert out.endswith(" still.lgt\n")
    assert "True" in run(tmp_path, "taught", "--channel", NAMES[0], "--play", "still")


def test_a_force_of_40_n(one: DaemonProcess, tmp_path: Path) -> None:
    with one.connect() as client:
        client.result("sim.object", width_mm=40.0)
    out = run(tmp_path, "hold_force", "--channel", NAMES[0], "--force", "40", "--hold-s", "2")
    assert out.startswith("2.0 s")


def test_a_grasp_and_what_serves_a_motor(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "grasp", "--channel", NAMES[0], "--hold-s", "1", "--skip-loaded")
    assert "empty True True False 5 5" in out
    run(tmp_path, "service", "open", "--channel", NAMES[0])
    with one.connect() as client:
        client.result("sim.object", width_mm=30.0)
    arguments = ("--channel", NAMES[0], "--hold-s", "1", "--skip-empty")
    assert "loaded True False True 5 5" in run(tmp_path, "grasp", *arguments, answers="\n")
    for what in ("status", "release"):
        out = run(tmp_path, "service", what, "--channel", NAMES[0], "--duration", "0.3")
        assert "mst 0x18" in out


def test_a_bench_program_with_an_emergency_stop(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "bench_window", NAMES[0], str(tmp_path / "saved.json"))
    assert "enabled False failed 0" in out
    assert int(out.partition(" reports")[0].splitlines()[-1]) > 300
    assert "saved True" in out
    assert "force True" in out


def test_a_node(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "node", NAMES[0])
    assert out.splitlines() == ["idle False", "there True False", "slack False"]


def test_a_mirror(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "mirror", NAMES[0])
    assert out.splitlines() == ["from factory_calibration.json True", "held True", "there True"]


def test_two_grippers_in_one_process(tmp_path: Path) -> None:
    with gripper(tmp_path, NAMES[0]), gripper(tmp_path, NAMES[1], "reverse"):
        strokes, _, reads = run(tmp_path, "two_at_once", *NAMES).rpartition(" ")
        assert strokes == "[True, True] True"
        assert int(reads) > 100
        assert "100 frames" in run(tmp_path, "hand_and_twin", *NAMES)


def test_a_fake_leader(one: DaemonProcess, tmp_path: Path) -> None:
    out = run(tmp_path, "follow", "--channel", NAMES[0], "--mode", "slave", "--fake-leader")
    *_, last, final = out.splitlines()
    assert final.startswith("frames ")
    assert int(final.split()[1]) > 50
    assert final.endswith("fault ''")
    assert float(last.split()[1]) >= 0.0
