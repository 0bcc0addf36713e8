"""Enabling and disabling the simulated motor: order of frames, lost frames, honest results."""

import struct

import pytest

from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, MitCommand, MotorPhase, Status
from litegripd.motor import codec
from tests.motor.bench import LosesFirst
from tests.world import CAN_ID, PERIOD_S, World, enabled_world, is_command

ENABLE, DISABLE, CLEAR = (b"\xff" * 7 + end for end in (b"\xfc", b"\xfd", b"\xfb"))


def is_slack(data: bytes) -> bool:
    command = codec.decode_command(data, DM4310.ranges)
    return (
        command.kp_nm_rad == 0.0
        and command.kd_nm_s_rad == 0.0
        and abs(command.torque_nm) < 0.00245
        and abs(command.velocity_rad_s) < 0.008
    )


def loses(kind: bytes, count: int) -> LosesFirst:
    return LosesFirst(count, lambda frame: frame.data == kind)


def test_a_motor_found_enabled_is_disabled_and_that_is_confirmed() -> None:
    world = World()
    world.gripper.receive(world.now_s, CanFrame(CAN_ID, ENABLE))
    assert world.gripper.motor.status == Status.ENABLED
    world.start()
    assert world.gripper.motor.status == Status.DISABLED
    assert set(world.own_frames()) == {DISABLE}


def test_a_motor_that_somebody_else_enables_is_disabled() -> None:
    world = World().start()
    frame = CanFrame(CAN_ID, ENABLE)
    for reply in world.gripper.receive(world.now_s, frame):
        world.inject(frame)
        world.inject(reply)
    world.run(0.1)
    assert world.gripper.motor.status == Status.DISABLED
    assert world.machine.motor.counters.foreign_commands == 1


def test_enabling_sends_zero_gains_before_enable_and_then_holds_what_is_measured() -> None:
    world = World().start()
    world.client().result("motor.enable")
    sent = world.own_frames()
    index = sent.index(ENABLE)
    assert sent.count(ENABLE) == 1
    assert index >= 1
    assert all(is_slack(data) for data in sent[:index])
    assert CLEAR not in sent
    world.run(0.1)
    after = [codec.decode_command(d, DM4310.ranges) for d in world.own_frames()[index + 1 :]]
    held = [command for command in after if command.kp_nm_rad > 0.0]
    assert len(held) > 10
    assert {round(c.position_rad, 3) for c in held} == {round(world.gripper.position_rad, 3)}
    assert {round(c.kp_nm_rad) for c in held} == {100}


@pytest.mark.parametrize("phase", ["stored", "pushed"])
def test_the_jaws_do_not_jump_on_enable(phase: str) -> None:
    """A set-point that came while the motor was disabled is applied by enable at once."""
    world = World().start()
    if phase == "stored":
        stored = codec.encode_command(MitCommand(-1.4, 0.0, 300.0, 0.0, 0.0), DM4310.ranges)
        world.gripper.receive(world.now_s, CanFrame(CAN_ID, stored))
    else:  # moved by hand between looking and enabling
        world.gripper.push(1.0)
        world.run(0.2)
        world.gripper.push(0.0)
        world.run(0.2)
    began_rad = world.gripper.position_rad
    furthest = []
    client = world.client()
    number = client.send("motor.enable")
    for _ in range(200):
        world.tick()
        furthest.append(abs(world.gripper.position_rad - began_rad))
    assert client.answered(number)["result"]["ok"]
    assert max(furthest) < 0.002


def test_a_fault_is_cleared_first_and_only_if_there_is_one() -> None:
    world = World().start()
    world.gripper.set_supply(40.0)
    world.run_until(lambda: world.phase is MotorPhase.FAULT)
    world.gripper.set_supply(24.0)
    assert not world.own_frames()
    assert world.client().result("motor.enable")["ok"]
    sent = world.own_frames()
    assert sent.index(CLEAR) < sent.index(ENABLE)


def test_a_fault_that_stays_is_named_and_the_motor_is_left_disabled() -> None:
    world = World().start()
    world.gripper.set_supply(5.0)
    world.run(0.2)
    data = world.client().refused("motor.enable", "motor_fault", "24 V")
    assert data["status"] == "under_voltage"
    world.run(0.1)
    assert world.in_phase(MotorPhase.DISABLED)
    assert ENABLE not in world.own_frames()
    assert world.own_frames()[-1] == DISABLE


@pytest.mark.parametrize("lost", [1, 2])
def test_a_lost_enable_frame_is_sent_again_with_zero_gains_right_before_every_try(
    lost: int,
) -> None:
    world = World().start()
    world.lose_to_motor = loses(ENABLE, lost)
    result = world.client().result("motor.enable")
    assert (result["ok"], result["tries"]) == (True, lost + 1)
    sent = [s for s in world.sent if s.frame.can_id == CAN_ID]
    tries = [i for i, s in enumerate(sent) if s.frame.data == ENABLE]
    assert len(tries) == lost + 1
    for index in tries:
        assert is_slack(sent[index - 1].frame.data)
        assert sent[index - 1].at_s == sent[index].at_s
    times = [sent[index].at_s for index in tries]
    assert times[1] - times[0] == pytest.approx(0.2, abs=PERIOD_S)


@pytest.mark.parametrize("tries", [1, 4])
def test_a_motor_that_does_not_take_enable_is_reported_honestly(tries: int) -> None:
    world = World().start()
    world.lose_to_motor = loses(ENABLE, 1000)
    result = world.client().result("motor.enable", retries=tries)
    assert (result["ok"], result["tries"]) == (False, tries)
    assert str(tries) in result["message"]
    world.run(0.05)
    assert world.own_frames().count(ENABLE) == tries
    assert world.own_frames()[-1] == DISABLE
    assert world.in_phase(MotorPhase.DISABLED)


def test_an_enable_whose_answers_are_lost_ends_disabled() -> None:
    """The motor did take it; nobody may find it energised later."""
    world = World().start()
    world.lose_from_motor = lambda frame: frame.data[0] >> 4 == 1
    result = world.client().result("motor.enable", retries=1)
    assert not result["ok"]
    world.lose_from_motor = lambda _frame: False
    world.run(0.1)
    assert world.gripper.motor.status == Status.DISABLED
    assert world.in_phase(MotorPhase.DISABLED)


def test_the_next_failure_is_not_told_in_the_words_of_the_last() -> None:
    world = World().start()
    world.lose_to_motor = loses(ENABLE, 1000)
    client = world.client()
    assert client.result("motor.enable", retries=5)["tries"] == 5
    world.lose_to_motor = lambda _frame: False
    world.run(0.1)
    assert client.result("motor.enable", retries=2)["tries"] == 1


@pytest.mark.parametrize("lost", [1, 5, 40])
def test_a_lost_disable_frame_is_sent_until_the_motor_says_disabled(lost: int) -> None:
    world, client = enabled_world()
    world.lose_to_motor = loses(DISABLE, lost)
    since_s = world.now_s
    assert client.result("motor.disable")["ok"]
    assert world.gripper.motor.status != Status.ENABLED
    assert world.own_frames(since_s).count(DISABLE) > lost


def test_a_motor_that_never_confirms_is_said_to_be_not_disabled() -> None:
    world, client = enabled_world()
    world.lose_to_motor = loses(DISABLE, 10_000)
    feed = codec.encode_command(MitCommand(0.0, 0.0, 0.0, 0.0, 0.0), DM4310.ranges)

    def somebody_else_keeps_it_awake(frame: CanFrame) -> bool:
        if frame.data == DISABLE:
            for reply in world.gripper.receive(world.now_s, CanFrame(CAN_ID, feed)):
                world.inject(reply)
            return True
        return False

    world.lose_to_motor = somebody_else_keeps_it_awake
    assert client.refusal("motor.disable") == "not_confirmed"
    assert world.in_phase(MotorPhase.DISABLING)
    assert client.refusal("motor.enable") == "not_confirmed"
    world.lose_to_motor = lambda _frame: False
    world.run(0.1)
    assert world.in_phase(MotorPhase.DISABLED)
    assert client.result("motor.enable")["ok"]


def test_disabling_a_disabled_motor_is_confirmed_as_well() -> None:
    world = World().start()
    assert world.client().result("motor.disable")["ok"]


def test_a_motor_that_was_enabled_after_a_power_cycle_waits_for_a_client() -> None:
    world, client = enabled_world()
    world.gripper.power_cycle()
    world.run(3.0)
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.gripper.motor.status == Status.DISABLED
    assert world.own_frames().count(ENABLE) == 1
    assert client.result("motor.enable")["ok"]


def test_a_position_that_is_off_by_a_turn_after_a_power_cycle_moves_nothing() -> None:
    world, client = enabled_world()
    world.gripper.power_cycle(turns=1)
    world.run(0.5)
    assert client.result("motor.enable")["ok"]
    began_mm = world.gripper.opening_mm
    for method in ("motion.open", "motion.close"):
        client.refused(method, "out_of_limits", "turns")
    assert world.gripper.opening_mm == pytest.approx(began_mm, abs=0.1)


def test_an_answer_that_comes_before_disabled_is_true_does_not_count() -> None:
    """A reply from before the disable frame may still be under way when it is sent."""
    world, client = enabled_world()
    stale = bytes([CAN_ID, *struct.pack(">H", 0x7000), 0x7F, 0xF7, 0xFF, 30, 30])
    world.lose_to_motor = loses(DISABLE, 4)
    client.send("motor.disable")
    world.tick()
    world.inject(CanFrame(0x18, stale))
    world.tick()
    assert world.in_phase(MotorPhase.DISABLING)


def test_the_last_frame_to_a_disabled_motor_is_no_command() -> None:
    world, client = enabled_world()
    client.result("motor.disable")
    since_s = world.now_s
    world.run(1.0)
    assert not world.own_frames(since_s)
    assert not is_command(CanFrame(CAN_ID, DISABLE))
