"""A gripper at rest is no alarm: verdict, journal and dumps are quiet until somebody misses it."""

import logging
from collections.abc import Callable
from dataclasses import replace

import pytest

from litegripd.app.status import log_event
from litegripd.model.motor import UP, BusCondition, BusState, MotorPhase, Status
from litegripd.model.state import Event
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.app.test_facts import judged, verdict
from tests.world import World, enabled_world, found_world

CLOSED_RAD, OPEN_RAD = limits_of_mount("normal")
NOMINAL = SimulatorParameters(closed_rad=CLOSED_RAD, open_rad=OPEN_RAD)
BENCH = replace(NOMINAL, idle_loss_s=0.9)
"""As on the vendor's bench: after 0.9 s of silence a disabled motor shows a communication loss."""
SLOW_S = 0.01
"""A long period, for scenes that last for minutes: a dump waits for two."""


def notes(world: World) -> list[str]:
    return judged(world).notes()


def keep_journal(world: World) -> None:
    """Let a world's events be logged as the daemon logs them."""
    record = world.service.on_event

    def on_event(event: Event, now_s: float) -> None:
        record(event, now_s)
        log_event(event, "can0")

    world.service.on_event = on_event


def warned(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.message for record in caplog.records if record.levelno > logging.INFO]


def lost_communication(world: World) -> None:
    world.gripper.latch_fault(Status.COMMUNICATION_LOST)


def no_supply(world: World) -> None:
    world.gripper.set_supply(0.0)


def no_power(world: World) -> None:
    world.gripper.power_off()


def nobody_acknowledges(world: World) -> None:
    world.condition = BusCondition("bus_stalled", "frames wait")
    world.lose_to_motor = lambda _frame: True


RESTS = [lost_communication, no_supply, no_power, nobody_acknowledges]


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("before", ["nothing", "found", "used"])
def test_a_gripper_at_rest_is_no_alarm(
    rest: Callable[[World], None], before: str, caplog: pytest.LogCaptureFixture
) -> None:
    world = World()
    keep_journal(world)
    if before != "nothing":
        client = world.start().client()
        if before == "used":
            client.result("motor.enable")
            client.result("motor.disable")
    rest(world)
    world.run(3.0)
    assert verdict(world) == ("ok", [])
    (note,) = notes(world)
    assert "normal" in note or "24 V" in note
    assert world.disk.dumps == []
    assert warned(caplog) == []


def test_a_motor_that_latches_it_again_and_again_is_disabled_all_the_while() -> None:
    world, client = found_world(parameters=BENCH, period_s=SLOW_S)
    client.result("events.subscribe", kinds=["motor"])
    world.run(3.0)
    assert (world.state.motor, world.state.status) == ("disabled", "communication_lost")
    for _ in range(3):
        assert client.result("motor.enable")["ok"]
        assert client.result("motion.open")["ok"]
        assert client.result("motor.disable")["ok"]
        world.run(3.0)
        assert verdict(world) == ("ok", [])
        assert "latched" in notes(world)[0]
        assert (world.state.motor, world.state.enabled) == ("disabled", False)
    client.read()
    assert not [n for n in client.notifications if "fault" in str(n["params"])]
    world.run(130.0)
    assert world.disk.dumps == []


def test_a_motion_at_rest_is_refused_because_nothing_is_enabled() -> None:
    world = World(parameters=BENCH).start()
    world.run(2.0)
    assert world.client().refusal("motion.open") == "not_enabled"
    assert verdict(world) == ("ok", [])


@pytest.mark.parametrize("status", [Status.COMMUNICATION_LOST, Status.UNDER_VOLTAGE])
def test_the_same_in_an_enabled_motor_is_a_loss_until_it_is_disabled(status: Status) -> None:
    world, client = enabled_world(period_s=SLOW_S)
    world.gripper.latch_fault(status)
    world.run(3.0)
    assert world.in_phase(MotorPhase.FAULT)
    assert verdict(world)[0] == "down"
    assert len(world.disk.dumps) == 1
    client.result("motor.disable")
    world.run(130.0)
    assert world.in_phase(MotorPhase.DISABLED)
    assert verdict(world) == ("ok", [])
    assert len(world.disk.dumps) == 1
    assert client.result("motor.enable")["ok"]


def test_a_loss_that_is_found_after_a_long_silence_is_still_a_loss() -> None:
    world = World()
    world.enabled()
    world.condition = BusCondition("adapter_gone", "unplugged")
    world.lose_to_motor = lambda _frame: True
    world.run(30.0)
    assert verdict(world)[0] == "down"
    world.condition, world.lose_to_motor = UP, lambda _frame: False
    world.run(1.0)
    assert world.state.status == "communication_lost"
    assert world.in_phase(MotorPhase.FAULT)
    assert verdict(world)[0] == "down"


def test_a_motor_that_falls_silent_while_enabled_is_missed_until_it_says_that_it_is_off() -> None:
    world = World()
    world.enabled()
    world.gripper.power_off()
    world.run(30.0)
    told, reasons = verdict(world)
    assert told == "down"
    assert "does not answer" in reasons[0]
    world.gripper.power_on()
    world.run(2.0)
    assert verdict(world) == ("ok", [])


@pytest.mark.parametrize("rest", [no_power, nobody_acknowledges])
def test_a_request_that_fails_for_it_makes_it_an_alarm_until_the_motor_is_back(
    rest: Callable[[World], None],
) -> None:
    world = World().start()
    rest(world)
    world.run(2.0)
    assert world.client().refusal("motor.enable") in ("motor_silent", "bus_down")
    world.run(60.0)
    assert verdict(world)[0] == "down"
    assert notes(world) == []
    world.gripper.power_on()
    world.condition, world.lose_to_motor = UP, lambda _frame: False
    world.run(2.0)
    assert verdict(world) == ("ok", [])


@pytest.mark.parametrize("remedy", ["supply", "disable"])
def test_no_supply_is_an_alarm_once_somebody_wants_to_enable(remedy: str) -> None:
    world, client = found_world()
    no_supply(world)
    world.run(2.0)
    error = client.call("motor.enable")["error"]
    assert (error["data"]["reason"], error["data"]["status"]) == ("motor_fault", "under_voltage")
    world.run(10.0)
    told, (reason,) = verdict(world)
    assert (told, reason) == ("down", error["message"])
    if remedy == "supply":
        world.gripper.set_supply(24.0)
        assert client.result("motor.enable")["ok"]
    else:
        assert client.result("motor.disable")["ok"]
        world.run(1.0)
    assert verdict(world) == ("ok", [])


def test_whoever_has_the_lease_misses_a_silent_motor() -> None:
    world, client = found_world()
    client.result("lease.acquire", ttl_s=60.0)
    no_power(world)
    world.run(1.0)
    assert verdict(world)[0] == "down"
    client.result("lease.release")
    world.run(1.0)
    assert verdict(world) == ("ok", [])


@pytest.mark.parametrize("state", ["link_down", "adapter_gone", "bus_off", "down"])
def test_a_bus_that_somebody_must_mend_is_told_at_rest_but_is_no_alarm(state: BusState) -> None:
    world = World().start()
    world.condition = BusCondition(state, "as the test wants it")
    world.lose_to_motor = lambda _frame: True
    world.run(2.0)
    told, reasons = verdict(world)
    assert told == "degraded"
    assert state in reasons[0]


@pytest.mark.parametrize("status", [Status.OVER_VOLTAGE, Status.OVER_CURRENT, Status.COIL_HOT])
def test_any_other_fault_is_one_at_rest_as_well_but_is_not_dumped(status: Status) -> None:
    world = World(period_s=SLOW_S).start()
    world.gripper.latch_fault(status)
    world.run(130.0 if status is Status.OVER_VOLTAGE else 5.0)
    assert world.in_phase(MotorPhase.FAULT)
    assert verdict(world)[0] == "down"
    assert world.disk.dumps == []


def test_what_was_latched_at_rest_can_be_cleared_without_enabling() -> None:
    world, client = found_world()
    client.result("events.subscribe", kinds=["motor"])
    lost_communication(world)
    world.run(1.0)
    assert client.result("motor.clear_fault")["cleared"] == "communication_lost"
    assert world.state.status == "disabled"
    client.read()
    assert not [n for n in client.notifications if "fault" in str(n["params"])]
    assert notes(world) == []


def test_clearing_at_rest_says_when_the_cause_is_still_there() -> None:
    world = World().start()
    no_supply(world)
    world.run(1.0)
    client = world.client()
    error = client.call("motor.clear_fault")["error"]
    assert (error["data"]["reason"], error["data"]["status"]) == ("motor_fault", "under_voltage")
    world.gripper.set_supply(24.0)
    assert client.result("motor.clear_fault")["cleared"] == "under_voltage"
    assert client.result("motor.clear_fault")["cleared"] is None


def test_a_new_zero_is_set_at_rest_after_what_was_latched_is_cleared() -> None:
    world = World().start()
    lost_communication(world)
    world.run(1.0)
    assert world.client().result("motor.set_zero")["ok"]
    no_supply(world)
    world.run(1.0)
    assert world.client().refusal("motor.set_zero") == "motor_fault"
