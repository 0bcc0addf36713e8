"""Whether a motion may begin, and if not, why and what to do."""

from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.jobs import Job
from litegripd.model.motion_config import MotionConfig, move_conflict
from litegripd.model.motor import MotorPhase, MotorView

IMPLAUSIBLE_OUTSIDE_RAD = 1.0
"""Further outside the calibrated travel no jaw can be. The motor loses its count of turns in a
power cycle: its position can come back off by 2π."""

ENDING = Refusal("shutting_down", "the daemon is about to end")
NO_FEEDBACK = Refusal("motor_silent", "no feedback has come yet: try again")

NOT_ENABLED = Refusal(
    "not_enabled", "the motor is not enabled: enable it first", {"hint": "motor.enable"}
)

NOT_CALIBRATED = Refusal(
    "not_calibrated",
    "no calibration is loaded, so the closing direction would be a guess: configure"
    ' mount = "normal" or "reverse", or a calibration file, in [gripper]',
)


def busy_refusal(running: Job | None) -> Refusal | None:
    """Say who is moving, if anybody is."""
    if running is None:
        return None
    owner = running.owner
    return Refusal(
        "busy",
        f"job {running.number}, {running.kind} by {owner.program} (pid {owner.pid}), is running:"
        " wait for it (job.wait), cancel it (job.cancel) or stop",
        {
            "job": running.number,
            "kind": running.kind,
            "owner": {"pid": owner.pid, "uid": owner.uid, "program": owner.program},
        },
    )


def motor_refusal(motor: MotorView) -> Refusal | None:
    """Say why no motion may begin or go on, if so."""
    if motor.phase is MotorPhase.ENABLED:
        return None
    if motor.phase is MotorPhase.FAULT and motor.fault is not None:
        return motor.fault
    if motor.phase in (MotorPhase.SILENT, MotorPhase.UNKNOWN):
        return motor.problem or NOT_ENABLED
    return NOT_ENABLED


def speed_refusal(
    config: MotionConfig, speed_mm_s: float, geometry: Geometry, period_s: float
) -> Refusal | None:
    """Say why a move at this speed does not go with the other settings, if so."""
    conflict = move_conflict(config, speed_mm_s, geometry, period_s)
    if conflict is None:
        return None
    data = {"field": conflict.field, "requested": conflict.requested, "limit": conflict.limit}
    return Refusal("out_of_limits", conflict.message, data)


def position_refusal(motor: MotorView, geometry: Geometry) -> Refusal | None:
    """Say why the measured position cannot be where the jaws are, if so."""
    feedback = motor.feedback
    if feedback is None:
        return NO_FEEDBACK
    low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad))
    position_rad = feedback.position_rad
    outside_rad = max(low_rad - position_rad, position_rad - high_rad)
    if outside_rad <= IMPLAUSIBLE_OUTSIDE_RAD:
        return None
    return Refusal(
        "out_of_limits",
        f"the motor says that it is at {position_rad:.3f} rad, but the calibrated travel is"
        f" {low_rad:.3f} to {high_rad:.3f} rad: it may have lost its count of turns in a"
        " power cycle; power it on with the jaws inside the travel, or load the"
        " calibration that fits",
        {"requested": position_rad, "limit": [low_rad, high_rad]},
    )
