"""Forces up to 40 N, and up to what a grip may have of the motor, by the file's N per N·m."""

from dataclasses import replace

import pytest

from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import DM4310, FORCE_PER_TORQUE_N_NM
from litegripd.model.motion_config import MotionConfig
from tests.world import Client, World, ready

FAST = {"force_rate_n_s": 200.0}
CODE_NM = 0.05  # a code of torque, and one of velocity under the damping of a hold


def gripper(
    nm_to_n: float = FORCE_PER_TORQUE_N_NM, ambient_c: float = 25.0
) -> tuple[World, Client]:
    """Return a gripper with an object of 50 mm and a file that has so many N per N·m."""
    world = World(ambient_c=ambient_c)
    world.controller.use_calibration(Calibration(replace(NOMINAL[0], nm_to_n=nm_to_n)))
    world.gripper.put_object(width_mm=50.0)
    return world, world.enabled()


def squeeze(world: World, client: Client, method: str, force_n: float) -> None:
    """Hold the object with a force, from a grasp or without one."""
    more = {"until": "verdict"} if method == "motion.grasp" else {}
    assert client.result(method, force_n=force_n, config=FAST, **more)
    world.run(1.5)


@pytest.mark.parametrize("method", ["motion.grasp", "motion.set_force"])
def test_the_most_is_held_with_more_than_the_rating(method: str) -> None:
    """The peak's impulse would be used up after 2 s if it counted from the rating."""
    world, client = gripper()
    squeeze(world, client, method, DM4310.most_force_n)
    assert DM4310.holding_nm > DM4310.rated_nm
    for _ in range(8):
        world.run(1.0)
        assert world.squeeze_nm == pytest.approx(DM4310.holding_nm, abs=CODE_NM)
        assert world.state.limited == ()
    assert world.state.force_set_n == DM4310.most_force_n


def test_until_the_coil_is_hot() -> None:
    world, client = gripper(ambient_c=68.0)
    squeeze(world, client, "motion.grasp", DM4310.most_force_n)
    world.run_until(lambda: "heat" in world.state.limited, 120.0)
    world.run(5.0)
    assert 1.0 < world.squeeze_nm < DM4310.holding_nm - CODE_NM
    assert world.gripper.motor.coil_c < DM4310.coil_limit_c + 1.5
    assert world.state.is_grasped


def test_what_is_no_hold_by_force_resists_a_push_and_presses_gently_for_long() -> None:
    """Jaws that hold a place against a hand are no grip: nobody has set a force."""
    world, client = ready()
    client.result("motion.hold")
    here_mm = world.gripper.opening_mm
    world.gripper.push(-2.5)
    world.run(0.4)
    assert world.torque_nm == pytest.approx(2.5, abs=0.3)
    world.gripper.push(-6.0)
    world.run(4.0)
    assert world.torque_nm <= MotionConfig().stop_nm + CODE_NM
    world.gripper.push(0.0)
    world.run(3.0)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.3)


@pytest.mark.parametrize("method", ["motion.grasp", "motion.set_force"])
def test_a_force_that_takes_more_torque_than_a_grip_may_have_is_refused(method: str) -> None:
    world, client = gripper(5.0)
    answer = client.call(method, force_n=20.5)["error"]
    assert answer["data"]["reason"] == "out_of_limits"
    assert (answer["data"]["field"], answer["data"]["limit"]) == ("force_n", 20.0)
    assert "5 N per N·m" in answer["message"]
    assert "at most 20" in answer["message"]
    assert "4 N·m" in answer["message"]
    assert world.state.force_set_n is None
    squeeze(world, client, method, 20.0)
    assert world.squeeze_nm == pytest.approx(4.0, abs=CODE_NM)


def test_a_running_grasp_is_not_changed_to_such_a_force() -> None:
    world, client = gripper(5.0)
    client.send("motion.grasp", force_n=10.0, config=FAST)
    world.run(2.0)
    assert client.refusal("motion.set_force", force_n=21.0) == "out_of_limits"
    world.run(1.0)
    assert world.state.force_set_n == 10.0
    assert world.squeeze_nm == pytest.approx(2.0, abs=CODE_NM)


@pytest.mark.parametrize(("nm_to_n", "torque_nm"), [(20.0, 1.0), (10.0, 2.0), (5.0, 4.0)])
@pytest.mark.parametrize("method", ["motion.grasp", "motion.set_force"])
def test_the_files_factor_says_how_much_torque_a_force_is(
    method: str, nm_to_n: float, torque_nm: float
) -> None:
    world, client = gripper(nm_to_n)
    squeeze(world, client, method, 20.0)
    assert world.squeeze_nm == pytest.approx(torque_nm, abs=CODE_NM)
    state = world.state
    assert state.force_set_n == 20.0
    assert state.force_n == pytest.approx(20.0, abs=1.0)
    if method == "motion.grasp":
        low_n, high_n = world.clamp_range_n
        assert low_n <= nm_to_n * world.gripper.clamp_nm <= high_n
        world.gripper.remove_object()
        world.run_until(lambda: not world.state.is_grasped, 0.1)


def test_the_force_changes_at_its_rate_in_newton() -> None:
    world, client = gripper(20.0)
    client.result("motion.grasp", force_n=10.0, until="verdict")
    world.run(1.5)
    client.result("motion.set_force", force_n=30.0)
    world.run(0.5)  # at 20 N/s half of the way
    assert world.squeeze_nm == pytest.approx(20.0 / 20.0, abs=2 * CODE_NM)


def test_a_grip_keeps_the_newtons_with_which_it_began() -> None:
    world, client = gripper(5.0)
    squeeze(world, client, "motion.grasp", 5.0)
    content = Calibration(replace(NOMINAL[0], nm_to_n=30.0)).file_content(
        channel="can0", can_id=8, master_id=None, motor_type="DM4310", kp_nm_rad=100, kd_nm_s_rad=2
    )
    assert client.result("calibration.load", content=content)["loaded"]
    assert client.refusal("motion.set_force", force_n=40.0) == "out_of_limits"
    squeeze(world, client, "motion.set_force", 10.0)
    assert world.squeeze_nm == pytest.approx(2.0, abs=0.05)


def test_a_taught_grip_that_takes_more_torque_than_a_grip_may_have_is_refused() -> None:
    world, client = gripper()
    client.result("trajectory.record_start", zero_gravity=False)
    squeeze(world, client, "motion.grasp", 40.0)
    client.result("motion.open")
    client.result("trajectory.record_stop", name="hard")
    world.controller.use_calibration(Calibration(replace(NOMINAL[0], nm_to_n=5.0)))
    number = client.send("trajectory.play", name="hard", force="replay")
    hardest_nm = max(client.track(number, lambda: world.squeeze_nm))
    assert client.answers[number]["error"]["data"]["field"] == "force_n"
    assert hardest_nm < 1.0


def test_taught_grips_are_closed_on_no_faster_than_any_motion() -> None:
    world, client = gripper()
    world.controller.use_calibration(Calibration(replace(NOMINAL[0], rad_to_mm=46.7)))
    client.result("trajectory.record_start", zero_gravity=False)
    squeeze(world, client, "motion.grasp", 10.0)
    client.result("trajectory.record_stop", name="quick")
    config = {"grasp_speed_mm_s": 150.0}
    for method, params in (
        ("motion.grasp", {}),
        ("trajectory.play", {"name": "quick", "force": "replay"}),
    ):
        assert client.refusal(method, config=config, **params) == "out_of_limits"


def heat_events(client: Client) -> list[str]:
    client.read()
    return [
        note["params"]["message"]
        for note in client.notifications
        if note["method"] == "event" and note["params"]["kind"] == "heat"
    ]


@pytest.mark.parametrize("waits_s", [0.0, 3.0])
def test_how_long_the_coil_bears_a_force_is_said_once(waits_s: float) -> None:
    world, client = gripper()
    client.result("events.subscribe")
    world.run(waits_s)  # a temperature is believed after a second
    squeeze(world, client, "motion.grasp", 40.0)
    for number in range(50):
        client.result("motion.set_force", force_n=38.0 + 0.02 * number)
    (said,) = heat_events(client)
    assert "40 N can be held for about" in said


def test_a_force_that_the_coil_bears_is_not_foretold() -> None:
    world, client = gripper()
    client.result("events.subscribe")
    world.run(3.0)
    squeeze(world, client, "motion.grasp", 20.0)
    assert heat_events(client) == []


def test_a_template_leaves_a_measured_force_per_torque() -> None:
    world, client = gripper(19.0)
    world.gripper.remove_object()
    client.result("calibration.load", template="normal")
    assert client.result("calibration.get")["content"]["nm_to_n"] == 19.0
    assert client.result("calibration.zero", save=False)["content"]["nm_to_n"] == 19.0
