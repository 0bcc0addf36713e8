"""What a gripper's state is in a data set, and what a data set's action is for a gripper.

Pure: no clock, no connection, nothing of LeRobot's. A position is the share of the travel that is
open, in percent, as that of LeRobot's own grippers. Positions and velocities grow while the jaws
open, torques are positive while they squeeze, whichever way the motor is mounted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from litegrip_client import CommandError, GripperState, ParameterError

POS, TORQUE = "gripper.pos", "gripper.torque"
AGE, STAMP = "gripper.age_s", "gripper.stamp_s"
OBSERVED = (POS, "gripper.vel", TORQUE, "gripper.grasped", "gripper.temp")

PERCENT = 100.0
LEAST_TORQUE_NM, MOST_TORQUE_NM = 0.1, 3.0
"""What a stream of targets may press with."""

CLOSED_PERCENT = 2.0
"""Jaws that press within this of closed press on each other."""


@dataclass(frozen=True, slots=True)
class Travel:
    """The travel in use, in radians of the motor."""

    closed_rad: float
    open_rad: float

    @classmethod
    def from_info(cls, info: Mapping[str, Any]) -> Travel:
        """Read `LiteGrip.info()`; raises `CommandError` for a gripper that is not calibrated."""
        gripper = info["gripper"]
        if not gripper["calibrated"]:
            raise not_calibrated()
        return cls(float(gripper["closed_rad"]), float(gripper["open_rad"]))

    @property
    def close_sign(self) -> float:
        """1 if closing increases the motor's radians, else -1."""
        return math.copysign(1.0, self.closed_rad - self.open_rad)

    def percent_s(self, velocity_rad_s: float) -> float:
        """Return a velocity in percent of the travel a second, positive while opening."""
        return PERCENT * velocity_rad_s / (self.open_rad - self.closed_rad)


def observation_of(state: GripperState, travel: Travel, zero_s: float) -> dict[str, float]:
    """Return what a data set has of a state, but for its age.

    `gripper.stamp_s` is when the motor measured it, in seconds since `zero_s` of the daemon's
    clock: a data set has float32, which cannot tell the milliseconds of a clock that runs for
    days. Raises `CommandError` while the gripper is not calibrated, and for a motor that has not
    reported yet.
    """
    openness, velocity_rad_s, torque_nm = state.openness, state.velocity_rad_s, state.torque_nm
    coil_c, feedback_s = state.coil_temperature_c, state.feedback_s
    if openness is None or velocity_rad_s is None or torque_nm is None:
        raise not_calibrated()
    if coil_c is None or feedback_s is None:
        raise CommandError("the motor has not reported yet", reason="not_initialized")
    pos, squeeze_nm = PERCENT * openness, travel.close_sign * torque_nm
    # A set force has the daemon's verdict. Jaws that follow targets have none: there they hold
    # something if they stand and squeeze, short of each other.
    presses = state.pressing_n is not None and squeeze_nm > 0.0 and pos > CLOSED_PERCENT
    return {
        POS: pos,
        "gripper.vel": travel.percent_s(velocity_rad_s),
        TORQUE: squeeze_nm,
        "gripper.grasped": float(state.is_grasped is True or presses),
        "gripper.temp": float(coil_c),
        STAMP: feedback_s - zero_s,
    }


def target_of(action: Mapping[str, Any], torque_nm: float) -> tuple[float, float]:
    """Return the openness (0 to 1) and the torque (N·m) that an action asks for, clipped.

    Values may be tensors without dimensions, as `lerobot-replay` sends them. Without a torque of
    its own an action presses with `torque_nm` at most. Raises `ParameterError` for an action
    without a position, and for what is no finite number.
    """
    if POS not in action:
        raise ParameterError(f"an action needs {POS}, this one has: {', '.join(action)}")
    return (
        clipped(POS, action[POS], 0.0, PERCENT) / PERCENT,
        clipped(TORQUE, action.get(TORQUE, torque_nm), LEAST_TORQUE_NM, MOST_TORQUE_NM),
    )


def action_of(state: GripperState, torque_nm: float) -> dict[str, float]:
    """Return what a leader whose state this is asks its follower for.

    LeRobot stores what the leader asks for, not what the follower makes of it: so it is clipped
    here. Raises `CommandError` while the gripper is not calibrated.
    """
    if state.openness is None:
        raise not_calibrated()
    openness, torque_nm = target_of({POS: PERCENT * state.openness}, torque_nm)
    return {POS: PERCENT * openness, TORQUE: torque_nm}


def clipped(name: str, value: Any, least: float, most: float) -> float:
    """Return a value within its range; raises `ParameterError` for what is no finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} is {value!r:.60}, it must be a number") from error
    if not math.isfinite(number):
        raise ParameterError(f"{name} is {number}, it must be a finite number")
    return min(max(number, least), most)


def not_calibrated() -> CommandError:
    """Return the error for a gripper whose travel is not known."""
    return CommandError(
        "the gripper is not calibrated",
        reason="not_calibrated",
        data={"hint": "calibrate it: lerobot-calibrate"},
    )
