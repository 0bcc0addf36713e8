"""Setting the force: of a grasp that runs, of what is held, and from where the jaws are."""

from itertools import pairwise
from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.motor import MotorPhase
from litegripd.sim.plant import MOUNTS
from tests.world import Client, World

MM_RAD = NOMINAL[0].rad_to_mm
FORCE_CODE_NM = 0.05  # a code of torque, and one of velocity under the damping of a hold


def with_object(width_mm: float | None = 50.0, mount: str = "normal") -> tuple[World, Client]:
    world = World(mount, initial_opening_mm=70.0)
    if width_mm is not None:
        world.gripper.put_object(width_mm=width_mm)
    return world, world.enabled()


def holding(client: Client, **params: Any) -> int:
    """Begin a grasp that holds without an end; return its job."""
    world = client.world
    client.send("motion.grasp", force_n=10, **params)
    world.run_until(lambda: world.state.is_grasped)
    world.run(1.0)
    job = world.running
    return job.number


def test_a_motor_that_is_off_has_no_set_force() -> None:
    world, client = with_object()
    client.result("motion.grasp", force_n=10, until="verdict")
    assert world.state.force_set_n == 10.0
    world.lose_from_motor = lambda _frame: True
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 1.0)
    assert world.state.force_set_n == 10.0  # it may still squeeze
    world.lose_from_motor = lambda _frame: False
    world.run_until(lambda: not world.in_phase(MotorPhase.SILENT), 1.0)
    assert world.in_phase(MotorPhase.ENABLED)
    assert world.state.force_set_n == 10.0
    client.result("motor.disable")
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.state.force_set_n is None


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_running_grasp_goes_on_with_the_new_force(mount: str) -> None:
    world, client = with_object(mount=mount)
    number = holding(client)
    jobs = len(list(world.controller.jobs))
    for force_n in (25.0, 3.0):
        result = client.result("motion.set_force", force_n=force_n)
        assert (result["job"], result["force_n"]) == (number, force_n)
        assert result["state"]["force_set_n"] == force_n
        world.run(2.0)
        assert world.squeeze_nm == pytest.approx(force_n / 10, abs=FORCE_CODE_NM)
    assert len(list(world.controller.jobs)) == jobs
    assert world.controller.jobs.running is not None
    assert world.controller.jobs.running.number == number
    assert world.state.is_grasped


def test_the_result_of_the_grasp_tells_the_force_that_it_held_with_last() -> None:
    world, client = with_object()
    number = client.send("motion.grasp", force_n=10, hold_s=3.0)
    world.run_until(lambda: world.state.is_grasped)
    client.result("motion.set_force", force_n=15)
    assert client.wait(number)["result"]["force_n"] == 15


def test_anothers_grasp_is_not_touched() -> None:
    world, client = with_object()
    number = holding(client)
    other = world.client()
    answer = other.call("motion.set_force", force_n=25)
    assert answer["error"]["data"]["reason"] == "busy"
    assert answer["error"]["data"]["job"] == number
    world.run(1.0)
    assert world.state.force_set_n == 10
    assert world.squeeze_nm == pytest.approx(1.0, abs=FORCE_CODE_NM)


def test_what_a_grasp_has_left_is_held_with_the_new_force_by_anybody() -> None:
    world, client = with_object()
    client.result("motion.grasp", force_n=10, until="verdict")
    world.run(1.0)
    result = world.client().result("motion.set_force", force_n=20)
    assert result["state"]["force_set_n"] == 20
    assert client.result("job.get", job=result["job"])["state"] == "done"
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(2.0, abs=FORCE_CODE_NM)
    assert world.state.is_grasped
    assert world.state.mode == "holding"


@pytest.mark.parametrize("mount", MOUNTS)
def test_without_a_hold_the_jaws_squeeze_from_where_they_are(mount: str) -> None:
    world, client = with_object(mount=mount)
    assert client.result("motion.set_force", force_n=12)["force_n"] == 12
    world.run(3.0)
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=2.0)
    assert world.squeeze_nm == pytest.approx(1.2, abs=FORCE_CODE_NM)
    assert world.state.force_set_n == 12
    assert not world.state.is_grasped  # nobody has looked whether something is there


@pytest.mark.parametrize("force_n", [30, 40])
def test_with_nothing_between_them_the_jaws_close_no_faster_than_a_grasp(force_n: float) -> None:
    world, client = with_object(None)
    client.result("motion.set_force", force_n=force_n)
    assert max(world.track(4.0, lambda: abs(world.gripper.velocity_rad_s))) * MM_RAD < 100.0
    assert world.gripper.opening_mm < 1.0
    assert world.squeeze_nm == pytest.approx(force_n / 10, abs=FORCE_CODE_NM)
    assert client.result("motion.open")["outcome"] == "pressed_home"
    assert world.state.force_set_n is None


@pytest.mark.parametrize("rate_n_s", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("force_n", [2.0, 25.0])
def test_the_force_of_a_hold_changes_at_its_rate(rate_n_s: float, force_n: float) -> None:
    world, client = with_object()
    holding(client, config={"force_rate_n_s": rate_n_s})
    since_s = world.now_s
    client.result("motion.set_force", force_n=force_n)
    world.run(20.0 / rate_n_s + 0.5)
    torques_nm = [(at_s, command.torque_nm) for at_s, command in world.commands_since(since_s)]
    expected_s = abs(force_n - 10.0) / rate_n_s
    reached_s = next(
        at_s - since_s for at_s, torque_nm in torques_nm if abs(torque_nm - force_n / 10) < 0.004
    )
    assert reached_s == pytest.approx(expected_s, rel=0.05, abs=0.01)
    for (was_s, was_nm), (is_s, is_nm) in pairwise(torques_nm):
        assert abs(is_nm - was_nm) <= rate_n_s / 10 * (is_s - was_s) + 0.005


def test_the_rate_of_the_call_counts_where_the_squeeze_begins() -> None:
    world, client = with_object()
    client.result("motion.set_force", force_n=20, config={"force_rate_n_s": 4.0})
    since_s = world.now_s
    world.run(6.0)
    torques_nm = [(at_s, command.torque_nm) for at_s, command in world.commands_since(since_s)]
    reached_s = next(at_s - since_s for at_s, torque_nm in torques_nm if torque_nm > 1.99)
    assert reached_s == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize("params", [{"force_n": 0.4}, {"force_n": 40.1}, {"force_n": 41}, {}])
def test_a_force_that_no_jaw_may_have_is_refused(params: dict[str, float]) -> None:
    world, client = with_object()
    assert client.refusal("motion.set_force", **params) == "invalid_params"
    assert world.state.force_set_n is None


@pytest.mark.parametrize("when", ["running", "left"])
def test_a_stop_keeps_the_force_and_lets_it_rise_no_further(when: str) -> None:
    world, client = with_object()
    if when == "running":
        holding(client)
    else:
        client.result("motion.grasp", force_n=10, until="verdict")
        world.run(1.0)
    client.result("motion.set_force", force_n=30)
    world.run(0.5)  # at 20 N/s half of the way
    in_flight_nm = world.squeeze_nm
    assert 1.5 < in_flight_nm < 2.5
    world.client().send("stop")
    assert client.refusal("motion.set_force", force_n=30) == "stopped"
    squeezes_nm = world.track(2.0, lambda: world.squeeze_nm)
    assert max(squeezes_nm) <= in_flight_nm + 2 * FORCE_CODE_NM
    assert world.squeeze_nm == pytest.approx(in_flight_nm, abs=2 * FORCE_CODE_NM)
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=2.0)
    client.result("stop.clear")
    client.result("motion.set_force", force_n=5)
    world.run(2.0)
    assert world.squeeze_nm == pytest.approx(0.5, abs=FORCE_CODE_NM)


@pytest.mark.parametrize("ends_by", ["stop", "hold", "client_lost"])
@pytest.mark.parametrize("after_s", [0.1, 0.15, 0.3, 0.5])
@pytest.mark.parametrize("width_mm", [None, 20.0])
def test_jaws_that_close_by_force_on_nothing_yet_are_stopped_where_they_are(
    ends_by: str, after_s: float, width_mm: float | None
) -> None:
    """A torque that has met nothing drives the jaws: there is no object to keep it for."""
    world, client = with_object(width_mm)
    client.result("lease.acquire")
    client.result("motion.set_force", force_n=20)
    world.run(after_s)
    before_mm = world.gripper.opening_mm
    if ends_by == "stop":
        world.client().send("stop")
    elif ends_by == "hold":
        client.send("motion.hold")
    else:
        client.leave()
    world.run(2.0)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=2.0)
    assert not world.state.is_grasped
    assert world.state.mode == "holding"


def test_what_is_squeezed_when_a_stop_comes_is_squeezed_on() -> None:
    world, client = with_object(50.0)
    client.result("motion.set_force", force_n=20)
    world.run(5.0)
    world.client().send("stop")
    world.run(2.0)
    assert world.squeeze_nm == pytest.approx(2.0, abs=0.1)
    client.result("stop.clear")
    client.result("motion.set_force", force_n=5)
    world.gripper.remove_object()
    world.run(3.0)
    assert world.gripper.opening_mm < 5.0  # it may close on again: that was asked for


def test_a_press_of_a_blocked_move_does_not_outlast_it_in_a_gentler_force() -> None:
    world, client = with_object(50.0)
    assert client.result("motion.move", opening_mm=10)["outcome"] == "blocked"
    client.result("motion.set_force", force_n=5)
    world.run(0.05)
    assert max(world.track(2.0, lambda: world.squeeze_nm)) < 0.6


@pytest.mark.parametrize("ends_by", ["stop", "hold"])
@pytest.mark.parametrize("stiffness_nm_rad", [30.0, 60.0, 250.0])
def test_what_is_squeezed_may_be_shaken_and_is_squeezed_on(
    ends_by: str, stiffness_nm_rad: float
) -> None:
    """It moves, but it resists: that is no closing on nothing."""
    world, client = with_object(None)
    world.gripper.put_object(width_mm=50.0, stiffness_nm_rad=stiffness_nm_rad)
    client.result("motion.set_force", force_n=20)
    world.run(4.0)
    sign = world.gripper.parameters.close_sign
    world.gripper.push(sign * 0.3)
    world.run(0.02)
    if ends_by == "stop":
        world.client().send("stop")
    else:
        client.send("motion.hold")
    world.run(0.02)
    world.gripper.push(0.0)
    world.run(1.0)
    world.gripper.push(sign * 1.0)
    world.run(0.06)
    world.gripper.push(0.0)
    world.run(1.0)
    assert world.squeeze_nm == pytest.approx(2.0, abs=0.1)
    assert world.state.force_set_n == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize("stiffness_nm_rad", [10.0, 30.0])
def test_a_stop_while_the_force_on_something_soft_rises_keeps_what_there_is(
    stiffness_nm_rad: float,
) -> None:
    world, client = with_object(None)
    world.gripper.put_object(width_mm=50.0, stiffness_nm_rad=stiffness_nm_rad)
    client.result("motion.set_force", force_n=30)
    world.run_until(lambda: world.squeeze_nm > 2.5)
    world.client().send("stop")
    world.run(1.0)
    assert world.squeeze_nm > 2.4
