"""Zero gravity: enabled, and as free as the motor can be."""

import pytest

from tests.control.states import is_slack
from tests.world import PERIOD_S, ready

LEAST_NM = 10.0 / 4095 * 1.01  # the two codes next to zero; there is none for zero


@pytest.mark.parametrize("state", ["holding", "pressed", "gripped", "stuck out"])
def test_it_lets_everything_go_at_once(state: str) -> None:
    world, client = ready()
    if state == "pressed":
        client.result("motion.close")
    elif state == "gripped":
        world.gripper.put_object(width_mm=40.0)
        client.result("motion.grasp", until="verdict")
        world.run(1.0)
    elif state == "stuck out":
        world.gripper.push(2.0)
        world.run(0.5)
    since_s = world.now_s
    number = client.send("motion.zero_gravity")
    world.run(2.0)
    result = client.answers[number]["result"] if client.has_answer(number) else {}
    assert result["position_rad"] == pytest.approx(result["state"]["position_rad"])
    commands = world.commands_since(since_s + PERIOD_S)
    assert len(commands) == 400
    for _, command in commands:
        assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0
        assert abs(command.torque_nm) <= LEAST_NM
    assert world.torque_nm <= LEAST_NM
    assert world.state.mode == "relaxed"
    assert world.state.enabled
    assert (world.state.is_grasped, world.state.force_set_n) == (False, None)


def test_a_hand_moves_the_jaws_against_friction_alone() -> None:
    world, client = ready()
    client.result("motion.zero_gravity")
    began_mm = world.gripper.opening_mm
    world.gripper.push(0.3)  # the breakaway friction is 0.21 N·m
    world.run(0.5)
    assert abs(world.gripper.opening_mm - began_mm) > 20.0
    world.gripper.push(0.0)
    world.run(0.5)
    here_mm = world.gripper.opening_mm
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.1)


def test_it_lasts_without_its_client() -> None:
    world, client = ready()
    other = world.client()
    other.result("motion.zero_gravity")
    other.leave()
    world.run(1.0)
    assert world.state.mode == "relaxed"
    client.leave()
    world.run(1.0)
    assert is_slack(world)


def test_hold_ends_it_where_the_jaws_are_now() -> None:
    world, client = ready()
    client.result("motion.zero_gravity")
    world.gripper.push(1.0)
    world.run(0.15)
    world.gripper.push(0.0)
    world.run(0.3)
    here_mm = world.gripper.opening_mm
    assert client.result("motion.hold")["state"]["mode"] == "holding"
    world.run(0.2)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.1)
    world.gripper.push(1.0)
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=1.5)


@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("motion.open", {}),
        ("motion.close", {}),
        ("motion.grasp", {"until": "verdict"}),
        ("motion.move", {"opening_mm": 70.0}),
        ("motion.set_force", {"force_n": 5}),
        ("stream.set", {"opening_mm": 70.0}),
    ],
)
def test_any_motion_ends_it_and_holds_afterwards(
    method: str, params: dict[str, float | str]
) -> None:
    world, client = ready()
    client.result("motion.zero_gravity")
    client.result(method, **params)
    world.run_until(lambda: world.controller.jobs.running is None)
    world.run(0.1)
    assert world.state.mode == "holding"
    assert not is_slack(world)


def test_it_needs_no_calibration() -> None:
    world, client = ready(calibrated=False)
    client.result("motion.zero_gravity")
    world.run(0.1)
    assert is_slack(world)


@pytest.mark.parametrize("level", ["hold", "relax"])
def test_a_stop_leaves_slack_jaws_slack(level: str) -> None:
    world, client = ready()
    client.result("motion.zero_gravity")
    client.result("stop", level=level)
    world.run(0.2)
    assert is_slack(world)
    assert client.refusal("motion.zero_gravity") == "stopped"
    assert client.refusal("motion.hold") == "stopped"
    client.result("stop.clear")
    world.run(0.2)
    assert is_slack(world)
