"""The second gripper itself: it makes nothing from nothing, and is much like the simulator's.

No comparison here is exact: two models that agree to the digit would be one.
"""

import ast
import random
import struct
from pathlib import Path

import pytest

from litegripd.model.gripper import Geometry
from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.plants.codec import Command, Scale, read_command, write_command
from tests.plants.mechanics import STEP_S, Mechanics
from tests.plants.motor import COMMUNICATION_LOST, ENABLED, REGISTERS, PlantMotor
from tests.plants.parameters import (
    LIMITS_RAD,
    MM_RAD,
    TRAVEL_RAD,
    Item,
    PlantParameters,
    random_plant,
)
from tests.plants.scenes import play
from tests.plants.world import PlantWorld

SEEDS = range(12)
MOUNTS = ("normal", "reverse")
TO_MOTOR, TO_ALL = 0x08, 0x7FF
ENABLE, DISABLE, CLEAR, ZERO = (
    CanFrame(TO_MOTOR, b"\xff" * 7 + bytes((code,))) for code in (0xFC, 0xFD, 0xFB, 0xFE)
)
GOLDEN = {
    "79DA7FF3336667FF": Command(position_rad=-0.6, kp_nm_rad=100.0, kd_nm_s_rad=2.0),
    "7FFF7FF0000007FF": Command(),
}


def test_no_code_of_the_simulator_is_in_it() -> None:
    for name in ("codec", "parameters", "mechanics", "motor"):
        tree = ast.parse((Path(__file__).parent / f"{name}.py").read_text())
        imported = {
            node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
        }
        ours = {module for module in imported if module.startswith("litegripd")}
        assert ours <= {"litegripd.model.motor"}


def command(**fields: float) -> CanFrame:
    return CanFrame(TO_MOTOR, write_command(Command(**fields), Scale()))


def register_frame(what: int, number: int, raw: bytes = bytes(4)) -> CanFrame:
    return CanFrame(TO_ALL, bytes((TO_MOTOR, 0, what, number)) + raw)


@pytest.mark.parametrize("frame", GOLDEN)
def test_the_codec_agrees_with_the_makers_frames(frame: str) -> None:
    data, said = bytes.fromhex(frame), GOLDEN[frame]
    assert write_command(said, Scale()) == data
    assert read_command(data, Scale()) == pytest.approx(said, abs=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_stands_stays_where_it_is(seed: int) -> None:
    mechanics = Mechanics(random_plant(seed), 60.0)
    mechanics.drive(0.0, 0.0, 0.0, 5.0, 0.0)
    mechanics.run(10_000)
    assert mechanics.opening_mm == pytest.approx(60.0)
    assert (mechanics.rotor_rad_s, mechanics.finger_rad_s) == (0.0, 0.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_comes_from_nothing(seed: int) -> None:
    """Thrown against its ends and an object, it loses what it was thrown with."""
    chance = random.Random(seed)
    mechanics = Mechanics(random_plant(seed), chance.uniform(0.04, 0.96) * TRAVEL_RAD * MM_RAD)
    if seed % 2:
        mechanics.put(Item(mechanics.opening_mm - 2.0, chance.uniform(60.0, 1500.0)))
    mechanics.drive(0.0, 0.0, 0.0, 0.0, 0.0)
    mechanics.rotor_rad_s = mechanics.finger_rad_s = chance.uniform(-15.0, 15.0)
    least_j = mechanics.energy_j
    for _ in range(5000):
        mechanics.run(1)
        # A spring that is met in the midst of a step is deeper in at its end by half a step.
        assert mechanics.energy_j <= least_j * 1.05 + 1e-4
        least_j = min(least_j, mechanics.energy_j)
    assert (mechanics.rotor_rad_s, mechanics.finger_rad_s) == (0.0, 0.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_friction_stops_and_never_turns_round(seed: int) -> None:
    """Without springs a free rotor and its fingers slow down to a standstill, and stay there."""
    mechanics = Mechanics(random_plant(seed), 60.0)
    mechanics.drive(0.0, 0.0, 0.0, 0.0, 0.0)
    mechanics.rotor_rad_s = 3.0
    lowest, before = 0.0, mechanics.rotor_rad
    for _ in range(3000):
        mechanics.run(1)
        lowest = min(lowest, mechanics.rotor_rad - before)
        before = mechanics.rotor_rad
    # The cable's spring may swing the masses against each other, by no more than its stretch.
    assert lowest >= -1e-3
    assert mechanics.rotor_rad_s == 0.0


def test_the_same_seed_does_the_same_and_another_one_does_not() -> None:
    first, again = play("bump", 3), play("bump", 3)
    assert first == again
    assert first.before_n != play("bump", 4).before_n


def test_slices_of_time_do_not_matter() -> None:
    places = []
    for slices in (1, 7, 100):
        mechanics = Mechanics(random_plant(5), 60.0)
        mechanics.put(Item(55.0))
        mechanics.drive(0.0, 0.0, 0.0, 1.0, 1.0)
        for _ in range(slices):
            mechanics.run(2100 // slices)
        places.append((mechanics.rotor_rad, mechanics.clamp_nm, mechanics.reported_nm))
    assert places[1] == pytest.approx(places[0], rel=1e-4)
    assert places[2] == pytest.approx(places[0], rel=1e-4)


@pytest.mark.parametrize("mount", MOUNTS)
def test_it_closes_on_an_object_about_as_the_simulator_does(mount: str) -> None:
    """The same frames to both: a ramp at 50 mm/s into an object of 50 mm, then a hold by force."""
    closed_rad, open_rad = limits_of_mount(mount)
    assert LIMITS_RAD[mount] == (closed_rad, open_rad)
    parameters = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad)
    ours, simulated = PlantMotor(PlantParameters(), mount), SimulatedGripper(parameters)
    ours.mechanics.put(Item(50.0))
    simulated.put_object(width_mm=50.0)
    sign, at_s = ours.sign, 0.0
    begin_rad, speed_rad_s = closed_rad - sign * 60.0 / MM_RAD, 50.0 / MM_RAD
    frames = [
        command(
            position_rad=begin_rad + sign * speed_rad_s * t,
            velocity_rad_s=sign * speed_rad_s,
            kp_nm_rad=50.0,
        )
        for t in (0.005 * tick for tick in range(45))
    ]
    frames += [command(torque_nm=sign * 2.0, kd_nm_s_rad=1.0)] * 60
    ours.receive(at_s, ENABLE)
    simulated.receive(at_s, ENABLE)
    for frame in frames:
        at_s += 0.005
        ours.receive(at_s, frame)
        simulated.receive(at_s, frame)
        assert ours.mechanics.opening_mm == pytest.approx(simulated.opening_mm, abs=0.6)
    torque_nm = sign * ours.mechanics.torque_nm
    assert torque_nm == pytest.approx(simulated.motor_torque_nm, abs=0.05)
    assert ours.mechanics.clamp_nm == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_daemon_finds_it_opens_and_closes_it(mount: str) -> None:
    world = PlantWorld(PlantParameters(), mount)
    client = world.enabled()
    geometry = world.controller.geometry
    assert geometry == Geometry(*LIMITS_RAD[mount], MM_RAD)
    assert client.result("motion.open")["outcome"] == "pressed_home"
    assert world.mechanics.opening_mm == pytest.approx(TRAVEL_RAD * MM_RAD, abs=0.5)
    assert client.result("motion.close")["outcome"] == "pressed_home"
    assert world.mechanics.opening_mm == pytest.approx(0.0, abs=0.5)


def test_pressed_and_let_go_the_closed_end_springs_back() -> None:
    mechanics = Mechanics(PlantParameters(), 1.0)
    mechanics.drive(0.0, 0.0, 0.0, 0.0, 1.0)
    mechanics.run(5000)
    pressed_rad = mechanics.finger_rad
    mechanics.brake()  # let go at once by a motor that does not brake, they would bounce
    mechanics.run(5000)
    assert pressed_rad - mechanics.finger_rad == pytest.approx(0.0275, rel=0.2)


def test_a_stored_command_is_applied_at_once_when_it_is_enabled() -> None:
    motor = PlantMotor(PlantParameters())
    motor.receive(0.0, command(torque_nm=1.0))
    motor.advance(0.1)
    assert motor.mechanics.torque_nm == 0.0
    (answer,) = motor.receive(0.1, ENABLE)
    assert answer.data[0] == ENABLED << 4 | TO_MOTOR
    motor.advance(0.11)
    assert motor.mechanics.torque_nm == pytest.approx(1.0, abs=0.01)


def test_silence_latches_a_fault_that_only_clearing_ends() -> None:
    motor = PlantMotor(PlantParameters(timeout_s=0.1))
    motor.receive(0.0, ENABLE)
    motor.receive(0.09, register_frame(0xCC, 0))  # which feeds no watchdog
    motor.advance(0.11)
    assert motor.status == COMMUNICATION_LOST
    for frame in (DISABLE, ENABLE):
        motor.receive(0.2, frame)
        assert motor.status == COMMUNICATION_LOST
    motor.receive(0.3, CLEAR)
    assert motor.status == 0
    motor.receive(0.3, ENABLE)
    assert motor.status == ENABLED


def test_zero_is_taken_where_it_stands_but_not_while_enabled() -> None:
    motor = PlantMotor(PlantParameters(), opening_mm=30.0)
    before_rad = motor.reported_rad
    motor.receive(0.0, ENABLE)
    motor.receive(0.0, ZERO)
    assert motor.reported_rad == before_rad
    motor.receive(0.0, DISABLE)
    motor.receive(0.0, ZERO)
    assert motor.reported_rad == pytest.approx(0.0, abs=1e-9)


def test_registers_are_read_and_written_as_far_as_they_may_be() -> None:
    motor = PlantMotor(PlantParameters(speed_lag_s=2e-3))
    for number, row in REGISTERS.items():
        (answer,) = motor.receive(0.0, register_frame(0x33, number))
        assert answer.data[:4] == bytes((TO_MOTOR, 0, 0x33, number))
        assert struct.unpack(row.form, answer.data[4:])[0] == pytest.approx(motor.registers[number])
    assert motor.registers[32] == pytest.approx(79.6, abs=0.1)
    motor.receive(0.0, register_frame(0x55, 23, struct.pack("<f", 54.0)))
    assert motor.scale.torque_nm == 54.0
    motor.receive(0.0, register_frame(0x55, 20, struct.pack("<f", 1.0)))
    assert motor.registers[20] == 10.0
    assert motor.receive(0.0, register_frame(0x33, 200)) == []


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
def test_frames_take_their_time_and_keep_their_order(rate_hz: int) -> None:
    world = PlantWorld(PlantParameters(delay_s=2e-3, jitter_s=0.5e-3), rate_hz=rate_hz)
    assert world.period_s == 1.0 / rate_hz
    world.enabled()
    world.run(0.3)
    arrivals = [at_s for at_s, _ in world._answers]
    assert arrivals == sorted(arrivals)
    assert len(arrivals) <= 0.004 * rate_hz + 1
    assert world.longest_gap_s(world.now_s - 0.2) == pytest.approx(world.period_s)


def test_a_hand_opens_the_jaws_as_far_as_it_is_told() -> None:
    world = PlantWorld(PlantParameters(), opening_mm=60.0)
    world.start()
    world.hold_open(2.0, 0.03)
    world.run(0.03)
    assert max(look.opening_mm for look in world.looks) == pytest.approx(62.0, abs=0.3)


def test_a_step_of_the_plant_is_a_tenth_of_a_millisecond() -> None:
    assert STEP_S == 1e-4
