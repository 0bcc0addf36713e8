"""What travels on the bus, and what is known of bus and motor."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal, NamedTuple, TypeAlias

from litegrip_client.values.errors import ErrorCode
from litegrip_client.values.figures import LIST_SERIAL
from litegripd.model.errors import Refusal


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One classic CAN data frame with an 11-bit identifier.

    `can_id` is 0 to 0x7FF and `data` at most 8 bytes. Error, remote and extended frames never
    become a `CanFrame`. The bus drops and counts them, because the masked id of an error frame can
    equal the feedback id (0x08 | 0x10 = 0x18).
    """

    can_id: int
    data: bytes


SIMULATOR = "litegrip_sim"
MUJOCO = "mujoco"
"""The mechanics that a simulated gripper may have in place of its own."""
DIRECT_INTERFACES = ("socketcan", "virtual", SIMULATOR)
"""python-can interfaces whose send and recv(0) never block."""

IN_PROCESS_INTERFACES = ("virtual", SIMULATOR)
"""Those whose bus, and what is on it, ends with the process."""


@dataclass(frozen=True, slots=True)
class BusSettings:
    """The arguments of python-can; `options` are the interface's own keyword arguments."""

    interface: str
    channel: str
    bitrate: int
    options: Mapping[str, Any] = field(default_factory=dict)


BusState: TypeAlias = Literal[
    "up", "link_down", "adapter_gone", "bus_off", "bus_stalled", "motor_silent", "down"
]
"""`down` stands for what has no name of its own: not opened yet, or an adapter's own error."""

_REMEDIES: dict[BusState, str] = {
    "link_down": "bring the link up: {up}",
    "adapter_gone": "plug the adapter in, or correct its name ('ip -brief link show type can' lists"
    " CAN interfaces): it is opened as soon as it is there",
    "bus_off": "check wiring, termination and bit rate; a controller with restart-ms set then comes"
    " back by itself, any other one by: sudo ip link set {name} down && sudo ip link set {name} up",
    "bus_stalled": "nobody on the bus acknowledges a frame: check the cable and the motor's power",
    "motor_silent": "check the motor's 24 V supply, the CAN wiring and its id",
    "down": "fix what the error names: the daemon keeps reopening the bus",
}

_SERIAL_REMEDIES: dict[BusState, str] = {
    **_REMEDIES,
    "link_down": "unplug the adapter and plug it in again: it is opened as soon as it is there",
    "adapter_gone": f"plug the adapter in, or correct [bus] channel ('{LIST_SERIAL}' lists serial"
    " adapters): it is opened as soon as it is there",
    "bus_off": "check wiring, termination and bit rate, then unplug the adapter and plug it in"
    " again",
}
"""Those of an adapter that is a device file and no network interface."""


def remedy(state: BusState, bus_channel: str) -> str | None:
    """Return what to do about a state of the bus that [bus] channel names; None for "up".

    Every adapter takes these commands; some drivers refuse `restart-ms`, and the restart by hand.
    """
    name = shlex.quote(bus_channel)
    settings = "" if bus_channel.startswith(("vcan", "vxcan")) else " type can bitrate 1000000"
    text = (_SERIAL_REMEDIES if bus_channel.startswith("/") else _REMEDIES).get(state)
    up = f"sudo ip link set {name} up{settings}"
    return None if text is None else text.format(name=name, up=up)


@dataclass(frozen=True, slots=True)
class BusCondition:
    """The state of the bus; `error` is a sentence that says why it is not up.

    Of a bus that is up, it says what is doubtful about it.
    """

    state: BusState
    error: str | None = None

    @property
    def is_usable(self) -> bool:
        """True if frames can be exchanged, as far as is known; the motor may still be silent."""
        return self.state in ("up", "motor_silent")

    def refusal(self, bus_channel: str) -> Refusal | None:
        """Return why the motor cannot be reached because of the bus, or None."""
        if self.is_usable:
            return None
        hint = remedy(self.state, bus_channel)
        text = f"the CAN bus cannot be used ({self.state}): {self.error}; {hint}"
        return Refusal("bus_down", text, {"bus": self.state, "hint": hint})


UNANSWERED: tuple[BusState, ...] = ("bus_stalled", "motor_silent")
"""The states of a bus whose motor has no power: nobody acknowledges a frame, or answers one. While
nobody uses the gripper that is as it should be. All others take a person to mend."""

UP = BusCondition("up")
NOT_OPENED = BusCondition("down", "not opened yet")


KP_MAX_NM_RAD, KD_MAX_NM_S_RAD = 500.0, 5.0
"""What a command frame can carry."""


@dataclass(frozen=True, slots=True)
class MitCommand:
    """One MIT-mode command: the motor applies kp·(q - q') + kd·(dq - dq') + torque.

    `kp_nm_rad` and `kd_nm_s_rad` are 0 to what a frame can carry; the motor's
    registers hold the other ranges.
    """

    position_rad: float
    velocity_rad_s: float
    kp_nm_rad: float
    kd_nm_s_rad: float
    torque_nm: float


Status = ErrorCode
"""The status nibble of a feedback frame; the client reads it by the same table."""


def status_name(code: int) -> str:
    """Return the name of a status nibble, as it travels; an unknown one by its number."""
    try:
        return Status(code).name.lower()
    except ValueError:
        return f"unknown_{code:x}"


def is_fault(code: int) -> bool:
    """Return True if a status nibble is a fault, known or not: not "disabled" and not "enabled"."""
    return code not in (Status.DISABLED, Status.ENABLED)


@dataclass(frozen=True, slots=True)
class Feedback:
    """One feedback frame, decoded.

    `at_s` is when the latest request was sent before the frame was taken from the bus. The motor
    answers at once, so the measurement is no older than that.
    """

    status: int
    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    driver_temperature_c: int
    coil_temperature_c: int
    at_s: float


@dataclass(frozen=True, slots=True)
class Ranges:
    """The ranges that the codes of a frame span, ± each; the motor's registers hold them."""

    position_rad: float
    velocity_rad_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class MotorIdentity:
    """What the motor reported about itself; None for a register that it did not answer."""

    can_id: int
    master_id: int
    ranges: Ranges
    timeout_s: float
    control_mode: int
    registers: Mapping[str, float | int | None] = field(default_factory=dict)


class MotorPhase(Enum):
    """Where the motor is in its life, as clients see it."""

    UNKNOWN = "unknown"
    DISABLED = "disabled"
    ENABLING = "enabling"
    ENABLED = "enabled"
    DISABLING = "disabling"
    FAULT = "fault"
    SILENT = "silent"


@dataclass(frozen=True, slots=True)
class RegisterRequest:
    """A request for the value of register `number`; `identity` distinguishes requests.

    With `sought_id` it is asked of whatever motor has that id, while this one is not powered.
    """

    identity: int
    number: int
    sought_id: int | None = None


@dataclass(frozen=True, slots=True)
class RegisterReply:
    """The answer to the request `identity`: the register's `value`, or a `failure`."""

    identity: int
    value: float | int | None
    failure: Refusal | None = None


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """A write to the motor's registers by another sender.

    `name` is the register's, or its number if the table does not have it; None when all registers
    were saved. `value` is None if it is unknown or not a number.
    """

    name: str | None
    value: float | int | None


ZeroState: TypeAlias = Literal["idle", "pending", "done", "failed"]


SOONEST_DISARM_S, LATEST_DISARM_S = 0.1, 0.9
"""After so long without a command, at the soonest and at the latest, motors have been seen to
disarm themselves (vendor's SDK 0.1, its manual 0.4, measured 0.9). Register TIMEOUT did not predict
it: it read 0.4 s and 0 where 0.9 s were measured. Nothing may rely on the later end."""

UNASKED_S = 0.1
"""About so often do some motors report by themselves while they are enabled (vendor's studio)."""


@dataclass(frozen=True, slots=True)
class ZeroView:
    """The state of the latest setting of the motor's zero; "idle" before the first one.

    When it is done, the motor counts its positions from where the jaws were: all are less by
    `shift_rad` than before, and `position_rad` is the first measured one. `failure` is the reason
    of a failure. `is_uncertain` is True from the first frame that sets the zero until it is
    confirmed, and after a failure: meanwhile nobody knows from which zero the positions count.
    """

    state: ZeroState = "idle"
    shift_rad: float = 0.0
    position_rad: float = 0.0
    failure: Refusal | None = None
    is_uncertain: bool = False


class MotorView(NamedTuple):
    """The motor as the controller sees it in one tick.

    `feedback` is the latest, whatever its age; `enable_tries` counts the tries of the present or
    latest enabling; `problem` is why the motor cannot be enabled now, or None; `failure` why the
    latest enabling or disabling did not succeed; `fault` what the motor reports; `latched` the
    status that a disabled motor has taken by itself while nobody used it, which is no fault;
    `last_known` the feedback before the motor fell silent, which is only to be shown, because
    another motor may answer next; `register` is the reply to the latest answered register request;
    `foreign_commands` counts the frames to the motor from other senders, and `foreign_write` is the
    latest of them that wrote registers. `is_short` is the controller's: standing jaws get less
    torque than is commanded; None while that is not certain yet.
    """

    phase: MotorPhase
    feedback: Feedback | None = None
    identity: MotorIdentity | None = None
    enable_tries: int = 0
    problem: Refusal | None = None
    failure: Refusal | None = None
    fault: Refusal | None = None
    latched: int | None = None
    last_known: Feedback | None = None
    register: RegisterReply | None = None
    zero: ZeroView = ZeroView()
    foreign_commands: int = 0
    foreign_write: RegisterWrite | None = None
    is_short: bool | None = False

    @property
    def has_jumped(self) -> bool:
        """True if the position is not believed, because it jumped."""
        return self.problem is not None and self.problem.reason == "implausible_feedback"

    @property
    def is_being_read(self) -> bool:
        """True if it answers, and only its registers are still to be read before it is used."""
        return (
            self.problem is not None
            and self.problem.reason == "motor_silent"
            and self.phase is not MotorPhase.SILENT
        )


@dataclass(frozen=True, slots=True)
class EnableMotor:
    """Enable the motor: at most `tries` tries, `interval_s` apart."""

    tries: int
    interval_s: float


@dataclass(frozen=True, slots=True)
class DisableMotor:
    """Disable the motor, confirmed."""


@dataclass(frozen=True, slots=True)
class SetZero:
    """Make the present position the zero of the motor's positions, confirmed.

    Only a disabled motor accepts it.
    """


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Clear a latched fault, confirmed; this energises nothing."""


MotorRequest: TypeAlias = EnableMotor | DisableMotor | SetZero | ClearFault


class MotorInput(NamedTuple):
    """What the controller wants of the motor in one tick.

    `is_motion` is True if `command` leads the jaws on: it must not continue without feedback. A
    `request` is given once. A `register` is given in every tick until it is answered; leaving it
    out withdraws it.
    """

    command: MitCommand | None = None
    request: MotorRequest | None = None
    is_motion: bool = False
    register: RegisterRequest | None = None
