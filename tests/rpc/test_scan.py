"""Other ids are asked for a motor, but only while nothing depends on the bus."""

from dataclasses import replace

import pytest

from litegripd.model.motor import BusCondition, MotorPhase
from litegripd.motor.codec import MASTER_ID, read_request
from litegripd.motor.exchange import LOST_GIVES_UP_S
from litegripd.sim.plant import SimulatorParameters
from tests.world import World, enabled_world, found_world, reason_of

ASKED = list(range(1, 17))


def at(can_id: int, master_id: int = 0x18) -> World:
    """Return a world whose motor has these ids; the daemon expects it at 0x08."""
    return World(parameters=replace(SimulatorParameters(), can_id=can_id, master_id=master_id))


@pytest.mark.parametrize(
    ("can_id", "master_id"), [(1, 0x11), (7, 0x18), (9, 0x18), (9, 0x08), (16, 0), (8, 0x18)]
)
def test_a_motor_at_another_id_is_found_where_it_is(can_id: int, master_id: int) -> None:
    world = at(can_id, master_id)
    world.run(0.5)
    assert world.client().result("motor.scan") == {
        "asked": ASKED,
        "found": [{"can_id": can_id, "master_id": master_id}],
    }


def test_a_motor_that_is_found_by_its_configured_id_is_known_as_before() -> None:
    world, client = found_world()
    before = client.result("state.get")["position_rad"]
    ignored = world.machine.motor.counters.ignored_frames
    began_s = world.now_s
    assert client.result("motor.scan")["found"] == [{"can_id": 8, "master_id": 0x18}]
    assert world.now_s - began_s < 1.5
    assert client.result("state.get")["position_rad"] == pytest.approx(before)
    client.result("motor.enable")
    assert world.phase is MotorPhase.ENABLED
    assert world.machine.motor.counters.ignored_frames - ignored <= 2
    assert world.machine.motor.counters.foreign_commands == 0


def test_nothing_is_found_on_an_empty_bus() -> None:
    world = World()
    world.gripper.power_off()
    world.run(1.0)
    assert world.client().result("motor.scan") == {"asked": ASKED, "found": []}


def test_each_id_is_asked_at_0x7ff_for_its_mst_id_and_nothing_else_is_sent_to_it() -> None:
    world = at(40)
    world.run(0.5)
    before = len(world.sent)
    world.client().result("motor.scan")
    sent = [one.frame for one in world.sent[before:]]
    for can_id in ASKED:
        asked = [frame for frame in sent if frame == read_request(can_id, MASTER_ID)]
        assert len(asked) >= 2
    assert {frame.can_id for frame in sent} == {0x7FF}


def test_while_the_motor_is_enabled_no_other_id_is_asked() -> None:
    world, client = enabled_world()
    before = len(world.sent)
    error = client.call("motor.scan")["error"]
    assert (error["data"]["reason"], "disable it first" in error["message"]) == ("busy", True)
    assert all(one.frame.can_id != 0x7FF or one.frame.data[0] == 8 for one in world.sent[before:])
    client.result("motor.disable")
    assert client.result("motor.scan")["found"]


def test_one_that_was_enabled_and_fell_silent_is_given_the_time_to_let_go() -> None:
    """After LOST_GIVES_UP_S its own watchdog has disarmed it; then it is looked for."""
    world, client = enabled_world()
    world.lose_from_motor = lambda _frame: True
    world.run(LOST_GIVES_UP_S / 2.0)
    assert client.refusal("motor.scan") == "busy"
    world.run(LOST_GIVES_UP_S)
    assert client.result("motor.scan")["found"] == []


def test_who_enables_the_motor_meanwhile_ends_it() -> None:
    world = World().start()
    scanning, enabling = world.client(), world.client()
    number = scanning.send("motor.scan")
    world.run(0.1)
    enabling.result("motor.enable")
    assert world.phase is MotorPhase.ENABLED
    assert reason_of(scanning.answered(number)) == "busy"


def test_without_a_bus_nothing_is_asked() -> None:
    world = World().start()
    world.condition = BusCondition("link_down", "the link is down")
    world.tick()
    assert world.client().refusal("motor.scan") == "bus_down"


def test_who_may_only_read_may_not_scan() -> None:
    client = World().start().client(role="observer")
    assert client.refusal("motor.scan") == "not_permitted"
