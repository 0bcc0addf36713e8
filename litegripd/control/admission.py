"""Whether a motion may begin, and if not, why and what to do."""

from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job
from litegripd.model.motor import MotorPhase, MotorView

_NOT_ENABLED = Refusal(
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
        return motor.problem or _NOT_ENABLED
    return _NOT_ENABLED
