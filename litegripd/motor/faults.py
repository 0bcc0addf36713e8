"""The motor's faults by name, and what to do about each."""

from collections.abc import Mapping

from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, Status, status_name

REMEDIES: Mapping[int, str] = {
    Status.OVER_VOLTAGE: "lower the supply voltage (24 V nominal, 32 V at most)",
    Status.UNDER_VOLTAGE: "check that the 24 V supply of the power stage is on",
    Status.OVER_CURRENT: "check that the jaws are not jammed, then enable again",
    Status.DRIVER_HOT: "let the driver cool down, then enable again",
    Status.COIL_HOT: "let the motor cool down, then hold with less force",
    Status.COMMUNICATION_LOST: "enable again; if it recurs, check the CAN wiring",
    Status.OVERLOAD: "remove what loads the jaws, then enable again",
}

SILENT = Refusal(
    "motor_silent",
    "the motor does not answer: check its 24 V supply, the CAN wiring and its id",
)

STILL_ENABLED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled: cut its power"
)


_STOOD_STILL = (
    "enable again; if it recurs, find what keeps the daemon from running: no real-time rights,"
    " another real-time program, a machine that is overloaded or suspended"
)


def fault_refusal(feedback: Feedback, stood_still_s: float | None = None) -> Refusal:
    """Return a refusal that names the reported fault, and what to do about it.

    `stood_still_s` is how long the daemon itself sent nothing before the fault; None if it did
    send.
    """
    name = status_name(feedback.status)
    if feedback.status == Status.COMMUNICATION_LOST and stood_still_s is not None:
        return Refusal(
            "motor_fault",
            f"the motor reports communication lost: the daemon itself stood still for"
            f" {stood_still_s * 1e3:.0f} ms, and the motor disarmed itself: {_STOOD_STILL}",
            {"status": name, "hint": _STOOD_STILL, "stood_still_s": stood_still_s},
        )
    remedy = REMEDIES.get(feedback.status, "see the motor's manual")
    return Refusal(
        "motor_fault",
        f"the motor reports {name.replace('_', ' ')}: {remedy}",
        {"status": name, "hint": remedy},
    )


def implausible_refusal(jump_rad: float) -> Refusal:
    """Return a refusal because of an implausible position, with what to do about it."""
    remedy = (
        "look where the jaws are, and power-cycle the motor if what is shown is wrong; then"
        " motor.clear_fault, and calibrate again if it is still wrong"
    )
    return Refusal(
        "implausible_feedback",
        f"the motor's position jumped by {jump_rad:.3f} rad, as no jaw can move: the motor was"
        f" disabled; {remedy}",
        {"jump_rad": jump_rad, "hint": remedy},
    )
