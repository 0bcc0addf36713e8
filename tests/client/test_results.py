import time
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from litegrip_client import EnableResult, GripperState, MoveProgress, MoveResult, ProtocolError
from tests.client.fake_daemon import MOVE, STATE

PROGRESS = {
    "phase": "travel",
    "step": 3,
    "total_steps": 9,
    "command_rad": 0.1,
    "position_rad": 0.2,
    "torque_nm": 0.3,
}
ENABLE = {"ok": True, "tries": 2, "state": STATE}


def test_a_move_has_the_vendor_sdks_names() -> None:
    move = MoveResult.from_wire(MOVE)
    assert move
    assert (move.ok, move.reached, move.stalled, move.steps) == (True, False, True, 200)
    assert (move.target_rad, move.limit_rad, move.final_cmd_rad) == (1.05, 1.0, 1.01)
    assert (move.outcome, move.state.opening_mm) == ("pressed", 35.25)


def test_truth_is_ok() -> None:
    assert not MoveResult.from_wire({**MOVE, "ok": False, "reached": True})
    assert EnableResult.from_wire(ENABLE)
    assert not EnableResult.from_wire({**ENABLE, "ok": False})


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
        (EnableResult, ENABLE),
        (MoveProgress, PROGRESS),
    ],
)
def test_more_is_ignored_and_less_is_an_error(kind: Any, data: dict[str, Any]) -> None:
    assert kind.from_wire({**data, "of_tomorrow": 1}) == kind.from_wire(data)
    optional = {"job"} if kind is MoveResult else set()
    for name in data.keys() - optional:
        less = {key: value for key, value in data.items() if key != name}
        with pytest.raises(ProtocolError, match=f"lacks '{name}'"):
            kind.from_wire(less)
    with pytest.raises(ProtocolError, match="is no object"):
        kind.from_wire(None)


def test_values_cannot_be_changed() -> None:
    state = GripperState.from_wire(STATE)
    with pytest.raises(FrozenInstanceError):
        state.seq = 1  # type: ignore[misc]
    with pytest.raises((AttributeError, TypeError)):
        state.other = 1  # type: ignore[attr-defined]
