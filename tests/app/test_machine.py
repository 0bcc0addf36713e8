"""The machine: what it knows of the motor's power, a bus that is down, and a job that fails."""

from typing import Any

import pytest

from litegripd.model.motor import BusCondition, CanFrame, MotorInput, MotorPhase, Status
from tests.world import PERIOD_S, World, enabled_world, found_world, reason_of


def broken(*_arguments: Any, **_keywords: Any) -> Any:
    raise ZeroDivisionError("a defect")


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
    world, client = enabled_world()
    assert client.result("motor.disable")["ok"]
    assert not silent(world).machine.may_be_energised


def test_a_bus_that_is_down_is_the_reason_that_clients_are_told() -> None:
    world, client = found_world()
    world.condition = BusCondition("link_down", "Network is down")
    world.lose_to_motor = lambda _frame: True
    world.tick()
    assert client.refusal("motor.enable") == "bus_down"
    world.run_until(lambda: world.machine.is_out_of_reach, 5.0)
    answer = client.call("motion.open")
    assert answer["error"]["data"]["reason"] == "bus_down"
    assert "Network is down" in answer["error"]["message"]


@pytest.mark.parametrize("fails", ["once", "always"])
def test_a_job_whose_action_fails_ends_at_once_and_the_jaws_hold(
    fails: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    world, client = enabled_world()
    motion = client.send("motion.open")
    world.run(0.5)
    kind: Any = type(world.controller.action)
    step: Any = kind.step
    calls: list[Any] = []

    def failing(*arguments: Any) -> Any:
        calls.append(arguments)
        return (broken if fails == "always" or len(calls) == 1 else step)(*arguments)

    monkeypatch.setattr(kind, "step", failing)
    failed_s, before_mm = world.now_s, world.gripper.opening_mm
    with pytest.raises(ZeroDivisionError):
        world.tick()
    world.run(1.0)
    error = client.answered(motion)["error"]
    assert error["data"]["reason"] == "internal_error"
    assert "open failed by a defect: ZeroDivisionError: a defect" in error["message"]
    assert (world.state.mode, world.state.job) == ("holding", None)
    assert world.gripper.motor.status == Status.ENABLED
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=3.0)
    assert world.longest_gap_s(failed_s - PERIOD_S) < 2.5 * PERIOD_S
    assert len(calls) == 1


def test_a_disabling_that_fails_disables_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    world, client = enabled_world()
    disabling = client.send("motor.disable")
    monkeypatch.setattr(type(world.controller.action), "step", broken)
    with pytest.raises(ZeroDivisionError):
        world.tick()
    world.run_until(lambda: world.machine.is_disabled, 1.0)
    assert reason_of(client.answered(disabling)) == "internal_error"
    assert world.gripper.motor.status == Status.DISABLED


def test_a_queued_motion_that_fails_to_begin_ends_and_the_next_one_is_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, client = enabled_world()
    motion = client.send("motion.open")
    queued = client.send("motion.close", if_busy="queue")
    with monkeypatch.context() as patch:
        patch.setattr(world.controller, "begin", broken)
        with pytest.raises(ZeroDivisionError):
            world.run(20.0)
    world.run(0.1)
    assert client.has_answer(motion)
    assert reason_of(client.answered(queued)) == "internal_error"
    jobs = {job.number: job.state for job in world.controller.jobs}
    other = world.client().result("motion.close", wait=False)["job"]
    assert other not in jobs


def test_a_disabling_that_is_due_in_a_tick_that_fails_is_not_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World()
    world.enabled()
    motor, step = world.machine.motor, world.machine.motor.step
    fails = [True]

    def failing(now_s: float, order: MotorInput) -> list[CanFrame]:
        if fails.pop() if fails else False:
            raise RuntimeError("a defect")
        return step(now_s, order)

    world.client().send("stop", level="disable")
    monkeypatch.setattr(motor, "step", failing)
    with pytest.raises(RuntimeError):
        world.tick()
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)
