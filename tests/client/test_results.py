import copy
import inspect
import pickle
import time
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from litegrip_client import (
    EnableResult,
    Event,
    GraspResult,
    GripperState,
    LiteGrip,
    MoveProgress,
    MoveResult,
    ProtocolError,
    SetZeroResult,
)
from litegrip_client.aio import LiteGrip as AioLiteGrip
from litegrip_client.values.calibration import NOMINAL_RAD_TO_MM
from litegrip_client.values.fields import STILL_RAD_S
from litegrip_client.values.printed import HealthReport
from litegrip_client.values.results import NEWER_FIELDS
from tests.client.fake_daemon import GRASP, MOVE, STATE

PROGRESS = {
    "phase": "travel",
    "step": 3,
    "total_steps": 9,
    "command_rad": 0.1,
    "position_rad": 0.2,
    "torque_nm": 0.3,
}
ENABLE = {"ok": True, "tries": 2, "state": STATE}
ZEROED = {"job": 3, "ok": True, "shift_rad": 0.25, "position_rad": 0.0, "state": STATE}


def test_a_move_has_the_vendor_sdks_names() -> None:
    move = MoveResult.from_wire(MOVE)
    assert move
    assert (move.ok, move.reached, move.stalled, move.steps) == (True, False, True, 200)
    assert (move.target_rad, move.limit_rad, move.final_cmd_rad) == (1.05, 1.0, 1.01)
    assert (move.outcome, move.state.opening_mm) == ("pressed", 35.25)
    assert MoveResult.from_wire({**MOVE, "protected": True}).protected


def test_a_grasp_has_the_vendor_sdks_names_and_more() -> None:
    grasp = GraspResult.from_wire(GRASP)
    assert grasp
    assert (grasp.ok, grasp.reached, grasp.stalled) == (True, False, True)
    assert (grasp.target_rad, grasp.force_n, grasp.cycles) == (0.95, 20.0, 15)
    assert (grasp.outcome, grasp.width_mm, grasp.held_s) == ("object_held", 31.5, 3.0)
    assert grasp.state.mode == "holding"


def test_truth_is_ok() -> None:
    assert not MoveResult.from_wire({**MOVE, "ok": False, "reached": True})
    assert EnableResult.from_wire(ENABLE)
    assert not EnableResult.from_wire({**ENABLE, "ok": False})
    assert not GraspResult.from_wire({**GRASP, "ok": False, "outcome": "no_object"})
    assert SetZeroResult.from_wire(ZEROED)
    assert not SetZeroResult.from_wire({**ZEROED, "ok": False})


def test_an_enable_that_failed_tells_why() -> None:
    assert EnableResult.from_wire(ENABLE).reason is None
    failed = EnableResult.from_wire(
        {**ENABLE, "ok": False, "reason": "motor_silent", "message": "m"}
    )
    assert (failed.tries, failed.reason, failed.message) == (2, "motor_silent", "m")


def test_progress_has_the_vendor_sdks_names() -> None:
    assert MoveProgress.from_wire(PROGRESS) == MoveProgress("travel", 3, 9, 0.1, 0.2, 0.3)


def test_a_state_has_all_fields_of_the_protocol() -> None:
    state = GripperState.from_wire({**STATE, "limited": ["speed"]})
    for name, value in STATE.items():
        assert getattr(state, name) == (("speed",) if name == "limited" else value)


def test_each_field_of_a_state_has_its_own_value() -> None:
    own: dict[str, Any] = {name: f"the {name}" for name in STATE}
    own |= {"limited": ("speed",), "clamp_n": (1.0, 2.0)}
    sent = own | {"limited": ["speed"], "clamp_n": [1.0, 2.0], "of_tomorrow": 1}
    state = GripperState.from_wire(sent)
    assert type(state) is GripperState
    assert state == GripperState(**own)
    assert state == pickle.loads(pickle.dumps(state)) == copy.copy(state)
    with pytest.raises(FrozenInstanceError):
        state.mode = "moving"  # type: ignore[misc]


def test_the_age_goes_on() -> None:
    state = GripperState.from_wire({**STATE, "feedback_s": time.monotonic() - 2.0})
    assert state.age_now_s is not None
    assert 2.0 <= state.age_now_s < 60.0
    assert GripperState.from_wire({**STATE, "feedback_s": None}).age_now_s is None


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (GripperState, STATE),
        (MoveResult, MOVE),
        (GraspResult, GRASP),
        (SetZeroResult, ZEROED),
        (EnableResult, ENABLE),
        (MoveProgress, PROGRESS),
    ],
)
def test_more_is_ignored_and_less_is_an_error(kind: Any, data: dict[str, Any]) -> None:
    assert kind.from_wire({**data, "of_tomorrow": 1}) == kind.from_wire(data)
    optional = {"job"} if kind is not GripperState else set(NEWER_FIELDS)
    for name in data.keys() - optional:
        less = {key: value for key, value in data.items() if key != name}
        with pytest.raises(ProtocolError, match=f"lacks '{name}'"):
            kind.from_wire(less)
    with pytest.raises(ProtocolError, match="is no object"):
        kind.from_wire(None)


def test_what_an_older_daemon_does_not_say_of_a_grip_is_not_known() -> None:
    older = {name: value for name, value in STATE.items() if name not in NEWER_FIELDS}
    state = GripperState.from_wire(older)
    assert (state.clamp_n, state.loss_detection, state.loss_detection_from_n) == (None,) * 3
    held = {"clamp_n": [17.5, 22.5], "loss_detection": True, "loss_detection_from_n": 3.6}
    state = GripperState.from_wire({**STATE, **held})
    assert state.clamp_n == (17.5, 22.5)
    assert state.loss_detection
    assert state.loss_detection_from_n == 3.6


def test_values_cannot_be_changed() -> None:
    state = GripperState.from_wire(STATE)
    with pytest.raises(FrozenInstanceError):
        state.seq = 1  # type: ignore[misc]
    with pytest.raises((AttributeError, TypeError)):
        state.other = 1  # type: ignore[attr-defined]


def test_what_an_interpreter_shows_is_one_short_line() -> None:
    state = GripperState.from_wire(STATE)
    assert repr(state) == (
        "GripperState('holding', opening_mm=35.2, force_n=5.0, coil_temperature_c=33)"
    )
    busy = {
        **STATE,
        "opening_mm": None,
        "force_n": None,
        "stale": True,
        "is_grasped": True,
        "force_set_n": 12.0,
        "job": {"kind": "grasp"},
        "stop": {"level": "hold"},
        "scale_doubt": "superseded",
    }
    assert repr(GripperState.from_wire(busy)) == (
        "GripperState('holding', force_set_n=12.0, coil_temperature_c=33, stale, is_grasped,"
        " scale_doubt='superseded', job='grasp', stop='hold')"
    )
    fault = {**STATE, "mode": "fault", "status": "overload", "opening_mm": None, "force_n": None}
    assert repr(GripperState.from_wire(fault)) == (
        "GripperState('fault', status='overload', coil_temperature_c=33)"
    )
    assert repr(GraspResult.from_wire({**GRASP, "width_mm": 31.456789})) == (
        f"GraspResult(ok=True, reached=False, stalled=True, state={state!r}, target_rad=0.95,"
        " force_n=20, cycles=15, outcome='object_held', width_mm=31.46, held_s=3)"
    )
    assert (
        repr(EnableResult.from_wire(ENABLE)) == f"EnableResult(ok=True, state={state!r}, tries=2)"
    )


def test_a_gripper_says_which_one_it_is_without_asking_anybody() -> None:
    assert repr(LiteGrip("can7")) == "<LiteGrip can7, not connected>"
    assert repr(AioLiteGrip("can7")) == "<LiteGrip can7, not connected>"


def test_the_time_of_a_state_and_of_an_event_is_also_the_time_of_day() -> None:
    now_s = time.monotonic()
    state = GripperState.from_wire({**STATE, "feedback_s": now_s - 5})
    event = Event(1, now_s - 5, "motor", "", {})
    for timestamp in (state.timestamp, event.timestamp):
        assert timestamp == pytest.approx(time.time() - 5, abs=1)


@pytest.mark.parametrize("kind", [GripperState, LiteGrip])
def test_what_counts_as_moving_is_told_in_the_scale_that_ships(kind: type) -> None:
    told = f"{STILL_RAD_S:g} rad/s ({STILL_RAD_S * NOMINAL_RAD_TO_MM:.1f} mm/s at"
    assert told in str(inspect.getdoc(kind.is_moving))  # type: ignore[attr-defined]


def test_a_member_of_health_that_is_read_as_an_attribute_is_told_how() -> None:
    health = HealthReport({"verdict": "ok"})
    with pytest.raises(AttributeError, match=r"it is a dictionary: health\['verdict'\]"):
        _ = health.verdict  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match=r"no attribute 'colour'$"):
        _ = health.colour  # type: ignore[attr-defined]
