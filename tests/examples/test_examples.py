"""The examples for one gripper, each to its end, on a whole daemon in virtual time."""

import csv
import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from examples import collect, policy, run_simulated, teleop
from litegrip_client import LiteGrip
from litegripd.model.calibration import NOMINAL
from tests.drop_in import Daemon, Site, a_site

TRAVEL_MM = NOMINAL[0].travel_mm


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with a_site(tmp_path) as site:
        yield site


def test_the_policy_drives_the_jaws_at_50_hz(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon = site.add(Daemon())
    with site.recorded(daemon) as moments:
        assert policy.main(["--seconds", "5"]) == 0
    steps = int(capsys.readouterr().out.split()[0])
    assert steps == pytest.approx(250, abs=2)
    openings = [moment.opening_mm for moment in moments]
    assert (max(openings), min(openings)) == pytest.approx(
        (0.8 * TRAVEL_MM, 0.208 * TRAVEL_MM), abs=1.4
    )
    assert not daemon.is_energised


def test_the_simulated_gripper_says_what_it_takes_and_starts_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["run_simulated.py", "--help"])
    assert run_simulated.main() == 0
    usage, _, rest = capsys.readouterr().out.partition("\n")
    assert usage == "usage: run_simulated.py [simulated|mujoco]"
    assert "With the argument `mujoco`" in rest


def test_the_policy_feels_an_object(site: Site) -> None:
    daemon = site.add(Daemon())
    daemon.gripper.put_object(width_mm=50.0)
    with site.recorded(daemon) as moments:
        assert policy.main(["--seconds", "5"]) == 0
    assert min(moment.opening_mm for moment in moments) == pytest.approx(50.0, abs=1.0)
    assert max(abs(moment.closing_torque_nm) for moment in moments) < 1.1


def test_what_a_follower_does_is_collected_tick_by_tick(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon = site.add(Daemon())
    file = tmp_path / "data.csv"
    with LiteGrip("can0") as other:
        other.enable()
        other.teleop_start("slave", fake_leader=True)
        with site.recorded(daemon) as moments:
            assert collect.main([str(file), "--seconds", "6"]) == 0
        assert other.teleop_status()["active"]  # the one that watches takes nothing away
    collected = file.read_bytes()
    with pytest.raises(FileExistsError):
        collect.main([str(file)])
    assert file.read_bytes() == collected
    assert capsys.readouterr().out == "1200 rows, 0 missing; the follower was following\n"
    with file.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines))
    assert len(rows) == 1200
    assert list(rows[0]) == collect.FIELDS
    times = [float(row["monotonic_s"]) for row in rows]
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([0.005] * 1199)
    seen = [float(row["openness"]) for row in rows]
    true = [moment.opening_mm / TRAVEL_MM for moment in moments]
    assert (max(seen), min(seen)) == pytest.approx((max(true), min(true)), abs=0.02)


def test_the_line_of_a_teleoperation_is_rounded_and_tells_why_a_link_failed() -> None:
    status: dict[str, Any] = {
        "phase": "following",
        "link_state": "open",
        "link_error": None,
        "frames": 12,
        "openness": 0.123456,
        "torque_nm": -0.5678,
        "loop_hz": 199.96,
        "stale": False,
        "torque_trips": 0,
    }
    shown = teleop.line(status)
    assert "openness 0.123  torque -0.57 N·m  200 Hz" in shown
    assert shown.endswith("trips 0")
    failed = {**status, "link_state": "failed", "link_error": "port 17448 is in use"}
    shown = teleop.line({**failed, "openness": None, "torque_nm": None})
    assert "link failed" in shown
    assert "openness -  torque - N·m" in shown
    assert shown.endswith("  port 17448 is in use")


EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = sorted(
    {path.stem for path in EXAMPLES.glob("*.py")} - {"__init__", "demo", "run_simulated"}
)


@pytest.mark.parametrize("name", NAMES)
def test_every_example_has_help_and_names_its_channel_in_the_same_way(name: str) -> None:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    for option in ("--left", "--right") if name == "two_grippers" else ("--channel",):
        assert option in done.stdout


def test_a_trajectory_that_is_not_there_is_answered_by_where_to_look(tmp_path: Path) -> None:
    command = [sys.executable, str(EXAMPLES / "trajectory.py"), "--play", "nix"]
    environment = {**os.environ, "LITEGRIP_TRAJ_DIR": str(tmp_path)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "nix.lgt; --list shows what was saved" in done.stderr
