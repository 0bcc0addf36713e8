"""Programs as users of the SDK have them, unchanged, in virtual time.

They make the calls of the SDK's own examples and of programs that people run, in their order and
at their rates.
"""

import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import litegrip
from tests.drop_in import Daemon, Site
from tests.geometry import TRAVEL_MM
from tests.sdk.readme.trajectories import teach

PROGRAMS = Path(__file__).parent / "programs"

Run = Callable[..., int]


@pytest.fixture
def run(site: Site, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return what runs a program with its arguments; it returns the exit code."""

    def run(name: str, *arguments: str) -> int:
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", [f"{name}.py", *arguments])
            for module, stand_in in site.turns.modules().items():
                patch.setitem(sys.modules, module, stand_in)
            for module in [one for one in sys.modules if one.partition(".")[0] == "litegrip"]:
                patch.setitem(sys.modules, module, sys.modules[module])  # a program may reload it
            with pytest.raises(SystemExit) as ended, site.turns:
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


# Programs with threads


def test_a_bench_program_with_an_emergency_stop(
    run: Run, daemon: Daemon, site: Site, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its worker never waits for the daemon, also while the window's thread reads."""
    said: list[str] = []
    said_s: list[float] = []
    limp_s: list[float] = []

    def say(*words: object) -> None:
        said.append(" ".join(map(str, words)))
        said_s.append(site.now_s)

    def watch() -> None:
        if not daemon.is_energised:
            limp_s.append(site.now_s)

    monkeypatch.setattr("builtins.print", say)
    site._watchers.append(watch)
    assert run("bench_window", "can0", str(tmp_path / "saved.json")) == 0
    *seen, reports, saved = said
    assert seen == ["at 0.00", "at 0.00", "force True", "enabled False failed 0"]
    assert saved == "saved True"
    stops_s = said_s[2]  # in the window's thread, while the worker squeezes
    assert min(at_s for at_s in limp_s if at_s > stops_s - 1.0) - stops_s <= 0.015
    count, slowest = reports.split(" reports, slowest ")
    assert int(count) == pytest.approx(200.0 * 6.3, abs=3)
    assert slowest == "0.0 ms"


def test_two_grippers_in_one_process(
    run: Run, daemon: Daemon, site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    other = site.add(Daemon("can1", "reverse"))
    with site.recorded(daemon) as one, site.recorded(other) as two:
        assert run("two_at_once", "can0", "can1") == 0
    strokes, _, reads = capsys.readouterr().out.strip().rpartition(" ")
    assert strokes == "[True, True] True"
    assert int(reads) == pytest.approx(200.0 * 2.25, abs=10)
    for moments in (one, two):
        assert max(moment.opening_mm for moment in moments) == pytest.approx(TRAVEL_MM, abs=1.0)
    midway = [
        {moment.at_s for moment in moments if abs(moment.opening_mm - TRAVEL_MM / 2) < 30.0}
        for moments in (one, two)
    ]
    assert len(midway[0] & midway[1]) > 100  # on their ways at the same time


class Led(litegrip.InProcTeleopTransport):
    """A bus that knows how far open the leader on it is."""

    openness: float | None = None

    def pub(self, topic: str, payload: bytes) -> None:
        """Publish, and take note."""
        if topic == litegrip.teleop_topic():
            type(self).openness = litegrip.decode_frame(payload)[0]
        super().pub(topic, payload)


@pytest.mark.parametrize(("mm_s", "most_mm"), [(25.0, 1.0), (110.0, 5.0)])
def test_a_follower_does_not_lag(
    run: Run,
    daemon: Daemon,
    site: Site,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    mm_s: float,
    most_mm: float,
) -> None:
    """Also where the leader turns round at once; frames come every 20 ms, 2.2 mm apart."""
    behind_mm: list[float] = []

    def watch() -> None:
        if Led.openness is not None:
            behind_mm.append(abs(Led.openness * TRAVEL_MM - daemon.gripper.opening_mm))

    monkeypatch.setattr(Led, "openness", None)
    monkeypatch.setattr(litegrip, "InProcTeleopTransport", Led)
    site._watchers.append(watch)
    arguments = ("--mode", "slave", "--fake-leader", "--openness-rate", str(mm_s / TRAVEL_MM))
    assert run("follow", *arguments) == 0
    assert max(behind_mm[200:1000]) < most_mm  # aligned within the first second
    *_, final = capsys.readouterr().out.splitlines()
    assert final == "frames 298 fault ''"


def test_a_twin_keeps_up_with_a_hand(
    run: Run, daemon: Daemon, site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    site.add(Daemon("can1", "reverse"))
    teach(site, daemon)
    assert run("hand_and_twin", "can0", "can1") == 0
    frames, behind, _ = capsys.readouterr().out.rsplit(" ", 2)
    assert frames == "100 frames, behind"
    assert float(behind) < 4.0
