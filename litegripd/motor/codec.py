"""Frames of the motor: commands, feedback and registers, packed and unpacked."""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from litegripd.model.errors import Refusal
from litegripd.model.motor import (
    KD_MAX_NM_S_RAD,
    KP_MAX_NM_RAD,
    CanFrame,
    Feedback,
    MitCommand,
    Ranges,
    RegisterReply,
    RegisterRequest,
    RegisterWrite,
)
from litegripd.motor.phases import SILENT, Phase

FRAME_BYTES = 8

_SPECIAL = b"\xff" * 7
ENABLE = _SPECIAL + b"\xfc"
DISABLE = _SPECIAL + b"\xfd"
SET_ZERO = _SPECIAL + b"\xfe"
CLEAR_FAULT = _SPECIAL + b"\xfb"

_CODES_16 = (1 << 16) - 1
_CODES_12 = (1 << 12) - 1


def encode_command(command: MitCommand, ranges: Ranges) -> bytes:
    """Pack a command into its 8 bytes.

    Raises `ValueError` for a field that is not finite or out of its range. A clamped NaN would
    become an end of the range: a real command that nobody asked for.
    """
    position = _to_code("position_rad", command.position_rad, ranges.position_rad, _CODES_16)
    velocity = _to_code("velocity_rad_s", command.velocity_rad_s, ranges.velocity_rad_s, _CODES_12)
    torque = _to_code("torque_nm", command.torque_nm, ranges.torque_nm, _CODES_12)
    kp = _to_gain_code("kp_nm_rad", command.kp_nm_rad, KP_MAX_NM_RAD)
    kd = _to_gain_code("kd_nm_s_rad", command.kd_nm_s_rad, KD_MAX_NM_S_RAD)
    packed = position << 48 | velocity << 36 | kp << 24 | kd << 12 | torque
    return packed.to_bytes(FRAME_BYTES, "big")


def encode_zero_gains(position_rad: float, ranges: Ranges) -> bytes:
    """Pack the command that energises nothing, neither now nor when the motor is enabled later.

    Without gains the position has no effect; one beyond the range becomes the end of the range.
    """
    position_rad = min(max(position_rad, -ranges.position_rad), ranges.position_rad)
    return encode_command(MitCommand(position_rad, 0.0, 0.0, 0.0, 0.0), ranges)


def decode_command(data: bytes, ranges: Ranges) -> MitCommand:
    """Unpack a command frame; raises `ValueError` unless it has 8 bytes."""
    packed = _packed(data)
    return MitCommand(
        position_rad=_from_code(packed >> 48 & _CODES_16, ranges.position_rad, _CODES_16),
        velocity_rad_s=_from_code(packed >> 36 & _CODES_12, ranges.velocity_rad_s, _CODES_12),
        kp_nm_rad=(packed >> 24 & _CODES_12) * KP_MAX_NM_RAD / _CODES_12,
        kd_nm_s_rad=(packed >> 12 & _CODES_12) * KD_MAX_NM_S_RAD / _CODES_12,
        torque_nm=_from_code(packed & _CODES_12, ranges.torque_nm, _CODES_12),
    )


def decode_feedback(data: bytes, ranges: Ranges, at_s: float) -> Feedback:
    """Unpack a feedback frame; raises `ValueError` unless it has 8 bytes."""
    packed = _packed(data)
    return Feedback(
        status=packed >> 60,
        position_rad=_from_code(packed >> 40 & _CODES_16, ranges.position_rad, _CODES_16),
        velocity_rad_s=_from_code(packed >> 28 & _CODES_12, ranges.velocity_rad_s, _CODES_12),
        torque_nm=_from_code(packed >> 16 & _CODES_12, ranges.torque_nm, _CODES_12),
        driver_temperature_c=packed >> 8 & 0xFF,
        coil_temperature_c=packed & 0xFF,
        at_s=at_s,
    )


def is_from_motor(data: bytes, can_id: int) -> bool:
    """Return True if a frame on the master id can be feedback of the motor `can_id`."""
    return len(data) == FRAME_BYTES and data[0] & 0xF == can_id & 0xF


def _packed(data: bytes) -> int:
    if len(data) != FRAME_BYTES:
        raise ValueError(f"a frame has {FRAME_BYTES} bytes, not {len(data)}")
    return int.from_bytes(data, "big")


def _to_code(name: str, value: float, limit: float, codes: int) -> int:
    if not math.isfinite(value) or abs(value) > limit:
        raise ValueError(f"{name} is {value}, it must be within ±{limit:g}")
    return round((value + limit) * codes / (2.0 * limit))


def _to_gain_code(name: str, value: float, limit: float) -> int:
    if not math.isfinite(value) or not 0.0 <= value <= limit:
        raise ValueError(f"{name} is {value}, it must be 0 to {limit:g}")
    return round(value * _CODES_12 / limit)


def _from_code(code: int, limit: float, codes: int) -> float:
    return limit * (2.0 * code / codes - 1.0)  # rounding never leads beyond the limit


REGISTER_CAN_ID = 0x7FF
TIMEOUT_UNIT_S = 50e-6
MIT_MODE = 1
ANSWER_WITHIN_S = 0.02

_READ = 0x33
_WRITE = 0x55
_SAVE = 0xAA
_STATUS_REQUEST = 0xCC
_ANSWERS = (_READ, _WRITE, _SAVE)
_ANSWER_BYTES = 8
_HEAD_BYTES = 4


@dataclass(frozen=True, slots=True, eq=False)  # there is one object for each
class Register:
    """One register: its number, the maker's name, and float ("f") or unsigned ("u")."""

    number: int
    name: str
    kind: Literal["f", "u"]

    def decode(self, raw: bytes) -> float | int:
        """Return the value of four little-endian bytes."""
        value: float | int = struct.unpack("<f" if self.kind == "f" else "<I", raw)[0]
        return value

    def encode(self, value: float) -> bytes:
        """Return the four little-endian bytes of a value."""
        return struct.pack("<f", value) if self.kind == "f" else struct.pack("<I", int(value))


MASTER_ID = Register(7, "MST_ID", "u")
CAN_ID = Register(8, "ESC_ID", "u")
TIMEOUT = Register(9, "TIMEOUT", "u")
CONTROL_MODE = Register(10, "CTRL_MODE", "u")
HARDWARE_VERSION = Register(13, "hw_ver", "u")
SOFTWARE_VERSION = Register(14, "sw_ver", "u")
SERIAL = Register(15, "SN", "u")
GEAR_RATIO = Register(20, "Gr", "f")
PMAX = Register(21, "PMAX", "f")
VMAX = Register(22, "VMAX", "f")
TMAX = Register(23, "TMAX", "f")

REGISTERS: Mapping[int, Register] = MappingProxyType(
    {
        register.number: register
        for register in (
            Register(0, "UV_Value", "f"),
            Register(1, "KT_Value", "f"),
            Register(2, "OT_Value", "f"),
            Register(3, "OC_Value", "f"),
            Register(4, "ACC", "f"),
            Register(5, "DEC", "f"),
            Register(6, "MAX_SPD", "f"),
            MASTER_ID,
            CAN_ID,
            TIMEOUT,
            CONTROL_MODE,
            Register(11, "Damp", "f"),
            Register(12, "Inertia", "f"),
            HARDWARE_VERSION,
            SOFTWARE_VERSION,
            SERIAL,
            Register(16, "NPP", "u"),
            Register(17, "Rs", "f"),
            Register(18, "Ls", "f"),
            Register(19, "Flux", "f"),
            GEAR_RATIO,
            PMAX,
            VMAX,
            TMAX,
            Register(24, "I_BW", "f"),
            Register(25, "KP_ASR", "f"),
            Register(26, "KI_ASR", "f"),
            Register(27, "KP_APR", "f"),
            Register(28, "KI_APR", "f"),
            Register(29, "OV_Value", "f"),
            Register(30, "GREF", "f"),
            Register(31, "Deta", "f"),
            Register(32, "V_BW", "f"),
            Register(33, "IQ_c1", "f"),
            Register(34, "VL_c1", "f"),
            Register(35, "can_br", "u"),
            Register(36, "sub_ver", "u"),
            Register(50, "u_off", "f"),
            Register(51, "v_off", "f"),
            Register(52, "k1", "f"),
            Register(53, "k2", "f"),
            Register(54, "m_off", "f"),
            Register(55, "dir", "f"),
            # The maker gives 54 and 56 the same name; here each needs its own.
            Register(56, "m_off_56", "f"),
            Register(59, "Imax", "f"),
            Register(60, "VBus", "f"),
            Register(61, "Tpcb", "f"),
            Register(62, "Tmtr", "f"),
            Register(63, "Iu_off", "f"),
            Register(64, "Iv_off", "f"),
            Register(65, "Iw_off", "f"),
            Register(80, "p_m", "f"),
            Register(81, "xout", "f"),
        )
    }
)

READ_AT_START: tuple[Register, ...] = tuple(
    REGISTERS[number] for number in (7, 8, 9, 10, 13, 14, 15, 20, 21, 22, 23, 35)
)
ESSENTIAL: frozenset[Register] = frozenset({MASTER_ID, TIMEOUT, CONTROL_MODE, PMAX, VMAX, TMAX})
"""Without these the motor cannot be used safely; the others only inform."""


VERIFIED: tuple[Register, ...] = (TMAX, PMAX, VMAX, CONTROL_MODE, TIMEOUT, MASTER_ID, CAN_ID)
"""What decides how the motor must be commanded; what changes the force most comes first."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A frame in the form of a register answer."""

    number: int
    is_write: bool
    """True if it answers a write or a save, False for a read."""
    raw: bytes
    is_save: bool = False
    """True if it answers a save; then it has no register and no value."""


def read_request(can_id: int, register: Register) -> CanFrame:
    """Return the frame that asks for a register's value."""
    return _request(can_id, _READ, register.number, bytes(4))


def write_request(can_id: int, register: Register, value: float) -> CanFrame:
    """Return the frame that sets a register until the motor's next power cycle."""
    return _request(can_id, _WRITE, register.number, register.encode(value))


def status_request(can_id: int) -> CanFrame:
    """Return the frame that asks for feedback; it does not energise or feed the watchdog."""
    return CanFrame(REGISTER_CAN_ID, struct.pack("<HBx4x", can_id, _STATUS_REQUEST))


def parse_answer(data: bytes, can_id: int) -> Answer | None:
    """Return the register answer of the motor `can_id` in a frame, or None for another form.

    Such a frame also decodes to plausible feedback, of about -12.47 rad, so call this first.
    Feedback thereby loses three positions, which lie far outside any travel below 2π.
    """
    if len(data) != _ANSWER_BYTES or data[:2] != can_id.to_bytes(2, "little"):
        return None
    if data[2] not in _ANSWERS:
        return None
    return Answer(data[3], data[2] != _READ, data[4:], is_save=data[2] == _SAVE)


def parse_write_request(frame: CanFrame, can_id: int) -> Answer | None:
    """Return a frame as a request to write or save registers of the motor `can_id`, or None.

    A request has the form of its own answer.
    """
    data = frame.data
    if frame.can_id != REGISTER_CAN_ID or data[:2] != can_id.to_bytes(2, "little"):
        return None
    if data[2:3] == bytes([_SAVE]) and len(data) >= _HEAD_BYTES:
        return Answer(data[3], True, data[4:], is_save=True)
    answer = parse_answer(data, can_id)
    return answer if answer is not None and answer.is_write else None


def described(write: Answer) -> RegisterWrite:
    """Return the register and the value of a write."""
    if write.is_save:
        return RegisterWrite(None, None)
    register = REGISTERS.get(write.number)
    if register is None:
        return RegisterWrite(str(write.number), None)
    value = register.decode(write.raw)
    return RegisterWrite(register.name, value if math.isfinite(value) else None)


def _request(can_id: int, opcode: int, number: int, raw: bytes) -> CanFrame:
    return CanFrame(REGISTER_CAN_ID, struct.pack("<HBB4s", can_id, opcode, number, raw))


READABLE = frozenset({Phase.DISABLED, Phase.ENABLED, Phase.FAULT})
"""In the other phases the motor does not answer, or its answers are awaited by other code."""

IN_USE = Refusal(
    "busy",
    "the motor is, or may be, enabled: other ids are asked only while it is off: disable it first",
)
UNPOWERED = frozenset({Phase.LOOKING, Phase.DISABLED, Phase.FAULT})
"""The phases in which other ids may be asked: nothing depends on the bus then."""
SEEK_TRIES = 2
READ_TRIES = 5
READ_WITHIN_S = 1.0
"""How long a request waits in all, also for the end of an enabling or of a scan."""


class RegisterReader:
    """Reads the register of the present request; another request starts a new read."""

    def __init__(self, can_id: int) -> None:
        self.reply: RegisterReply | None = None
        self._can_id = can_id
        self._request: RegisterRequest | None = None
        self._register: Register | None = None
        """What is being read; None once the request has its reply."""
        self._began_s = 0.0
        self._asked_s = float("-inf")
        self._tries = 0

    def step(self, now_s: float, request: RegisterRequest | None, phase: Phase) -> list[CanFrame]:
        """Work on `request`, and return the frame that is due, if any.

        In a phase that is not `READABLE` it waits; a request for another id ends in one that is not
        `UNPOWERED`. None withdraws the pending request.
        """
        if request != self._request:
            self._begin(now_s, request)
        register = self._register
        if register is None or request is None:
            return []
        sought_id = request.sought_id
        if sought_id is not None and phase not in UNPOWERED:
            self._answer(None, IN_USE)
            return []
        is_readable = sought_id is not None or phase in READABLE
        may_ask_again = is_readable and now_s - self._asked_s >= ANSWER_WITHIN_S
        tries = READ_TRIES if sought_id is None else SEEK_TRIES
        is_over = may_ask_again and self._tries >= tries
        if is_over or now_s - self._began_s >= READ_WITHIN_S:
            self._answer(None, SILENT)
            return []
        if not may_ask_again:
            return []
        self._tries += 1
        self._asked_s = now_s
        return [read_request(self._can_id if sought_id is None else sought_id, register)]

    def find(self, frame: CanFrame) -> bool:
        """Take the answer of the id that is sought; return True if it is of another motor.

        It tells its MST_ID, on which it answers: so a frame that only looks like it does not count.
        """
        register, request = self._register, self._request
        if register is None or request is None or request.sought_id is None or not self._tries:
            return False
        answer = parse_answer(frame.data, request.sought_id)
        if answer is None or answer.is_write or answer.number != MASTER_ID.number:
            return False
        if MASTER_ID.decode(answer.raw) != frame.can_id:
            return False
        self._answer(frame.can_id, None)
        return request.sought_id != self._can_id

    def take(self, answer: Answer) -> bool:
        """Take an answer of the motor; return True if it was the awaited one."""
        register, request = self._register, self._request
        if request is not None and request.sought_id is not None:
            return False
        is_awaited = register is not None and self._tries > 0 and answer.number == register.number
        if register is None or not is_awaited or answer.is_write:
            return False
        value = register.decode(answer.raw)
        if math.isfinite(value):
            self._answer(value, None)
        else:
            text = (
                f"the motor's register {register.name} holds {value}, which is no number: set it"
                " with the maker's tool"
            )
            self._answer(None, Refusal("motor_unsuitable", text, {"register": register.name}))
        return True

    def _begin(self, now_s: float, request: RegisterRequest | None) -> None:
        self._request = request
        self._register = None if request is None else REGISTERS.get(request.number)
        self._began_s = now_s
        self._asked_s = float("-inf")
        self._tries = 0
        if request is not None and self._register is None:
            known = ", ".join(f"{number} {register.name}" for number, register in REGISTERS.items())
            text = f"there is no register {request.number}; these can be read: {known}"
            data = {"requested": request.number, "limit": list(REGISTERS)}
            self._answer(None, Refusal("invalid_params", text, data))

    def _answer(self, value: float | None, failure: Refusal | None) -> None:
        self._register = None
        if self._request is not None:
            self.reply = RegisterReply(self._request.identity, value, failure)
