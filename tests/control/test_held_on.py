"""Each closing on a held object is blocked at once; the hold keeps its force."""

from typing import Any

import pytest

from litegrip_client import MoveResult
from litegripd.model.calibration import NOMINAL
from tests.control.held import Held, every_mount

CLOSING: list[tuple[str, dict[str, Any]]] = [
    ("motion.close", {}),
    ("motion.close", {"speed_mm_s": 100}),
    ("motion.move", {"opening_mm": 10}),
    ("motion.move", {"openness": 0.0}),
    ("motion.move", {"opening_mm": 30, "duration_s": 1.0}),
]


def held_on(held: Held, force_n: float, duration_s: float = 1.0) -> None:
    """Nothing presses harder than the hold meanwhile, and it holds on."""
    seen = held.track(duration_s, lambda: (held.clamp_n, held.torque_nm))
    clamps_n, torques_nm = zip(*seen, strict=True)
    assert 0.85 * force_n < min(clamps_n)
    assert max(clamps_n) < 1.1 * force_n
    assert max(torques_nm) < force_n / 10.0 + 0.1
    assert held.state.is_grasped
    assert held.state.force_set_n == force_n
    assert held.events("object_lost") == []


@every_mount
@pytest.mark.parametrize("hold_by", ["torque", "gains"])
@pytest.mark.parametrize(("method", "params"), CLOSING)
def test_closing_on_what_is_held_is_blocked_at_once(
    method: str, params: dict[str, Any], hold_by: str, mount: str
) -> None:
    held = Held(20.0, mount, hold_by=hold_by)
    began_s = held.now_s
    result = held.owner.result(method, **params)
    assert held.now_s - began_s <= 2 * held.period_s
    assert (result["ok"], result["outcome"]) == (False, "blocked")
    assert (result["stalled"], result["reached"], result["protected"]) == (True, False, False)
    assert result["state"]["is_grasped"]
    held_on(held, 20.0)


def test_the_client_gets_the_result_of_a_move_that_stalled() -> None:
    result = MoveResult.from_wire(Held(20.0).owner.result("motion.close"))
    assert (result.ok, result.stalled, result.outcome) == (False, True, "blocked")
    assert result.state.is_grasped


def test_closing_in_the_background_is_blocked_too() -> None:
    held = Held(20.0)
    job = held.owner.result("motion.close", wait=False, detach=True)["job"]
    held_on(held, 20.0, 0.5)
    kept = held.owner.result("job.get", job=job)
    assert (kept["state"], kept["result"]["outcome"]) == ("done", "blocked")


def test_a_closing_that_waited_for_a_grasp_is_blocked_after_it() -> None:
    held = Held(20.0)
    grasping = held.owner.send("motion.grasp", force_n=20, hold_s=0.5)
    closing = held.owner.send("motion.close", if_busy="queue")
    held_on(held, 20.0)
    assert held.owner.has_answer(grasping)
    assert held.owner.has_answer(closing)
    assert held.owner.answers[closing]["result"]["outcome"] == "blocked"


@pytest.mark.parametrize(
    ("method", "params", "to_mm"),
    [("motion.open", {}, NOMINAL[0].travel_mm), ("motion.move", {"opening_mm": 80}, 80.0)],
)
def test_opening_lets_go_as_ever(method: str, params: dict[str, Any], to_mm: float) -> None:
    held = Held(20.0)
    assert held.owner.result(method, **params)["ok"]
    assert held.gripper.opening_mm == pytest.approx(to_mm, abs=1.5)
    assert not held.state.is_grasped


def test_closing_works_again_once_the_object_is_gone() -> None:
    held = Held(20.0)
    held.gripper.remove_object()
    held.run(0.3)
    assert held.owner.result("motion.close")["ok"]
