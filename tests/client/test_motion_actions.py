import math
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    GripperState,
    HardwareError,
    LiteGrip,
    MoveProgress,
    MoveResult,
)
from tests.client.fake_daemon import GRASP, MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import interrupt_main_thread, last_params
from tests.geometry import SPAN_MM

# Grasp


@pytest.fixture
def _grasping(daemon: FakeDaemon) -> None:
    daemon.handlers["motion.grasp"] = lambda request: GRASP


@pytest.mark.usefixtures("_grasping")
@pytest.mark.parametrize(
    ("arguments", "keywords", "sent"),
    [
        ((), {}, {"hold_s": 0.0}),
        ((20, 3), {}, {"force_n": 20.0, "hold_s": 3.0}),
        ((), {"force_n": 5.0, "hold_s": 1.0}, {"force_n": 5.0, "hold_s": 1.0}),
        (
            (),
            {"width_mm": 30, "tolerance_mm": 2, "hold_by": "gains"},
            {"hold_s": 0.0, "width_mm": 30.0, "tolerance_mm": 2.0, "hold_by": "gains"},
        ),
        ((), {"until": "verdict"}, {"until": "verdict"}),
        ((), {"until": "verdict", "hold_s": 2.0}, {"until": "verdict", "hold_s": 2.0}),
        ((), {"speed_mm_s": 10}, {"hold_s": 0.0, "speed_mm_s": 10.0}),
    ],
)
def test_a_grasp_says_what_was_asked(
    daemon: FakeDaemon,
    gripper: LiteGrip,
    arguments: Any,
    keywords: dict[str, Any],
    sent: dict[str, Any],
) -> None:
    result = gripper.grasp(*arguments, **keywords)
    assert last_params(daemon) == {**sent, "progress": True}
    assert (bool(result), result.stalled, result.reached, result.cycles) == (True, True, False, 15)


@pytest.mark.usefixtures("_grasping")
def test_a_grasp_has_tunables(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    gripper.motion_config.grasp_speed_mm_s = 40.0
    gripper.grasp()
    assert last_params(daemon)["config"] == {"grasp_speed_mm_s": 40.0}
    daemon.handlers["motion.set_force"] = lambda request: {"force_n": 3.0, "state": STATE}
    gripper.set_force(3.0, 0.0)
    assert last_params(daemon)["config"] == {"grasp_speed_mm_s": 40.0}


def test_a_grasp_on_nothing_is_false(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    nothing = {**GRASP, "ok": False, "outcome": "no_object", "width_mm": None, "cycles": 0}
    daemon.handlers["motion.grasp"] = lambda request: nothing
    result = gripper.grasp()
    assert (bool(result), result.outcome, result.width_mm) == (False, "no_object", None)


def test_a_grasp_for_ever_waits_until_an_interrupt_which_cancels_it(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    phases = []

    def hold(request: Request) -> None:
        request.progress(job=9, phase="approach")
        request.progress(job=9, phase="hold", total_steps=0)

    def show(progress: MoveProgress) -> None:
        phases.append((progress.phase, progress.total_steps))
        if progress.phase == "hold":
            interrupt_main_thread()

    daemon.handlers["motion.grasp"] = hold
    daemon.handlers["job.cancel"] = lambda request: {"job": 9, "state": "cancelled"}
    with pytest.raises(KeyboardInterrupt):
        gripper.grasp(progress=show)
    assert phases == [("move", 10), ("hold", 0)]
    assert daemon.requests[-1].method == "job.cancel"
    assert daemon.requests[-1].params == {"job": 9}


@pytest.mark.parametrize("force_n", ["20", float("nan"), [20]])
def test_a_force_that_is_no_number_is_refused_here(
    daemon: FakeDaemon, gripper: LiteGrip, force_n: Any
) -> None:
    for call in (gripper.grasp, gripper.set_force):
        with pytest.raises(CommandError, match="force_n is"):
            call(force_n)
    assert daemon.methods() == ["hello"]


# To a target


@pytest.mark.parametrize(
    ("move", "sent"),
    [
        (lambda g: g.goto(30), {"opening_mm": 30.0, "at_least_s": 0.5}),
        (lambda g: g.goto(30, 150), {"opening_mm": 30.0, "kp": 150.0, "at_least_s": 0.5}),
        (
            lambda g: g.goto(30, 150, 2, 1),
            {"opening_mm": 30.0, "kp": 150.0, "kd": 2.0, "at_least_s": 1.0},
        ),
        (lambda g: g.goto(position_mm=30, duration=None), {"opening_mm": 30.0}),
        (lambda g: g.goto_rad(-0.5), {"position_rad": -0.5, "at_least_s": 0.5}),
        (
            lambda g: g.goto_rad(-0.5, 150, 2, 0, 0, 2),
            {"position_rad": -0.5, "kp": 150.0, "kd": 2.0, "at_least_s": 2.0},
        ),
        (lambda g: g.goto_openness(0.5, duration=0.2), {"openness": 0.5, "at_least_s": 0.2}),
        (lambda g: g.move_at_speed(30, 25), {"opening_mm": 30.0, "speed_mm_s": 25.0}),
        (
            lambda g: g.move_at_speed(target_mm=30, kp=150, kd=2),
            {"opening_mm": 30.0, "speed_mm_s": 30.0, "kp": 150.0, "kd": 2.0},
        ),
    ],
)
def test_moving_to_a_target(
    daemon: FakeDaemon,
    gripper: LiteGrip,
    move: Callable[[LiteGrip], MoveResult],
    sent: dict[str, float],
) -> None:
    reached = {**MOVE, "outcome": "reached", "reached": True, "stalled": False}
    daemon.handlers["motion.move"] = lambda request: reached
    assert move(gripper).outcome == "reached"
    assert last_params(daemon) == {**sent, "progress": True}


@pytest.mark.parametrize("feedforward", [{"dq_target": 0.5}, {"tau_feedforward": -1.0}])
def test_a_move_with_a_feedforward_of_the_callers_own_is_rejected(
    daemon: FakeDaemon, gripper: LiteGrip, feedforward: dict[str, Any]
) -> None:
    with pytest.raises(CommandError, match="the daemon computes velocity and torque") as caught:
        gripper.goto_rad(-0.5, **feedforward)
    assert caught.value.reason == "unsupported"
    assert daemon.methods() == ["hello"]


def test_moving_has_progress_and_tunables(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    def move(request: Request) -> Any:
        request.progress(3)
        return MOVE

    daemon.handlers["motion.move"] = move
    gripper.motion_config.max_lead_mm = 2.0
    seen: list[MoveProgress] = []
    gripper.goto(20.0, progress=seen.append)
    gripper.move_at_speed(20.0, 30.0, progress=seen.append)
    assert [one.i for one in seen] == [3, 3]
    assert last_params(daemon)["config"] == {"max_lead_mm": 2.0}


def test_a_target_outside_the_travel_tells_the_travel(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    daemon.handlers["motion.move"] = lambda request: request.fail(
        "out_of_limits", -32011, limit=[0.0, SPAN_MM]
    )
    with pytest.raises(CommandError) as caught:
        gripper.goto(500.0)
    assert caught.value.data["limit"] == [0.0, SPAN_MM]


# Force, and loose jaws


@pytest.mark.parametrize(
    ("call", "method", "sent"),
    [
        (lambda g: g.zero_gravity(), "motion.zero_gravity", {}),
        (lambda g: g.zero_gravity(on=False), "motion.hold", {}),
        (lambda g: g.hold(), "motion.hold", {}),
    ],
)
def test_what_is_answered_at_once(
    daemon: FakeDaemon,
    gripper: LiteGrip,
    call: Callable[[LiteGrip], GripperState],
    method: str,
    sent: dict[str, float],
) -> None:
    daemon.handlers[method] = lambda request: {"job": 4, "force_n": 12.0, "state": STATE}
    assert call(gripper).mode == "holding"
    assert last_params(daemon) == sent
    daemon.handlers[method] = lambda request: request.fail("busy", -32020)
    with pytest.raises(BusyError):
        call(gripper)


@pytest.mark.parametrize("duration", [-0.1, math.nan, "1", 1e12])
def test_a_force_for_an_impossible_time_is_rejected(
    daemon: FakeDaemon, gripper: LiteGrip, duration: Any
) -> None:
    with pytest.raises(CommandError, match="duration is"):
        gripper.set_force(12, duration)
    assert daemon.methods() == ["hello"]


# The motor by itself


@pytest.mark.parametrize(("register", "sent"), [("PMAX", "PMAX"), (21, "21"), ("0x15", "0x15")])
def test_a_register_by_name_or_number(
    daemon: FakeDaemon, gripper: LiteGrip, register: str | int, sent: str
) -> None:
    answer = {"number": 21, "name": "PMAX", "value": 12.5}
    daemon.handlers["motor.read_register"] = lambda request: answer
    assert gripper.read_param(register) == 12.5
    assert daemon.requests[-1].params == {"register": sent}


def test_what_is_no_register_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(CommandError, match=r"register is 2\.5"):
        gripper.read_param(2.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("ok", [True, False])
def test_a_new_zero_leaves_the_motor_disabled(daemon: FakeDaemon, ok: bool) -> None:
    answer = {"job": 3, "ok": ok, "shift_rad": 0.25, "position_rad": 0.0, "state": STATE}
    daemon.handlers["motor.set_zero"] = lambda request: answer
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
        result = gripper.set_zero()
        assert (bool(result), result.shift_rad, result.position_rad) == (ok, 0.25, 0.0)
        assert last_params(daemon) == {}
    assert ("motor.disable" in daemon.methods()) is not ok


def test_a_zero_that_fails_raises(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motor.set_zero"] = lambda request: request.fail("motor_silent", -32032)
    with pytest.raises(HardwareError):
        gripper.set_zero()
