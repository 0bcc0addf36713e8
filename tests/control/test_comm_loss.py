"""Motors that disarm themselves sooner or later than their register says, and report unasked.

What has been seen: 0.1, 0.4 and 0.9 s, with 8000 and with 0 in register TIMEOUT; motors that only
answer, and motors that also report about 10 times a second by themselves while they are enabled.
"""

import struct
from dataclasses import replace
from itertools import product

import pytest

from litegripd.app.machine import Machine
from litegripd.model.gripper import GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import CanFrame, MotorPhase, Status
from litegripd.motor.codec import TIMEOUT_UNIT_S
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from tests.properties import NIGHTLY, chosen
from tests.world import CAN_ID, PERIOD_S, Client, World, ready

LOSSES_S = [0.1, 0.4, 0.9]
UNASKED_HZ = [0.0, 10.0]
READS = [8000, 0, 2000]
every_motor = pytest.mark.parametrize(
    ("loss_s", "unasked_hz", "reads"), list(product(LOSSES_S, UNASKED_HZ, READS))
)
WORST = (0.1, 10.0, 8000)
"""Misses its daemon soonest, and says otherwise: it holds for a minute; at night each does."""
each_rate = pytest.mark.parametrize("unasked_hz", UNASKED_HZ)


def a_motor(loss_s: float, unasked_hz: float, reads: int = 8000) -> SimulatorParameters:
    watchdog_s = reads * TIMEOUT_UNIT_S
    return SimulatorParameters(watchdog_s=watchdog_s, comm_loss_s=loss_s, unasked_hz=unasked_hz)


def enabled(loss_s: float, unasked_hz: float, reads: int = 8000) -> tuple[World, Client]:
    """Let a client that hears every event enable such a motor."""
    world = World(parameters=a_motor(loss_s, unasked_hz, reads)).start()
    client = world.client()
    client.result("events.subscribe")
    assert client.result("motor.enable")["ok"]
    return world, client


def kinds(client: Client) -> list[str]:
    return [event["kind"] for event in client.events()]


@every_motor
def test_it_opens_closes_grips_and_holds(loss_s: float, unasked_hz: float, reads: int) -> None:
    world, client = enabled(loss_s, unasked_hz, reads)
    client.read()
    client.notifications.clear()
    before = replace(world.machine.motor.counters, commands=0)
    assert client.result("motion.open")["outcome"] == "pressed_home"
    assert client.result("motion.close")["outcome"] == "pressed_home"
    assert client.result("motion.open")["outcome"] == "pressed_home"
    world.gripper.put_object(width_mm=40.0)
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["outcome"] == "object_held"
    is_long = chosen() == NIGHTLY or (loss_s, unasked_hz, reads) == WORST
    world.run(60.0 if is_long else 5.0)
    assert world.state.is_grasped
    assert world.state.age_s == pytest.approx(PERIOD_S)
    counters = world.machine.motor.counters
    assert replace(counters, commands=0) == before
    assert set(kinds(client)) == {"job_started", "job_ended"}
    assert client.result("motor.disable")["ok"]
    assert world.gripper.motor.status == Status.DISABLED


def silence(world: World, duration_s: float) -> None:
    """Let the frames of both directions get lost for a while."""
    world.lose_to_motor = world.lose_from_motor = everything
    world.run(duration_s)
    world.lose_to_motor = world.lose_from_motor = nothing


def everything(_frame: CanFrame) -> bool:
    return True


def nothing(_frame: CanFrame) -> bool:
    return False


@each_rate
@pytest.mark.parametrize("loss_s", LOSSES_S)
def test_what_a_silence_leads_to_is_for_the_motor_to_say(loss_s: float, unasked_hz: float) -> None:
    world, client = enabled(loss_s, unasked_hz)
    client.send("motion.open")
    world.run(0.3)
    silence(world, 0.3)
    world.run(0.1)
    if loss_s > 0.3:
        assert world.in_phase(MotorPhase.ENABLED)
        assert world.state.mode == "holding"
    else:
        assert world.in_phase(MotorPhase.FAULT)
        assert world.state.status == "communication_lost"
        assert client.result("motor.enable")["ok"]
    assert client.result("motion.open")["outcome"] == "pressed_home"


def test_a_motor_that_reports_but_no_longer_hears_is_silent() -> None:
    """Its reports look like answers; without a watchdog it would go on for ever."""
    world, client = enabled(0.0, 10.0)
    moving = client.send("motion.open")
    world.run(0.3)
    world.lose_to_motor = everything
    since_s = world.now_s
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 0.05)
    seen = world.track(0.5, lambda: (world.phase, world.state.age_s or 0.0))
    phases, ages_s = zip(*seen, strict=True)
    assert set(phases) == {MotorPhase.SILENT}
    assert max(ages_s) < 0.12  # what it reports is a measurement
    assert client.has_answer(moving)
    assert client.answers[moving]["error"]["data"]["reason"] == "motor_silent"
    assert world.gripper.motor.status == Status.ENABLED
    assert client.refusal("motion.open") == "motor_silent"
    world.run(2.0)
    assert world.in_phase(MotorPhase.SILENT)
    assert kinds(client).count("bus") <= 1
    assert len(world.commands_since(since_s)) <= 14  # it is no answer, but takes its place once
    world.lose_to_motor = nothing
    world.run(0.5)
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.gripper.motor.status == Status.DISABLED


def test_a_motor_that_reports_but_no_longer_hears_is_not_said_to_be_disabled() -> None:
    world, client = enabled(0.0, 10.0)
    world.lose_to_motor = everything
    answer = client.call("motor.disable")
    assert answer["error"]["data"]["reason"] == "not_confirmed"
    assert "cut its power" in answer["error"]["message"]


@each_rate
@pytest.mark.parametrize("loss_s", LOSSES_S)
def test_when_the_daemon_dies_the_motor_disarms_itself_in_its_own_time(
    loss_s: float, unasked_hz: float
) -> None:
    world, _ = enabled(loss_s, unasked_hz, reads=0)
    died_s = world.now_s
    world.gripper.advance(died_s + loss_s - PERIOD_S)
    assert world.gripper.motor.status == Status.ENABLED
    world.gripper.advance(died_s + loss_s + PERIOD_S)
    assert world.gripper.motor.status == Status.COMMUNICATION_LOST
    unasked = world.gripper.take_unasked(died_s + 2.0)
    assert len(unasked) == pytest.approx(loss_s * unasked_hz, abs=1)  # disarmed, it says nothing


@each_rate
def test_a_daemon_that_follows_before_that_disables_the_motor(unasked_hz: float) -> None:
    world, _ = enabled(0.9, unasked_hz)
    world.now_s += 0.3
    world.advance()
    world.machine = Machine(GripperId(), None, MotionConfig(), PERIOD_S)
    world.run(0.3)
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.gripper.motor.status == Status.DISABLED


@each_rate
@pytest.mark.parametrize("reads", READS)
def test_a_single_false_status_is_left_out_beside_unasked_reports(
    unasked_hz: float, reads: int
) -> None:
    world, client = enabled(0.9, unasked_hz, reads)
    client.read()
    client.notifications.clear()
    for _ in range(50):
        world.inject(CanFrame(0x18, bytes([0xD << 4 | CAN_ID, *bytes.fromhex("79DA7FF7FF1E1E")])))
        world.run(0.065)
    assert world.in_phase(MotorPhase.ENABLED)
    assert not kinds(client)
    assert world.machine.motor.counters.implausible_frames == 50


@pytest.mark.parametrize("period_s", [0.010, 0.002, 0.001])
def test_unasked_reports_are_plausible_at_any_rate_of_ticks(period_s: float) -> None:
    world, client = ready(parameters=a_motor(0.1, 37.0), period_s=period_s)
    for method in ("motion.open", "motion.close"):
        answer = client.result(method, speed_mm_s=60.0)
        assert answer["outcome"] == "pressed_home"
    counters = world.machine.motor.counters
    assert (counters.implausible_frames, counters.missed_replies) == (0, 0)


class Forgetful(SimulatedGripper):
    """Its register TIMEOUT does not take: whatever is written, it holds what it held."""

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        if frame.data[2:4] == bytes((0x55, 9)):
            held = round(self.parameters.watchdog_s / TIMEOUT_UNIT_S)
            frame = CanFrame(frame.can_id, frame.data[:4] + struct.pack("<I", held))
        return super().receive(now_s, frame)


class ForgetfulWorld(World):
    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        return Forgetful(parameters)


@pytest.mark.parametrize(("units", "read"), [(0, "reads 0 (off)"), (20_000, "reads 20000 (1 s)")])
def test_a_motor_on_which_the_register_does_not_take_is_not_enabled(units: int, read: str) -> None:
    world = ForgetfulWorld(parameters=a_motor(0.9, 10.0, units)).start()
    error = world.client().call("motor.enable")["error"]
    assert error["data"]["reason"] == "motor_unsuitable"
    assert error["data"]["value"] == units
    assert f"TIMEOUT, its watchdog, {read} after 2000 (100 ms) was written" in error["message"]
    assert world.gripper.motor.status == Status.DISABLED
