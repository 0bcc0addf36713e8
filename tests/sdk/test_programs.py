"""Programs as users of the SDK have them, unchanged, in virtual time.

They make the calls of the SDK's own examples and of programs that people run, in their order and
at their rates.
"""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.drop_in import Daemon, Site
from tests.sdk_compat.trajectories import teach

PROGRAMS = Path(__file__).parent / "programs"

Run = Callable[..., int]


@pytest.fixture
def run(site: Site, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return what runs a program with its arguments; it returns the exit code."""
    clock = SimpleNamespace(time=lambda: site.now_s, monotonic=lambda: site.now_s, sleep=site.run)

    def run(name: str, *arguments: str) -> int:
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", [f"{name}.py", *arguments])
            patch.setitem(sys.modules, "time", clock)
            for module in [one for one in sys.modules if one.partition(".")[0] == "litegrip"]:
                patch.setitem(sys.modules, module, sys.modules[module])  # a program may reload it
            with pytest.raises(SystemExit) as ended:
                runpy.run_path(str(PROGRAMS / f"{name}.py"), run_name="__main__")
        return int(ended.value.code or 0)

    return run


@pytest.fixture
def daemon(site: Site) -> Daemon:
    return site.add(Daemon())


def test_strokes(run: Run, daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("stroke", "--dry-run", "--template", "reverse") == 0
    assert "work 80.0 mm, kp 100.0, reverse" in capsys.readouterr().out
    assert (
        run("stroke", "--kp", "80", "--cycles", "2", "--template", "normal", "--speed", "60") == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:4] for line in lines if line.startswith(("True", "False"))] == [
        ["True", "True", "False", "False"],  # to the template's work stroke
        ["True", "False", "True", "False"],
    ] * 2
    assert not daemon.is_energised


def test_grasps(
    run: Run, daemon: Daemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("builtins.input", lambda: daemon.gripper.put_object(width_mm=30.0))
    assert run("grasp", "--force", "15") == 0
    out = capsys.readouterr().out
    assert "empty True True False 10 10\nTrue" in out
    assert "loaded True False True 10 10\nTrue" in out


@pytest.mark.parametrize("force_n", [20, 40])
def test_a_force_is_held(
    run: Run, daemon: Daemon, capsys: pytest.CaptureFixture[str], force_n: int, tmp_path: Path
) -> None:
    daemon.gripper.put_object(width_mm=40.0)
    rows = tmp_path / "rows.csv"
    assert run("hold_force", "--force", str(force_n), "--hold-s", "10", "--csv", str(rows)) == 0
    assert "10.0 s" in capsys.readouterr().out
    times = [float(line.split(",")[0]) for line in rows.read_text().splitlines()]
    assert times == pytest.approx([0.2 * n for n in range(1, 51)])


def test_nothing_to_hold_is_told(run: Run, daemon: Daemon) -> None:
    assert run("hold_force", "--hold-s", "2") == 1


def test_a_motion_is_taught(
    run: Run, daemon: Daemon, site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    teach(site, daemon)
    assert run("taught", "--record", "1.5", "--save", "lift") == 0
    assert capsys.readouterr().out == "150 lift.lgt\n"
    assert run("taught", "--list") == 0
    assert capsys.readouterr().out == "lift.lgt 150 1.49 100 normal\n"
    assert run("taught", "--play", "lift", "--repeat", "2") == 0
    assert capsys.readouterr().out.count("True 0.") == 2
    assert run("taught", "--play", "none") == 1
    assert "none.lgt" in capsys.readouterr().out


def test_a_motor_by_itself(
    run: Run, daemon: Daemon, site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    for what in ("status", "open", "close", "release"):
        assert run("service", what) == 0, what
    assert run("service", "goto", "--rad", "-0.3") == 0
    out = capsys.readouterr().out
    assert "mst 0x18" in out
    assert "-0.30 1" in out
    assert run("service", "zero") == 0
    assert "zero True" in capsys.readouterr().out
    assert run("service", "goto", "--rad", "-0.3") == 1  # its limits mean other angles now
    assert "calibrate again" in capsys.readouterr().out


def test_a_node(run: Run, daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    jobs = daemon.controller.jobs
    assert run("node", "can0") == 0
    out = capsys.readouterr().out
    assert out.splitlines() == ["idle False", "there True False", "slack False"]
    assert len(list(jobs)) < 12  # not one a cycle


def test_a_mirror(run: Run, daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("mirror", "can0") == 0
    assert capsys.readouterr().out.splitlines() == [
        "from factory_calibration.json True",
        "held True",
        "there True",
    ]
