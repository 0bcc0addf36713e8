"""What counts as a motor that makes less torque than is commanded, by measurements alone."""

from collections.abc import Callable

import pytest

from litegripd.control.made_torque import LEAST_NM, SHORT_S, STANDS_S, WEAK_S, MadeTorque
from litegripd.model.motor import CanFrame, Feedback, MitCommand, Status
from tests.control.held import Held
from tests.world import ready

PERIOD_S = 0.005
COMMANDED_NM = 2.0
Reports = Callable[[int], tuple[float, float]]


def watch(reports: Reports, ticks: int, commanded_nm: float = COMMANDED_NM) -> MadeTorque:
    """Let a motor report position and torque by the number of the tick."""
    made = MadeTorque()
    for tick in range(ticks):
        position_rad, torque_nm = reports(tick)
        command = MitCommand(position_rad, 0.0, 0.0, 1.0, commanded_nm)
        made.see(feedback(tick * PERIOD_S, position_rad, torque_nm), command)
    return made


def feedback(at_s: float, position_rad: float, torque_nm: float) -> Feedback:
    return Feedback(Status.ENABLED, position_rad, 0.0, torque_nm, 30, 30, at_s)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_short_before_it_is_weak(sign: float) -> None:
    short, weak = (round((STANDS_S + lasts_s) / PERIOD_S) + 1 for lasts_s in (SHORT_S, WEAK_S))
    made = watch(lambda _: (0.0, sign * 0.3), short - 1, sign * COMMANDED_NM)
    assert (made.is_short, made.is_weak) == (None, False)
    made = watch(lambda _: (0.0, sign * 0.3), short, sign * COMMANDED_NM)
    assert (made.is_short, made.is_weak) == (True, False)
    made = watch(lambda _: (0.0, sign * 0.3), weak, sign * COMMANDED_NM)
    assert (made.is_short, made.is_weak) == (True, True)
    assert made.commanded_nm == pytest.approx(COMMANDED_NM)
    assert made.made_nm == pytest.approx(0.3)


@pytest.mark.parametrize("made_nm", [1.52, 1.8, 2.0, 2.5])
def test_what_is_nearly_made_is_made(made_nm: float) -> None:
    assert not watch(lambda _: (0.0, made_nm), 200).is_short


def test_torque_the_other_way_is_none() -> None:
    assert watch(lambda _: (0.0, -2.0), 60).is_weak


def test_little_torque_is_not_judged() -> None:
    assert not watch(lambda _: (0.0, 0.0), 200, 0.99 * LEAST_NM).is_short


def test_moving_jaws_are_not_judged() -> None:
    """At 0.3 rad/s: what is commanded of them depends on where they are by now."""
    assert not watch(lambda tick: (0.3 * tick * PERIOD_S, 0.2), 200).is_short


@pytest.mark.parametrize("every", [5, 10, 50])
def test_damaged_answers_make_no_motor_weak(every: int) -> None:
    made = watch(lambda tick: (0.0, -10.0 if tick % every == 0 else 2.0), 400)
    assert (made.is_short, made.is_weak) == (False, False)


def test_a_measurement_counts_once() -> None:
    made, old = watch(lambda _: (0.0, 2.0), 5), feedback(1.0, 0.0, 0.0)
    for _ in range(200):
        assert not made.see(old, MitCommand(0.0, 0.0, 0.0, 1.0, COMMANDED_NM))
    assert not made.is_short


def test_what_was_seen_before_the_power_went_does_not_count() -> None:
    made = watch(lambda _: (0.0, 0.3), 100)
    made.reset()
    assert (made.is_short, made.is_weak) == (False, False)


def weak_events(world: Held) -> list[bool]:
    return [event["data"]["weak"] for event in world.events("weak")]


def test_a_motor_whose_torque_heat_limits_makes_what_is_commanded() -> None:
    held = Held(30.0)
    for _ in range(200):
        held.controller.output.heat.allowance_nm = 1.0
        held.tick()
    assert "heat" in held.state.limited
    assert weak_events(held) == []


def test_torque_that_the_motors_own_current_limit_withholds() -> None:
    """Register OC_Value, or a supply that cannot give more: it makes what it can."""
    held = Held(40.0, figures={"current_limit_a": 2.0})
    held.run(1.0)
    assert weak_events(held) == [True]
    low_n, high_n = held.clamp_range_n
    assert low_n <= held.clamp_n <= high_n


def test_frames_that_are_late_make_no_motor_weak() -> None:
    """By 30 ms each way: what the daemon sees is old, and so is what the motor obeys."""
    world, client = ready(watchdog_s=0.4)
    client.result("events.subscribe", kinds=["weak"])
    delayed: list[tuple[float, CanFrame]] = []

    def late(frame: CanFrame) -> bool:
        delayed.append((world.now_s + 0.06, frame))
        return True

    world.lose_from_motor = late
    for openness in (0.2, 0.9, 0.3):
        number = client.send("motion.move", openness=openness)
        while not client.has_answer(number):
            while delayed and delayed[0][0] <= world.now_s:
                world.inject(delayed.pop(0)[1])
            world.tick()
    assert [n for n in client.notifications if n["method"] == "event"] == []


def test_a_motor_that_another_program_commands_is_not_judged() -> None:
    held = Held(20.0)
    held.controller.second_master.is_tolerated = True
    slack = bytes.fromhex("7fff7ff000000800")[:8]
    for _ in range(200):
        held.tick()
        held.gripper.receive(held.now_s + 0.001, CanFrame(0x08, slack))
        held.inject(CanFrame(0x08, slack))
    assert weak_events(held) == []
