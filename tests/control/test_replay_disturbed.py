"""Replays that are held up, stopped, lost, refused, or that cannot be loaded."""

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import FASTEST_RAD_S
from litegripd.model.motor import MitCommand, MotorPhase
from litegripd.motor import codec
from litegripd.sim.plant import limits_of_mount
from tests.control.replays import (
    SLOW,
    TOLERANCE,
    TRAVEL_MM,
    followed,
    openness,
    playing,
    reason_of,
    result_of,
    started,
)
from tests.control.states import LEVELS, is_slack
from tests.trajectories import Point, lgt, sampled, send, swing, uploaded
from tests.world import PERIOD_S, ready

OBJECT_MM = TRAVEL_MM * 5.0 / 12.0


def bound_nm(command: MitCommand, position_rad: float) -> float:
    """The most that a command makes the motor press on jaws that stand still."""
    lead_nm = command.kp_nm_rad * abs(command.position_rad - position_rad)
    return lead_nm + command.kd_nm_s_rad * abs(command.velocity_rad_s)


@pytest.mark.parametrize("torque_nm", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("period_s", [1.5, 4.0])
def test_an_object_is_pressed_with_no_more_than_the_torque(
    torque_nm: float, period_s: float
) -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=2000.0)
    number = started(
        world, client, sampled(swing(0.5, 0.4, period_s), period_s), torque_nm=torque_nm
    )
    hardest_nm = bound = 0.0
    while not client.has_answer(number):
        at_rad = world.gripper.position_rad
        world.tick()
        _, command = world.commands_since(world.now_s)[-1]
        bound = max(bound, bound_nm(command, at_rad))
        if abs(world.gripper.velocity_rad_s) < 0.05:
            hardest_nm = max(hardest_nm, world.torque_nm)
    assert hardest_nm <= torque_nm + 0.1
    assert bound <= torque_nm * 1.15  # what the jaws moved since the measurement, and rounding
    assert hardest_nm > 0.6 * torque_nm  # it did press
    assert result_of(client, number)["ok"]  # the path ends where the way is free


def test_ended_by_an_object_it_says_so_and_presses_on() -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=2000.0)
    number = started(world, client, sampled(lambda t_s: 0.6 - 0.2 * t_s, 2.0), torque_nm=1.5)
    result = result_of(client, number)
    assert (result["ok"], result["outcome"]) == (False, "blocked")
    assert result["largest_lag_mm"] == pytest.approx(OBJECT_MM - 0.2 * TRAVEL_MM, abs=0.7)
    world.run(2.0)
    assert world.state.mode == "holding"
    assert world.torque_nm <= 1.6
    assert client.result("trajectory.status")["completed"] is False


def test_jaws_that_come_free_catch_up_without_shooting() -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=2000.0)
    number = started(world, client, sampled(lambda t_s: 0.6 - 0.1 * t_s, 4.0))
    world.run(2.5)
    world.gripper.remove_object()
    fastest_rad_s = max(client.track(number, lambda: abs(world.gripper.velocity_rad_s)))
    # 1.2 of 50 mm/s is what it catches up with; the motor filters its speed, and brakes the later.
    assert fastest_rad_s * NOMINAL[0].rad_to_mm < 180.0
    assert fastest_rad_s < FASTEST_RAD_S
    assert result_of(client, number)["ok"]
    assert openness(world) == pytest.approx(0.2, abs=0.02)


def test_jaws_that_do_not_get_to_the_start_replay_nothing() -> None:
    world, client = ready()
    client.result("motion.move", openness=0.83)
    world.gripper.put_object(width_mm=0.67 * TRAVEL_MM, stiffness_nm_rad=2000.0)
    number = client.send("trajectory.play", name=uploaded(client, SLOW))
    result = result_of(client, number)
    assert (result["ok"], result["outcome"], result["loops"]) == (False, "not_aligned", 0)
    assert world.gripper.opening_mm > 0.625 * TRAVEL_MM


# Stops, losses, faults


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("phase", ["load", "align", "play"])
def test_a_stop_ends_it_by_the_next_tick(level: str, phase: str) -> None:
    world, client = ready()
    client.result("motion.move", openness=0.75)
    number = client.send("trajectory.play", name=uploaded(client, SLOW))
    world.run_until(lambda: playing(world).phase == phase)
    world.run(0.0 if phase == "load" else 0.2)
    here_mm, before_nm = world.gripper.opening_mm, world.torque_nm
    world.client().send("stop", level=level)
    world.tick()
    assert world.controller.jobs.running is None
    world.run(0.5)
    assert reason_of(client, number) == "stopped"
    expected = {"hold": "holding", "relax": "relaxed", "disable": "disabled"}
    assert world.state.mode == expected[level]
    if level == "hold":
        assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.02 * NOMINAL[0].rad_to_mm)
        assert world.torque_nm <= max(before_nm, 0.3)
    assert client.refusal("trajectory.play", name="tmp/upload-1") == "stopped"


@pytest.mark.parametrize("detach", [False, True])
def test_a_lost_client_ends_it_unless_it_is_detached(detach: bool) -> None:
    world, client = ready()
    started(world, client, SLOW, detach=detach)
    world.run(0.5)
    client.leave()
    world.run(0.2)
    assert (world.controller.jobs.running is not None) is detach
    assert world.state.mode == ("moving" if detach else "holding")
    if detach:  # though its upload went with its connection
        world.run_until(lambda: world.controller.jobs.running is None)
        assert openness(world) == pytest.approx(SLOW[-1][1], abs=0.02)


def test_a_lost_lease_ends_it() -> None:
    world, client = ready()
    client.result("lease.acquire", on_lost="relax")
    number = started(world, client, SLOW)
    world.client().result("lease.take", why="a test", jaws="relax")
    world.run(0.1)
    assert reason_of(client, number) == "lease_lost"
    assert is_slack(world)


def test_a_fault_ends_it_and_leaves_the_motor_off() -> None:
    world, client = ready()
    number = started(world, client, SLOW)
    world.run(0.5)
    world.gripper.set_supply(40.0)
    world.run(0.2)
    assert world.phase is MotorPhase.FAULT
    assert reason_of(client, number) == "motor_fault"
    sent = len(world.sent)
    world.gripper.set_supply(24.0)
    world.run(1.0)
    assert codec.ENABLE not in [frame.frame.data for frame in world.sent[sent:]]


def test_a_few_lost_answers_do_not_bend_the_path() -> None:
    world, client = ready()
    number = started(world, client, SLOW)
    began_s = world.now_s
    lost = iter([False] * 40 + [True, True] + [False] * 10_000)
    world.lose_from_motor = lambda _frame: next(lost)
    assert max(followed(world, client, number)) < TOLERANCE
    assert world.now_s - began_s == pytest.approx(4.0, abs=4 * PERIOD_S)


def test_one_replay_replaces_or_follows_another_where_that_is_asked_for() -> None:
    world, client = ready()
    first = started(world, client, SLOW)
    second = client.send("trajectory.play", name="tmp/upload-1", if_busy="queue", speed=2.0)
    third = client.send("trajectory.play", name="tmp/upload-1", if_busy="replace", speed=4.0)
    assert reason_of(client, first) == "replaced"
    world.run_until(lambda: client.has_answer(third) and client.has_answer(second), 30.0)
    assert result_of(client, third)["ok"]
    assert result_of(client, second)["ok"]


# Loading


def test_a_long_one_is_loaded_in_many_pieces_while_the_jaws_hold() -> None:
    world, client = ready()
    points = sampled(swing(0.5, 0.1, 2.0), 16.0, hz=200)
    number = client.send("trajectory.play", name=uploaded(client, points))
    since_s = world.now_s
    world.run_until(lambda: playing(world).phase != "load")
    assert len({c.position_rad for _, c in world.commands_since(since_s)}) <= 2
    assert world.longest_gap_s(since_s) < 2 * PERIOD_S
    assert playing(world).samples == 3201
    errors = followed(world, client, number)
    assert max(errors) < TOLERANCE
    assert len(errors) == pytest.approx(3200, abs=3)


def test_a_helper_that_fails_while_it_is_loaded_moves_nothing_and_drops_nothing() -> None:
    world, client = ready()
    world.gripper.put_object(width_mm=29.0)
    name = uploaded(client, SLOW)
    client.result("motion.grasp", force_n=10, until="verdict")
    world.run(1.0)
    world.disk.error = "the helper process died while it worked on this"
    answer = client.call("trajectory.play", name=name)
    assert answer["error"]["data"]["reason"] == "trajectory_unreadable"
    assert "helper process died" in answer["error"]["message"]
    world.run(0.5)
    assert world.state.is_grasped
    assert world.state.force_n == pytest.approx(10.0, abs=1.5)


def test_a_helper_that_never_answers_is_waited_for_so_long_and_no_longer() -> None:
    world, client = ready()
    name = uploaded(client, SLOW)
    number = client.send("trajectory.play", name=name)
    world.disk.silent = True
    client.wait(number, 12.0)
    assert reason_of(client, number) == "trajectory_unreadable"
    assert world.state.mode == "holding"


def test_one_that_is_changed_while_it_is_loaded_is_not_replayed() -> None:
    world, client = ready()
    points = sampled(swing(0.5, 0.1, 2.0), 32.0, hz=200)
    send(client, lgt(points), name="pick")
    number = client.send("trajectory.play", name="pick")
    world.run(3 * PERIOD_S)
    assert playing(world).phase == "load"
    path = world.disk.trajectories() / "pick.lgt"
    path.write_bytes(lgt([*points[:-1], (points[-1][0] + 1.0, 0.5)]))
    assert reason_of(client, number) == "trajectory_unreadable"


@pytest.mark.parametrize("points", [[], [(0.0, 0.5), (-1.0, 0.5)], [(0.0, 1.5)]])
def test_a_bad_file_of_the_daemon_is_not_replayed(points: list[Point]) -> None:
    world, client = ready()
    send(client, lgt(SLOW), name="pick")
    (world.disk.trajectories() / "pick.lgt").write_bytes(lgt(points))
    assert client.refusal("trajectory.play", name="pick") == "trajectory_unreadable"


def test_progress_tells_where_it_is() -> None:
    _world, client = ready()
    name = uploaded(client, SLOW)
    number = client.send("trajectory.play", name=name, progress=True, repeat=2, speed=2.0)
    client.wait(number)
    seen = [one["params"] for one in client.notifications if one["method"] == "job.progress"]
    assert {one["phase"] for one in seen} >= {"play"}
    assert [one["frames"] for one in seen] == sorted(one["frames"] for one in seen)
    assert {one["loops"] for one in seen} == {0, 1}
    playing_ones = [one for one in seen if one["phase"] == "play"]
    assert all(0.0 <= one["openness"] <= 1.0 and one["speed"] == 2.0 for one in playing_ones)
    assert all(0 <= one["step"] <= one["total_steps"] == 800 for one in playing_ones)
    assert client.result("trajectory.status")["completed"] is True


def test_the_torques_that_were_recorded_are_never_fed_forward() -> None:
    world, client = ready()
    number = started(world, client, SLOW)
    since_s = world.now_s
    client.wait(number)
    assert all(abs(command.torque_nm) < 0.003 for _, command in world.commands_since(since_s))


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_nothing_leaves_the_travel(mount: str) -> None:
    world, client = ready(mount)
    closed_rad, open_rad = limits_of_mount(mount)
    number = started(world, client, sampled(swing(0.5, 0.5, 6.0), 6.0))
    since_s = world.now_s
    client.wait(number)
    low_rad, high_rad = sorted((closed_rad, open_rad))
    for _, command in world.commands_since(since_s):
        assert low_rad - 4e-4 <= command.position_rad <= high_rad + 4e-4
