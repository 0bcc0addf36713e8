"""The state of the gripper, and the results of its actions, as values.

Fields that only a newer daemon sends are ignored. A missing field is a `ProtocolError`, except for
`NEWER_FIELDS`: these are None if the daemon is older.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, cast

from litegrip_client.values.checks import pick
from litegrip_client.values.fields import Hinting, MoveNames, StateNames

if TYPE_CHECKING:
    from litegrip_client.values.terms import Voice

USABLE_BUS = ("up", "motor_silent")
"""States of a bus on which frames can be exchanged."""


NEWER_FIELDS = (
    *("clamp_n", "loss_detection", "loss_detection_from_n"),
    *("work_stroke_mm", "scale_doubt", "pressing_n"),
)
"""Fields that an older daemon does not send."""


class ShortRepr(Hinting):
    """Shows the known fields, rounded to four digits; the fields themselves are not rounded."""

    __slots__ = ()

    def _beyond(self) -> dict[str, type]:
        return {"state.": GripperState} if hasattr(type(self), "state") else {}

    def __repr__(self) -> str:
        values = ((one.name, getattr(self, one.name)) for one in fields(cast("Any", self)))
        known = (
            f"{name}={value:.4g}" if isinstance(value, float) else f"{name}={value!r}"
            for name, value in values
            if value is not None
        )
        return f"{type(self).__name__}({', '.join(known)})"


@dataclass(frozen=True, slots=True, repr=False)
class GripperState(StateNames):
    """The daemon's newest state. None stands where something is not known.

    Times are CLOCK_MONOTONIC seconds: `monotonic_s` of this state, `feedback_s` of the motor's
    last feedback. `age_s` is the feedback's age when the state was made; `stale` is true if the
    figures are old ones. `error_code` is the motor's status nibble and `status` its name. `enabled`
    is None while nobody knows: take only False for a motor that is off. `mode` is "offline",
    "disabled", "enabling", "holding", "moving", "relaxed" (zero gravity), "disabling" or "fault".

    `command_rad` and `command_torque_nm` are the motor's command, `requested_rad` and
    `requested_torque_nm` the motion's request; `limited` says why they differ, and
    has "speed" while a stream's speed holds its target back.
    `force_set_n` is the squeezing force that a hold by force aims at, None in any other and
    when the motor is off; `is_grasped` is true if an object is held, and
    None if one was when the motor fell silent, which may have let go by itself.

    While one is, `clamp_n` is the least and the most force (N) that it may feel: friction hides the
    difference, and a tenth of it is the motor's. The least is 0 while the jaws search for an object
    that gave way. What else pushes the jaws is not in it: a hand, a weight.
    `loss_detection` is true if its loss would be noticed, `loss_detection_from_n` with which set
    force it would. All three are None without an object, and of a daemon that does not know them.

    `pressing_n` is about the force with which the jaws press in any mode, by the motor's torque:
    they stand, and it makes more than friction explains, or they hold by force. None while they do
    not press.

    `work_stroke_mm` is the opening to which `open` goes, None for the open stop. `scale_doubt` says
    why the calibration's millimetres are probably wrong: "superseded" if they are those of earlier
    versions, which took the travel for 120 mm, "unusual" if no gripper was seen to have them; then
    measure the jaws and call `rescale_calibration`.
    """

    seq: int
    monotonic_s: float
    feedback_s: float | None
    age_s: float | None
    stale: bool
    bus: str
    motor: str
    error_code: int | None
    status: str | None
    enabled: bool | None
    mode: str
    position_rad: float | None
    velocity_rad_s: float | None
    torque_nm: float | None
    force_n: float | None
    opening_mm: float | None
    openness: float | None
    driver_temperature_c: float | None
    coil_temperature_c: float | None
    command_rad: float | None
    requested_rad: float | None
    command_torque_nm: float | None
    requested_torque_nm: float | None
    force_set_n: float | None
    is_grasped: bool | None
    clamp_n: tuple[float, float] | None
    loss_detection: bool | None
    loss_detection_from_n: float | None
    pressing_n: float | None
    limited: tuple[str, ...]
    calibrated: bool
    mount: str | None
    work_stroke_mm: float | None
    scale_doubt: str | None
    job: dict[str, Any] | None
    stop: dict[str, Any] | None
    stop_generation: int

    def __repr__(self) -> str:
        figures = (
            ("opening_mm", self.opening_mm, ".1f"),
            ("force_n", self.force_n, ".1f"),
            ("force_set_n", self.force_set_n, ".1f"),
            ("coil_temperature_c", self.coil_temperature_c, ".0f"),
        )
        parts = [repr(self.mode)]
        if self.mode == "fault" and self.status is not None:
            parts.append(f"status={self.status!r}")
        parts += [f"{name}={value:{form}}" for name, value, form in figures if value is not None]
        parts += [name for name in ("stale", "is_grasped") if getattr(self, name)]
        if self.scale_doubt is not None:
            parts.append(f"scale_doubt={self.scale_doubt!r}")
        if self.job is not None:
            parts.append(f"job={self.job.get('kind')!r}")
        if self.stop is not None:
            parts.append(f"stop={self.stop.get('level')!r}")
        return f"GripperState({', '.join(parts)})"

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> GripperState:
        """Read the wire's form; raises `ProtocolError`."""
        try:
            state: Any = _Draft(data)
        except (KeyError, TypeError):  # an older daemon's, or none
            needed = pick(data, _NEEDED_FIELDS, "state")
            newer = {name: data.get(name) for name in NEWER_FIELDS}
            state = _Draft(needed | newer)
        state.__class__ = cls
        return cast("GripperState", state)

    @property
    def age_now_s(self) -> float | None:
        """How old the motor's feedback is by now, in seconds; None if there never was any."""
        return None if self.feedback_s is None else time.monotonic() - self.feedback_s


STATE_FIELDS = tuple(field.name for field in fields(GripperState))
_NEEDED_FIELDS = tuple(name for name in STATE_FIELDS if name not in NEWER_FIELDS)


class _Draft(StateNames):
    """A `GripperState` that is being made: its fields, which may still be set.

    Loops read states, and the frozen class itself takes four times as long to set its fields.
    """

    __slots__ = STATE_FIELDS

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.seq = data["seq"]
        self.monotonic_s = data["monotonic_s"]
        self.feedback_s = data["feedback_s"]
        self.age_s = data["age_s"]
        self.stale = data["stale"]
        self.bus = data["bus"]
        self.motor = data["motor"]
        self.error_code = data["error_code"]
        self.status = data["status"]
        self.enabled = data["enabled"]
        self.mode = data["mode"]
        self.position_rad = data["position_rad"]
        self.velocity_rad_s = data["velocity_rad_s"]
        self.torque_nm = data["torque_nm"]
        self.force_n = data["force_n"]
        self.opening_mm = data["opening_mm"]
        self.openness = data["openness"]
        self.driver_temperature_c = data["driver_temperature_c"]
        self.coil_temperature_c = data["coil_temperature_c"]
        self.command_rad = data["command_rad"]
        self.requested_rad = data["requested_rad"]
        self.command_torque_nm = data["command_torque_nm"]
        self.requested_torque_nm = data["requested_torque_nm"]
        self.force_set_n = data["force_set_n"]
        self.is_grasped = data["is_grasped"]
        self.clamp_n = None if data["clamp_n"] is None else tuple(data["clamp_n"])
        self.loss_detection = data["loss_detection"]
        self.loss_detection_from_n = data["loss_detection_from_n"]
        self.pressing_n = data["pressing_n"]
        self.limited = tuple(data["limited"] or ())
        self.calibrated = data["calibrated"]
        self.mount = data["mount"]
        self.work_stroke_mm = data["work_stroke_mm"]
        self.scale_doubt = data["scale_doubt"]
        self.job = data["job"]
        self.stop = data["stop"]
        self.stop_generation = data["stop_generation"]


__all__ = [
    "EnableResult",
    "GraspResult",
    "GripperState",
    "MoveProgress",
    "MoveResult",
    "PlayResult",
    "SetZeroResult",
]


@dataclass(frozen=True, slots=True, repr=False)
class EnableResult(ShortRepr):
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
    def from_wire(cls, data: Mapping[str, Any], voice: Voice | None = None) -> EnableResult:
        """Read the wire's form, in the words of a voice; raises `ProtocolError`."""
        values = _with_state(data, ("ok", "tries"), "enable result")
        message = data.get("message")
        if message is not None:
            from litegrip_client.values.terms import told  # noqa: PLC0415 - seldom needed
            from litegrip_client.values.voices import in_python  # noqa: PLC0415 - seldom needed

            message = told(data, "message", voice or in_python)
        return cls(**values, reason=data.get("reason"), message=message)


@dataclass(frozen=True, slots=True, repr=False)
class MoveResult(ShortRepr):
    """How a motion ended; true if it ended as it should.

    For open and close that is pressed onto the mechanical stop: then `stalled` is true and
    `reached` is not, because the target lies behind the stop. For the motions to a target, and for
    open to a `work_stroke_mm`, it is `reached` and not `stalled`. `outcome` names the end;
    `protected` is true if the torque guard ended it, before the jaws pressed harder on what blocks
    them. `target_rad` is what was aimed at, `limit_rad` the calibrated stop, `final_cmd_rad` the
    last position commanded, `steps` the number of commands.
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
    def from_wire(cls, data: Mapping[str, Any]) -> MoveResult:
        """Read the wire's form; raises `ProtocolError`."""
        same = ("ok", "reached", "stalled", "target_rad", "limit_rad", "steps", "outcome")
        values = _with_state(data, (*same, "protected", "final_command_rad"), "move result")
        return cls(final_cmd_rad=values.pop("final_command_rad"), **values)


@dataclass(frozen=True, slots=True, repr=False)
class GraspResult(ShortRepr):
    """How a grasp ended; true if an object is held, and of the width that was asked for.

    On an object `stalled` is true and `reached` is not: the jaws stop short of where they would
    stand empty. `outcome` is object_held, wrong_width, motor_weak (the motor makes less torque than
    is commanded: what is held is held by less), no_object, object_lost or timed_out; `width_mm`
    the opening between the fingers at the object, None without one. `cycles` counts the whole
    slices of `hold_interval` for which the force was held, `held_s` the seconds.
    `speed_mm_s` is how fast the jaws closed, slower than requested for a small force; None if they
    held the object already, and of an older daemon.
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
    speed_mm_s: float | None = None

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> GraspResult:
        """Read the wire's form; raises `ProtocolError`."""
        figures = ("target_rad", "force_n", "cycles", "outcome", "width_mm", "held_s")
        values = _with_state(data, ("ok", "reached", "stalled", *figures), "grasp result")
        return cls(**values, speed_mm_s=data.get("speed_mm_s"))


@dataclass(frozen=True, slots=True, repr=False)
class PlayResult(ShortRepr):
    """How a replay ended; true if it came through to the end of its path.

    `outcome` is completed, blocked (something keeps the jaws from the end of the path) or
    not_aligned (they could not get to its start). `loops` counts the whole passes, `frames` the
    commands; `largest_lag_mm` is how far the jaws were behind the path at most.

    With `force` "replay" `outcome` may also be a grasp's: motor_weak, no_object, object_lost or
    timed_out.
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

    def __getitem__(self, name: str) -> Any:
        """Return a field by its name, as from the status of a replay; raises `KeyError`."""
        if name not in _PLAY_FIELDS:
            raise KeyError(name)
        return getattr(self, name)

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> PlayResult:
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


_PLAY_FIELDS = tuple(field.name for field in fields(PlayResult))


@dataclass(frozen=True, slots=True, repr=False)
class SetZeroResult(ShortRepr):
    """True if the motor counts from its new zero; `shift_rad` is by how much it was moved."""

    ok: bool
    shift_rad: float
    position_rad: float
    state: GripperState

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> SetZeroResult:
        """Read the wire's form; raises `ProtocolError`."""
        return cls(**_with_state(data, ("ok", "shift_rad", "position_rad"), "zero"))


@dataclass(frozen=True, slots=True, repr=False)
class MoveProgress(ShortRepr, MoveNames):
    """How far a motion is: command `i` of `total_steps`, and what the motor does.

    `phase` is "move" on the way of every motion, "hold" while a grasp holds, and else what the
    daemon calls it, as `stage` does in any case. `total_steps` is 0 where a phase has no
    foreseeable end, as the "hold" of a grasp. `delta_rad` is how far the jaws have moved since the
    report before, `win_delta_rad` since the fifth before; `temperature_coil` is in °C, None of an
    older daemon.
    """

    stage: str
    i: int
    total_steps: int
    cmd_rad: float
    pos_rad: float
    torque_nm: float
    delta_rad: float = 0.0
    win_delta_rad: float = 0.0
    temperature_coil: float | None = None

    @classmethod
    def from_wire(cls, data: Mapping[str, Any], before: list[float] | None = None) -> MoveProgress:
        """Read the wire's form; raises `ProtocolError`.

        `before` has the positions of the motion's last reports, to which this one is added.
        """
        values = pick(data, _PROGRESS_KEYS, "progress")
        position_rad, seen = values["position_rad"], [] if before is None else before
        delta_rad = position_rad - seen[-1] if seen else 0.0
        win_delta_rad = position_rad - seen[0] if seen else 0.0
        seen.append(position_rad)
        del seen[:-_WINDOW]
        values |= {"delta_rad": delta_rad, "win_delta_rad": win_delta_rad}
        values["temperature_coil"] = data.get("coil_temperature_c")
        return cls(*values.values())


_WINDOW = 5
_PROGRESS_KEYS = ("phase", "step", "total_steps", "command_rad", "position_rad", "torque_nm")


def _with_state(data: Mapping[str, Any], names: tuple[str, ...], what: str) -> dict[str, Any]:
    values = pick(data, (*names, "state"), what)
    values["state"] = GripperState.from_wire(values["state"])
    return values
