"""What was held and is let go by nobody's wish: an event of its own, and true sentences."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import pytest

from litegrip_client.ctl.state_view import state_rows
from litegripd.model.motor import UP, BusCondition, CanFrame, MotorPhase, Status
from litegripd.motor import codec
from tests.control.held import WIDTH_MM, Held
from tests.world import CAN_ID, World

FORCE_N = 10.0
OFF = ": the motor was off, which nobody here had asked for"


def told(held: Held) -> list[dict[str, Any]]:
    held.watcher.read()
    events = [n["params"] for n in held.watcher.notifications if n["method"] == "event"]
    return [event for event in events if event["kind"] == "released_by_fault"]


def rows(held: Held) -> dict[str, str]:
    return dict(state_rows(asdict(held.state), str))


def unplug(held: Held) -> None:
    held.condition = BusCondition("adapter_gone", "the adapter is gone")
    held.lose_to_motor = lambda _frame: True


def plug(held: Held) -> None:
    held.condition, held.lose_to_motor = UP, lambda _frame: False


def communication_lost(held: Held) -> None:
    held.gripper.latch_fault(Status.COMMUNICATION_LOST)


def overloaded(held: Held) -> None:
    held.gripper.latch_fault(Status.OVERLOAD)


def switched_off_and_on(held: Held) -> None:
    held.gripper.power_cycle()


def disabled_by_another(held: Held) -> None:
    held.gripper.receive(held.now_s, CanFrame(CAN_ID, codec.DISABLE))


def jumped(held: Held) -> None:
    held.gripper.jump(0.5)


@pytest.mark.parametrize(
    ("fault", "why", "past"),
    [
        (communication_lost, "communication lost", " by a fault (communication lost)"),
        (overloaded, "overload", " by a fault (overload)"),
        (switched_off_and_on, "its supply failed for a moment", OFF),
        (disabled_by_another, "another program disabled it", OFF),
        (jumped, "jumped", ": the motor's position jumped, and it was disabled"),
    ],
)
def test_a_fault_while_something_is_held_says_once_that_it_is_let_go(
    fault: Callable[[Held], None], why: str, past: str
) -> None:
    held = Held(FORCE_N)
    fault(held)
    held.run(3.0)
    (event,) = told(held)
    assert event["message"].startswith("what was held with 10 N, at ")
    assert "has been let go" in event["message"]
    assert why in event["message"]
    assert why in event["data"]["why"]
    assert event["data"]["certain"] is True
    width_mm = event["message"].split(" mm", maxsplit=1)[0]
    assert event["data"]["past"] == f"{width_mm} mm, was let go{past}"
    assert event["data"]["force_n"] == FORCE_N
    assert event["data"]["width_mm"] == pytest.approx(WIDTH_MM, abs=1.0)
    assert held.state.is_grasped is False
    assert held.state.force_set_n is None
    assert "squeezing" not in rows(held)


def test_an_adapter_that_is_unplugged_leaves_what_was_known_with_its_age() -> None:
    held = Held(FORCE_N)
    before = held.state
    unplug(held)
    held.run(0.5)
    assert told(held) == []
    held.run(11.5)
    (event,) = told(held)
    assert "must be taken for let go" in event["message"]
    assert "adapter_gone" in event["message"]
    assert event["data"]["certain"] is False
    assert event["data"]["past"].endswith("mm, was let go: the motor did not answer")
    state = held.state
    assert state.stale
    assert state.age_s == pytest.approx(12.0, abs=0.1)
    assert state.opening_mm == pytest.approx(before.opening_mm, abs=0.1)
    assert (state.is_grasped, state.force_set_n, state.clamp_n) == (None, FORCE_N, None)
    shown = rows(held)
    assert shown["age"] == "STALE, 12.0 s old"
    assert shown["opening"].startswith(f"{before.opening_mm:.1f}"[:4])
    assert shown["squeezing"].startswith("was with 10.0 N 12.0 s ago, when the motor last answered")
    assert "an object was held then" in shown["squeezing"]
    plug(held)
    held.run(1.0)
    assert held.in_phase(MotorPhase.FAULT)
    assert (held.state.is_grasped, held.state.force_set_n, held.state.stale) == (False, None, False)
    assert len(told(held)) == 1


def test_a_motor_without_power_is_told_the_same_way() -> None:
    held = Held(FORCE_N)
    held.gripper.power_off()
    held.run(5.0)
    (event,) = told(held)
    assert "must be taken for let go" in event["message"]
    assert "24 V" in event["message"]
    assert held.state.opening_mm is not None
    held.gripper.power_on()
    held.run(1.0)
    assert held.in_phase(MotorPhase.DISABLED)
    assert len(told(held)) == 1
    assert (held.state.is_grasped, held.state.stale) == (False, False)


def test_a_silence_that_the_hold_survives_is_no_release() -> None:
    held = Held(FORCE_N, figures={"comm_loss_s": 0.9})
    for _ in range(3):
        unplug(held)
        held.run(0.6)
        assert held.state.is_grasped is None
        plug(held)
        held.run(1.0)
        assert held.state.is_grasped is True
    assert told(held) == []


@pytest.mark.parametrize("way", ["motor.disable", "stop", "motor.set_zero", "motion.zero_gravity"])
def test_what_is_let_go_by_wish_is_no_event(way: str) -> None:
    held = Held(FORCE_N)
    held.owner.result(way, **({"level": "disable"} if way == "stop" else {}))
    held.run(2.0)
    held.gripper.power_cycle()
    held.run(2.0)
    assert told(held) == []


def test_a_client_that_disables_an_unplugged_motor_has_let_go_by_wish() -> None:
    held = Held(FORCE_N)
    unplug(held)
    held.run(0.3)
    held.owner.send("motor.disable")
    held.run(3.0)
    assert told(held) == []


def test_a_motor_that_never_answered_has_no_figures() -> None:
    world = World()
    world.gripper.power_off()
    world.run(2.0)
    assert (world.state.position_rad, world.state.age_s, world.state.stale) == (None, None, True)
    assert world.state.is_grasped is False


def test_another_motor_that_answers_next_is_not_shown_with_the_figures_of_the_first() -> None:
    held = Held(FORCE_N)
    held.gripper.power_off()
    held.run(3.0)
    held.gripper.power_on(turns=1)
    held.run(1.0)
    assert not held.state.stale
    assert held.state.position_rad == pytest.approx(
        held.gripper.motor.reported_position_rad, abs=0.01
    )
