"""How a goal is carried out, and what its end means: pure, in the daemon's words and ROS'.

A goal with an effort that closes the jaws is a grasp: they stop at an object, hold it with that
force, and go no further than the position. A goal without is a move. What has opened has no use
for a force.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from litegrip_client import ConnectError, GraspResult, GripperState, LiteGripError, MoveResult
from litegrip_client.values.voices import in_shell

from .joints import Target

CLOSES_FROM_MM = 1.0
"""Jaws that are so near to the position still close on it: they may hold something there."""
LARGEST_MARGIN = 0.95
"""Share of the travel that a grasp can leave before the closed stop; the daemon's bound."""


@dataclass(frozen=True)
class Plan:
    """One goal, as the client's calls need it."""

    opening_mm: float
    speed_mm_s: float | None
    force_n: float | None = None
    margin: float | None = None
    """For a grasp: the share of the travel before the closed stop at which it goes no further."""


def plan(target: Target, opening_mm: float | None, travel_mm: float) -> Plan:
    """Plan the way to a target inside the travel, from an opening (None if it is not known)."""
    margin = target.opening_mm / travel_mm
    closes = opening_mm is None or target.opening_mm <= opening_mm + CLOSES_FROM_MM
    if target.force_n is None or not closes or not 0.0 <= margin <= LARGEST_MARGIN:
        return Plan(target.opening_mm, target.speed_mm_s)
    return Plan(target.opening_mm, target.speed_mm_s, target.force_n, margin)


class Ending(Enum):
    """How an action ends in ROS."""

    SUCCEEDED = "succeeded"
    ABORTED = "aborted"
    CANCELED = "canceled"


@dataclass(frozen=True)
class Outcome:
    """The end of a goal. `why` is for a person, `reason` for a program; empty on success."""

    ending: Ending
    reached_goal: bool = False
    stalled: bool = False
    state: GripperState | None = None
    why: str = ""
    reason: str = ""


def of_move(result: MoveResult, *, allow_stalling: bool) -> Outcome:
    """Return the end of a goal that was a move."""
    if result.ok:
        return Outcome(Ending.SUCCEEDED, reached_goal=True, state=result.state)
    stalled = result.stalled or result.outcome == "blocked"
    ending = Ending.SUCCEEDED if stalled and allow_stalling else Ending.ABORTED
    why = "something blocks the jaws" if stalled else f"the move ended: {result.outcome}"
    return Outcome(ending, False, stalled, result.state, why, result.outcome)


def of_grasp(result: GraspResult) -> Outcome:
    """Return the end of a goal that was a grasp: without an object the jaws are at the position."""
    if result.ok:
        return Outcome(Ending.SUCCEEDED, stalled=True, state=result.state)
    if result.outcome == "no_object":
        return Outcome(Ending.SUCCEEDED, reached_goal=True, state=result.state)
    why = _GRASP_ENDS.get(result.outcome, f"the grasp ended: {result.outcome}")
    is_held = result.outcome == "motor_weak"
    return Outcome(Ending.ABORTED, False, is_held, result.state, why, result.outcome)


_GRASP_ENDS = {
    "motor_weak": "an object is held, but by less than the effort: the motor makes less torque",
    "object_lost": "the object was lost",
    "timed_out": "the jaws came neither to an object nor to the position in time",
}


def of_error(error: LiteGripError) -> Outcome:
    """Return the end of a goal that was refused, or could not run its course."""
    return Outcome(Ending.ABORTED, why=refusal(error), reason=error.reason or "")


SERVICES = {
    "stop": "~/stop",
    "stop.clear": "~/clear",
    "motor.clear_fault": "~/clear",
    "motor.enable": "~/enable",
    "motor.disable": "~/disable",
}
"""By the daemon's method: the node's service that does it."""


def in_ros(method: str | None, parameter: str | None, asked: str | None) -> str | None:
    """Name what the daemon's texts name, for who sits before ROS: a service, else a command."""
    if method is None:  # a parameter of the call that was asked: those of a command differ
        return None
    return SERVICES.get(method) or in_shell(method, parameter, asked)


def refusal(error: LiteGripError) -> str:
    """Return a refusal in one line: what was wrong, whose it is, and what to do."""
    return "; ".join(line.strip().rstrip(".") for line in str(error).splitlines())


def has_not_arrived(error: LiteGripError) -> bool:
    """Return True if no daemon has refused it: none answers, or it was too late on its way."""
    return isinstance(error, ConnectError) or error.reason == "too_late"
