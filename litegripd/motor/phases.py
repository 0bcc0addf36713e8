"""The life of a motor as a literal table: which event leads from which phase to which.

A pair that is not in the table changes nothing. Only `ENABLE`, which comes from a client's request
alone, leads towards `ENABLED`. The one other way in is from `LOST`: a motor that was enabled, did
not answer for a moment, and then reports that it still is.
"""

from collections.abc import Mapping
from enum import Enum, auto
from types import MappingProxyType

from litegripd.model.motor import MotorPhase


class Phase(Enum):
    """Finer than `MotorPhase`: enabling has three steps, and silence two degrees."""

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
