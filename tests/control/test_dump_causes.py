"""What makes the daemon dump by itself though no motor faults: silence, reset, jump, stranger."""

import pytest

from litegripd.model.motor import CanFrame, MotorPhase
from litegripd.model.state import TaskResult
from litegripd.motor import codec
from litegripd.recorder.recorder import APART_S
from tests.control.test_dumps import causes, recover, watching
from tests.world import CAN_ID, World, ready

SLOW_S = 0.01
"""The slowest control rate: these scenes wait for minutes."""

FOREIGN = CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF"))


def until_dumped(world: World, count: int) -> None:
    world.run_until(lambda: len(world.disk.dumps) == count, 70.0)


def lose_frames(world: World, duration_s: float) -> None:
    world.lose_to_motor = lambda _frame: True
    world.run(duration_s)
    world.lose_to_motor = lambda _frame: False


def test_an_enabled_motor_that_is_switched_off_is_dumped_each_time_it_was_enabled() -> None:
    world, client = ready(period_s=SLOW_S)
    observer = watching(world)
    for count in (1, 2):
        world.gripper.power_off()
        world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 1.0)
        at_s = world.now_s
        world.gripper.power_on()
        world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 5.0)
        recover(world, client)
        until_dumped(world, count)
        assert world.disk.dumps[-1].ticks[0].at_s < at_s - 0.1
    world.run(2.0 * APART_S)
    assert causes(observer) == ["motor_silent", "motor_silent"]


def test_a_silence_that_comes_again_and_again_is_dumped_once() -> None:
    """A loose plug must not push the dumps of other faults out of those that are kept."""
    world = World(period_s=SLOW_S)
    world.enabled()
    observer = watching(world)
    for _ in range(5):
        lose_frames(world, 0.05)
        assert world.in_phase(MotorPhase.SILENT)
        world.run(20.0)
        assert world.in_phase(MotorPhase.ENABLED)
    assert causes(observer) == ["motor_silent"]
    world.run(APART_S)
    lose_frames(world, 0.05)
    world.run(2.0)
    assert causes(observer) == ["motor_silent", "motor_silent"]


def test_a_disabled_motor_that_is_switched_off_is_not_dumped() -> None:
    world, client = ready(period_s=SLOW_S)
    client.result("motor.disable")
    world.gripper.power_off()
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT), 5.0)
    world.run(3.0)
    assert world.disk.dumps == []


def test_a_motor_that_is_disabled_by_nobody_here_is_dumped() -> None:
    world, client = ready(period_s=SLOW_S)
    observer = watching(world)
    world.gripper.power_cycle()
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)
    world.run(2.0)
    assert causes(observer) == ["motor_reset"]
    recover(world, client)
    world.run(APART_S)
    world.gripper.receive(world.now_s, CanFrame(CAN_ID, codec.DISABLE))
    world.run(2.0)
    assert causes(observer) == ["motor_reset", "motor_reset"]


def test_a_position_that_jumps_is_dumped_with_the_jump() -> None:
    world, client = ready(period_s=SLOW_S)
    observer = watching(world)
    client.result("motion.move", opening_mm=60)
    world.gripper.jump(0.5)
    world.run_until(lambda: world.in_phase(MotorPhase.DISABLED), 1.0)
    at_s = world.now_s
    world.run(2.0 * APART_S)
    assert causes(observer) == ["implausible"]
    (dump,) = world.disk.dumps
    assert dump.ticks[0].at_s < at_s - 0.2
    assert dump.ticks[-1].at_s > at_s + 0.9


def test_a_second_master_is_dumped_when_it_begins() -> None:
    world = World(period_s=SLOW_S)
    world.enabled()
    observer = watching(world)
    for _ in range(20):
        world.inject(FOREIGN)
        world.run(4.0)  # each ends an episode of the refusal, and begins another
    assert causes(observer) == ["second_master"]
    world.run(APART_S)
    world.inject(FOREIGN)
    world.run(2.0)
    assert causes(observer) == ["second_master", "second_master"]


def test_a_second_master_that_is_tolerated_is_not() -> None:
    world = World(period_s=SLOW_S)
    world.enabled()
    world.controller.second_master.is_tolerated = True
    world.inject(FOREIGN)
    world.run(2.0)
    assert world.disk.dumps == []


def test_a_jump_is_dumped_once_however_often_the_motor_is_disabled_after_it() -> None:
    world, client = ready(period_s=SLOW_S)
    observer = watching(world)
    world.gripper.jump(0.5)
    until_dumped(world, 1)
    for _ in range(2):
        world.run(APART_S + 10.0)
        client.result("motor.disable")
    world.run(APART_S + 10.0)
    assert causes(observer) == ["implausible"]


@pytest.mark.parametrize("every_s", [2.0, 30.0, 300.0])
def test_a_plug_that_is_loose_for_a_day_is_dumped_ever_more_rarely(every_s: float) -> None:
    """The motor stays enabled: without a bound this wrote a file in every 55 s, of a megabyte."""
    world = World()
    world.enabled()
    written_s: list[float] = []
    for number in range(round(86_400.0 / every_s)):
        at_s = world.now_s + number * every_s
        for bus_is_up, after_s in ((False, 0.0), (True, 0.02), (True, 1.5)):
            world.dumps.step(at_s + after_s, failed=False, bus_is_up=bus_is_up)
        tasks, world.controller.tasks = world.controller.tasks, []
        for task in tasks:
            written_s.append(at_s)
            task.on_result(TaskResult(None, "a full disk"))
    assert 20 < len(written_s) < 35
    assert written_s[1] - written_s[0] < max(61.0, 1.5 * every_s)
    others = world.controller.take_events()
    assert len(others) == len(written_s)
    print(f"{every_s:g} s: {len(written_s)} dumps")
    world.dumps.step(world.now_s + 86_401.0, failed=True, bus_is_up=True)
    world.dumps.step(world.now_s + 86_460.0, failed=False, bus_is_up=True)
    assert [task.parameters["cause"] for task in world.controller.tasks] == ["tick_error"]
