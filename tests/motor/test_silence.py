"""A motor that stops answering, comes back, faults, or is replaced."""

from itertools import pairwise
from typing import Any

import pytest

from litegripd.model.motor import CanFrame, MotorPhase, Status
from litegripd.motor import codec
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from tests.world import CAN_ID, PERIOD_S, Client, World, enabled_world


def deaf(world: World) -> None:
    world.lose_to_motor = lambda _frame: True


def hears(world: World) -> None:
    world.lose_to_motor = lambda _frame: False
    world.lose_from_motor = lambda _frame: False


def mute(world: World) -> None:
    world.lose_from_motor = lambda _frame: True


def moving(**options: Any) -> tuple[World, Client]:
    world, client = enabled_world(**options)
    client.send("motion.open")
    world.run(0.5)
    return world, client


def test_three_unanswered_commands_are_repeated_without_feed_forward_and_then_withheld() -> None:
    world, _ = moving()
    mute(world)
    since_s = world.now_s + PERIOD_S / 2
    world.tick()  # takes the last answer, sends the first command that stays unanswered
    world.run(0.2)
    commands = [command for _, command in world.commands_since(since_s)]
    assert len(commands) == 4
    first, *repeats = commands
    assert abs(first.velocity_rad_s) > 0.1
    for repeat in repeats:
        assert repeat.position_rad == first.position_rad
        assert (repeat.kp_nm_rad, repeat.kd_nm_s_rad) == (first.kp_nm_rad, first.kd_nm_s_rad)
        assert abs(repeat.velocity_rad_s) < 0.01
    after = [s for s in world.sent if s.at_s >= since_s + 4 * PERIOD_S]
    assert {s.frame.can_id for s in after} == {0x7FF}
    assert {s.frame.data[2] for s in after} == {0xCC}
    assert len(after) == round((world.now_s - after[0].at_s) / PERIOD_S) + 1
    assert world.in_phase(MotorPhase.SILENT)
    assert world.machine.motor.counters.withheld_commands > 0


def test_after_a_short_silence_the_measured_position_is_held() -> None:
    world, client = moving()
    deaf(world)
    world.run(0.05)
    assert world.in_phase(MotorPhase.SILENT)
    world.gripper.push(6.0)  # a hand moves the jaws meanwhile
    world.run(0.03)
    world.gripper.push(0.0)
    hears(world)
    since_s = world.now_s
    world.run_until(lambda: world.phase is MotorPhase.ENABLED, 0.1)
    here_rad = world.state.position_rad
    world.run(0.1)
    commands = [command for _, command in world.commands_since(since_s)]
    assert commands
    assert {round(c.position_rad, 2) for c in commands} == {round(here_rad or 0.0, 2)}
    client.read()
    errors = [a["error"]["data"]["reason"] for a in client.answers.values() if "error" in a]
    assert errors == ["motor_silent"]
    assert world.state.mode == "holding"


def test_jaws_that_were_slack_stay_slack_after_a_silence() -> None:
    """A hand may be between them: that is why they were let go."""
    world, client = enabled_world()
    client.result("stop", level="relax")
    world.run(0.05)
    deaf(world)
    world.run(0.05)
    hears(world)
    world.run(0.1)
    assert world.in_phase(MotorPhase.ENABLED)
    _, last = world.commands_since(world.now_s - 2 * PERIOD_S)[-1]
    assert (last.kp_nm_rad, last.kd_nm_s_rad) == (0.0, 0.0)
    assert world.state.mode == "relaxed"


def test_a_stop_is_in_force_by_the_next_tick_though_answers_fail() -> None:
    world, client = moving()
    mute(world)
    world.run(2 * PERIOD_S)
    client.send("stop", level="relax")
    world.tick()
    _, command = world.commands_since(world.now_s)[-1]
    assert (command.kp_nm_rad, command.kd_nm_s_rad) == (0.0, 0.0)


def test_a_motor_that_disarmed_itself_in_a_silence_is_looked_at_again_and_not_enabled() -> None:
    world, _ = moving()
    deaf(world)
    world.run(0.3)  # its watchdog trips at 0.1 s
    hears(world)
    world.run(0.5)
    assert world.gripper.motor.status == Status.COMMUNICATION_LOST
    assert world.in_phase(MotorPhase.FAULT)
    assert world.state.status == "communication_lost"


def test_a_motor_that_lost_power_in_a_silence_is_looked_at_again() -> None:
    world, client = moving()
    deaf(world)
    world.run(0.05)
    world.gripper.power_cycle()
    reads = sum(s.frame.data[2] == 0x33 for s in world.sent)
    hears(world)
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED)
    assert sum(s.frame.data[2] == 0x33 for s in world.sent) > reads
    assert client.result("motor.enable")["ok"]


@pytest.mark.parametrize("powered", [False, True])
def test_a_long_silence_is_said_and_ends_when_the_motor_is_back(powered: bool) -> None:
    world = World()
    client = world.enabled() if powered else world.start().client()
    deaf(world)
    world.run(3.0)
    assert world.in_phase(MotorPhase.SILENT)
    assert world.state.stale
    assert client.refusal("motor.enable") == "motor_silent"
    assert not [s for s in world.sent if s.frame.can_id == CAN_ID and s.at_s > world.now_s - 2.0]
    hears(world)
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED, MotorPhase.FAULT)
    assert client.result("motor.enable")["ok"]


def test_another_motor_with_another_master_id_may_come_in_the_place_of_a_silent_one() -> None:
    world = World().start()
    deaf(world)
    world.run(1.0)
    world.gripper = SimulatedGripper(SimulatorParameters(master_id=0x22))
    world.gripper.advance(world.now_s)
    hears(world)
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.identity.master_id == 0x22


def test_a_motor_that_is_exchanged_while_it_is_looked_at_is_found() -> None:
    world = World()
    world.run(4 * PERIOD_S)  # its master id is known, the rest is not
    deaf(world)
    world.run(1.0)
    assert world.in_phase(MotorPhase.SILENT)
    world.gripper = SimulatedGripper(SimulatorParameters(master_id=0x22))
    world.gripper.advance(world.now_s)
    hears(world)
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED)


def test_a_motor_that_has_fallen_silent_is_never_said_to_be_unknown() -> None:
    world = World().start()
    deaf(world)
    phases = [world.phase]
    while phases[-1] is not MotorPhase.SILENT:
        world.tick()
        phases.append(world.phase)
        assert len(phases) < 100
    assert set(phases) == {MotorPhase.DISABLED, MotorPhase.SILENT}


def test_no_motor_at_all_is_silent_from_the_start() -> None:
    world = World()
    deaf(world)
    world.run(1.0)
    assert world.in_phase(MotorPhase.SILENT)
    assert world.state.mode == "offline"
    assert world.state.position_rad is None
    assert {s.frame.can_id for s in world.sent} == {0x7FF}
    asked = [s.at_s for s in world.sent if s.frame.data[2] == 0x33]
    assert all(later - earlier >= 0.02 for earlier, later in pairwise(asked))


def test_a_fault_while_enabled_ends_the_job_and_is_not_cleared_by_itself() -> None:
    world, client = moving()
    world.gripper.set_supply(40.0)
    world.run(0.05)
    world.gripper.set_supply(24.0)
    client.read()
    errors = [a["error"] for a in client.answers.values() if "error" in a]
    assert [e["data"]["reason"] for e in errors] == ["motor_fault"]
    assert errors[0]["data"]["status"] == "over_voltage"
    since_s = world.now_s
    world.run(2.0)
    assert world.in_phase(MotorPhase.FAULT)
    assert not [s for s in world.sent if s.frame.can_id == CAN_ID and s.at_s > since_s]
    assert client.refusal("motion.open") == "motor_fault"
    assert client.result("motor.enable")["ok"]


@pytest.mark.parametrize("status", [0x8, 0x9, 0xA, 0xB, 0xC, 0xD, 0xE, 0x2, 0x7, 0xF])
def test_every_status_but_two_is_a_fault(status: int) -> None:
    world, _ = moving()
    world.lose_from_motor = lambda _frame: True
    reported = CanFrame(0x18, bytes([status << 4 | CAN_ID, 0x79, 0xDA, 0x7F, 0xF7, 0xFF, 30, 30]))
    for phase in (MotorPhase.ENABLED, MotorPhase.FAULT):  # a second frame must agree
        world.inject(reported)
        world.tick()
        assert world.in_phase(phase)
    view = world.machine.motor.view()
    assert view.fault is not None
    assert view.fault.reason == "motor_fault"


def test_foreign_and_malformed_frames_are_ignored_and_counted() -> None:
    world, client = enabled_world()
    counters = world.machine.motor.counters
    before = counters.ignored_frames
    foreign = [
        CanFrame(0x19, bytes(8)),
        CanFrame(0x18, b""),
        CanFrame(0x18, bytes(7)),
        CanFrame(0x18, bytes([0x87, 0, 0, 0, 0, 0, 0, 0])),
        CanFrame(0x7FF, bytes(8)),
        CanFrame(0x000, b"\xff" * 8),
    ]
    for frame in foreign:
        world.inject(frame)
    world.run(0.05)
    assert counters.ignored_frames == before + len(foreign)
    assert world.in_phase(MotorPhase.ENABLED)
    world.inject(CanFrame(CAN_ID, codec.ENABLE))
    world.run(0.05)
    assert counters.foreign_commands == 1
    assert client.refusal("motion.open") == "second_master"


def test_one_lost_answer_is_counted_and_disturbs_nothing() -> None:
    world, client = enabled_world()
    number = client.send("motion.open")
    world.run(0.5)
    mute(world)
    world.tick()
    hears(world)
    assert client.wait(number)["result"]["ok"]
    assert world.machine.motor.counters.missed_replies == 1
