"""Another type of motor in a gripper that is made without any code of the simulator."""

import pytest

from litegripd.model.gripper import DM4310, DM4340
from tests.plants.motor import REGISTERS
from tests.plants.parameters import Item, PlantParameters, dm4340
from tests.plants.world import PlantWorld

MOTORS = {
    "as estimated": dm4340(),
    "easy": dm4340(coulomb_nm=0.1, viscous_nm_s_rad=0.1),
    "hard": dm4340(coulomb_nm=0.45, viscous_nm_s_rad=0.6),
    "slow to tell its speed": dm4340(speed_lag_s=2e-3, delay_s=2e-3),
    "soft cable": dm4340(cable_nm_rad=300.0),
}
"""The true figures are not known: the daemon's row is right about none of them but the first."""

any_motor = pytest.mark.parametrize("parameters", MOTORS.values(), ids=MOTORS)


@any_motor
@pytest.mark.parametrize(
    ("mount", "stiffness_nm_rad"), [("normal", 40.0), ("reverse", 250.0), ("normal", 1000.0)]
)
def test_it_grips_holds_and_lets_go(
    parameters: PlantParameters, mount: str, stiffness_nm_rad: float
) -> None:
    world = PlantWorld(parameters, mount, motor_type=DM4340)
    client = world.enabled()
    world.mechanics.put(Item(40.0, stiffness_nm_rad))
    answer = client.result("motion.grasp", force_n=30.0, until="verdict")
    assert answer["outcome"] == "object_held"
    world.run(2.0)
    begun_s = world.now_s
    world.run(1.0)
    looks = world.looks_since(begun_s)
    hidden_n = 20.0 * parameters.breakaway_nm
    assert all(look.clamp_n == pytest.approx(30.0, abs=hidden_n) for look in looks)
    assert max(abs(look.jaw_mm_s) for look in looks) < 0.5  # calm
    assert max(look.torque_nm for look in world.looks) <= DM4340.rated_nm
    assert client.result("motion.open")["outcome"] == "pressed_home"


@any_motor
def test_a_move_ends_where_it_shall_and_rests_there(parameters: PlantParameters) -> None:
    world = PlantWorld(parameters, motor_type=DM4340)
    client = world.enabled()
    for opening_mm in (80.0, 30.0):
        assert client.result("motion.move", opening_mm=opening_mm)["ok"]
        assert world.mechanics.opening_mm == pytest.approx(opening_mm, abs=2.0)
        begun_s = world.now_s
        world.run(0.5)
        assert max(abs(look.jaw_mm_s) for look in world.looks_since(begun_s)) < 2.0


def test_the_table_of_its_registers_is_the_usual_motors() -> None:
    usual, spans = PlantParameters(), DM4310.ranges
    assert REGISTERS[20].first == usual.gear == DM4310.gear_ratio
    assert usual.ranges == (spans.position_rad, spans.velocity_rad_s, spans.torque_nm)
    other = DM4340.ranges
    assert dm4340().ranges == (other.position_rad, other.velocity_rad_s, other.torque_nm)
