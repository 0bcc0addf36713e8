"""Setting the zero as an action: disabled first, asked once, and an honest outcome."""

from collections.abc import Callable

import pytest

from litegripd.control.motions.base import SetZero as SetZeroAction
from litegripd.model.errors import Refusal
from litegripd.model.motor import (
    DisableMotor,
    Feedback,
    MotorPhase,
    MotorRequest,
    MotorView,
    SetZero,
    ZeroView,
)
from litegripd.model.state import SetZeroResult
from litegripd.motor import codec
from tests.motor.bench import CAN_ID, PERIOD_S, Bench, everything, is_zero
from tests.motor.test_set_zero import silent

DISABLED = MotorView(MotorPhase.DISABLED, Feedback(0, 0.5, 0.0, 0.0, 30, 30, 0.0))


class Run:
    """Steps the action as an controller does, in every tick, until it has an outcome."""

    def __init__(self, bench: Bench) -> None:
        self.requests: list[MotorRequest] = []
        self.outcome: object = None
        action = SetZeroAction()
        assert not action.needs_power
        for _ in range(1000):
            step = action.step(bench.now_s, bench.receive())
            assert step.command is None
            if step.request is not None:
                self.requests.append(step.request)
            bench.step(step.request)
            if step.outcome is not None:
                self.outcome = step.outcome
                break

    @property
    def refusal(self) -> str:
        assert isinstance(self.outcome, Refusal)
        return self.outcome.reason


def test_a_disabled_motor_is_asked_once() -> None:
    bench = Bench().started()
    before_rad, since_s = bench.feedback.position_rad, bench.now_s
    run = Run(bench)
    assert run.requests == [SetZero()]
    assert isinstance(run.outcome, SetZeroResult)
    assert run.outcome.ok
    assert run.outcome.shift_rad == pytest.approx(before_rad, abs=1e-3)
    assert run.outcome.position_rad == bench.feedback.position_rad == pytest.approx(0.0, abs=1e-3)
    assert bench.now_s - since_s < 0.15


def test_an_enabled_motor_is_disabled_first_and_stays_so() -> None:
    bench = Bench().enabled()
    mechanical_rad = bench.gripper.position_rad
    run = Run(bench)
    assert run.requests == [DisableMotor(), SetZero()]
    assert isinstance(run.outcome, SetZeroResult)
    assert run.outcome.shift_rad == pytest.approx(mechanical_rad, abs=1e-3)
    own = [frame.data for _, frame in bench.sent if frame.can_id == CAN_ID]
    assert own[-1] == codec.SET_ZERO
    assert own[-2] == codec.DISABLE
    bench.run(0.5)
    assert bench.view.phase is MotorPhase.DISABLED


def test_a_second_setting_is_not_confirmed_by_the_first() -> None:
    bench = Bench().started()
    assert isinstance(Run(bench).outcome, SetZeroResult)
    bench.lose_to_motor = is_zero
    bench.gripper.push(1.0)
    bench.run(0.2)
    bench.gripper.push(0.0)
    bench.run(0.2)
    run = Run(bench)
    assert run.refusal == "not_confirmed"
    assert len(bench.times_of(is_zero)) == 4


def test_a_setting_that_never_began_is_not_taken_for_done() -> None:
    action = SetZeroAction()
    done = MotorView(MotorPhase.DISABLED, DISABLED.feedback, zero=ZeroView("done", 0.1, 0.0))
    assert action.step(0.0, done).request == SetZero()
    now_s, outcome = 0.0, None
    while outcome is None:
        now_s += PERIOD_S
        outcome = action.step(now_s, done).outcome
        assert now_s < 3.0
    assert isinstance(outcome, Refusal)
    assert outcome.reason == "not_confirmed"


def test_a_motor_that_does_not_confirm_that_it_is_disabled_gets_no_zero() -> None:
    bench = Bench().enabled()
    since_s = bench.now_s
    bench.lose_to_motor = lambda frame: frame.data == codec.DISABLE
    bench.lose_from_motor = everything
    run = Run(bench)
    assert run.requests == [DisableMotor()]
    assert run.refusal in ("not_confirmed", "motor_silent")
    assert bench.now_s - since_s < 1.1
    assert not bench.times_of(is_zero)


@pytest.mark.parametrize(
    ("made", "why"), [(lambda: Bench().faulty(), "motor_fault"), (silent, "motor_silent")]
)
def test_a_fault_and_a_silence_are_said_and_nothing_is_sent(
    made: Callable[[], Bench], why: str
) -> None:
    run = Run(made())
    assert (run.requests, run.refusal) == ([], why)


@pytest.mark.parametrize("is_uncertain", [False, True])
def test_a_bus_that_is_down_explains_it_unless_the_zero_may_have_been_set(
    is_uncertain: bool,
) -> None:
    failure, down = Refusal("not_confirmed", "not confirmed"), Refusal("bus_down", "down")
    action = SetZeroAction()
    assert action.step(0.0, DISABLED).request == SetZero()
    zero = ZeroView("failed", failure=failure, is_uncertain=is_uncertain)
    view = MotorView(MotorPhase.DISABLED, DISABLED.feedback, problem=down, zero=zero)
    assert action.step(PERIOD_S, view).outcome == (failure if is_uncertain else down)
