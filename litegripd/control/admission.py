"""Whether the motor is fit for a motion, and if not, why and what to do."""

from litegripd.model.errors import Refusal
from litegripd.model.motor import MotorPhase, MotorView

_NOT_ENABLED = Refusal(
    "not_enabled", "the motor is not enabled: enable it first", {"hint": "motor.enable"}
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
