"""Replaying trajectories on the simulated gripper: to the start, along the path, and hold."""

from itertools import pairwise

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.motion_config import MOVING_KP_NM_RAD, REACHING_KP_NM_RAD
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
from tests.trajectories import fetched, sampled, send, swing, uploaded
from tests.world import PERIOD_S, ready

MM_RAD = NOMINAL[0].rad_to_mm
WIDE_MM = 0.92 * TRAVEL_MM


@pytest.mark.parametrize("mount", ["normal", "reverse"])
@pytest.mark.parametrize("taught_on", [b"normal\0\0", b"reverse\0", b"\0" * 8])
def test_the_openness_follows_whatever_mount_it_was_taught_on(mount: str, taught_on: bytes) -> None:
    world, client = ready(mount)
    points = sampled(swing(size=0.4), 4.0, hz=50)
    number = started(world, client, points, kp=100)
    errors = followed(world, client, number)
    assert max(errors) < TOLERANCE
    assert len(errors) == pytest.approx(4.0 / PERIOD_S, abs=2)
    result = result_of(client, number)
    assert (result["ok"], result["outcome"], result["loops"]) == (True, "completed", 1)
    assert openness(world) == pytest.approx(points[-1][1], abs=TOLERANCE)


@pytest.mark.parametrize(
    "content",
    [
        {"zero_position_rad": -0.05, "max_position_rad": -1.3, "rad_to_mm": 66.0},
        {"zero_position_rad": 0.0, "max_position_rad": -1.0, "rad_to_mm": 80.0},
    ],
)
def test_the_openness_follows_by_another_calibration(content: dict[str, float]) -> None:
    world, client = ready()
    client.result("calibration.load", content=content)
    client.result("motion.move", openness=0.5)
    number = started(world, client, SLOW)
    assert max(followed(world, client, number)) < TOLERANCE
    geometry = world.geometry
    assert geometry.open_rad == content["max_position_rad"]


def test_a_motion_taught_by_hand_replays_on_another_mount() -> None:
    world, client = ready()
    client.result("trajectory.record_start", rate_hz=200)
    for torque_nm, duration_s in ((-0.24, 0.4), (0.0, 0.3), (0.25, 0.4), (0.0, 0.3)):
        world.gripper.push(torque_nm)
        world.run(duration_s)
    taught = client.result("trajectory.record_stop")["name"]
    content = fetched(client, name=taught)
    other, others_client = ready("reverse")
    send(others_client, content, name="pick")
    number = others_client.send("trajectory.play", name="pick", speed=0.4)
    assert max(followed(other, others_client, number)) < TOLERANCE
    assert result_of(others_client, number)["ok"]


@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0, 2.0, 4.0])
def test_it_takes_as_long_as_its_speed_says(speed: float) -> None:
    world, client = ready()
    points = sampled(lambda t_s: 0.5 + 0.05 * t_s, 1.0)
    number = started(world, client, points, speed=speed)
    began_s = world.now_s
    client.wait(number, 30.0)
    assert world.now_s - began_s == pytest.approx(1.0 / speed, abs=6 * PERIOD_S)
    assert result_of(client, number)["ok"]


def test_nothing_jumps_from_the_first_command_on() -> None:
    """Aligning from afar, going along the path, and holding at its end."""
    world, client = ready()
    client.result("motion.move", opening_mm=WIDE_MM)
    world.run(0.2)
    since_s = world.now_s
    here_rad = world.gripper.position_rad
    number = client.send("trajectory.play", name=uploaded(client, sampled(swing(0.3), 2.0)))
    client.wait(number)
    world.run(0.5)
    commands = world.commands_since(since_s + PERIOD_S)
    assert commands[0][1].position_rad == pytest.approx(here_rad, abs=0.01)
    geometry = world.geometry
    fastest_rad_s = 1.2 * geometry.to_rad(max(50.0, TRAVEL_MM * 0.3 * 6.28 / 4.0)) + 0.2
    for (_, one), (_, other) in pairwise(commands):
        assert abs(other.position_rad - one.position_rad) <= fastest_rad_s * PERIOD_S + 8e-4


def test_it_goes_to_the_start_at_the_speed_of_a_move() -> None:
    world, client = ready()
    client.result("motion.move", opening_mm=WIDE_MM)
    client.send("trajectory.play", name=uploaded(client, SLOW), config={"speed_mm_s": 20})
    world.run_until(lambda: playing(world).phase == "align")
    began_s = world.now_s
    world.run_until(lambda: playing(world).phase == "play")
    assert world.now_s - began_s == pytest.approx((WIDE_MM - 0.5 * TRAVEL_MM) / 20.0, rel=0.1)


def test_without_align_it_begins_only_where_it_begins() -> None:
    world, client = ready()
    name = uploaded(client, SLOW)
    client.result("motion.move", opening_mm=0.5 * TRAVEL_MM + 10.0)
    since_s = world.now_s
    answer = client.call("trajectory.play", name=name, align=False)
    data = answer["error"]["data"]
    assert (data["reason"], data["limit"]) == ("out_of_limits", 4.0)
    assert data["requested"] == pytest.approx(10.0, abs=0.5)
    positions = {command.position_rad for _, command in world.commands_since(since_s)}
    assert max(positions) - min(positions) < 0.02
    client.result("motion.move", opening_mm=0.5 * TRAVEL_MM + 2.0)
    assert client.result("trajectory.play", name=name, align=False)["ok"]


def test_the_hold_at_its_end_lasts() -> None:
    world, client = ready()
    started(world, client, SLOW)
    world.run_until(lambda: world.controller.jobs.running is None)
    since_s = world.now_s
    world.run(5.0)
    assert world.state.mode == "holding"
    assert world.longest_gap_s(since_s) < 2 * PERIOD_S
    world.gripper.push(0.8)
    world.run(0.5)
    assert openness(world) == pytest.approx(SLOW[-1][1], abs=0.01)


# Pause, resume, speed


def test_a_pause_is_in_force_within_a_tick_and_the_path_goes_on_where_it_was() -> None:
    world, client = ready()
    number = started(world, client, sampled(swing(), 4.0))
    world.run(1.5)
    assert client.result("trajectory.control", action="pause")["phase"] == "paused"
    since_s, paused_at = world.now_s, playing(world).openness
    world.run(2.0)
    assert playing(world).openness == paused_at
    commands = [command for _, command in world.commands_since(since_s + PERIOD_S)]
    assert len({command.position_rad for command in commands}) <= 2
    assert all(abs(command.velocity_rad_s) < 0.01 for command in commands)
    assert client.result("trajectory.status")["active"]
    client.result("trajectory.control", action="resume")
    resumed_s = world.now_s
    world.tick()
    assert playing(world).openness != paused_at
    assert max(followed(world, client, number)) < TOLERANCE
    assert world.now_s - resumed_s == pytest.approx(2.5, abs=5 * PERIOD_S)


def test_a_new_speed_counts_from_the_next_tick() -> None:
    world, client = ready()
    number = started(world, client, sampled(lambda t_s: 0.2 + 0.1 * t_s, 4.0))
    world.run(1.0)
    assert client.result("trajectory.control", action="speed", speed=3.0)["speed"] == 3.0
    changed_s, before = world.now_s, playing(world).openness or 0.0
    world.tick()
    after = playing(world).openness or 0.0
    assert after - before == pytest.approx(3.0 * 0.1 * PERIOD_S)
    assert max(followed(world, client, number)) < TOLERANCE
    assert world.now_s - changed_s == pytest.approx(1.0, abs=5 * PERIOD_S)


def test_a_pause_on_the_way_to_the_start_holds_there() -> None:
    world, client = ready()
    client.result("motion.move", opening_mm=WIDE_MM)
    client.send("trajectory.play", name=uploaded(client, SLOW))
    world.run_until(lambda: playing(world).phase == "align")
    world.run(0.3)
    client.result("trajectory.control", action="pause")
    world.run(0.1)
    here = openness(world)
    world.run(10.0)  # longer than aligning may take
    assert openness(world) == pytest.approx(here, abs=0.002)
    client.result("trajectory.control", action="resume")
    world.run_until(lambda: playing(world).phase == "play")


def test_control_is_refused_where_it_makes_no_sense() -> None:
    world, client = ready()
    assert client.refusal("trajectory.control", action="pause") == "unknown_job"
    started(world, client, SLOW)
    assert client.refusal("trajectory.control", action="speed") == "invalid_params"
    assert client.refusal("trajectory.control", action="pause", speed=2) == "invalid_params"
    assert client.refusal("trajectory.control", action="speed", speed=5) == "invalid_params"
    assert client.refusal("trajectory.control", action="pause", job=999) == "unknown_job"
    client.send("motion.open", if_busy="replace")
    world.run(0.1)
    assert client.refusal("trajectory.control", action="pause") == "unknown_job"


@pytest.mark.parametrize("detach", [False, True])
def test_only_a_detached_one_is_controlled_by_others(detach: bool) -> None:
    world, client = ready()
    started(world, client, SLOW, detach=detach)
    other = world.client()
    if detach:
        other.result("trajectory.control", action="pause")
    else:
        assert other.refusal("trajectory.control", action="pause") == "busy"
    assert playing(world).is_paused is detach
    client.result("trajectory.control", action="resume")
    assert not playing(world).is_paused


@pytest.mark.parametrize(("kp", "kd"), [(20.0, 0.5), (60.0, 2.0), (None, None)])
def test_the_gains_are_at_most_the_wanted_ones_but_stiff_enough_to_reach(
    kp: float | None, kd: float | None
) -> None:
    world, client = ready()
    gains = {"kp": kp, "kd": kd} if kp is not None else {}
    number = started(world, client, SLOW, **gains)
    since_s = world.now_s
    client.wait(number)
    commands = [command for _, command in world.commands_since(since_s)]
    most_kp = max(MOVING_KP_NM_RAD if kp is None else kp, REACHING_KP_NM_RAD)
    assert max(command.kp_nm_rad for command in commands) == pytest.approx(most_kp, rel=0.02)
    assert max(command.kd_nm_s_rad for command in commands) <= (kd or 2.0) + 0.01


def test_the_status_tells_of_the_latest_of_recordings_and_replays() -> None:
    world, client = ready()
    empty = {"active": False, "kind": None, "job": None, "samples": 0, "error": None}
    assert client.result("trajectory.status") == {**empty, "unkept": None}
    client.result("trajectory.record_start")
    world.run(0.3)
    client.result("trajectory.record_stop", name="pick")
    status = client.result("trajectory.status")
    assert (status["active"], status["kind"]) == (False, "record")
    taught = status["samples"]
    client.result("trajectory.play", name="pick")
    status = client.result("trajectory.status")
    assert (status["active"], status["kind"], status["samples"]) == (False, "play", taught)
    client.result("trajectory.record_start", zero_gravity=False)
    assert client.result("trajectory.status")["kind"] == "record"


# Speeds


def test_a_path_that_is_too_fast_is_refused_with_the_speed_that_goes() -> None:
    world, client = ready()
    name = uploaded(client, sampled(lambda t_s: 0.2 + 6.0 * t_s, 0.1, hz=200))  # 522 mm/s
    since_s = world.now_s
    answer = client.call("trajectory.play", name=name)
    data = answer["error"]["data"]
    assert (data["reason"], data["field"]) == ("out_of_limits", "speed")
    assert data["limit"] == pytest.approx(FASTEST_MM_S / (6.0 * TRAVEL_MM), rel=1e-3)
    assert world.state.mode == "holding"
    assert len({c.position_rad for _, c in world.commands_since(since_s)}) <= 2
    assert client.result("trajectory.play", name=name, speed=0.28)["ok"]


def test_a_jump_is_refused_at_every_speed() -> None:
    _, client = ready()
    name = uploaded(client, [(0.0, 0.4), (0.0, 0.6), (1.0, 0.6)])
    assert client.refusal("trajectory.play", name=name, speed=0.1) == "out_of_limits"


@pytest.mark.parametrize("after_s", [0.0, 0.001])
@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_a_jump_within_a_period_is_a_jump(after_s: float, speed: float) -> None:
    _, client = ready()
    name = uploaded(client, [(0.0, 0.05), (after_s, 0.95)])
    assert client.refusal("trajectory.play", name=name, speed=speed) == "out_of_limits"


@pytest.mark.parametrize("after_s", [0.0, 0.001])
@pytest.mark.parametrize("moved", [0.0, 0.001])
def test_a_path_within_a_period_is_a_pose_as_long_as_it_is_slow(
    after_s: float, moved: float
) -> None:
    world, client = ready()
    name = uploaded(client, [(0.0, 0.25), (after_s, 0.25 + moved * after_s / 0.001)])
    assert client.result("trajectory.play", name=name)["ok"]
    assert openness(world) == pytest.approx(0.25, abs=0.02)


def test_a_running_one_is_not_made_too_fast_either() -> None:
    world, client = ready()
    started(world, client, sampled(lambda t_s: 0.1 + 1.5 * t_s, 0.5, hz=200), speed=0.2)
    assert client.refusal("trajectory.control", action="speed", speed=4.0) == "out_of_limits"
    assert playing(world).speed == 0.2
    client.result("trajectory.control", action="speed", speed=1.0)


def test_a_path_of_days_is_refused() -> None:
    _, client = ready()
    name = uploaded(client, [(0.0, 0.5), (1e6, 0.5)])
    assert client.refusal("trajectory.play", name=name) == "out_of_limits"
    name = uploaded(client, [(-1.7e308, 0.5), (1.7e308, 0.6)])
    assert client.refusal("trajectory.play", name=name) == "out_of_limits"


# Poses and loops


def test_one_sample_is_a_pose_to_go_to() -> None:
    world, client = ready()
    result = client.result("trajectory.play", name=uploaded(client, [(5.0, 0.25)]))
    assert (result["ok"], result["loops"]) == (True, 1)
    assert openness(world) == pytest.approx(0.25, abs=0.02)
    assert world.state.mode == "holding"


def test_one_sample_in_a_loop_is_held() -> None:
    world, client = ready()
    number = started(world, client, [(5.0, 0.25)], loop=True)
    world.run(5.0)
    assert not client.has_answer(number)
    status = client.result("trajectory.status")
    assert (status["active"], status["completed"], status["loops"]) == (True, False, 0)
    assert openness(world) == pytest.approx(0.25, abs=0.005)
    client.result("job.cancel", job=status["job"])
    assert client.result("trajectory.status")["completed"] is False


def test_a_closed_path_goes_round_without_a_break() -> None:
    world, client = ready()
    points = sampled(swing(0.5, 0.2, 2.0), 2.0)
    number = started(world, client, points, repeat=3)
    began_s = world.now_s
    errors = followed(world, client, number)
    assert max(errors) < TOLERANCE
    assert world.now_s - began_s == pytest.approx(6.0, abs=4 * PERIOD_S)
    assert result_of(client, number)["loops"] == 3


def test_an_open_path_goes_back_to_its_start_between_the_passes() -> None:
    world, client = ready()
    points = sampled(lambda t_s: 0.3 + 0.3 * t_s, 1.0)
    number = started(world, client, points, repeat=2)
    phases = []
    while not client.has_answer(number):
        world.tick()
        if world.controller.action is not None:
            phases.append(playing(world).phase)
    changes = [one for one, other in pairwise([*phases, "end"]) if one != other]
    assert changes[:3] == ["play", "align", "play"]
    assert result_of(client, number)["loops"] == 2


def test_a_loop_goes_on_until_it_is_cancelled_and_then_holds() -> None:
    world, client = ready()
    number = started(world, client, sampled(swing(0.5, 0.1, 1.0), 1.0), loop=True)
    world.run(7.5)
    status = client.result("trajectory.status")
    assert (status["loops"], status["kind"], status["samples"]) == (7, "play", 101)
    assert status["frames"] > 1400
    here_mm = world.gripper.opening_mm
    client.result("job.cancel", job=status["job"])
    assert reason_of(client, number) == "cancelled"
    world.run(0.5)
    assert world.state.mode == "holding"
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=2.0)


@pytest.mark.parametrize("ticks", [1, 3, 10, 40])
def test_one_that_is_broken_off_on_its_way_stops_where_the_jaws_are(ticks: int) -> None:
    world, client = ready()
    points = sampled(lambda t: min(0.1 + 1.7 * max(t - 0.5, 0.0), 0.9), 1.2, hz=200)
    client.send("trajectory.play", name=uploaded(client, points))
    world.run_until(lambda: (playing(world).openness or 0.0) > 0.11)
    world.run(ticks * PERIOD_S)
    before_mm = world.gripper.opening_mm
    client.result("stop")
    world.run(0.6)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.04 * MM_RAD)
