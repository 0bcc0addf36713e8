"""Motions at the real daemon: what is asked, and what comes of it."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    GraspResult,
    GripperState,
    HardwareError,
    LeaseError,
    LiteGrip,
    MotionConfig,
    MoveProgress,
    MoveResult,
    ParameterError,
    StoppedError,
)
from tests.client.rig import GUARDS, Bench, Heard, Kind
from tests.client.taught import TAUGHT
from tests.geometry import TRAVEL_MM

Move = Callable[[LiteGrip], Any]
MOVES: list[tuple[Move, dict[str, Any]]] = [
    (lambda g: g.goto(30), {"opening_mm": 30.0, "at_least_s": 0.5}),
    (lambda g: g.goto(30, 150), {"opening_mm": 30.0, "kp": 150.0, "at_least_s": 0.5}),
    (
        lambda g: g.goto(30, 150, 2, 0.6),
        {"opening_mm": 30.0, "kp": 150.0, "kd": 2.0, "at_least_s": 0.6},
    ),
    (lambda g: g.goto(position_mm=30, duration=None), {"opening_mm": 30.0}),
    (lambda g: g.goto_rad(-0.5), {"position_rad": -0.5, "at_least_s": 0.5}),
    (
        lambda g: g.goto_rad(-0.5, 150, 2, 0, 0, 0.6),
        {"position_rad": -0.5, "kp": 150.0, "kd": 2.0, "at_least_s": 0.6},
    ),
    (lambda g: g.goto_openness(0.5, duration=0.2), {"openness": 0.5, "at_least_s": 0.2}),
    (
        lambda g: g.goto_openness(0.5, kp=90, kd=1),
        {"openness": 0.5, "kp": 90.0, "kd": 1.0, "at_least_s": 0.5},
    ),
    (lambda g: g.move_at_speed(40, 45), {"opening_mm": 40.0, "speed_mm_s": 45.0}),
    (
        lambda g: g.move_at_speed(target_mm=50, kp=150, kd=2),
        {"opening_mm": 50.0, "speed_mm_s": 30.0, "kp": 150.0, "kd": 2.0},
    ),
]


@pytest.mark.parametrize(("move", "asked"), MOVES)
def test_moving_to_a_target(
    daemon: Heard, enabled: LiteGrip, move: Move, asked: dict[str, float]
) -> None:
    result = move(enabled)
    assert (result.outcome, result.reached, result.stalled) == ("reached", True, False)
    assert daemon.asked("motion.move") == [{**asked, "progress": True}]
    assert result.state.position_rad == pytest.approx(result.target_rad, abs=0.02)


@pytest.mark.parametrize(
    ("move", "told"),
    [
        (lambda g: g.goto(500), "position_mm is 500 mm, the calibrated travel is 0 to 86.9 mm"),
        (
            lambda g: g.move_at_speed(-2),
            "target_mm is -2 mm, the calibrated travel is 0 to 86.9 mm",
        ),
        (lambda g: g.goto_rad(9), r"position_rad is 9 rad, the calibrated travel is .* to .* rad"),
        (lambda g: g.move_to(9), r"target_rad is 9 rad, the calibrated travel is .* to .* rad"),
        (lambda g: g.goto_openness(2), "openness is 2, it must be 0 to 1"),
    ],
)
def test_a_target_out_of_reach_is_named_as_the_caller_has_it(
    enabled: LiteGrip, move: Move, told: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{told}$"):
        move(enabled)


def teleop(name: str, gripper: LiteGrip) -> None:
    options: dict[str, Any] = {name: "no"}
    gripper.teleop_start("master", **options)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda g: g.open(progress=5), "progress is 5, it must be a function of a MoveProgress"),
        (lambda g: g.lease("x", wait_s="a"), "wait_s is 'a', it must be a number"),
        (lambda g: g.lease("x", ttl_s=math.nan), "ttl_s is nan, it must be a finite number"),
        (lambda g: g.zero_gravity("off"), "on is 'off', it must be True or False"),
        (lambda g: g.clear_fault(enable="no"), "enable is 'no', it must be True or False"),
        (lambda g: g.record(1.0, zero_gravity="no"), "zero_gravity is 'no', it must be True .*"),
        (lambda g: g.record_start(zero_gravity=None), "zero_gravity is None, it must be True .*"),
        (lambda g: g.record_stop("no"), "allow_empty is 'no', it must be True or False"),
        (lambda g: g.record_stop(allow_partial=2), "allow_partial is 2, it must be True or False"),
        (lambda g: g.play(TAUGHT, align="no"), "align is 'no', it must be True or False"),
        (lambda g: g.play(TAUGHT, loop="no"), "loop is 'no', it must be True or False"),
        (lambda g: g.play_start(TAUGHT, loop="no"), "loop is 'no', it must be True or False"),
        (lambda g: g.play_start(TAUGHT, align="no"), "align is 'no', it must be True or False"),
        *(
            (partial(teleop, name), f"{name} is 'no', it must be True or False")
            for name in ("align", "require_ready", "reflect", "fake_leader")
        ),
        (
            lambda g: setattr(g, "disable_on_disconnect", "no"),
            "disable_on_disconnect is 'no', it must be True or False",
        ),
        (lambda g: g.grasp(50), "force_n is 50, it must be 0.5 to 40 N"),
        (lambda g: g.grasp(50.5), "force_n is 50.5, it must be 0.5 to 40 N"),
    ],
)
def test_an_argument_that_cannot_be_is_refused_at_the_call_and_as_it_was_typed(
    enabled: LiteGrip, call: Move, told: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{told}$"):
        call(enabled)


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("force_n", "motion_config: force_n is 500, it must be 0.5 to 40 N"),
        ("force_rate_n_s", "motion_config: force_rate_n_s is 500, it must be 1 to 200 N/s"),
    ],
)
def test_a_tunable_out_of_its_range_is_refused_with_the_unit(
    enabled: LiteGrip, field: str, told: str
) -> None:
    setattr(enabled.motion_config, field, 500)
    name = f"gripper.motion_config.{field}"
    told = f"{told}\n{name} = ..., or for the daemon's own: del {name}"
    with pytest.raises(ParameterError) as caught:
        enabled.open()
    assert str(caught.value) == told
    with pytest.raises(ParameterError) as caught:
        enabled.calibrate(kp=500)
    assert str(caught.value).endswith(" N·m/rad")


@pytest.mark.parametrize("name", ["open", "close"])
def test_a_motion_carries_what_guards_it(
    site: Bench, daemon: Heard, enabled: LiteGrip, name: str
) -> None:
    began_s = site.now_s
    result = getattr(enabled, name)(150)
    assert isinstance(result, MoveResult)
    assert result
    motion = daemon.requests[-1]
    assert motion.plain == {"speed_mm_s": 150.0, "progress": True}
    assert motion.params["sent_s"] == began_s
    assert motion.params["stop_generation"] == daemon.state.stop_generation
    assert getattr(enabled.actions, name)()
    assert daemon.requests[-1].plain == {"progress": True}


@pytest.mark.parametrize(
    ("arguments", "keywords", "asked"),
    [
        ((20, 0.3), {}, {"force_n": 20.0, "hold_s": 0.3}),
        ((), {"force_n": 5.0, "hold_s": 0.3}, {"force_n": 5.0, "hold_s": 0.3}),
        (
            (),
            {"width_mm": 50, "tolerance_mm": 2, "hold_by": "gains", "hold_s": 0.3},
            {"hold_s": 0.3, "width_mm": 50.0, "tolerance_mm": 2.0, "hold_by": "gains"},
        ),
        ((), {"until": "verdict"}, {"until": "verdict"}),
        ((), {"speed_mm_s": 30, "hold_s": 0.3}, {"hold_s": 0.3, "speed_mm_s": 30.0}),
    ],
)
def test_a_grasp_says_what_was_asked(
    daemon: Heard, enabled: LiteGrip, arguments: Any, keywords: Any, asked: dict[str, Any]
) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    result = enabled.grasp(*arguments, **keywords)
    assert isinstance(result, GraspResult)
    assert (bool(result), result.stalled, result.reached) == (True, True, False)
    assert result.width_mm == pytest.approx(50.0, abs=0.5)
    assert daemon.asked("motion.grasp") == [{**asked, "progress": True}]


def test_a_verdict_and_a_time_are_both_asked_and_the_daemon_decides(
    daemon: Heard, enabled: LiteGrip
) -> None:
    with pytest.raises(CommandError):
        enabled.grasp(until="verdict", hold_s=2.0)
    asked = {"until": "verdict", "hold_s": 2.0, "progress": True}
    assert daemon.asked("motion.grasp") == [asked]


def test_tunables_that_were_set_travel_with_each_call_of_their_gripper(
    daemon: Heard, kind: Kind
) -> None:
    config = MotionConfig(enable_retries=5, enable_retry_interval=0.1)
    daemon.gripper.put_object(width_mm=58.0)
    with kind.gripper(motion_config=config) as gripper, kind.gripper() as other:
        assert gripper.motion_config is config
        assert gripper.enable()
        gripper.motion_config = MotionConfig(speed_mm_s=25.0, force_n=10.0)
        gripper.close()
        gripper.motion_config.force_n = 5.0
        gripper.actions.close(10.0)
        with pytest.raises(BusyError):
            other.open()
    wished = {"enable_retries": 5, "enable_retry_interval": 0.1}
    assert daemon.asked("motor.enable") == [{"config": wished}]
    first, second = daemon.asked("motion.close")
    assert first == {"config": {"speed_mm_s": 25.0, "force_n": 10.0}, "progress": True}
    assert second["config"] == {"speed_mm_s": 25.0, "force_n": 5.0}
    assert second["speed_mm_s"] == 10.0
    assert daemon.asked("motion.open") == [{"progress": True}]


def test_a_grasp_and_a_force_have_tunables(daemon: Heard, enabled: LiteGrip) -> None:
    enabled.motion_config.grasp_speed_mm_s = 60.0
    daemon.gripper.put_object(width_mm=50.0)
    enabled.grasp(until="verdict")
    assert enabled.set_force(3.0, 0.0)
    for method in ("motion.grasp", "motion.set_force"):
        assert daemon.asked(method)[0]["config"] == {"grasp_speed_mm_s": 60.0}


def test_a_grasp_on_nothing_is_false(enabled: LiteGrip) -> None:
    result = enabled.grasp()
    assert (bool(result), result.outcome, result.width_mm) == (False, "no_object", None)


def test_what_something_blocks_is_false(daemon: Heard, enabled: LiteGrip) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    result = enabled.close()
    assert (bool(result), result.outcome) == (False, "protected")


def test_progress_is_reported_as_the_sdk_does(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    seen: list[MoveProgress] = []
    truth: list[tuple[float, float]] = []

    def note(progress: MoveProgress) -> None:
        feedback = daemon.controller.motor.feedback
        assert feedback is not None
        truth.append((feedback.position_rad, feedback.torque_nm))
        seen.append(progress)

    enabled.motion_config.max_lead_mm = 2.0
    enabled.goto(30.0, progress=note)
    steps = [one.i for one in seen]
    assert steps == sorted(steps)
    assert {(one.stage, one.phase) for one in seen} == {("ramp", "move"), ("settle", "move")}
    assert all(0 < one.i <= one.total_steps for one in seen)
    for one, (position_rad, torque_nm) in zip(seen, truth, strict=True):
        assert one.pos_rad == pytest.approx(position_rad, abs=1e-4)
        assert one.torque_nm == pytest.approx(torque_nm, abs=1e-2)
        assert one.pos_rad <= one.cmd_rad + 0.01
    first = len(seen)
    enabled.move_at_speed(40.0, 60.0, progress=note)
    assert len(seen) > first
    assert [one["config"] for one in daemon.asked("motion.move")] == [{"max_lead_mm": 2.0}] * 2


# Refused, here or there


@pytest.mark.parametrize("force_n", ["20", math.nan, [20]])
def test_a_force_that_is_no_number_is_refused_here(
    daemon: Heard, gripper: LiteGrip, force_n: Any
) -> None:
    for call in (gripper.grasp, gripper.set_force):
        with pytest.raises(ParameterError, match="force_n is"):
            call(force_n)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    ("name", "instead"), [("dq_target", "move_at_speed"), ("tau_feedforward", "set_force")]
)
def test_a_move_with_a_feedforward_of_the_callers_own_is_rejected_with_what_to_use(
    daemon: Heard, gripper: LiteGrip, name: str, instead: str
) -> None:
    feedforward: dict[str, Any] = {name: -0.5}
    with pytest.raises(CommandError, match="the daemon computes velocity and torque") as caught:
        gripper.goto_rad(-0.5, **feedforward)
    assert caught.value.reason == "unsupported"
    assert instead in str(caught.value.hint)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize("duration", [-0.1, math.nan, "1", 1e12])
def test_a_force_for_an_impossible_time_is_rejected(
    daemon: Heard, gripper: LiteGrip, duration: Any
) -> None:
    with pytest.raises(CommandError, match="duration is"):
        gripper.set_force(12, duration)
    assert daemon.methods() == ["hello"]


def test_what_the_daemon_refuses_is_a_bad_parameter_and_tells_the_travel(
    enabled: LiteGrip,
) -> None:
    with pytest.raises(ParameterError) as caught:
        enabled.goto(500.0)
    assert caught.value.data["limit"] == pytest.approx([0.0, TRAVEL_MM], abs=0.1)
    with pytest.raises(ParameterError):
        enabled.goto_openness(1.2)
    with pytest.raises(ParameterError):
        enabled.goto(50.0, 10_000.0)
    with pytest.raises(ParameterError):
        enabled.open(speed_mm_s=-1.0)


# Force, loose jaws, and holding


def test_a_force_stays_and_is_true_while_the_jaws_hold(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    assert enabled.grasp(5.0, until="verdict")
    began_s = site.now_s
    assert enabled.set_force(12) is True
    assert site.now_s - began_s == pytest.approx(0.3, abs=0.02)
    assert daemon.asked("motion.set_force") == [{"force_n": 12.0}]
    assert daemon.state.force_set_n == 12.0
    connection = enabled._session.connection
    site.after(0.1, lambda: connection.post("motion.zero_gravity", {}))
    assert enabled.set_force(10.0) is False


@pytest.mark.parametrize(
    ("call", "method", "mode"),
    [
        (lambda g: g.zero_gravity(), "motion.zero_gravity", "relaxed"),
        (lambda g: g.zero_gravity(on=False), "motion.hold", "holding"),
        (lambda g: g.hold(), "motion.hold", "holding"),
    ],
)
def test_what_is_answered_at_once(
    daemon: Heard,
    enabled: LiteGrip,
    kind: Kind,
    call: Callable[[LiteGrip], GripperState],
    method: str,
    mode: str,
) -> None:
    assert call(enabled).mode == mode
    assert daemon.requests[-1].method == method
    assert daemon.requests[-1].params.keys() == set(GUARDS)
    daemon.client().send("motion.open")
    with kind.gripper() as other, pytest.raises(BusyError):
        call(other)


# The motor by itself


@pytest.mark.parametrize(("register", "sent"), [("PMAX", "PMAX"), (21, "21"), ("0x15", "0x15")])
def test_a_register_by_name_or_number(
    daemon: Heard, gripper: LiteGrip, register: str | int, sent: str
) -> None:
    assert gripper.read_param(register) == 12.5
    assert daemon.requests[-1].params == {"register": sent}


def test_what_is_no_register_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(CommandError, match=r"register is 2\.5"):
        gripper.read_param(2.5)  # type: ignore[arg-type]


def test_a_new_zero_leaves_the_motor_disabled_and_uncalibrated(
    daemon: Heard, enabled: LiteGrip
) -> None:
    before_rad = daemon.state.position_rad
    result = enabled.set_zero()
    assert result
    assert result.shift_rad == pytest.approx(before_rad, abs=0.01)
    assert result.position_rad == pytest.approx(0.0, abs=0.01)
    assert daemon.requests[-1].params.keys() == set(GUARDS)
    assert not daemon.is_energised
    assert (enabled.mount, enabled.config.pos_closed_rad) == (None, None)
    enabled.disconnect()
    assert "motor.disable" not in daemon.methods()
    enabled.connect()
    enabled.enable()
    with pytest.raises(CommandError) as caught:
        enabled.open()
    assert caught.value.reason == "not_calibrated"


def test_a_zero_that_fails_raises_and_one_that_is_not_sure_leaves_it_to_be_disabled(
    daemon: Heard, enabled: LiteGrip
) -> None:
    unsure = {"job": 3, "ok": False, "shift_rad": 0.25, "position_rad": 0.0}
    daemon.instead["motor.set_zero"] = {**unsure, "state": daemon.wire_state}
    assert not enabled.set_zero()
    del daemon.instead["motor.set_zero"]
    daemon.lose_from_motor = lambda _frame: True
    with pytest.raises(HardwareError):
        enabled.set_zero()
    daemon.lose_from_motor = lambda _frame: False
    enabled.disconnect()
    assert daemon.methods()[-2:] == ["motor.disable", "lease.release"]


@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
def test_after_a_stop_the_next_call_is_for_when_it_is_safe(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind, level: str
) -> None:
    why = "a hand is in there"
    site.after(0.3, lambda: daemon.client().result("stop", level=level, why=why))
    with pytest.raises(StoppedError) as caught:
        enabled.close(speed_mm_s=10.0)
    assert str(caught.value).endswith(
        f": {why}\nwhen it is safe: {kind.awaits}gripper.clear_stop()"
    )


def test_so_it_is_after_a_take_over(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    why = "the arm is in the way"
    site.after(0.3, lambda: daemon.client().result("lease.take", why=why, jaws="disable"))
    with pytest.raises(LeaseError) as caught:
        enabled.close(speed_mm_s=10.0)
    assert str(caught.value).endswith(f": {why}\nwhen it is safe: {kind.awaits}gripper.enable()")
