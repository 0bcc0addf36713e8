"""Each refusal names a remedy, and each remedy is carried out here: after it the call works."""

import re
import struct
from collections.abc import Callable
from typing import Any

import pytest

from litegripd.model.errors import at_least, at_most
from litegripd.model.motor import CanFrame, Status
from litegripd.motor import codec
from tests.control.test_exclusive import TELEOP
from tests.world import CAN_ID, Client, World

Act = Callable[[World, Client], None]
OPEN: tuple[str, dict[str, Any]] = ("motion.open", {})


FOLLOW: tuple[str, dict[str, Any]] = ("teleop.start", TELEOP)
MOVE: tuple[str, dict[str, Any]] = ("motion.move", {"opening_mm": 45.0})


def fault(status: Status) -> Act:
    def latch(world: World, client: Client) -> None:
        client.result("motor.enable")
        world.gripper.latch_fault(status)
        world.run(0.2)

    return latch


def nothing(_world: World, _client: Client) -> None:
    pass


def enable(_world: World, client: Client) -> None:
    assert client.result("motor.enable")["ok"]


def no_supply(world: World, _client: Client) -> None:
    world.gripper.set_supply(5.0)
    world.run(0.2)


def supply_lost(world: World, client: Client) -> None:
    enable(world, client)
    no_supply(world, client)


def supply_on_and_enable(world: World, client: Client) -> None:
    world.gripper.set_supply(24.0)
    enable(world, client)


def supply_high(world: World, client: Client) -> None:
    enable(world, client)
    world.gripper.set_supply(40.0)
    world.run(0.2)


def hot(world: World, client: Client) -> None:
    enable(world, client)
    world.gripper.heat_coil(110.0)
    world.run(0.2)


def cooled_and_enable(world: World, client: Client) -> None:
    world.gripper.heat_coil(25.0)
    world.run(0.2)
    enable(world, client)


def without_power(world: World, _client: Client) -> None:
    world.gripper.power_off()
    world.run(1.0)


def power_on(world: World, _client: Client) -> None:
    world.gripper.power_on()
    world.run(1.0)


def jumped(world: World, client: Client) -> None:
    enable(world, client)
    client.result("motion.move", opening_mm=60)
    world.gripper.jump(0.3)
    world.run(0.3)


def clear_fault_and_enable(world: World, client: Client) -> None:
    client.result("motor.clear_fault")
    enable(world, client)


def zero_moved(world: World, client: Client) -> None:
    client.result("motor.set_zero")
    client.result("motor.enable")


def zero_with_a_mount(_world: World, client: Client) -> None:
    assert client.result("calibration.zero", mount="normal")["ok"]


def uncalibrated(world: World, client: Client) -> None:
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, "calibrated": False})
    enable(world, client)


def load_a_template(_world: World, client: Client) -> None:
    client.result("calibration.load", template="normal")


def stopped(world: World, client: Client) -> None:
    enable(world, client)
    client.result("stop")


def clear(_world: World, client: Client) -> None:
    client.result("stop.clear")


def a_motion_runs(world: World, client: Client) -> None:
    enable(world, client)
    world.client().send("motion.move", opening_mm=10.0, duration_s=8.0, detach=True)
    world.run(0.2)


def cancel_it(world: World, client: Client) -> None:
    running = world.controller.jobs.running
    assert running is not None
    client.result("job.cancel", job=running.number)


def wait_for_it(_world: World, client: Client) -> None:
    job = client.result("state.get")["job"]["job"]
    client.result("job.wait", job=job)


def another_has_the_lease(world: World, client: Client) -> None:
    enable(world, client)
    world.client().result("lease.acquire", ttl_s=60.0)


def take_it(_world: World, client: Client) -> None:
    client.result("lease.take", why="the test")


def the_lease_was_taken(world: World, client: Client) -> None:
    enable(world, client)
    client.result("lease.acquire", ttl_s=60.0)
    other = world.client()
    other.result("lease.take", why="the test")
    other.result("lease.release")


def acquire(_world: World, client: Client) -> None:
    client.result("lease.acquire", ttl_s=60.0)


def another_program(world: World, client: Client) -> None:
    enable(world, client)
    world.inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
    world.run(0.1)


def it_has_ended(world: World, _client: Client) -> None:
    world.run(3.0)


def register(number: int, raw: bytes) -> Act:
    """With the maker's tool, while nobody listens; then the motor is read again."""

    def write(world: World, client: Client) -> None:
        frame = CanFrame(0x7FF, struct.pack("<HBB", CAN_ID, 0x55, number) + raw)
        world.gripper.receive(world.now_s, frame)
        client.call("motor.clear_fault")
        world.run(1.0)

    return write


def follows(world: World, client: Client) -> None:
    enable(world, client)
    client.result("teleop.start", **TELEOP)


def stop_following(_world: World, client: Client) -> None:
    client.result("teleop.stop")


def records(world: World, client: Client) -> None:
    enable(world, client)
    client.result("trajectory.record_start")


def end_recording(_world: World, client: Client) -> None:
    client.result("trajectory.record_stop", name="pick")


def as_observer(world: World, client: Client) -> None:
    enable(world, client)
    client.session.role = "observer"


def as_operator(_world: World, client: Client) -> None:
    client.session.role = "operator"


def off_by_a_turn(world: World, client: Client) -> None:
    world.gripper.jump(6.28)
    world.run(0.2)
    enable(world, client)


def power_cycle_inside_the_travel(world: World, client: Client) -> None:
    client.result("motor.disable")
    world.gripper.jump(-6.28)
    world.run(0.2)
    enable(world, client)


MODE = 10


def other_mode(world: World, client: Client) -> None:
    register(MODE, struct.pack("<I", 2))(world, client)
    client.call("motor.enable")


def mit_mode(world: World, client: Client) -> None:
    register(MODE, struct.pack("<I", 1))(world, client)


CASES: list[tuple[str, Act, tuple[str, dict[str, Any]], str, Act]] = [
    ("not_enabled", nothing, OPEN, "motor.enable", enable),
    ("motor_fault", fault(Status.COMMUNICATION_LOST), OPEN, "enable again", enable),
    ("motor_fault", fault(Status.OVER_CURRENT), OPEN, "enable again", enable),
    ("motor_fault", fault(Status.DRIVER_HOT), OPEN, "enable again", enable),
    ("motor_fault", fault(Status.OVERLOAD), OPEN, "enable again", enable),
    ("motor_fault", supply_lost, OPEN, "24 V supply .* on, then enable", supply_on_and_enable),
    ("motor_fault", supply_high, OPEN, "lower .*, then enable", supply_on_and_enable),
    ("motor_fault", hot, OPEN, "cool down, then enable", cooled_and_enable),
    ("motor_fault", no_supply, ("motor.enable", {}), "24 V", supply_on_and_enable),
    ("motor_silent", without_power, ("motor.enable", {}), "24 V", power_on),
    ("implausible_feedback", jumped, MOVE, "motor.clear_fault", clear_fault_and_enable),
    ("not_calibrated", zero_moved, OPEN, "calibration.zero with a mount", zero_with_a_mount),
    ("not_calibrated", uncalibrated, OPEN, "mount", zero_with_a_mount),
    ("not_calibrated", uncalibrated, OPEN, "mount", load_a_template),
    ("stopped", stopped, OPEN, "stop.clear", clear),
    ("busy", a_motion_runs, OPEN, "job.cancel", cancel_it),
    ("busy", a_motion_runs, OPEN, "job.wait", wait_for_it),
    ("lease_held", another_has_the_lease, OPEN, "lease.take", take_it),
    ("lease_lost", the_lease_was_taken, OPEN, "lease.acquire", acquire),
    ("second_master", another_program, OPEN, "end it", it_has_ended),
    ("teleop_busy", follows, OPEN, "teleop.stop", stop_following),
    ("trajectory_busy", records, FOLLOW, "trajectory.record_stop", end_recording),
    ("busy", records, OPEN, "trajectory.record_stop", end_recording),
    ("teleop_not_ready", nothing, FOLLOW, "motor.enable", enable),
    ("not_permitted", as_observer, OPEN, "role", as_operator),
    ("out_of_limits", off_by_a_turn, OPEN, "power-cycle", power_cycle_inside_the_travel),
    ("out_of_limits", off_by_a_turn, OPEN, "calibration.zero with a mount", zero_with_a_mount),
    ("motor_unsuitable", other_mode, ("motor.enable", {}), "motor.clear_fault", mit_mode),
]


@pytest.mark.parametrize(
    ("reason", "cause", "call", "says", "remedy"), CASES, ids=[f"{c[0]}-{c[3][:20]}" for c in CASES]
)
def test_after_the_remedy_the_call_works(
    reason: str, cause: Act, call: tuple[str, dict[str, Any]], says: str, remedy: Act
) -> None:
    world = World().start()
    client = world.client()
    cause(world, client)
    method, params = call
    error = client.call(method, **params)["error"]
    assert error["data"]["reason"] == reason
    assert re.search(says, f"{error['message']} {error['data'].get('hint', '')}")
    remedy(world, client)
    assert client.result(method, **params).get("ok", True)


BEYOND = [
    ("motion.move", "opening_mm", 500.0, {}),
    ("motion.move", "opening_mm", -3.0, {}),
    ("motion.move", "position_rad", 9.0, {}),
    ("motion.move", "position_rad", -9.0, {}),
    ("motion.move", "duration_s", 0.01, {"opening_mm": 10.0}),
    ("motion.move", "speed_mm_s", 149.99, {"opening_mm": 10.0}),
    ("motion.open", "speed_mm_s", 149.99, {}),
    ("motion.close", "speed_mm_s", 0.11, {}),
    ("motion.grasp", "speed_mm_s", 149.99, {}),
    ("motion.grasp", "speed_mm_s", 0.11, {}),
    ("motion.grasp", "force_n", 39.999, {}),
]


SCALES = (47.123456, 52.69, 61.01229326764816, 74.8)


@pytest.mark.parametrize(("method", "name", "value", "rest"), BEYOND)
def test_the_limit_that_a_refusal_names_is_accepted(
    method: str, name: str, value: float, rest: dict[str, Any]
) -> None:
    """A limit that is told rounded the wrong way leads back to the same refusal."""
    refused = 0
    for rad_to_mm in SCALES:
        client = with_scale(rad_to_mm)
        answer = client.call(method, **{name: value}, **rest)
        if "result" in answer:
            continue
        refused += 1
        error = answer["error"]
        assert error["data"]["reason"] == "out_of_limits", error
        told = told_limit(error["message"], value)
        again = client.call(method, **{name: told, "wait": False}, **rest)
        assert "result" in again, again
    assert refused


def with_scale(rad_to_mm: float) -> Client:
    """Return a client of an enabled gripper whose limits are no round numbers."""
    world = World().start()
    client = world.client()
    content = client.result("calibration.get")["content"]
    limits = {"zero_position_rad": 0.05, "max_position_rad": 0.05 - 86.0123456789 / rad_to_mm}
    scale = {"rad_to_mm": rad_to_mm, "nm_to_n": 8.34567}
    client.result("calibration.load", content={**content, **limits, **scale})
    enable(world, client)
    return client


def told_limit(message: str, value: float) -> float:
    """Return the limit in a message that `value` is beyond."""
    ends = re.search(r"travel is (\S+) to (\S+)$", message)
    if ends is not None:
        return float(ends[1]) if value < float(ends[1]) else float(ends[2])
    told = re.search(r"at (?:most|least) (-?[\d.e-]*\d)", message)
    assert told is not None, message
    return float(told[1])


def test_a_limit_is_told_so_that_it_is_kept() -> None:
    assert at_most(86.99256) == "86.9925"
    assert at_least(0.00123456, 3) == "0.00124"
    assert at_least(-1.651026) == "-1.65102"
    assert at_most(-1.6510261) == "-1.65103"
    for value in (0.0, 1.0, 40.0, 85.5, -2.5, 1e-9, 123456.7):
        assert float(at_most(value)) <= value <= float(at_least(value))
    assert (at_most(40.0), at_least(40.0), at_most(0.0)) == ("40", "40", "0")
    assert at_most(float("inf")) == "inf"


def test_disabling_stays_possible_and_is_the_end_of_any_fault() -> None:
    world = World().start()
    client = world.client()
    for status in (Status.COMMUNICATION_LOST, Status.UNDER_VOLTAGE, Status.OVERLOAD):
        enable(world, client)
        world.gripper.latch_fault(status)
        world.run(0.2)
        assert client.result("motor.disable")["ok"]
        world.gripper.receive(world.now_s, CanFrame(CAN_ID, codec.CLEAR_FAULT))
        world.run(0.2)
