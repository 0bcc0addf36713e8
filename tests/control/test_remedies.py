"""Each refusal names a remedy, and each remedy is carried out here: after it the call works."""

import re
import struct
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from litegripd.model.errors import at_least, at_most
from litegripd.model.motor import CanFrame, Status
from litegripd.motor import codec
from litegripd.rpc.sessions import Role
from tests.control.teleop_scene import FAKE
from tests.world import CAN_ID, Client, World

Call = tuple[str, dict[str, Any]]
Act = Call | Callable[[World], object] | float | Role
"""A client's request, something done to the world, seconds that pass, or the client's new role."""
Acts = tuple[Act, ...]

OPEN: Call = ("motion.open", {})
FOLLOW: Call = ("teleop.start", FAKE)
MOVE: Call = ("motion.move", {"opening_mm": 45.0})
ENABLE: Call = ("motor.enable", {})
DISABLE: Call = ("motor.disable", {})
CLEAR_FAULT: Call = ("motor.clear_fault", {})
STOP: Call = ("stop", {})
CLEAR: Call = ("stop.clear", {})
ACQUIRE: Call = ("lease.acquire", {"ttl_s": 60.0})
TAKE: Call = ("lease.take", {"why": "the test"})
TEMPLATE: Call = ("calibration.load", {"template": "normal"})
ZERO_WITH_A_MOUNT: Call = ("calibration.zero", {"mount": "normal"})
RECORD: Call = ("trajectory.record_start", {})
END_RECORDING: Call = ("trajectory.record_stop", {"name": "pick"})
MODE = 10


def do(world: World, client: Client, acts: Acts) -> None:
    for act in acts:
        if isinstance(act, float):
            world.run(act)
        elif isinstance(act, tuple):
            assert client.result(act[0], **act[1]).get("ok", True)
        elif isinstance(act, str):
            client.session.role = act
        else:
            act(world)


def supply(volts: float) -> Acts:
    return (lambda world: world.gripper.set_supply(volts), 0.2)


def coil(celsius: float) -> Acts:
    return (lambda world: world.gripper.heat_coil(celsius), 0.2)


def jump(by_rad: float) -> Acts:
    return (lambda world: world.gripper.jump(by_rad), 0.3)


def fault(status: Status) -> Acts:
    return (ENABLE, lambda world: world.gripper.latch_fault(status), 0.2)


def uncalibrated(world: World) -> None:
    assert world.controller.calibrated.calibration is not None
    world.controller.use_calibration(
        replace(world.controller.calibrated.calibration, calibrated=False)
    )


def other(*calls: Call) -> Callable[[World], None]:
    """Let another client ask."""

    def act(world: World) -> None:
        do(world, world.client(), calls)

    return act


def a_motion_runs(world: World) -> None:
    world.client().send("motion.move", opening_mm=10.0, duration_s=8.0, detach=True)
    world.run(0.2)


def cancel_it(world: World) -> None:
    world.client().result("job.cancel", job=world.running.number)


def wait_for_it(world: World) -> None:
    client = world.client()
    client.result("job.wait", job=client.result("state.get")["job"]["job"])


def another_program(world: World) -> None:
    world.inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
    world.run(0.1)


def mode(number: int) -> Callable[[World], None]:
    """With the maker's tool, while nobody listens; then the motor is read again."""

    def write(world: World) -> None:
        frame = CanFrame(0x7FF, struct.pack("<HBBI", CAN_ID, 0x55, MODE, number))
        world.gripper.receive(world.now_s, frame)
        world.client().call("motor.clear_fault")
        world.run(1.0)

    return write


SUPPLY_ON: Acts = (*supply(24.0), ENABLE)
JUMPED: Acts = (ENABLE, ("motion.move", {"opening_mm": 60.0}), *jump(0.3))
ZERO_MOVED: Acts = (ENABLE, ("motor.set_zero", {}), ENABLE)
LEASE_TAKEN: Acts = (ENABLE, ACQUIRE, other(TAKE, ("lease.release", {})))
POWER_OFF: Acts = (lambda world: world.gripper.power_off(), 1.0)
POWER_ON: Acts = (lambda world: world.gripper.power_on(), 1.0)
TURNED: Acts = (*jump(6.28), ENABLE)
TURNED_BACK: Acts = (DISABLE, *jump(-6.28), ENABLE)

CASES: list[tuple[str, Acts, Call, str, Acts]] = [
    ("not_enabled", (), OPEN, "motor.enable", (ENABLE,)),
    ("motor_fault", fault(Status.COMMUNICATION_LOST), OPEN, "enable again", (ENABLE,)),
    ("motor_fault", fault(Status.OVER_CURRENT), OPEN, "enable again", (ENABLE,)),
    ("motor_fault", fault(Status.DRIVER_HOT), OPEN, "enable again", (ENABLE,)),
    ("motor_fault", fault(Status.OVERLOAD), OPEN, "enable again", (ENABLE,)),
    ("motor_fault", (ENABLE, *supply(5.0)), OPEN, "24 V supply .* on, then enable", SUPPLY_ON),
    ("motor_fault", (ENABLE, *supply(40.0)), OPEN, "lower .*, then enable", SUPPLY_ON),
    ("motor_fault", (ENABLE, *coil(110.0)), OPEN, "cool down, then enable", (*coil(25.0), ENABLE)),
    ("motor_fault", supply(5.0), ENABLE, "24 V", SUPPLY_ON),
    ("motor_silent", POWER_OFF, ENABLE, "24 V", POWER_ON),
    ("implausible_feedback", JUMPED, MOVE, "motor.clear_fault", (CLEAR_FAULT, ENABLE)),
    ("not_calibrated", ZERO_MOVED, OPEN, "calibration.zero with a mount", (ZERO_WITH_A_MOUNT,)),
    ("not_calibrated", (ENABLE, uncalibrated), OPEN, "mount", (ZERO_WITH_A_MOUNT,)),
    ("not_calibrated", (ENABLE, uncalibrated), OPEN, "mount", (TEMPLATE,)),
    ("stopped", (ENABLE, STOP), OPEN, "stop.clear", (CLEAR,)),
    ("busy", (ENABLE, a_motion_runs), OPEN, "job.cancel", (cancel_it,)),
    ("busy", (ENABLE, a_motion_runs), OPEN, "job.wait", (wait_for_it,)),
    ("lease_held", (ENABLE, other(ACQUIRE)), OPEN, "lease.take", (TAKE,)),
    ("lease_lost", LEASE_TAKEN, OPEN, "lease.acquire", (ACQUIRE,)),
    ("second_master", (ENABLE, another_program), OPEN, "end it", (3.0,)),
    ("teleop_busy", (ENABLE, FOLLOW), OPEN, "teleop.stop", (("teleop.stop", {}),)),
    ("trajectory_busy", (ENABLE, RECORD), FOLLOW, "trajectory.record_stop", (END_RECORDING,)),
    ("busy", (ENABLE, RECORD), OPEN, "trajectory.record_stop", (END_RECORDING,)),
    ("teleop_not_ready", (), FOLLOW, "motor.enable", (ENABLE,)),
    ("not_permitted", (ENABLE, "observer"), OPEN, "operators in .access.", ("operator",)),
    ("out_of_limits", TURNED, OPEN, "power-cycle", TURNED_BACK),
    ("out_of_limits", TURNED, OPEN, "calibration.zero with a mount", (ZERO_WITH_A_MOUNT,)),
    (
        "motor_unsuitable",
        (mode(2), lambda world: world.client().call("motor.enable")),
        ENABLE,
        "motor.clear_fault",
        (mode(1),),
    ),
]


@pytest.mark.parametrize(
    ("reason", "cause", "call", "says", "remedy"), CASES, ids=[f"{c[0]}-{c[3][:20]}" for c in CASES]
)
def test_after_the_remedy_the_call_works(
    reason: str, cause: Acts, call: Call, says: str, remedy: Acts
) -> None:
    world = World().start()
    client = world.client()
    do(world, client, cause)
    method, params = call
    error = client.call(method, **params)["error"]
    assert error["data"]["reason"] == reason
    assert re.search(says, f"{error['message']} {error['data'].get('hint', '')}")
    do(world, client, remedy)
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
    client.result("motor.enable")
    return client


def told_limit(message: str, value: float) -> float:
    """Return the limit in a message that `value` is beyond."""
    ends = re.search(r"travel is (\S+) to (-?[\d.]+)(?: mm| rad)?$", message)
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
        do(world, client, fault(status))
        assert client.result("motor.disable")["ok"]
        world.gripper.receive(world.now_s, CanFrame(CAN_ID, codec.CLEAR_FAULT))
        world.run(0.2)
