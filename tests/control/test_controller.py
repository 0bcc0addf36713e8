"""One motion at a time, whose it is, and how the daemon ends."""

import math
from dataclasses import replace
from typing import Any

import pytest

from litegripd.model.motor import MotorPhase, Status
from litegripd.motor import codec
from litegripd.motor.codec import PMAX, parse_answer
from tests.control.states import (
    STATES,
    errors_of,
    in_state,
)
from tests.world import CAN_ID, PERIOD_S, Client, World, ready


def test_busy_names_the_owner() -> None:
    world, client = in_state("opening")
    other = world.client()
    for method in ("motion.close", "motion.hold", "motor.enable", "motor.disable"):
        error = other.call(method)["error"]
        assert error["data"]["reason"] == "busy"
        assert error["data"]["retryable"]
        assert error["data"]["owner"]["program"] == client.session.peer.program
        assert error["data"]["owner"]["pid"] == client.session.peer.pid
        assert client.session.peer.program in error["message"]
    assert client.refusal("motion.close") == "busy"


def test_a_cancelled_move_ends_held_where_it_is() -> None:
    world, client = in_state("opening")
    other = world.client()
    job = other.result("job.cancel", job=world.state.job.job if world.state.job else 0)
    assert job["state"] == "cancelled"
    world.run(0.02)
    here_rad = world.gripper.position_rad
    world.run(0.3)
    assert world.gripper.position_rad == pytest.approx(here_rad, abs=0.02)
    assert errors_of(client) == ["cancelled"]
    assert other.result("motion.close")["ok"]


def test_a_cancelled_enable_ends_disabled() -> None:
    world, client = in_state("enabling")
    other = world.client()
    other.result("job.cancel", job=world.state.job.job if world.state.job else 0)
    world.lose_to_motor = lambda _frame: False
    world.run(0.1)
    assert world.in_phase(MotorPhase.DISABLED)
    assert world.gripper.motor.status == Status.DISABLED
    assert "cancelled" in errors_of(client)


def test_enabling_waits_for_a_disabling_that_is_under_way() -> None:
    world, client = in_state("opening")
    client.result("stop", level="disable")
    client.result("stop.clear")
    assert client.result("motor.enable")["ok"]
    own = [s.frame.data for s in world.sent if s.frame.can_id == CAN_ID]
    assert codec.DISABLE in own
    assert own.index(codec.DISABLE) < len(own) - 1 - own[::-1].index(codec.ENABLE)


def back_on() -> tuple[World, Client]:
    """Return a gripper whose motor has just got its power back: its registers are being read."""
    world, client = ready()
    world.gripper.power_off()
    world.run_until(lambda: world.in_phase(MotorPhase.SILENT))
    world.gripper.power_on()
    world.run_until(lambda: world.in_phase(MotorPhase.UNKNOWN))
    world.sent.clear()
    return world, client


def test_enabling_waits_until_the_registers_are_read() -> None:
    world, client = back_on()
    enabling = client.send("motor.enable")
    world.run_until(lambda: world.controller.motor.identity is not None)
    assert codec.ENABLE not in [sent.frame.data for sent in world.sent]
    assert client.wait(enabling)["result"]["ok"]


def test_enabling_does_not_wait_for_registers_for_ever() -> None:
    world, client = back_on()
    world.lose_from_motor = lambda frame: (
        (answer := parse_answer(frame.data, CAN_ID)) is not None and answer.number == PMAX.number
    )
    began_s = world.now_s
    assert "still being read" in client.call("motor.enable")["error"]["message"]
    assert world.now_s - began_s == pytest.approx(3.0, abs=0.1)
    assert codec.ENABLE not in [sent.frame.data for sent in world.sent]


def test_enabling_that_waits_for_registers_ends_when_the_motor_falls_silent() -> None:
    world, client = back_on()
    enabling = client.send("motor.enable")
    world.run(0.01)
    world.gripper.power_off()
    assert client.wait(enabling, 1.0)["error"]["data"]["reason"] == "motor_silent"
    world.gripper.power_on()
    world.run(2.0)
    assert world.gripper.motor.status == Status.DISABLED


def test_cancelling_what_has_ended_changes_nothing() -> None:
    _world, client = ready()
    number = client.result("motion.open")["job"]
    assert client.result("job.cancel", job=number)["state"] == "done"
    assert client.refusal("job.cancel", job=12345) == "unknown_job"


def test_disabling_ends_the_own_motion_and_not_anothers() -> None:
    world, client = in_state("opening")
    assert world.client().refusal("motor.disable") == "busy"
    assert world.state.job is not None
    assert client.result("motor.disable")["ok"]
    assert "cancelled" in errors_of(client)
    assert world.gripper.motor.status == Status.DISABLED


def test_a_second_enable_is_fulfilled_at_once() -> None:
    world, client = ready()
    sent = len(world.sent)
    assert client.result("motor.enable")["ok"]
    assert not [s for s in world.sent[sent:] if s.frame.data == codec.ENABLE]


@pytest.mark.parametrize("state", STATES)
def test_shutting_down_from_any_state_ends_unpowered(state: str) -> None:
    world, client = in_state(state)
    world.controller.shut_down()
    number = client.send("motor.enable")
    world.lose_to_motor = lambda _frame: False
    world.run(0.05)
    world.run_until(lambda: world.machine.is_disabled, 1.0)
    assert world.gripper.motor.status != Status.ENABLED
    client.read()
    assert client.answers[number]["error"]["data"]["reason"] == "shutting_down"
    for method in ("motor.enable", "motion.open", "motion.hold"):
        assert client.refusal(method) == "shutting_down"


@pytest.mark.parametrize("state", ["opening", "holding"])
def test_shutting_down_does_not_move_the_jaws(state: str) -> None:
    world, _ = in_state(state)
    before_rad = world.gripper.position_rad
    world.controller.shut_down()
    world.run(1.0)
    assert world.gripper.position_rad == pytest.approx(before_rad, abs=0.03)


def test_no_transition_leaves_a_gap() -> None:
    world, client = ready()
    since_s = world.now_s
    client.result("motion.open")
    client.send("motion.close", wait=False)
    world.run(0.3)
    client.result("job.cancel", job=list(world.controller.jobs)[-1].number)
    client.result("motion.hold")
    client.result("stop", level="hold")
    client.result("stop", level="relax")
    client.result("stop.clear")
    client.result("motor.enable")
    client.send("motion.open")
    world.run(0.2)
    client.leave()
    world.run(0.1)
    other = world.client()
    other.result("motion.close")
    assert world.longest_gap_s(since_s) < 1.5 * PERIOD_S
    other.result("motor.disable")
    since_s = world.now_s
    world.run(0.2)
    other.send("motor.enable")
    world.run_until(lambda: world.gripper.motor.status == Status.ENABLED)
    since_s = world.now_s
    world.run(0.2)
    assert world.longest_gap_s(since_s) < 1.5 * PERIOD_S


def test_the_engine_says_what_happened() -> None:
    world, client = ready()
    client.result("stop", why="because")
    client.result("stop.clear")
    client.result("lease.acquire")
    client.leave()
    kinds: list[str] = []
    while events := world.service.take_events():
        kinds += [event.kind for event in events]
    wanted = {"job_started", "job_ended", "motor", "stop", "stop_cleared"}
    assert wanted | {"lease", "lease_lost", "client_lost"} <= set(kinds)
    assert world.controller.take_events() == []


def test_the_job_book_forgets_the_oldest() -> None:
    world, client = ready()
    for _ in range(70):
        client.result("motion.hold")
    numbers = [job.number for job in world.controller.jobs]
    assert numbers == list(range(numbers[-1] - 63, numbers[-1] + 1))
    assert client.refusal("job.get", job=1) == "unknown_job"


@pytest.mark.parametrize("name", ["position_rad", "velocity_rad_s", "torque_nm"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("method", ["motion.open", "motion.grasp", "motion.hold", "stream.set"])
def test_a_measurement_that_is_no_number_leads_to_no_command(
    method: str, name: str, value: float
) -> None:
    world, client = ready()
    params = {"opening_mm": 80} if method == "stream.set" else {}
    client.send(method, **params)
    view = world.machine.motor.view()
    assert view.feedback is not None
    changed: dict[str, Any] = {name: value}
    wrong = view._replace(feedback=replace(view.feedback, **changed))
    motor_input = world.controller.step(world.now_s + PERIOD_S, wrong)
    assert motor_input.command is None
    world.run(0.2)
    assert world.state.enabled
