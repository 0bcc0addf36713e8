"""Replays that do the taught grips again: contact, force, release, and all that may happen."""

from itertools import pairwise

import pytest

from tests.control.grips import (
    FORCE_CODE_N,
    both,
    gripper,
    in_phase,
    on_another,
    recording,
    replaying,
    started,
)
from tests.control.replays import TRAVEL_MM, openness, reason_of, result_of
from tests.control.test_grasp import kinds
from tests.trajectories import send
from tests.world import PERIOD_S


@pytest.mark.parametrize("mount", ["normal", "reverse"])
@pytest.mark.parametrize(
    ("width_mm", "stiffness"), [(36.0, 250.0), (36.0, 60.0), (30.0, 250.0), (51.0, 150.0)]
)
def test_a_taught_grip_is_done_again_with_its_force_whatever_the_object(
    mount: str, width_mm: float, stiffness: float
) -> None:
    world, client = on_another(width_mm, mount, stiffness_nm_rad=stiffness)
    number = started(world, client)
    held_s = 0.0
    while in_phase(world, "hold"):
        if held_s > 0.5:
            assert 10.0 * world.squeeze_nm == pytest.approx(8.0, abs=FORCE_CODE_N)
            assert world.state.is_grasped
        world.tick()
        held_s += PERIOD_S
    assert held_s == pytest.approx(1.0, abs=0.05)
    result = result_of(client, number)
    assert (result["ok"], result["outcome"], result["grips"]) == (True, "completed", 1)
    assert result["width_mm"] == pytest.approx(width_mm, abs=2.2)
    assert result["width_difference_mm"] == pytest.approx(width_mm - 36.0, abs=2.2)
    assert openness(world) == pytest.approx(72.0 / TRAVEL_MM, abs=0.02)


def test_along_the_path_alone_it_presses_as_hard_as_the_path_makes_it() -> None:
    """What the force is for: the same object, the same path."""
    world, client = on_another(51.0)
    number = client.send("trajectory.play", name="pick")
    hardest_n = max(client.track(number, lambda: 10.0 * world.squeeze_nm))
    assert hardest_n > 15.0
    assert result_of(client, number)["grips"] == 0
    assert result_of(client, number)["width_mm"] is None


@pytest.mark.parametrize("width_mm", [22.0, 36.0, 54.0, 65.0])
def test_nothing_is_pressed_harder_than_a_grasp_would_and_no_command_jumps(
    width_mm: float,
) -> None:
    """From the contact to the release, and not after it either."""
    world, client = on_another(width_mm, force_n=5.0)
    since_s = world.now_s
    number = client.send("trajectory.play", name="pick", force="replay")
    assert max(client.track(number, lambda: world.squeeze_nm)) < 1.3 * 1.05
    assert result_of(client, number)["ok"]
    world.run(0.2)
    commands = [command for _, command in world.commands_since(since_s + 2 * PERIOD_S)]
    for one, other in pairwise(commands):
        assert abs(other.position_rad - one.position_rad) < 0.029  # of 2.9 rad/s: 0.0145


@pytest.mark.parametrize("loop", [False, True])
def test_without_an_object_it_ends_and_says_so(loop: bool) -> None:
    world, client = on_another(None)
    answer = client.result("trajectory.play", name="pick", force="replay", loop=loop)
    assert (answer["ok"], answer["outcome"], answer["grips"]) == (False, "no_object", 0)
    assert answer["loops"] == 0
    world.run(0.5)
    assert world.state.mode == "holding"
    assert not world.state.is_grasped
    assert world.torque_nm < 0.3


def test_an_object_that_is_lost_ends_it() -> None:
    world, client = on_another(36.0)
    number = started(world, client)
    world.run(0.4)
    world.gripper.remove_object()
    result = result_of(client, number)
    assert (result["ok"], result["outcome"], result["grips"]) == (False, "object_lost", 1)
    assert "object_lost" in kinds(world)
    assert world.state.mode == "holding"


def test_its_speed_is_that_of_the_path_and_of_the_hold() -> None:
    world, client = on_another(36.0)
    number = started(world, client, speed=2.0)
    began_s = world.now_s
    world.run_until(lambda: not in_phase(world, "hold"))
    assert world.now_s - began_s == pytest.approx(0.5, abs=0.04)
    assert result_of(client, number)["ok"]


@pytest.mark.parametrize("repeat", [1, 3])
def test_each_pass_grips_anew(repeat: int) -> None:
    _, client = on_another(36.0)
    result = client.result("trajectory.play", name="pick", force="replay", repeat=repeat)
    assert (result["ok"], result["loops"], result["grips"]) == (True, repeat, repeat)
    assert client.result("trajectory.status")["grips"] == repeat


def test_a_loop_goes_on_until_it_is_cancelled() -> None:
    world, client = on_another(36.0)
    number = started(world, client, loop=True)
    world.run_until(lambda: replaying(world).grips.done == 3, 60.0)
    assert client.result("trajectory.status")["loops"] == 2
    client.result("job.cancel", job=client.result("trajectory.status")["job"])
    assert reason_of(client, number) == "cancelled"


def test_a_recording_that_ends_in_a_grip_ends_in_its_hold() -> None:
    world, client = on_another(42.0, release=False)
    result = client.result("trajectory.play", name="pick", force="replay")
    assert (result["ok"], result["outcome"], result["grips"]) == (True, "completed", 1)
    world.run(2.0)
    assert world.state.is_grasped
    assert world.state.force_set_n == 8.0
    assert 10.0 * world.squeeze_nm == pytest.approx(8.0, abs=FORCE_CODE_N)
    world.gripper.remove_object()
    world.run(0.5)
    assert not world.state.is_grasped


def test_one_that_ends_in_a_grip_lets_go_before_the_next_pass() -> None:
    world, client = on_another(42.0, release=False)
    result = client.result("trajectory.play", name="pick", force="replay", repeat=2)
    assert (result["ok"], result["loops"], result["grips"]) == (True, 2, 2)
    assert world.state.is_grasped


def test_a_pause_holds_in_the_grip_and_closes_no_further_before() -> None:
    world, client = on_another(36.0)
    number = started(world, client, "approach")
    world.run(0.3)
    client.result("trajectory.control", action="pause")
    world.run(0.1)
    here = openness(world)
    world.run(3.0)
    assert openness(world) == pytest.approx(here, abs=0.003)
    client.result("trajectory.control", action="resume")
    world.run_until(lambda: in_phase(world, "hold"))
    world.run(0.5)
    client.result("trajectory.control", action="pause")
    world.run(3.0)
    assert in_phase(world, "hold")
    assert 10.0 * world.squeeze_nm == pytest.approx(8.0, abs=FORCE_CODE_N)
    client.result("trajectory.control", action="resume")
    resumed_s = world.now_s
    world.run_until(lambda: not in_phase(world, "hold"))
    assert world.now_s - resumed_s == pytest.approx(0.5, abs=0.05)
    assert result_of(client, number)["ok"]


def test_what_is_held_when_the_recording_begins_is_gripped_first() -> None:
    taught, teacher = gripper()
    taught.gripper.put_object(width_mm=29.0)
    teacher.result("motion.grasp", until="verdict", force_n=8)
    teacher.result("trajectory.record_start", zero_gravity=False)
    taught.run(0.5)
    teacher.result("motion.move", opening_mm=65)
    content, grip_bytes = both(teacher, name=teacher.result("trajectory.record_stop")["name"])
    world, client = gripper("reverse")
    world.gripper.put_object(width_mm=43.0)
    send(client, content, name="pick", grip_bytes=grip_bytes)
    number = client.send("trajectory.play", name="pick", force="replay")
    hardest_n = max(client.track(number, lambda: 10.0 * world.squeeze_nm))
    assert (result_of(client, number)["ok"], result_of(client, number)["grips"]) == (True, 1)
    assert hardest_n < 1.3 * 10.5


def test_a_changed_force_is_changed_in_the_hold() -> None:
    taught, teacher = recording(force_n=6)
    taught.run(1.0)
    teacher.result("motion.set_force", force_n=12)
    taught.run(1.0)
    stopped = teacher.result("trajectory.record_stop")
    content, grip_bytes = both(teacher, name=stopped["name"])
    world, client = gripper()
    world.gripper.put_object(width_mm=36.0)
    send(client, content, name="pick", grip_bytes=grip_bytes)
    number = started(world, client)
    world.run(0.9)
    assert 10.0 * world.squeeze_nm == pytest.approx(6.0, abs=FORCE_CODE_N)
    assert min(client.track(number, lambda: world.squeeze_nm)) > 0.5
    assert 10.0 * world.squeeze_nm == pytest.approx(12.0, abs=FORCE_CODE_N)
    assert result_of(client, number)["grips"] == 1


def test_progress_tells_of_the_grip() -> None:
    world, client = on_another(30.0)
    client.result("motion.move", opening_mm=58)
    client.send("trajectory.play", name="pick", force="replay", progress=True)
    world.run_until(lambda: in_phase(world, "hold"))
    world.run(0.3)
    reported = client.told("job.progress")
    phases = [one["phase"] for one in reported]
    assert [phase for phase, after in pairwise([*phases, ""]) if phase != after] == [
        "load", "align", "play", "approach", "hold",
    ]  # fmt: skip
    assert (reported[-1]["grips"], reported[0]["width_mm"]) == (1, None)
    assert reported[-1]["width_mm"] == pytest.approx(30.0, abs=1.4)
