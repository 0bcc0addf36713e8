"""The bus's states by name, as clients see them: reported once a change, and recovered from."""

from typing import Any

import pytest

from litegripd.model.gripper import GripperId
from litegripd.model.motor import NOT_OPENED, UP, BusCondition, BusState, MotorPhase, remedy
from litegripd.motor import codec
from tests.world import CAN_ID, Client, World, ready

DOWN: tuple[BusState, ...] = ("link_down", "adapter_gone", "bus_off", "bus_stalled", "down")


def bus_events(client: Client) -> list[dict[str, Any]]:
    reported = client.events()
    return [event["data"] for event in reported if event["kind"] == "bus"]


def cut(world: World, state: BusState) -> None:
    world.condition = BusCondition(state, "as the test wants it")
    world.lose_to_motor = lambda _frame: True


def repair(world: World) -> None:
    world.condition = UP
    world.lose_to_motor = lambda _frame: False


@pytest.mark.parametrize("state", DOWN)
def test_a_bus_that_fails_while_holding_is_told_refused_and_recovered_from(state: BusState) -> None:
    world, client = ready()
    client.result("motion.move", opening_mm=60)
    client.result("events.subscribe")
    before_mm = world.gripper.opening_mm
    cut(world, state)
    world.run(2.0)
    assert (world.state.bus, world.state.stale, world.state.mode) == (state, True, "offline")
    error = client.call("motion.open")["error"]
    assert error["data"]["reason"] == "bus_down"
    assert error["data"]["bus"] == state
    repair(world)
    world.run_until(lambda: world.machine.is_disabled, 2.0)
    world.run(1.0)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.2)
    assert client.refusal("motion.open") in ("motor_fault", "not_enabled")
    assert client.result("motor.enable")["ok"]
    assert client.result("motion.open")["ok"]
    states = [data["state"] for data in bus_events(client)]
    assert states[0] == state
    assert states[-1] == "up"
    assert len(states) <= 3  # with motor_silent between


def test_a_silent_motor_on_a_bus_that_works_is_a_state_of_its_own() -> None:
    world = World().start()
    client = world.client()
    client.result("events.subscribe")
    world.lose_to_motor = lambda _frame: True
    world.run(2.0)
    assert world.state.bus == "motor_silent"
    assert client.refusal("motor.enable") == "motor_silent"
    repair(world)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 2.0)
    assert [data["state"] for data in bus_events(client)] == ["motor_silent", "up"]


def test_errors_that_change_while_the_state_does_not_are_told_once() -> None:
    world = World().start()
    client = world.client()
    client.result("events.subscribe")
    for number in range(100):
        world.condition = BusCondition("adapter_gone", f"error {number}")
        world.tick()
    assert len(bus_events(client)) == 1
    assert "error 99" in str(world.controller.bus.error)


def test_a_bus_that_cannot_be_opened_from_the_start_is_told_once() -> None:
    world = World()
    client = world.client()
    client.result("events.subscribe")
    world.lose_to_motor = lambda _frame: True
    world.condition = NOT_OPENED
    world.run(0.1)
    assert bus_events(client) == []
    for number in range(100):
        world.condition = BusCondition("down", f"cannot be opened: error {number}")
        world.tick()
    [reported] = bus_events(client)
    assert (reported["state"], reported["error"]) == ("down", "cannot be opened: error 0")
    repair(world)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 2.0)
    assert [data["state"] for data in bus_events(client)][-1] == "up"


def test_nothing_that_arms_is_sent_to_a_bus_that_does_not_answer() -> None:
    """An enable frame that lies in a queue would arm the motor when the bus comes back."""
    world = World().start()
    client = world.client()
    number = client.send("motor.enable", retries=20)
    world.run_until(lambda: world.in_phase(MotorPhase.ENABLING), 1.0)
    world.run_until(lambda: world.sent[-1].frame.data == codec.ENABLE, 1.0)
    world.lose_to_motor = lambda _frame: True
    world.lose_from_motor = lambda _frame: True
    world.run(0.03)
    since_s = world.now_s
    client.wait(number, 10.0)
    to_motor = [s for s in world.sent if s.frame.can_id == CAN_ID and s.at_s > since_s]
    assert {s.frame.data for s in to_motor} <= {codec.DISABLE}


@pytest.mark.parametrize("opens_after_s", [0.1, 0.2, 3.0])
def test_a_motor_is_not_called_silent_because_the_bus_took_long_to_open(
    opens_after_s: float,
) -> None:
    world = World()
    client = world.client()
    client.result("events.subscribe")
    cut(world, "down")
    world.run(opens_after_s)
    repair(world)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 2.0)
    assert [data["state"] for data in bus_events(client)] == ["down", "up"]


@pytest.mark.parametrize("state", DOWN)
@pytest.mark.parametrize("was_enabled", [False, True])
@pytest.mark.parametrize("lost_s", [0.05, 0.5, 2.0])
def test_a_motor_that_was_lost_with_the_bus_is_asked_before_it_is_called_silent(
    state: BusState, was_enabled: bool, lost_s: float
) -> None:
    world = World()
    client = world.enabled() if was_enabled else world.start().client()
    client.result("events.subscribe")
    cut(world, state)
    world.run(lost_s)
    repair(world)
    world.run_until(lambda: not (world.machine.is_out_of_reach or world.state.stale), 2.0)
    assert [data["state"] for data in bus_events(client)] == [state, "up"]


def test_a_motor_that_does_not_answer_is_called_silent_soon_after_the_bus_has_opened() -> None:
    world = World()
    cut(world, "down")
    world.run(3.0)
    world.condition = UP
    world.run(0.1)
    assert (world.state.bus, world.state.mode) == ("up", "offline")
    world.run_until(lambda: world.state.bus == "motor_silent", 0.15)


def test_a_motor_that_was_enabled_and_has_lost_its_power_meanwhile_is_soon_called_silent() -> None:
    world = World()
    world.enabled()
    cut(world, "down")
    world.run(0.5)
    world.condition = UP
    world.tick()
    assert world.state.bus == "up"
    assert world.in_phase(MotorPhase.SILENT)
    world.run_until(lambda: world.state.bus == "motor_silent", 0.03)


def test_a_motor_that_was_silent_before_the_bus_was_lost_is_so_when_it_is_back() -> None:
    world = World().start()
    world.lose_to_motor = lambda _frame: True
    world.run(1.0)
    assert world.state.bus == "motor_silent"
    world.condition = BusCondition("link_down", "as the test wants it")
    world.run(1.0)
    world.condition = UP
    world.tick()
    assert world.state.bus == "motor_silent"


def test_a_motor_that_was_lost_with_the_bus_for_a_moment_is_neither_found_anew_nor_stiff() -> None:
    """A hand may be between jaws that were slack."""
    world, client = ready()
    client.result("stop", level="relax")
    world.run(0.05)
    cut(world, "link_down")
    world.run(0.05)
    assert world.in_phase(MotorPhase.SILENT)
    repair(world)
    phases = set()
    while not world.in_phase(MotorPhase.ENABLED):
        phases.add(world.phase)
        world.tick()
        assert len(phases) == 1
    assert phases == {MotorPhase.SILENT}
    assert world.state.mode == "relaxed"


@pytest.mark.parametrize(
    ("state", "commands"),
    [
        ("link_down", "sudo ip link set left up type can bitrate 1000000"),
        ("bus_off", "sudo ip link set left down && sudo ip link set left up"),
    ],
)
def test_the_commands_that_are_reported_name_the_interface_and_suit_any_driver(
    state: BusState, commands: str
) -> None:
    """Those without a restart after bus-off refuse `restart-ms`, and one by hand as well."""
    world = World()
    world.controller.gripper_id = GripperId("arm", "left")
    client = world.start().client()
    client.result("events.subscribe")
    cut(world, state)
    world.run(0.1)
    [reported] = bus_events(client)
    assert reported["hint"].endswith(f": {commands}")
    error = client.call("motor.enable")["error"]
    assert error["data"]["hint"] == reported["hint"]
    assert commands in error["message"]


def test_a_virtual_bus_has_no_bit_rate_to_be_set() -> None:
    assert remedy("link_down", "vcan0") == "bring the link up: sudo ip link set vcan0 up"
    assert remedy("up", "can0") is None
    assert "set 'a b' down" in str(remedy("bus_off", "a b"))


def test_a_serial_adapter_is_looked_for_where_serial_adapters_are() -> None:
    gone = str(remedy("adapter_gone", "/dev/ttyACM0@115200"))
    assert "correct [bus] channel ('ls -l /dev/serial/by-id/' lists serial adapters)" in gone
    for state in DOWN:
        told = str(remedy(state, "/dev/ttyACM0"))
        assert "ip link" not in told
        assert "type can" not in told
