"""Each code block of the SDK's README runs, with nothing changed but its import."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from examples import teleop, trajectory
from litegrip_client import LiteGrip, Trajectory
from tests.drop_in import Daemon, Site
from tests.sdk.readme import blocks
from tests.sdk.readme.scenes import bench_unit, own_file, speed_mm_s
from tests.sdk.readme.test_teleop import Tapped, share_open
from tests.sdk.readme.trajectories import teach


def interrupt() -> None:
    raise KeyboardInterrupt


def a_script_enables_and_leaves() -> None:
    with LiteGrip("can0", disable_on_disconnect=False) as gripper:
        assert gripper.enable()


Hook = Callable[[Callable[[], None]], None]
"""What has something done while the next script leads."""


def at_the_end_of_its_block(monkeypatch: pytest.MonkeyPatch) -> Hook:
    leave = LiteGrip.__exit__

    def hook(action: Callable[[], None]) -> None:
        def stay(gripper: LiteGrip, *error: object) -> None:
            monkeypatch.setattr(LiteGrip, "__exit__", leave)
            action()
            leave(gripper, *error)  # type: ignore[arg-type]

        monkeypatch.setattr(LiteGrip, "__exit__", stay)

    return hook


def while_it_prints(monkeypatch: pytest.MonkeyPatch) -> Hook:
    follow_along = teleop.follow_along

    def hook(action: Callable[[], None]) -> None:
        def stay(_gripper: LiteGrip, _seconds: float | None) -> None:
            monkeypatch.setattr(teleop, "follow_along", follow_along)
            action()

        monkeypatch.setattr(teleop, "follow_along", stay)

    return hook


@dataclass(frozen=True, slots=True)
class TwoMachines:
    """A leader that a hand opens, and a follower of another mount and travel."""

    site: Site
    home: Path

    def run(self, lead: Callable[[], object], hook: Hook, follow: Callable[[], object]) -> None:
        """Run the leader's script, and meanwhile the follower's, until it is interrupted."""
        links = Tapped()
        unit = bench_unit("reverse")
        own_file(self.home, "can0", "normal")
        leader = self.site.add(Daemon("can0", links=links))
        follower = Daemon("can0", "reverse", boots=True, parameters=unit, links=links)
        apart: list[float] = []

        def elsewhere() -> None:
            self.site.leave("can0")
            limits = {"zero_position_rad": unit.closed_rad, "max_position_rad": unit.open_rad}
            own_file(self.home, "can0", "reverse", rad_to_mm=unit.rad_to_mm, **limits)
            self.site.add(follower)
            self.site.after(2.0, lambda: leader.gripper.push(-0.4))
            self.site.after(4.0, lambda: leader.gripper.push(0.0))
            self.site.after(6.0, lambda: apart.append(share_open(follower) - share_open(leader)))
            self.site.after(6.1, interrupt)
            follow()

        hook(elsewhere)
        lead()
        assert apart == pytest.approx([0.0], abs=0.01)
        assert share_open(leader) > 0.9
        assert [options.host for options in links.opened] == [None, "192.168.1.20"]
        assert not leader.is_energised
        assert not follower.is_energised


@pytest.fixture
def two_machines(site: Site, home: Path) -> TwoMachines:
    return TwoMachines(site, home)


def test_reverse_mount(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    unit = bench_unit("reverse")
    daemon = site.add(Daemon("can1", "reverse", calibrated=False, parameters=unit))
    names = blocks.run(blocks.source("reverse_mount"))
    assert capsys.readouterr().out.splitlines()[0] == "reverse"
    assert names["list_templates"]() == ["normal", "reverse"]
    geometry = daemon.controller.geometry
    assert geometry is not None
    assert geometry.closed_rad == pytest.approx(unit.closed_rad, abs=0.02)
    assert geometry.open_rad == pytest.approx(unit.open_rad, abs=0.02)
    assert not daemon.is_energised


def test_leader_and_follower_on_two_machines(
    two_machines: TwoMachines,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The leader's half ends its block at once; it leads for as long as it is held up there.

    To print takes time, and nothing else does in the follower's loop.
    """
    lead, follow = blocks.halves("teleop")

    def slow_print(status: dict[str, Any]) -> None:
        print(status)
        two_machines.site.run(0.05)

    def follow_until_interrupted() -> None:
        with pytest.raises(KeyboardInterrupt):
            blocks.run(follow, print=slow_print)

    hook = at_the_end_of_its_block(monkeypatch)
    two_machines.run(lambda: blocks.run(lead), hook, follow_until_interrupted)
    last = capsys.readouterr().out.splitlines()[-1]
    assert "'phase': 'following'" in last
    assert "'stale': False" in last


def test_trajectory(site: Site, home: Path, daemon: Daemon) -> None:
    own_file(home, "can0", daemon.mount)
    teach(site, daemon)
    began_mm = daemon.gripper.opening_mm
    with site.recorded(daemon) as moments:
        names = blocks.run(blocks.source("trajectory"))
    pushed_mm = next(m.opening_mm for m in moments if m.at_s > moments[0].at_s + 4.0)
    assert daemon.gripper.opening_mm == pytest.approx(pushed_mm, abs=2.5)
    assert pushed_mm > began_mm + 5.0
    assert len(names["taught"]) == pytest.approx(500, abs=2)
    assert (home / ".litegrip" / "trajectories" / "pick.lgt").exists()
    assert Trajectory.load("pick") == names["taught"]
    assert not daemon.is_energised


def test_progress(gripper: LiteGrip, capsys: pytest.CaptureFixture[str]) -> None:
    blocks.run(blocks.source("progress"), gripper=gripper)
    lines = capsys.readouterr().out.splitlines()
    number = r"[+-]\d\.\d"
    form = rf"\[move\] (\d+)/(\d+) cmd={number}{{4}} pos={number}{{4}} tau={number}{{3}}"
    found = [re.fullmatch(form, line) for line in lines]
    steps = [(int(match[1]), int(match[2])) for match in found if match is not None]
    assert len(steps) == len(lines) > 20
    assert steps == sorted(steps)
    assert all(0 < step <= total for step, total in steps)


def test_motion_config(site: Site, daemon: Daemon) -> None:
    """It neither enables nor, without a hold_s, ends: another script does, and Ctrl-C."""
    daemon.gripper.put_object(width_mm=15.0)
    a_script_enables_and_leaves()
    held: list[float] = []
    site.after(10.0, lambda: held.append(daemon.closing_torque_nm))
    site.after(10.1, interrupt)
    with site.recorded(daemon) as moments, pytest.raises(KeyboardInterrupt):
        blocks.run(blocks.source("motion_config"))
    assert speed_mm_s(moments, 55.0, 20.0) == pytest.approx(25.0, rel=0.03)
    assert held == pytest.approx([0.5], abs=0.05)


def test_the_lines_for_two_machines(
    two_machines: TwoMachines,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    lead, follow, _ = blocks.arguments("teleop_lines", "examples/teleop.py")
    hook = while_it_prints(monkeypatch)
    two_machines.run(lambda: teleop.main(lead), hook, lambda: teleop.main(follow))
    assert capsys.readouterr().out.count("no fault") == 2


def test_the_line_for_one_gripper(
    site: Site, daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rigid object is between the jaws, as it says there, and the guard lets go of it."""
    daemon.gripper.put_object(width_mm=40.0, stiffness_nm_rad=1500.0)
    *_, line = blocks.arguments("teleop_lines", "examples/teleop.py")
    site.after(15.0, interrupt)
    assert teleop.main(line) == 0
    out = capsys.readouterr().out
    assert "following link open  frames" in out
    assert "trips 1" in out
    assert "no fault" in out
    assert not daemon.is_energised


def test_the_lines_for_trajectories(
    site: Site, home: Path, daemon: Daemon, capsys: pytest.CaptureFixture[str]
) -> None:
    record, show, play = blocks.arguments("trajectory_lines", "examples/trajectory.py")
    teach(site, daemon)
    for line in (record, show, play):
        assert trajectory.main(line) == 0
    recorded, kept, repeated = capsys.readouterr().out.split("\n", 1)[1].splitlines()
    assert recorded.endswith("pick.lgt")
    assert "pick" in kept
    assert repeated == "ok=True (completed)"


def test_every_block_is_run() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("*.py"))
    for name in blocks.names():
        assert f'("{name}"' in text, name
