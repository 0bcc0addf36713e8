"""The motor's phases, and the refusals of its faults."""

from collections.abc import Mapping
from enum import Enum, auto
from functools import lru_cache
from types import MappingProxyType

from litegripd.model.errors import Refusal
from litegripd.model.motor import MotorPhase, Status, status_name
from litegripd.model.sentence import Sentence, sentence

REMEDIES: Mapping[int, Sentence] = {
    Status.OVER_VOLTAGE: sentence(
        "lower the supply voltage (24 V nominal, 32 V at most), then enable again ({motor.enable})"
    ),
    Status.UNDER_VOLTAGE: sentence(
        "switch the 24 V supply of the power stage on, then enable again ({motor.enable})"
    ),
    Status.OVER_CURRENT: sentence(
        "check that the jaws are not jammed, then enable again ({motor.enable})"
    ),
    Status.DRIVER_HOT: sentence("let the driver cool down, then enable again ({motor.enable})"),
    Status.COIL_HOT: sentence(
        "let the motor cool down, then enable again ({motor.enable}) and hold with less force"
    ),
    Status.COMMUNICATION_LOST: sentence(
        "enable again ({motor.enable}); if it recurs, check the CAN wiring"
    ),
    Status.OVERLOAD: sentence("remove what loads the jaws, then enable again ({motor.enable})"),
}

RESTING: Mapping[int, str] = {
    Status.COMMUNICATION_LOST: "the motor has latched 'communication lost' while this daemon did"
    " not use it: normal after a second without commands, and enabling clears it",
    Status.UNDER_VOLTAGE: "the motor's power stage has, or had, no supply while it is not used: see"
    " that its 24 V are on before you enable it",
}
"""The statuses that a motor takes by itself while nobody uses it, and what they mean then: nothing
was lost, and it is as good as disabled. Motors were seen to latch "communication lost" after 0.9 s
without traffic (the vendor's bench); without 24 V they answer "under-voltage" (its manual)."""

SILENT = Refusal(
    "motor_silent",
    "the motor does not answer: check its 24 V supply, the CAN wiring and its id",
)

STILL_ENABLED = Refusal(
    "not_confirmed", "the motor does not confirm that it is disabled: cut its power"
)


_STOOD_STILL = sentence(
    "enable again ({motor.enable}); if it recurs, find what keeps the daemon from running: no"
    " real-time rights, another real-time program, a machine that is overloaded or suspended"
)


@lru_cache(maxsize=8)
def fault_refusal(status: int, stood_still_s: float | None = None) -> Refusal:
    """Return a refusal that names the reported fault, and what to do about it; asked each tick.

    `stood_still_s` is how long the daemon itself sent nothing before the fault; None if it did
    send.
    """
    name = status_name(status)
    if status == Status.COMMUNICATION_LOST and stood_still_s is not None:
        return Refusal(
            "motor_fault",
            sentence(
                "the motor reports communication lost: the daemon itself stood still for"
                " {stood_ms:.0f} ms, and the motor disarmed itself: {remedy}",
                stood_ms=stood_still_s * 1e3,
                remedy=_STOOD_STILL,
            ),
            {"status": name, "hint": _STOOD_STILL, "stood_still_s": stood_still_s},
        )
    remedy = REMEDIES.get(status, "see the motor's manual")
    return Refusal(
        "motor_fault",
        sentence(
            "the motor reports {status}: {remedy}", status=name.replace("_", " "), remedy=remedy
        ),
        {"status": name, "hint": remedy},
    )


def implausible_refusal(jump_rad: float) -> Refusal:
    """Return a refusal because of an implausible position, with what to do about it."""
    remedy = sentence(
        "look where the jaws are, and power-cycle the motor if what is shown is wrong; then"
        " {motor.clear_fault}, and calibrate again if it is still wrong"
    )
    return Refusal(
        "implausible_feedback",
        sentence(
            "the motor's position jumped by {jump_rad:.3f} rad, as no jaw can move: the motor was"
            " disabled; {remedy}",
            jump_rad=jump_rad,
            remedy=remedy,
        ),
        {"jump_rad": jump_rad, "hint": remedy},
    )


class Phase(Enum):
    """Finer than `MotorPhase`: enabling has three steps, and silence two degrees."""

    __hash__ = object.__hash__  # every tick looks phases up; Enum would hash their names

    LOOKING = auto()
    """Reading the registers, also of a motor that fell silent: another may have taken its place.
    A status counts only after the registers, because they hold its ranges."""
    DISABLED = auto()
    PREPARING = auto()
    """Making sure that the motor's own watchdog is on."""
    CLEARING = auto()
    """Clearing a fault, if there is one, in order to enable."""
    ARMING = auto()
    """Sending zero gains, then the enable frame, until a fresh status reports "enabled"."""
    ENABLED = auto()
    LOST = auto()
    """Was enabled and stopped answering: commands are withheld, so that none can queue up."""
    DISABLING = auto()
    FAULT = auto()
    CLEARING_FAULT = auto()
    """Clearing a fault without enabling."""


class Event(Enum):
    """What can happen to a motor in one tick."""

    __hash__ = object.__hash__

    SAW_DISABLED = auto()
    SAW_ENABLED = auto()
    SAW_FAULT = auto()
    NO_ANSWER = auto()
    ENABLE = auto()
    DISABLE = auto()
    PREPARED = auto()
    GAVE_UP = auto()
    IMPLAUSIBLE = auto()
    CLEAR = auto()
    SCAN = auto()
    STAYED = auto()


_P, _E = Phase, Event

TRANSITIONS: Mapping[tuple[Phase, Event], Phase] = MappingProxyType(
    {
        (_P.LOOKING, _E.SAW_DISABLED): _P.DISABLED,
        (_P.LOOKING, _E.SAW_ENABLED): _P.DISABLING,
        (_P.LOOKING, _E.SAW_FAULT): _P.FAULT,
        (_P.DISABLED, _E.SAW_ENABLED): _P.DISABLING,
        (_P.DISABLED, _E.SAW_FAULT): _P.FAULT,
        (_P.DISABLED, _E.NO_ANSWER): _P.LOOKING,
        (_P.DISABLED, _E.ENABLE): _P.PREPARING,
        (_P.DISABLED, _E.DISABLE): _P.DISABLING,
        (_P.DISABLED, _E.SCAN): _P.LOOKING,
        (_P.FAULT, _E.SAW_DISABLED): _P.DISABLED,
        (_P.FAULT, _E.SAW_ENABLED): _P.DISABLING,
        (_P.FAULT, _E.NO_ANSWER): _P.LOOKING,
        (_P.FAULT, _E.ENABLE): _P.PREPARING,
        (_P.FAULT, _E.DISABLE): _P.DISABLING,
        (_P.FAULT, _E.CLEAR): _P.CLEARING_FAULT,
        (_P.CLEARING_FAULT, _E.SAW_DISABLED): _P.DISABLED,
        (_P.CLEARING_FAULT, _E.SAW_ENABLED): _P.DISABLING,
        (_P.CLEARING_FAULT, _E.STAYED): _P.FAULT,
        (_P.CLEARING_FAULT, _E.DISABLE): _P.DISABLING,
        (_P.CLEARING_FAULT, _E.NO_ANSWER): _P.LOOKING,
        (_P.PREPARING, _E.PREPARED): _P.CLEARING,
        (_P.PREPARING, _E.GAVE_UP): _P.DISABLING,
        (_P.PREPARING, _E.DISABLE): _P.DISABLING,
        (_P.CLEARING, _E.SAW_DISABLED): _P.ARMING,
        (_P.CLEARING, _E.SAW_ENABLED): _P.DISABLING,
        (_P.CLEARING, _E.GAVE_UP): _P.DISABLING,
        (_P.CLEARING, _E.DISABLE): _P.DISABLING,
        (_P.ARMING, _E.SAW_ENABLED): _P.ENABLED,
        (_P.ARMING, _E.SAW_FAULT): _P.CLEARING,
        (_P.ARMING, _E.GAVE_UP): _P.DISABLING,
        (_P.ARMING, _E.DISABLE): _P.DISABLING,
        (_P.ENABLED, _E.SAW_DISABLED): _P.LOOKING,  # a power cycle resets registers
        (_P.ENABLED, _E.SAW_FAULT): _P.FAULT,
        (_P.ENABLED, _E.NO_ANSWER): _P.LOST,
        (_P.ENABLED, _E.DISABLE): _P.DISABLING,
        (_P.ENABLED, _E.IMPLAUSIBLE): _P.DISABLING,
        (_P.LOST, _E.SAW_ENABLED): _P.ENABLED,
        (_P.LOST, _E.SAW_DISABLED): _P.LOOKING,
        (_P.LOST, _E.SAW_FAULT): _P.FAULT,
        (_P.LOST, _E.GAVE_UP): _P.LOOKING,
        (_P.LOST, _E.DISABLE): _P.DISABLING,
        (_P.DISABLING, _E.SAW_DISABLED): _P.DISABLED,
        (_P.DISABLING, _E.SAW_FAULT): _P.FAULT,
        (_P.DISABLING, _E.NO_ANSWER): _P.LOOKING,
    }
)
"""`DISABLE` in `LOOKING` needs no row: a motor that turns out to be enabled is disabled anyway."""

ARMING_PHASES = (Phase.PREPARING, Phase.CLEARING, Phase.ARMING)
FAULTY = (Phase.FAULT, Phase.CLEARING_FAULT)

PUBLIC: Mapping[Phase, MotorPhase] = MappingProxyType(
    {
        Phase.LOOKING: MotorPhase.UNKNOWN,
        Phase.DISABLED: MotorPhase.DISABLED,
        Phase.PREPARING: MotorPhase.ENABLING,
        Phase.CLEARING: MotorPhase.ENABLING,
        Phase.ARMING: MotorPhase.ENABLING,
        Phase.ENABLED: MotorPhase.ENABLED,
        Phase.LOST: MotorPhase.SILENT,
        Phase.DISABLING: MotorPhase.DISABLING,
        Phase.FAULT: MotorPhase.FAULT,
        Phase.CLEARING_FAULT: MotorPhase.FAULT,
    }
)
