"""The actions: their targets, samples and results, and a program's own limits and tunables."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import litegrip
from litegrip import LiteGrip, MoveProgress
from tests.drop_in import Daemon, Site

Taken = list[MoveProgress]


def test_open_and_close_press_onto_the_stops(gripper: LiteGrip, daemon: Daemon) -> None:
    opened = gripper.open()
    assert (bool(opened), opened.reached, opened.stalled, opened.protected) == (
        True,
        False,
        True,
        False,
    )
    target, limit, _, _ = litegrip.press_target(gripper.config, "open", 0.05)
    assert [opened.target_rad, opened.limit_rad] == pytest.approx([target, limit])
    assert opened.state.position_mm == pytest.approx(daemon.gripper.opening_mm, abs=0.2)
    closed = gripper.actions.close()
    assert (bool(closed), closed.state.position_mm < 0.5) == (True, True)


def test_a_work_stroke_is_reached_and_not_pressed(gripper: LiteGrip, daemon: Daemon) -> None:
    gripper.config.work_stroke_mm = 70.0
    opened = gripper.open()
    assert (opened.ok, opened.reached, opened.stalled) == (True, True, False)
    target, limit, _ = litegrip.work_limit_target(gripper.config, 70.0)
    assert [opened.target_rad, opened.limit_rad] == pytest.approx([target, limit])
    assert daemon.gripper.opening_mm == pytest.approx(70.0, abs=1.0)


def test_samples_come_each_ten_frames_and_at_the_last(gripper: LiteGrip) -> None:
    taken: Taken = []
    result = gripper.close(progress=taken.append)
    *on_the_way, last = taken
    assert [one.i for one in on_the_way] == [10 * (n + 1) for n in range(len(on_the_way))]
    assert last.i == result.steps
    assert {one.phase for one in taken} == {"move"}
    assert [one.win_delta_rad is None for one in taken[:7]] == [True] * 5 + [False] * 2
    assert all(one.total_steps >= one.i for one in taken)
    running = taken[len(taken) // 3]
    speed_mm_s = abs(running.delta_rad) / 0.05 * gripper.config.rad_to_mm
    assert speed_mm_s == pytest.approx(50.0, rel=0.2)


def test_a_longer_interval_has_fewer_samples(gripper: LiteGrip) -> None:
    gripper.motion_config.sample_interval = 0.1
    taken: Taken = []
    gripper.close(progress=taken.append)
    assert [one.i for one in taken[:3]] == [20, 40, 60]


@pytest.mark.parametrize("when", ["move", "hold"])
def test_what_a_callback_raises_ends_the_action(
    gripper: LiteGrip, daemon: Daemon, site: Site, when: str
) -> None:
    daemon.gripper.put_object(width_mm=30.0)

    def report(one: MoveProgress) -> None:
        if one.phase == when:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gripper.grasp(10.0, 5.0, progress=report)
    before_mm = daemon.gripper.opening_mm
    site.run(1.0)
    assert daemon.gripper.opening_mm == pytest.approx(before_mm, abs=0.5)


def test_a_grasp_of_something(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    taken: Taken = []
    result = gripper.grasp(15.0, 2.0, progress=taken.append)
    assert (bool(result), result.stalled, result.reached) == (True, True, False)
    assert (result.force_n, result.cycles) == (15.0, 10)
    target = litegrip.limit_target(gripper.config, "close", 0.05)[0]
    assert result.target_rad == pytest.approx(target)
    holds = [one for one in taken if one.phase == "hold"]
    assert [one.i for one in holds] == list(range(1, 11))
    for one in holds:
        assert (one.total_steps, one.delta_rad, one.win_delta_rad) == (0, 0.0, None)
        assert one.cmd_rad == one.pos_rad
    site.run(1.0)
    assert daemon.closing_torque_nm == pytest.approx(1.5, rel=0.1)  # it goes on


def test_a_grasp_of_nothing_squeezes_the_fingers(gripper: LiteGrip, daemon: Daemon) -> None:
    result = gripper.grasp(15.0, 1.0)
    assert (bool(result), result.reached, result.stalled, result.cycles) == (True, True, False, 5)
    assert daemon.closing_torque_nm == pytest.approx(1.5, rel=0.1)


def test_a_fault_ends_the_hold(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    taken: Taken = []

    def report(one: MoveProgress) -> None:
        taken.append(one)
        if one.phase == "hold" and one.i == 3:
            daemon.gripper.latch_fault(0xE)

    result = gripper.grasp(15.0, 0.0, progress=report)
    assert (bool(result), result.cycles, result.state.error_code) == (False, 4, 14)
    assert taken[-1].i == 3  # a slice that ends in a fault gives no sample


def test_an_interrupt_passes_through_and_the_force_stays(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    daemon.gripper.put_object(width_mm=30.0)

    def interrupt() -> None:
        raise KeyboardInterrupt

    site.after(6.0, interrupt)
    with pytest.raises(KeyboardInterrupt):
        gripper.grasp(15.0)
    site.run(1.0)
    assert daemon.closing_torque_nm == pytest.approx(1.5, rel=0.1)


def test_the_force_of_set_force_climbs_first(gripper: LiteGrip, site: Site) -> None:
    began_s = site.now_s
    assert gripper.set_force(20.0, 0.3) is True
    assert site.now_s - began_s == pytest.approx(1.3, abs=0.05)
    assert gripper.get_force() == pytest.approx(20.0, rel=0.1)
    with pytest.raises(litegrip.CommandError, match="100"):
        gripper.set_force(101.0)
    with pytest.raises(litegrip.CommandError, match="40"):
        gripper.set_force(60.0)
    with pytest.raises(litegrip.CommandError, match="opening"):
        gripper.set_force(-5.0)


Move = Callable[[LiteGrip, float], object]
MOVES: dict[str, Move] = {
    "goto": lambda g, mm: g.goto(mm),
    "goto_rad": lambda g, mm: g.goto_rad(_angle(g, mm)),
    "move_to": lambda g, mm: g.move_to(_angle(g, mm)),
    "move_at_speed": lambda g, mm: g.move_at_speed(mm, 80.0),
    "move_at_speed_rad": lambda g, mm: g.move_at_speed_rad(_angle(g, mm), 1.2),
}


def _angle(gripper: LiteGrip, opening_mm: float) -> float:
    config = gripper.config
    return config.pos_closed_rad - config.close_sign * opening_mm / config.rad_to_mm


@pytest.mark.parametrize("name", MOVES)
def test_moves_go_there_and_no_further_than_the_travel(
    gripper: LiteGrip, daemon: Daemon, name: str
) -> None:
    assert MOVES[name](gripper, 40.0) is True
    assert daemon.gripper.opening_mm == pytest.approx(40.0, abs=0.7)
    assert MOVES[name](gripper, 500.0) is True
    assert daemon.gripper.opening_mm == pytest.approx(87.0, abs=0.7)


def test_without_a_way_or_a_speed_nothing_is_sent(gripper: LiteGrip, daemon: Daemon) -> None:
    before_mm = daemon.gripper.opening_mm
    assert gripper.move_at_speed(10.0, 0.0) is True
    assert gripper.move_at_speed(10.0, -5.0) is True
    assert gripper.move_at_speed_rad(gripper.get_position_rad()) is True
    assert daemon.gripper.opening_mm == pytest.approx(before_mm, abs=0.01)


def test_home_is_closed(gripper: LiteGrip, daemon: Daemon) -> None:
    assert gripper.home() is True
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=0.7)


# A program's own configuration


def test_what_is_assigned_counts_from_the_next_call(gripper: LiteGrip, daemon: Daemon) -> None:
    config = gripper.config
    span = config.pos_open_rad - config.pos_closed_rad
    config.pos_open_rad = config.pos_closed_rad + 0.5 * span
    config.rad_to_mm *= 2.0
    assert gripper.goto(500.0) is True
    assert daemon.gripper.opening_mm == pytest.approx(43.5, abs=0.7)


def test_it_changes_nothing_for_other_programs(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    before = daemon.controller.calibrated.calibration
    gripper.config.kp, gripper.config.work_stroke_mm = 60.0, 30.0
    gripper.motion_config.speed_mm_s = 20.0
    assert gripper.open()
    assert daemon.gripper.opening_mm == pytest.approx(30.0, abs=0.7)
    assert daemon.controller.calibrated.calibration is before
    gripper.disconnect()
    with LiteGrip("can0") as other:
        other.load_calibration()
        other.enable()
        assert other.config.work_stroke_mm == 0.0
        assert other.open()
        assert daemon.gripper.opening_mm > 86.0


def test_limits_that_cannot_be_are_refused_and_nothing_moves(
    gripper: LiteGrip, daemon: Daemon
) -> None:
    before_mm = daemon.gripper.opening_mm
    gripper.config.rad_to_mm = 3000.0
    with pytest.raises(litegrip.CommandError):
        gripper.open()
    gripper.config.rad_to_mm = float("nan")
    with pytest.raises(litegrip.CommandError):
        gripper.open()
    assert daemon.gripper.opening_mm == pytest.approx(before_mm, abs=0.01)


def test_a_daemon_without_a_calibration_moves_by_the_programs(site: Site, home: Path) -> None:
    daemon = site.add(Daemon(calibrated=False))
    with LiteGrip("can0", mount="normal") as gripper:
        assert gripper.enable()
        assert gripper.close()
        assert gripper.goto(40.0)
        assert daemon.gripper.opening_mm == pytest.approx(40.0, abs=0.7)


# Frames


def test_frames_are_followed(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    for step in range(100):
        assert gripper.send_mit_frame(_angle(gripper, 60.0 - 0.4 * step), 100.0, 2.0) is True
        site.run(0.02)
    assert daemon.gripper.opening_mm == pytest.approx(20.4, abs=1.0)
    assert gripper.send_mit_frame(_angle(gripper, -300.0), 2000.0, 0.0)  # gains and angle saturate
    site.run(0.5)
    assert gripper.goto(30.0)  # another request ends them


def test_a_frame_beyond_what_a_frame_holds_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(litegrip.CommandError, match="10"):
        gripper.send_mit_frame(0.0, 0.0, 0.0, tau=10.5)
    with pytest.raises(litegrip.CommandError):
        gripper.send_mit_frame(0.0, 100.0, 2.0, tau=1.0)


# Calibration


def test_zero_measures_and_saves_for_the_program_and_the_daemon(
    site: Site, home: Path, mount: str
) -> None:
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0", mount=mount) as gripper:
        assert gripper.enable()
        data = gripper.zero()
        assert gripper.mount == mount
        assert data.travel_range == pytest.approx(abs(data.zero_position - data.max_position))
        assert data.rad_to_mm == pytest.approx(86.0 / data.travel_range, rel=1e-3)
        saved = json.loads((home / ".litegrip" / "can0_calibration.json").read_text())
        assert saved["zero_position_rad"] == gripper.config.pos_closed_rad
        assert daemon.controller.calibrated.geometry is not None
        assert gripper.close()


def test_calibrate_by_hand(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    sign = daemon.gripper.parameters.close_sign
    site.after(1.0, lambda: daemon.gripper.push(-0.5 * sign))
    site.after(5.0, lambda: daemon.gripper.push(0.5 * sign))
    site.after(10.0, lambda: daemon.gripper.push(0.0))
    data = gripper.calibrate_manual(duration=11.0)
    assert data.travel_mm == pytest.approx(86.0, abs=0.5)
    assert gripper.mount == daemon.mount


def test_a_probe_without_a_bound_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(litegrip.CommandError, match="tau_limit"):
        gripper.calibrate(tau_limit=None)


def test_the_motors_zero(gripper: LiteGrip) -> None:
    before_rad = gripper.get_position_rad()
    result = gripper.write_zero()
    assert (bool(result), result.before_rad) == (True, before_rad)
    assert abs(result.after_rad) <= 1e-3
    assert gripper.is_enabled
