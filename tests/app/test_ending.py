"""What the daemon's end tells of the motor: off, not known to be off, or not known at all."""

import logging
from functools import partial

import pytest

from litegripd.app.machine import Ending
from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, MitCommand, MotorPhase, Status
from litegripd.motor import codec
from litegripd.motor.codec import TIMEOUT, write_request
from tests.world import CAN_ID, World, enabled_world, reason_of


def left_enabled() -> World:
    """Return a motor that a killed program has left enabled, its own watchdog off."""
    world = World()
    for frame in (
        write_request(CAN_ID, TIMEOUT, 0),
        CanFrame(CAN_ID, codec.encode_zero_gains(-0.7, DM4310.ranges)),
        CanFrame(CAN_ID, codec.ENABLE),
        CanFrame(
            CAN_ID, codec.encode_command(MitCommand(-0.7, 0.0, 20.0, 2.0, 0.0), DM4310.ranges)
        ),
    ):
        world.gripper.receive(world.now_s, frame)
    assert world.gripper.motor.status == Status.ENABLED
    return world


def _is_over(ending: Ending, world: World) -> bool:
    return ending.is_over(world.now_s)


def ended(world: World, caplog: pytest.LogCaptureFixture) -> tuple[bool, int, str]:
    """End the daemon; return what it returns, and the level and text of its last word."""
    ending = Ending(world.machine)
    ending.begin(world.now_s)
    world.run_until(lambda: ending.is_over(world.now_s), 5.0)
    with caplog.at_level(logging.INFO):
        is_well = ending.report()
    return is_well, caplog.records[-1].levelno, caplog.records[-1].getMessage()


def test_a_motor_that_confirmed_it_is_off(caplog: pytest.LogCaptureFixture) -> None:
    world = World()
    world.enabled()
    assert ended(world, caplog) == (True, logging.INFO, "ended; the motor is off (disabled)")


def test_a_motor_that_fell_silent_after_it_had_confirmed_is_off(
    caplog: pytest.LogCaptureFixture,
) -> None:
    world = World().start()
    world.lose_to_motor = lambda _frame: True
    world.run_until(lambda: world.phase is MotorPhase.SILENT, 5.0)
    assert ended(world, caplog) == (True, logging.INFO, "ended; the motor is off (silent)")


def test_clients_are_told_last_what_is_known_of_the_motor() -> None:
    confirmed, refusing, unheard = World(), left_enabled(), left_enabled()
    confirmed.enabled()
    refusing.lose_to_motor = lambda frame: frame.data == codec.DISABLE
    unheard.lose_to_motor = lambda _frame: True
    told = []
    for world in (confirmed, refusing, unheard):
        ending = Ending(world.machine)
        assert ending.parting() is None
        world.run(0.5)
        ending.begin(world.now_s)
        world.run_until(partial(_is_over, ending, world), 5.0)
        refusal = ending.parting()
        assert refusal is not None
        assert refusal.reason == "shutting_down"
        told.append((refusal.data["motor_off"], refusal.message.partition("; ")[2]))
    assert told == [
        (True, "the motor is off, and what was held falls"),
        (False, "the motor did not confirm that it is off: cut its power"),
        (False, "it is not known whether the motor is off: cut its power"),
    ]


def test_who_waits_for_a_motion_is_told_that_the_daemon_ends() -> None:
    world, client = enabled_world()
    running = client.send("motion.open")
    queued = client.send("motion.close", if_busy="queue")
    world.run(0.2)
    Ending(world.machine).begin(world.now_s)
    world.run(0.1)
    for number in (running, queued):
        assert reason_of(client.answered(number)) == "shutting_down"
    assert world.controller.jobs.running is None


@pytest.mark.parametrize("phase", [MotorPhase.DISABLING, MotorPhase.UNKNOWN])
def test_a_motor_that_was_found_enabled_and_does_not_let_go_is_told_of(
    phase: MotorPhase, caplog: pytest.LogCaptureFixture
) -> None:
    """Be its ranges known or not: its status tells that it is enabled."""
    world = left_enabled()
    reads_range = b"\x33\x15"
    world.lose_to_motor = lambda frame: (
        frame.data == codec.DISABLE
        or (phase is MotorPhase.UNKNOWN and frame.data[2:4] == reads_range)
    )
    world.run(0.5)
    assert (world.phase, world.state.enabled) == (phase, None)
    is_well, level, text = ended(world, caplog)
    assert world.gripper.motor.status == Status.ENABLED
    assert (is_well, level) == (False, logging.ERROR)
    assert "did not confirm that it is off" in text


def test_a_motor_that_never_answered_is_not_told_to_be_off(
    caplog: pytest.LogCaptureFixture,
) -> None:
    world = left_enabled()
    world.lose_to_motor = lambda _frame: True
    world.run(1.0)
    state = world.state
    assert (state.motor, state.enabled, state.stale) == ("silent", None, True)
    text = "ended; it is not known whether the motor is off (silent)"
    assert ended(world, caplog) == (True, logging.WARNING, text)


def test_a_motor_that_is_being_disabled_is_not_told_to_be_off_before_it_says_so() -> None:
    world, client = enabled_world()
    client.send("motor.disable")
    world.lose_to_motor = lambda frame: frame.data == codec.DISABLE
    world.run_until(lambda: world.phase is MotorPhase.DISABLING, 1.0)
    world.run(0.1)
    assert (world.state.enabled, world.state.status) == (None, "enabled")
    world.lose_to_motor = lambda _frame: False
    world.run_until(lambda: world.machine.is_disabled, 1.0)
    assert world.state.enabled is False


@pytest.mark.parametrize("is_kept", [False, True])
def test_a_recording_that_nobody_has_kept_is_said_to_be_lost(
    caplog: pytest.LogCaptureFixture, is_kept: bool
) -> None:
    world = World()
    client = world.enabled()
    client.result("trajectory.record_start")
    world.run(0.1)
    if is_kept:
        client.result("trajectory.record_stop", name="kept")
    assert ended(world, caplog)[0]
    is_said = "is lost: nobody has kept it" in caplog.text
    assert is_said is not is_kept
