"""When the flight recorder is dumped: on a fault, a defect, a lost bus, on demand."""

import pytest

from litegripd.model.motor import BusCondition, MotorPhase
from litegripd.recorder.recorder import AFTER_S, APART_S
from tests.world import PERIOD_S, Client, World, ready


def watching(world: World) -> Client:
    client = world.client()
    client.result("events.subscribe", kinds=["recorder"])
    return client


def reported(client: Client) -> list[dict[str, object]]:
    return [event["data"] for event in client.events()]


def causes(observer: Client) -> list[object]:
    return [event["cause"] for event in reported(observer)]


def fault(world: World) -> None:
    """Let the motor report an over-voltage, which is over soon; the fault is latched."""
    world.gripper.set_supply(40.0)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 1.0)
    world.gripper.set_supply(24.0)


def recover(world: World, client: Client) -> None:
    assert client.result("motor.enable")["ok"]


def test_a_fault_is_dumped_once_with_what_came_before_and_after() -> None:
    world, client = ready()
    observer = watching(world)
    client.send("motion.open")
    world.run(0.2)
    fault(world)
    at_s = world.now_s
    world.run_until(lambda: bool(world.disk.dumps), 2.0)
    assert world.now_s - at_s == pytest.approx(AFTER_S, abs=2 * PERIOD_S)
    (dump,) = world.disk.dumps
    assert dump.ticks[0].at_s < at_s - 0.2
    assert dump.ticks[-1].at_s > at_s + 0.9
    assert "motor" in [event.content["kind"] for event in dump.events]
    world.run(2.0 * APART_S)
    assert len(world.disk.dumps) == 1
    (event,) = reported(observer)
    assert event == {"cause": "motor_fault", "path": "/state/dumps/1"}


def test_a_fault_soon_after_a_dump_waits_and_is_still_in_the_next_one() -> None:
    world, client = ready()
    fault(world)
    world.run_until(lambda: bool(world.disk.dumps), 2.0)
    first_s = world.disk.dumps[0].ticks[-1].at_s
    recover(world, client)
    fault(world)
    second_s = world.now_s
    world.run_until(lambda: len(world.disk.dumps) == 2, 70.0)
    assert world.now_s - first_s == pytest.approx(APART_S, abs=3 * PERIOD_S)
    assert world.disk.dumps[1].ticks[0].at_s < second_s - 1.0


def test_a_fault_that_the_motor_had_already_or_does_not_lose_is_no_new_one() -> None:
    world = World()
    world.gripper.set_supply(40.0)
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 2.0)
    client = world.client()
    assert client.refusal("motor.enable", retries=1) == "motor_fault"
    world.run_until(lambda: world.in_phase(MotorPhase.FAULT), 5.0)
    world.run(3.0)
    assert world.disk.dumps == []


def test_a_bus_that_is_lost_while_the_motor_is_enabled_is_dumped() -> None:
    world = World()
    world.enabled()
    observer = watching(world)
    world.condition = BusCondition("link_down", "Network is down")
    world.lose_to_motor = lambda _frame: True
    world.run(3.0)
    assert causes(observer) == ["bus_lost"]


def test_a_lost_bus_is_not_told_once_more_as_a_silent_motor() -> None:
    world = World()
    world.enabled()
    world.condition = BusCondition("link_down", "Network is down")
    world.lose_to_motor = lambda _frame: True
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 1.0)
    world.run(0.5)
    world.dumps.finish(world.now_s)
    assert [task.parameters["note"] for task in world.controller.tasks] == ["bus_lost"]


def test_a_bus_that_is_lost_while_the_motor_is_off_is_not() -> None:
    world = World().start()
    world.condition = BusCondition("link_down", "Network is down")
    world.lose_to_motor = lambda _frame: True
    world.run(3.0)
    assert world.disk.dumps == []


def test_a_defect_that_stays_is_dumped_once() -> None:
    world = World().start()
    observer = watching(world)
    for _ in range(round(2 * APART_S / PERIOD_S)):
        world.tick()
        world.dumps.step(world.now_s, failed=True, bus_is_up=True)
    assert causes(observer) == ["tick_error"]
    world.run(APART_S + 1.0)
    world.dumps.step(world.now_s, failed=True, bus_is_up=True)
    world.run(2.0)
    assert len(reported(observer)) == 2


def test_a_dump_is_told_to_who_asked_and_to_who_watches() -> None:
    world = World().start()
    observer, client = watching(world), world.client()
    result = client.result("recorder.dump", note="why not")
    assert result["path"] == "/state/dumps/1"
    assert result["ticks"] == len(world.disk.dumps[0].ticks) > 10
    assert result["seconds"] == pytest.approx((result["ticks"] - 1) * PERIOD_S)
    world.tick()
    assert reported(observer) == [{"cause": "demand", "path": "/state/dumps/1"}]


def test_one_dump_is_written_at_a_time() -> None:
    world = World().start()
    client = world.client()
    first = client.send("recorder.dump")
    assert client.refusal("recorder.dump") == "too_many_requests"
    client.wait(first)
    assert client.result("recorder.dump")["ticks"]


def test_a_fault_while_a_dump_is_written_is_dumped_after_it() -> None:
    world, client = ready()
    fault(world)
    world.run(AFTER_S - 2 * PERIOD_S)
    client.send("recorder.dump")
    world.run(0.1)
    assert len(world.disk.dumps) == 2


def test_a_disk_that_fails_is_told_and_ends_nothing() -> None:
    world, client = ready()
    observer = watching(world)
    world.disk.error = "OSError: no space left"
    answer = client.call("recorder.dump")
    assert answer["error"]["data"]["reason"] == "not_saved"
    assert "no space left" in answer["error"]["message"]
    fault(world)
    world.run(2.0)
    causes = [(event["cause"], event["error"]) for event in reported(observer)]
    assert causes == [(cause, "OSError: no space left") for cause in ("demand", "motor_fault")]
    world.disk.error = None
    assert client.result("recorder.dump")["ticks"]


def test_what_is_still_due_is_asked_for_at_the_end() -> None:
    world = World()
    world.enabled()
    world.dumps.finish(world.now_s)
    assert world.controller.tasks == []
    fault(world)
    world.dumps.finish(world.now_s)
    (task,) = world.controller.tasks
    assert task.parameters == {"cause": "motor_fault", "note": "motor_fault"}


def test_an_observer_may_not_ask_for_a_dump() -> None:
    world = World().start()
    client = world.client()
    client.session.role = "observer"
    assert client.refusal("recorder.dump") == "not_permitted"


def test_the_last_frames_to_a_bus_that_is_lost_are_recorded() -> None:
    world = World()
    world.enabled()
    world.lose_to_motor = lambda _frame: True
    world.condition = BusCondition("link_down", "Network is down")
    world.tick()
    last = world.sent[-1]
    world.run(2.0)
    (dump,) = world.disk.dumps
    assert {tick.at_s: tick.sent for tick in dump.ticks}[last.at_s] == last.frame.data
