"""What a successor process must know of the motor, so that it goes on without looking anew.

Only a motor that is found and settled is handed over: enabled, disabled or faulty. Nothing here
energises a motor: a phase is taken over as the predecessor had it confirmed.
"""

from typing import Any

from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, MitCommand, MotorIdentity, MotorPhase, ZeroView
from litegripd.model.plain import Carried, PlainError
from litegripd.motor.identity import Identification
from litegripd.motor.motor import Motor
from litegripd.motor.phases import Phase
from litegripd.motor.plausibility import Plausibility
from litegripd.motor.silence import Silence, Standstill
from litegripd.motor.traffic import Traffic
from litegripd.motor.zeroing import Zeroing

SETTLED = (MotorPhase.ENABLED, MotorPhase.DISABLED, MotorPhase.FAULT)

_MOTOR = Carried(
    Motor,
    left=(
        "counters",
        "_can_id",
        "_arming",
        "_register_reader",
        "_fresh",
        "_fault_clearing",
        "_status",
        "_foreign_write",
        "_foreign_requests",
        "_certain_s",
    ),
    _identification=Carried(
        Identification,
        left=(
            "can_id",
            "motor_type",
            "verifier",
            "_configured_master_id",
            "_judged",
            "_scan",
            "_refusal",
        ),
        identity=MotorIdentity,
    ),
    _phase=Phase,
    _entered_s=float,
    _zeroing=Carried(
        Zeroing,
        left=(
            "_zero_within_rad",
            "_rest_within_rad",
            "_can_id",
            "_began_s",
            "_answered_s",
            "_rest_rad",
            "_rests_since_s",
            "_position_rad",
            "_before_rad",
            "_is_due",
            "_tries",
            "_first_try_s",
            "_last_try_s",
            "_is_unchanged",
        ),  # they count only while it is pending
        view=ZeroView,
    ),
    _plausibility=Carried(
        Plausibility,
        left=("lasting_frames", "_acceleration_rad_s2", "_before", "_brake_nm"),
        in_a_row=int,
        refusal=Refusal | None,
        _last=Feedback | None,
        _doubted=Feedback | None,
        _told_s=float,
        _silent_s=float,
        _gap_s=float,
        _was_driven=bool,
    ),
    _feedback=Feedback,
    _asked_s=float,
    _standstill=Carried(
        Standstill,
        left=("_period_s",),
        _ticked_s=float | None,
        _ended_s=float | None,
        _lasted_s=float,
    ),
    _stood_still_s=float | None,
    _silence=Carried(
        Silence, left=("_bus_is_usable", "_was_total", "repeats", "_ticks_apart"), unanswered=int
    ),
    _traffic=Carried(
        Traffic,
        left=("_can_id", "_silence", "_counters"),
        _polled_at_s=float,
        _last_command=MitCommand | None,
        is_stored=bool,
    ),
    _tries=int,
    _failure=Refusal | None,
)


def refusal(motor: Motor) -> Refusal | None:
    """Return why a motor cannot be handed over now, or None."""
    view = motor.view()
    is_settled = view.phase in SETTLED and not motor.is_verifying
    if is_settled and view.feedback is not None and view.zero.state != "pending":
        return None
    reading = "; its registers are being read" if motor.is_verifying else ""
    text = (
        f"the motor is {view.phase.value}{reading}: it can be handed over once it answers and is"
        " settled"
    )
    passes_by_itself = motor.is_verifying
    problem = view.problem or Refusal("busy" if passes_by_itself else "restart_failed", text)
    hint = (
        "try again once it answers and is settled, or restart without the hold, which disables"
        " the motor"
    )
    return Refusal(problem.reason, problem.message, {**problem.data, "hint": hint})


def export(motor: Motor) -> dict[str, Any]:
    """Return the motor's state; the caller has asked for a `refusal`."""
    return _MOTOR.memory(motor)


def adopt(motor: Motor, can_id: int, plain: Any) -> None:
    """Go on where the predecessor was. Raises `PlainError` for a state that cannot be used."""
    _MOTOR.restore(motor, plain)
    view = motor.view()
    if view.phase not in SETTLED or view.zero.state == "pending":
        raise PlainError(f"Motor: {view.phase.value} is no phase in which it is handed over")
    if view.identity is None or view.identity.can_id != can_id:
        raise PlainError("Motor: the motor that is handed over has another id")
