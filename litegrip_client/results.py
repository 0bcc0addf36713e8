"""What the gripper's methods return: values, with the vendor SDK's names and truth.

Additional fields of a newer daemon are ignored. A missing field is a `ProtocolError`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from litegrip_client.checks import pick
from litegrip_client.state import GripperState

__all__ = [
    "EnableResult",
    "GraspResult",
    "GripperState",
    "MoveProgress",
    "MoveResult",
    "PlayResult",
    "SetZeroResult",
]


@dataclass(frozen=True, slots=True)
class EnableResult:
    """How enabling went; true if the motor's status says that it is enabled.

    `tries` counts the enable commands sent. `reason` and `message` explain a failure.
    """

    ok: bool
    state: GripperState
    tries: int
    reason: str | None = None
    message: str | None = None

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "EnableResult":
        """Read the wire's form; raises `ProtocolError`."""
        values = _with_state(data, ("ok", "tries"), "enable result")
        message = data.get("message")
        if message is not None:
            from litegrip_client.voices import in_python  # noqa: PLC0415 - seldom needed

            message = in_python(str(message))
        return cls(**values, reason=data.get("reason"), message=message)


@dataclass(frozen=True, slots=True)
class MoveResult:
    """How a motion ended; true if it ended as it should.

    For open and close that is pressed onto the mechanical stop: then `stalled` is true and
    `reached` is not, because the target lies behind the stop. For the motions to a target it is
    `reached` and not `stalled`. `outcome` names the end; `protected` is true if the torque guard
    ended it, before the jaws pressed harder on what blocks them. `target_rad` is what was aimed
    at, `limit_rad` the calibrated stop, `final_cmd_rad` the last position commanded, `steps` the
    number of commands.
    """

    ok: bool
    reached: bool
    stalled: bool
    state: GripperState
    target_rad: float
    limit_rad: float
    final_cmd_rad: float
    steps: int
    outcome: str
    protected: bool

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "MoveResult":
        """Read the wire's form; raises `ProtocolError`."""
        same = ("ok", "reached", "stalled", "target_rad", "limit_rad", "steps", "outcome")
        values = _with_state(data, (*same, "protected", "final_command_rad"), "move result")
        return cls(final_cmd_rad=values.pop("final_command_rad"), **values)


@dataclass(frozen=True, slots=True)
class GraspResult:
    """How a grasp ended; true if an object is held, and of the width that was asked for.

    On an object `stalled` is true and `reached` is not: the jaws stop short of where they would
    stand empty. `outcome` is object_held, wrong_width, no_object, object_lost or timed_out;
    `width_mm` the opening between the fingers at the object, None without one. `cycles` counts
    the whole slices of `hold_interval` for which the force was held, `held_s` the seconds.
    """

    ok: bool
    reached: bool
    stalled: bool
    state: GripperState
    target_rad: float
    force_n: float
    cycles: int
    outcome: str
    width_mm: float | None
    held_s: float

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "GraspResult":
        """Read the wire's form; raises `ProtocolError`."""
        figures = ("target_rad", "force_n", "cycles", "outcome", "width_mm", "held_s")
        return cls(**_with_state(data, ("ok", "reached", "stalled", *figures), "grasp result"))


@dataclass(frozen=True, slots=True)
class PlayResult:
    """How a replay ended; true if it came through to the end of its path.

    `outcome` is completed, blocked (something keeps the jaws from the end of the path) or
    not_aligned (they could not get to its start). `loops` counts the whole passes, `frames` the
    commands; `largest_lag_mm` is how far the jaws were behind the path at most.

    With `force` "replay" `outcome` may also be no_object, object_lost or timed_out, as a grasp's.
    `grips` counts those that held something; `width_mm` is the latest one's, and
    `width_difference_mm` by how much the object that differed most was wider (above 0) than the
    taught one.
    """

    ok: bool
    outcome: str
    state: GripperState
    loops: int
    frames: int
    largest_lag_mm: float
    final_cmd_rad: float
    grips: int = 0
    width_mm: float | None = None
    width_difference_mm: float | None = None

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "PlayResult":
        """Read the wire's form; raises `ProtocolError`."""
        same = ("ok", "outcome", "loops", "frames", "largest_lag_mm")
        values = _with_state(data, (*same, "final_command_rad"), "play result")
        return cls(
            final_cmd_rad=values.pop("final_command_rad"),
            grips=data.get("grips", 0),
            width_mm=data.get("width_mm"),
            width_difference_mm=data.get("width_difference_mm"),
            **values,
        )


@dataclass(frozen=True, slots=True)
class SetZeroResult:
    """True if the motor counts from its new zero; `shift_rad` is by how much it was moved."""

    ok: bool
    shift_rad: float
    position_rad: float
    state: GripperState

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "SetZeroResult":
        """Read the wire's form; raises `ProtocolError`."""
        return cls(**_with_state(data, ("ok", "shift_rad", "position_rad"), "zero"))


@dataclass(frozen=True, slots=True)
class MoveProgress:
    """How far a motion is: `phase`, command `i` of `total_steps`, and what the motor does.

    `total_steps` is 0 where a phase has no foreseeable end, as the "hold" of a grasp.
    """

    phase: str
    i: int
    total_steps: int
    cmd_rad: float
    pos_rad: float
    torque_nm: float

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "MoveProgress":
        """Read the wire's form; raises `ProtocolError`."""
        return cls(*pick(data, _PROGRESS_KEYS, "progress").values())


_PROGRESS_KEYS = ("phase", "step", "total_steps", "command_rad", "position_rad", "torque_nm")


def _with_state(data: Mapping[str, Any], names: tuple[str, ...], what: str) -> dict[str, Any]:
    values = pick(data, (*names, "state"), what)
    values["state"] = GripperState.from_wire(values["state"])
    return values
