"""Admission of motions: refusals that say why a motion may not begin, and what to do."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from litegripd.control.authority import said_of
from litegripd.model.calibration import SCALE_TOLERANCE, fits_stroke
from litegripd.model.errors import Refusal, at_least, at_most, unit_of
from litegripd.model.gripper import (
    SPAN_INSET_MM,
    SUPERSEDED_STROKE_MM,
    Geometry,
    GripperId,
    MotorType,
)
from litegripd.model.motion_config import Conflict
from litegripd.model.motor import MotorPhase, MotorView
from litegripd.model.sentence import Sentence, method_name, parameter_name, sentence
from litegripd.model.state import Job, JobKind, JobState, Stop

IMPLAUSIBLE_OUTSIDE_RAD = 1.0
"""No jaw can be further outside the calibrated travel. The motor loses its count of turns in a
power cycle, and its position can come back off by 2π."""

_ROUNDING = 1e-6

ENDING = Refusal(
    "shutting_down",
    "the daemon is about to end: it disables the motor, and what was held falls",
)
FOLLOWED = Refusal(
    "shutting_down",
    "a new daemon has taken the gripper over, and what was held is held on: connect again",
    {"followed": True},
)
NO_FEEDBACK = Refusal("motor_silent", "no feedback has come yet: try again")

NOT_ENABLED = Refusal(
    "not_enabled",
    sentence("the motor is not enabled: enable it first ({motor.enable})"),
    {"hint": method_name("motor.enable")},
)

FAULTLESS = Refusal(
    "out_of_limits", "the motor is enabled, so it has no fault; clearing one would disarm it"
)

NOT_CALIBRATED = Refusal(
    "not_calibrated",
    "no calibration is loaded, so the closing direction would be a guess: configure"
    ' mount = "normal" or "reverse", or a calibration file, in [gripper]',
    {"hint": sentence("choose a mount: {calibration.load with template}, then {calibration.zero}")},
)

CALIBRATION_COMING = Refusal(
    "starting",
    "the daemon has just started and is still reading the calibration: try again in a moment",
)

ZERO_MOVED = Refusal(
    "not_calibrated",
    sentence(
        "the motor's zero was moved, so the calibration is no longer valid: calibrate again"
        " ({calibration.zero with a mount}, or by hand)"
    ),
    {"hint": sentence("{calibration.zero with a mount}")},
)


_BUSY_BY: Mapping[JobKind, str] = {"teleop": "teleop_busy"}
_ENDED_BY: Mapping[JobKind, Sentence] = {
    "teleop": sentence("end it by {teleop.stop}"),
    "record": sentence("end it ({trajectory.record_stop})"),
    "stream": sentence(
        "it ends by itself soon after its last target; to end it at once, cancel it ({job.cancel})"
    ),
}
"""How to end a job that does not end by itself. A recording outlasts its job if that is cancelled,
and then refuses what it has refused before."""
_ENDS_ITSELF = sentence("wait for it ({job.wait}), cancel it ({job.cancel}) or stop")


def busy_refusal(running: Job | None) -> Refusal | None:
    """Return a refusal that names who is moving, None if nobody is."""
    return None if running is None else busy_with(running)


def busy_with(running: Job) -> Refusal:
    """Return a refusal that names the running job, or the next one, and its owner."""
    owner = running.owner
    how = _ENDED_BY.get(running.kind, _ENDS_ITSELF)
    does = "is about to begin" if running.state is JobState.QUEUED else "is running"
    return Refusal(
        _BUSY_BY.get(running.kind, "busy"),
        sentence(
            "job {number}, {kind} by {program} (pid {pid}), {does}: {how}",
            number=running.number,
            kind=running.kind,
            program=owner.program,
            pid=owner.pid,
            does=does,
            how=how,
        ),
        {
            "job": running.number,
            "kind": running.kind,
            "owner": {"pid": owner.pid, "uid": owner.uid, "program": owner.program},
            "hint": how,
        },
    )


def trajectory_or_teleop_refusal(running: Job | None) -> Refusal | None:
    """Return a refusal if a recording, a replay or teleoperation runs: they exclude each other."""
    if running is None or running.kind not in ("record", "play", "teleop"):
        return None
    busy = busy_with(running)
    reason = "trajectory_busy" if busy.reason == "busy" else busy.reason
    return Refusal(reason, busy.message, busy.data)


def stopped_under_way(running: Job, stop: Stop, stopped: Refusal) -> Refusal:
    """Return the reason for a job that a stop ended; it must not read as if it never began.

    It is told later, too, when the stop may be cleared.
    """
    return Refusal(
        stopped.reason,
        f"job {running.number}, {running.kind}, was broken off: {said_of(stop)}",
        {**stopped.data, "job": running.number, "kind": running.kind},
    )


def motor_refusal(motor: MotorView) -> Refusal | None:
    """Return why no motion may begin or continue, or None."""
    if motor.phase is MotorPhase.ENABLED:
        return None
    if motor.phase is MotorPhase.FAULT and motor.fault is not None:
        return motor.fault
    return motor.problem or NOT_ENABLED


def conflict_refusal(conflict: Conflict | None) -> Refusal | None:
    """Return a refusal of settings that do not fit together, or None."""
    if conflict is None:
        return None
    data = {"field": conflict.field, "requested": conflict.requested, "limit": conflict.limit}
    return Refusal("out_of_limits", conflict.message, data)


@dataclass(frozen=True, slots=True)
class Target:
    """Where to move the jaws, in the caller's own quantity."""

    quantity: Literal["opening_mm", "position_rad", "openness"]
    value: float

    def position_rad(self, geometry: Geometry) -> float:
        """Return the motor's position."""
        if self.quantity == "position_rad":
            return self.value
        opening_mm = self.value * (geometry.travel_mm if self.quantity == "openness" else 1.0)
        return geometry.closed_rad - geometry.close_sign * geometry.to_rad(opening_mm)

    def limits(self, geometry: Geometry) -> tuple[float, float]:
        """Return the calibrated travel in the same quantity."""
        if self.quantity == "position_rad":
            low, high = sorted((geometry.closed_rad, geometry.open_rad))
            return low, high
        return 0.0, geometry.travel_mm if self.quantity == "opening_mm" else 1.0


_DIGITS = {"opening_mm": 3, "position_rad": 4, "openness": 1}
"""With how many digits the limits of each quantity are told."""


def target_refusal(target: Target, geometry: Geometry) -> Refusal | None:
    """Return why a target cannot be reached, or None."""
    low, high = target.limits(geometry)
    unit, digits = unit_of(target.quantity), _DIGITS[target.quantity]
    if low - _ROUNDING <= target.value <= high + _ROUNDING:
        return None
    return Refusal(
        "out_of_limits",
        sentence(
            "{what} is {value:g}{unit}, the calibrated travel is {low} to {high}{unit}",
            what=parameter_name(target.quantity),
            value=target.value,
            low=at_least(low, digits),
            high=at_most(high, digits),
            unit=unit,
        ),
        {"field": target.quantity, "requested": target.value, "limit": [low, high]},
    )


def duration_refusal(duration_s: float, shortest_s: float, distance_mm: float) -> Refusal:
    """Return a refusal because a time is too short for its distance."""
    return Refusal(
        "out_of_limits",
        sentence(
            "{.duration_s} is {duration_s:g}, for {distance_mm:.1f} mm it must be at least {least}",
            duration_s=duration_s,
            distance_mm=distance_mm,
            least=at_least(shortest_s, 3),
        ),
        {"field": "duration_s", "requested": duration_s, "limit": shortest_s},
    )


def stroke_refusal(stroke_mm: float | None, gripper_id: GripperId) -> Refusal | None:
    """Return a refusal if a measured stroke is too far from the configured one, or None."""
    if stroke_mm is None:
        return None
    configured_mm, written_mm = gripper_id.stroke_mm, stroke_mm
    if stroke_mm == SUPERSEDED_STROKE_MM:  # which counts as the default there
        written_mm += 0.1
    if fits_stroke(stroke_mm + SPAN_INSET_MM, configured_mm):
        return None
    return Refusal(
        "out_of_limits",
        sentence(
            "{.stroke_mm} is {stroke_mm:g}, and the configured stroke is {configured_mm:g} mm: they"
            " may differ by {tolerance:.0%}; measure how far the jaws open (caliper), and if it is"
            " {stroke_mm:g} mm, set stroke_mm = {written_mm:g} in [gripper] of"
            " /etc/litegripd/{channel}.toml, or of the file that the daemon was given",
            channel=gripper_id.channel,
            stroke_mm=stroke_mm,
            configured_mm=configured_mm,
            tolerance=SCALE_TOLERANCE,
            written_mm=written_mm,
        ),
        {"field": "stroke_mm", "requested": stroke_mm, "limit": configured_mm},
    )


def force_refusal(force_n: float, geometry: Geometry, motor_type: MotorType) -> Refusal | None:
    """Return a refusal if a force takes more torque than a grip may have."""
    most_n = motor_type.holding_nm * geometry.nm_to_n
    if force_n <= most_n:
        return None
    return Refusal(
        "out_of_limits",
        sentence(
            "{.force_n} is {force_n:g}, with the calibration's {nm_to_n:g} N per N·m it must be"
            " at most {most}: a grip may have {most_nm:g} N·m",
            force_n=force_n,
            nm_to_n=geometry.nm_to_n,
            most=at_most(most_n, 3),
            most_nm=motor_type.holding_nm,
        ),
        {"field": "force_n", "requested": force_n, "limit": most_n},
    )


def width_refusal(width_mm: float | None, within_mm: float, geometry: Geometry) -> Refusal | None:
    """Return a refusal if no object between the jaws can be as wide as is expected, or None."""
    most_mm = geometry.travel_mm + within_mm
    if width_mm is None or width_mm <= most_mm:
        return None
    return Refusal(
        "out_of_limits",
        sentence(
            "{.width_mm} is {width_mm:g} mm, the calibrated travel is {travel} mm, and"
            " {.tolerance_mm} {within_mm:g} mm: no object between the jaws can be so wide",
            width_mm=width_mm,
            travel=at_most(geometry.travel_mm, 3),
            within_mm=within_mm,
        ),
        {"field": "width_mm", "requested": width_mm, "limit": most_mm},
    )


def push_refusal(push_nm: float, geometry: Geometry, motor_type: MotorType) -> Refusal | None:
    """Return a refusal if a push has more torque than a grip may have, or more force."""
    most_nm = min(motor_type.holding_nm, geometry.torque_nm(motor_type.most_force_n))
    if abs(push_nm) <= most_nm:
        return None
    return Refusal(
        "out_of_limits",
        f"push_nm is {push_nm:g}, it must be at most {at_most(most_nm, 3)} either way: a grip may"
        f" have {motor_type.holding_nm:g} N·m and {motor_type.most_force_n:g} N, and the"
        f" calibration has {geometry.nm_to_n:g} N per N·m",
        {"field": "push_nm", "requested": push_nm, "limit": [-most_nm, most_nm]},
    )


def heat_refusal(allowance_nm: float, needed_nm: float) -> Refusal | None:
    """Return a refusal if the coil's heat leaves too little torque."""
    if allowance_nm >= needed_nm:
        return None
    return Refusal(
        "motor_hot",
        f"the coil's heat leaves {allowance_nm:.2f} N·m, and to feel what is gripped takes"
        f" {needed_nm:.2f} N·m: let the motor cool down, by less force or disabled",
        {"limit": allowance_nm, "requested": needed_nm},
    )


def position_refusal(motor: MotorView, geometry: Geometry) -> Refusal | None:
    """Return why the measured position cannot be where the jaws are, or None."""
    feedback = motor.feedback
    if feedback is None:
        return NO_FEEDBACK
    low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad))
    position_rad = feedback.position_rad
    outside_rad = max(low_rad - position_rad, position_rad - high_rad)
    if outside_rad <= IMPLAUSIBLE_OUTSIDE_RAD:
        return None
    remedy = sentence(
        "power-cycle the motor with the jaws inside the travel; if it is still off, calibrate again"
        " ({calibration.zero with a mount})"
    )
    return Refusal(
        "out_of_limits",
        sentence(
            "the motor says that it is at {at:.3f} rad, but the calibrated travel is {low:.3f} to"
            " {high:.3f} rad: it may have lost its count of turns in a power cycle; {remedy}",
            at=position_rad,
            low=low_rad,
            high=high_rad,
            remedy=remedy,
        ),
        {"requested": position_rad, "limit": [low_rad, high_rad], "hint": remedy},
    )
