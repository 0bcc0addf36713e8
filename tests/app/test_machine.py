"""The machine: what it knows of the motor's power, and what a bus that is down explains."""

from litegripd.model.bus import BusCondition
from tests.world import World


def silent(world: World) -> World:
    """Let the motor fall silent."""
    world.lose_to_motor = lambda _frame: True
    world.run_until(lambda: world.machine.is_out_of_reach, 5.0)
    return world


def test_a_motor_that_was_never_enabled_is_not_in_doubt() -> None:
    assert not silent(World().start()).machine.may_be_energised


def test_a_motor_that_fell_silent_while_enabled_is_in_doubt_until_it_says_that_it_is_off() -> None:
    world = World()
    world.enabled()
    assert silent(world).machine.may_be_energised
    world.run(0.3)  # the motor's own watchdog has disarmed it by now
    world.lose_to_motor = lambda _frame: False
    world.run_until(lambda: world.machine.is_disabled, 5.0)
    assert not world.machine.may_be_energised


def test_a_motor_that_confirmed_that_it_is_off_and_then_fell_silent_is_not_in_doubt() -> None:
    world = World()
    client = world.enabled()
    assert client.result("motor.disable")["ok"]
    assert not silent(world).machine.may_be_energised


def test_a_bus_that_is_down_is_the_reason_that_clients_are_told() -> None:
    world = World().start()
    client = world.client()
    world.condition = BusCondition("link_down", "Network is down")
    world.lose_to_motor = lambda _frame: True
    world.tick()
    assert client.refusal("motor.enable") == "bus_down"
    world.run_until(lambda: world.machine.is_out_of_reach, 5.0)
    answer = client.call("motion.open")
    assert answer["error"]["data"]["reason"] == "bus_down"
    assert "Network is down" in answer["error"]["message"]
