"""What a client does to the world of a simulated gripper, and what jaws and motor then do."""

import math
from typing import Any

import pytest

from litegripd.app.build import SIMULATED_METHODS, build_service
from litegripd.model.motor import BusCondition
from litegripd.rpc.openrpc import document
from litegripd.sim.interface import SimulatedBus, gripper_on
from tests.world import PERIOD_S, Client, FixedFacts, World


def simulated(mount: str = "normal") -> tuple[World, Client]:
    """Return a world whose daemon knows that its gripper is simulated; the motor is enabled."""
    world = World(mount)
    world.service = build_service(
        world.controller, FixedFacts(), PERIOD_S, simulated=lambda: world.gripper
    )
    return world, world.enabled()


def test_an_object_is_held_lost_and_found_again() -> None:
    world, client = simulated()
    assert client.result("sim.get")["object"] is None
    put = client.result("sim.object", width_mm=40.0)
    assert put["object"] == {"width_mm": 40.0, "stiffness_nm_rad": 250.0, "slip_mm_s": 0.0}
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["outcome"] == "object_held"
    world.run(1.0)
    assert client.result("sim.get")["clamp_nm"] == pytest.approx(1.0, abs=0.3)
    assert client.result("sim.object")["object"] is None
    world.run(0.5)
    assert not world.state.is_grasped
    assert client.result("motion.open")["ok"]
    client.result("sim.object", width_mm=40.0)
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["ok"]


def test_an_object_that_slips_gives_way() -> None:
    world, client = simulated()
    client.result("sim.object", width_mm=40.0, slip_mm_s=2.0)
    client.result("motion.grasp", force_n=10.0, until="verdict")
    before_mm = client.result("sim.get")["opening_mm"]
    world.run(2.0)
    assert client.result("sim.get")["opening_mm"] == pytest.approx(before_mm - 4.0, abs=1.0)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
@pytest.mark.parametrize(("torque_nm", "goes"), [(0.5, -1), (-0.5, 1)])
def test_a_hand_closes_with_a_positive_torque(mount: str, torque_nm: float, goes: int) -> None:
    world, client = simulated(mount)
    client.result("motion.zero_gravity")
    before_mm = world.gripper.opening_mm
    assert client.result("sim.push", torque_nm=torque_nm)["push_nm"] == torque_nm
    world.run(0.3)
    assert (world.gripper.opening_mm - before_mm) * goes > 3.0
    assert client.result("sim.push", torque_nm=0.0)["push_nm"] == 0.0


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_hand_with_a_damping_leads_the_jaws_at_its_own_speed(mount: str) -> None:
    world, client = simulated(mount)
    client.result("motion.zero_gravity")
    friction_nm = world.gripper.parameters.coulomb_nm
    for speed_rad_s in (1.0, -1.0, 0.5):
        torque_nm = 2.0 * speed_rad_s + math.copysign(friction_nm, speed_rad_s)
        client.result("sim.push", torque_nm=torque_nm, damping_nm_s_rad=2.0)
        world.run(0.2)
        closes_rad_s = world.gripper.velocity_rad_s * world.gripper.parameters.close_sign
        assert closes_rad_s == pytest.approx(speed_rad_s, rel=0.05)
        # It pushes by no more than what the jaws resist.
        assert abs(client.result("sim.get")["push_nm"]) == pytest.approx(friction_nm, abs=0.05)
    client.result("sim.push", torque_nm=0.0)
    world.run(0.2)
    assert world.gripper.velocity_rad_s == pytest.approx(0.0, abs=0.01)


def test_jaws_that_are_held_do_not_move_until_they_are_let_go() -> None:
    world, client = simulated()
    before_mm = world.gripper.opening_mm
    assert client.result("sim.hold")["held"]
    assert not client.result("motion.open")["ok"]
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.1)
    assert not client.result("sim.push", torque_nm=0.0)["held"]
    assert client.result("motion.open")["ok"]


def test_a_fault_is_latched_and_cleared_as_in_life() -> None:
    world, client = simulated()
    assert client.result("sim.fault", name="overload")["fault"] == "overload"
    world.run(0.2)
    assert client.refusal("motion.open") == "motor_fault"
    client.result("motor.clear_fault")
    assert client.result("sim.get")["fault"] is None
    world.run(0.2)
    client.result("motor.enable")
    assert client.result("motion.open")["ok"]


def test_a_motor_without_power_is_silent_until_the_reset() -> None:
    world, client = simulated()
    assert not client.result("sim.fault", name="silent")["powered"]
    world.run(1.0)
    assert client.refusal("motion.open") == "motor_silent"
    assert client.refusal("sim.fault", name="overload") == "out_of_limits"
    assert client.result("sim.reset")["powered"]
    world.run(1.0)
    client.result("motor.enable")
    assert client.result("motion.open")["ok"]


@pytest.mark.parametrize("name", ["silent", "weak", "overload"])
def test_a_motor_whose_fault_is_taken_away_works_and_the_object_stays(name: str) -> None:
    world, client = simulated()
    client.result("sim.object", width_mm=40.0)
    client.result("sim.fault", name=name)
    world.run(1.0)
    after = client.result("sim.fault", name="none")
    assert (after["powered"], after["made_share"], after["object"]["width_mm"]) == (True, 1.0, 40.0)
    world.run(1.0)
    client.result("motor.enable")
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["ok"]


def test_a_weak_motor_makes_little_until_the_reset() -> None:
    _, client = simulated()
    assert client.result("sim.fault", name="weak")["made_share"] == 0.15
    client.result("sim.object", width_mm=40.0)
    assert client.result("motion.grasp", force_n=20.0)["outcome"] == "motor_weak"
    assert client.result("sim.reset")["made_share"] == 1.0
    client.result("motion.open")
    client.result("sim.object", width_mm=40.0)
    assert client.result("motion.grasp", force_n=20.0, until="verdict")["ok"]


def test_a_hot_coil_is_reported() -> None:
    world, client = simulated()
    assert client.result("sim.heat", coil_c=70.0)["coil_c"] == 70.0
    world.run(0.1)
    assert world.state.coil_temperature_c == pytest.approx(70.0, abs=1.5)


def test_a_reset_leaves_an_enabled_motor_enabled() -> None:
    world, client = simulated()
    client.result("sim.object", width_mm=40.0)
    client.result("sim.push", torque_nm=0.2)
    client.result("sim.heat", coil_c=60.0)
    after = client.result("sim.reset")
    assert (after["object"], after["push_nm"], after["held"]) == (None, 0.0, False)
    assert after["coil_c"] == pytest.approx(25.0)
    world.run(0.2)
    assert world.state.motor == "enabled"


@pytest.mark.parametrize(
    ("method", "params", "why"),
    [
        ("sim.object", {"width_mm": 100.0}, "out_of_limits"),  # the jaws are 60 mm open
        ("sim.object", {"width_mm": 0.0}, "invalid_params"),
        ("sim.object", {"slip_mm_s": 1.0}, "invalid_params"),
        ("sim.push", {"torque_nm": 50.0}, "invalid_params"),
        ("sim.push", {}, "invalid_params"),
        ("sim.fault", {"name": "rain"}, "invalid_params"),
        ("sim.heat", {"coil_c": 1000.0}, "invalid_params"),
    ],
)
def test_what_cannot_be_is_rejected_and_changes_nothing(
    method: str, params: dict[str, Any], why: str
) -> None:
    _, client = simulated()
    before = client.result("sim.get")
    assert client.refusal(method, **params) == why
    assert client.result("sim.get") == before


@pytest.mark.parametrize("role", ["observer", "operator"])
def test_only_an_admin_changes_the_world(role: Any) -> None:
    world, _ = simulated()
    client = world.client(role=role)
    assert client.refusal("sim.object", width_mm=40.0) == "not_permitted"
    assert client.result("sim.get")["object"] is None


def test_a_daemon_on_a_bus_has_no_such_methods() -> None:
    client = World().client()
    names = [method["name"] for method in client.result("rpc.discover")["methods"]]
    for row in SIMULATED_METHODS:
        assert client.refusal(row.name) == "unknown_method"
        assert row.name not in names
    world, _ = simulated()
    described = world.client().result("rpc.discover")
    assert {row.name for row in SIMULATED_METHODS} <= {one["name"] for one in described["methods"]}


def test_the_document_describes_what_is_answered() -> None:
    described = {one["name"]: one for one in document(SIMULATED_METHODS)["methods"]}
    assert list(described) == [row.name for row in SIMULATED_METHODS]
    form = document(SIMULATED_METHODS)["components"]["schemas"]["SimulatedWorld"]
    _, client = simulated()
    assert set(client.result("sim.get")) == set(form["properties"])


def test_without_an_open_bus_there_is_no_world() -> None:
    world = World()
    world.service = build_service(world.controller, FixedFacts(), PERIOD_S, simulated=lambda: None)
    assert world.client().refusal("sim.get") == "bus_down"


def test_why_the_bus_is_not_open_is_told_as_to_who_enables_the_motor() -> None:
    world = World()
    world.service = build_service(world.controller, FixedFacts(), PERIOD_S, simulated=lambda: None)
    world.condition = BusCondition("down", "cannot be opened: no such scene")
    world.tick()
    told = (
        "the CAN bus cannot be used (down): cannot be opened: no such scene;"
        " fix what the error names: the daemon keeps reopening the bus"
    )
    data = world.client().refused("sim.get", "bus_down", told)
    assert data["hint"] == "fix what the error names: the daemon keeps reopening the bus"


def test_the_gripper_of_an_open_bus_is_found_by_its_channel() -> None:
    assert gripper_on("found") is None
    with SimulatedBus("found", object_mm=30.0) as bus:
        assert gripper_on("found") is bus.gripper
    assert gripper_on("found") is None
