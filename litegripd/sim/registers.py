"""The motor's registers and frames, as its firmware has them.

The registers are a live copy that frames read and write, and a flash that outlives power. Only the
values and their rules are here; what a register means for the motion is in `motor` and `cascade`.

The coding of frames is kept apart from the daemon's codec on purpose: two implementations that
agree are worth more than one that agrees with itself. The firmware truncates where a careful driver
rounds.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from litegripd.model.gripper import DM4310, MotorType
from litegripd.sim.plant import SPEED_FILTER_MAX_HZ

KP_MAX_NM_RAD = 500.0
KD_MAX_NM_S_RAD = 5.0


@dataclass(frozen=True, slots=True)
class Ranges:
    """The ranges of position (rad), velocity (rad/s) and torque (N·m): registers 21, 22, 23."""

    position_rad: float = 12.5
    velocity_rad_s: float = 30.0
    torque_nm: float = 10.0


class MitCommand(NamedTuple):
    """A command frame, in units (motor's manual, MIT mode)."""

    position_rad: float
    velocity_rad_s: float
    kp_nm_rad: float
    kd_nm_s_rad: float
    torque_nm: float


class SetPoint(NamedTuple):
    """What a command frame of mode 2, 3 or 4 asks for, in units; in mode 3 there is no position.

    With a position the speed is a bound. `current_share` is the share of the largest current that
    may be used, 0 to 1.
    """

    position_rad: float | None
    velocity_rad_s: float
    current_share: float = 1.0


def to_code(value: float, low: float, high: float, bits: int) -> int:
    """Return the code of a value in [low, high], truncated; beyond it the nearest end's code."""
    most = (1 << bits) - 1
    return min(max(int((value - low) * most / (high - low)), 0), most)


def from_code(code: int, low: float, high: float, bits: int) -> float:
    """Return the value that a code of `bits` bits stands for."""
    return code * (high - low) / ((1 << bits) - 1) + low


def decode_command(data: bytes, ranges: Ranges) -> MitCommand:
    """Read a command frame of 8 bytes; every such frame is a command."""
    word = int.from_bytes(data, "big")
    q, dq, tau = ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm
    return MitCommand(
        from_code(word >> 48, -q, q, 16),
        from_code(word >> 36 & 0xFFF, -dq, dq, 12),
        (word >> 24 & 0xFFF) * KP_MAX_NM_RAD / 0xFFF,
        (word >> 12 & 0xFFF) * KD_MAX_NM_S_RAD / 0xFFF,
        from_code(word & 0xFFF, -tau, tau, 12),
    )


def decode_set_point(data: bytes, mode: int) -> SetPoint | None:
    """Read a command frame of control mode 2, 3 or 4, or return None for one that is none.

    Little-endian: position and bound of the speed as float32 (2), the speed as float32 (3), or the
    position as float32, then the bound in 0.01 rad/s and the share of the current in 1/10000, both
    uint16 (4). A value that is not finite is no command; what a real motor does then is not known.
    """
    if len(data) < (4 if mode == 3 else 8):
        return None
    if mode == 2:
        set_point = SetPoint(*struct.unpack("<ff", data))
    elif mode == 3:
        set_point = SetPoint(None, *struct.unpack("<f", data[:4]))
    else:
        position_rad, speed, current = struct.unpack("<fHH", data)
        set_point = SetPoint(position_rad, speed / 100.0, min(current / 10000.0, 1.0))
    return set_point if all(math.isfinite(value or 0.0) for value in set_point) else None


def position_code(position_rad: float, range_rad: float) -> int:
    """Return the 16-bit code of a reported position: beyond the range it wraps (firmware)."""
    return int((position_rad + range_rad) * 0xFFFF / (2.0 * range_rad) // 1.0) & 0xFFFF


def encode_feedback(
    *, motor_id: int, status: int, codes: tuple[int, int, int], driver_c: float, coil_c: float
) -> bytes:
    """Write a feedback frame of 8 bytes from the codes of position, velocity and torque."""
    position, velocity, torque = codes
    return bytes(
        (
            status << 4 | motor_id & 0xF,
            position >> 8,
            position & 0xFF,
            velocity >> 4,
            (velocity & 0xF) << 4 | torque >> 8,
            torque & 0xFF,
            min(max(int(driver_c), 0), 255),
            min(max(int(coil_c), 0), 255),
        )
    )


UV_VALUE, KT_VALUE, OT_VALUE, OC_VALUE = 0, 1, 2, 3
ACC, DEC, MAX_SPD = 4, 5, 6
MST_ID, ESC_ID, TIMEOUT, CTRL_MODE = 7, 8, 9, 10
HW_VER, SW_VER, SN, NPP, RS, GR = 13, 14, 15, 16, 17, 20
PMAX, VMAX, TMAX = 21, 22, 23
KP_ASR, KI_ASR, KP_APR, KI_APR, OV_VALUE = 25, 26, 27, 28, 29
V_BW, CAN_BR, SUB_VER = 32, 35, 36
IMAX, VBUS, TPCB, TMTR = 59, 60, 61, 62
P_M, XOUT = 80, 81

TIMEOUT_UNIT_S = 50e-6
MODE_MIT, MODE_POSITION, MODE_VELOCITY, MODE_FORCE_POSITION = 1, 2, 3, 4

_ID_STEP = 0x100
_FLOAT_MAX = 3.4e38
_TINY = 1e-6  # for ranges that do not include their end


@dataclass(frozen=True, slots=True)
class Register:
    """One register: its name, first value, whether it may be written, and in which range."""

    name: str
    first: float
    is_float: bool
    low: float = 0.0
    high: float = 0.0
    writable: bool = True


def _measured(name: str, first: float = 0.0) -> Register:
    """Make a float that nobody writes."""
    return Register(name, first, True, writable=False)


# Names, types and ranges: motor's manual. Values: those of a DM4310 set up for this gripper, where
# they are known: the limits, ids, ranges, Gr, KT_Value and Rs. The others are estimates of the
# right size: Ls, Flux and Inertia fit the maker's table, ACC to MAX_SPD and the gains of the
# cascade make a calm loop, the offsets from 50 on are what a healthy motor may have.
TABLE: dict[int, Register] = {
    UV_VALUE: Register("UV_Value", 15.0, True, 10.0, _FLOAT_MAX),
    KT_VALUE: Register("KT_Value", DM4310.torque_constant_nm_a, True, 0.0, _FLOAT_MAX),
    OT_VALUE: Register("OT_Value", 100.0, True, 80.0, 199.0),
    OC_VALUE: Register("OC_Value", 0.98, True, 0.01, 0.99),
    ACC: Register("ACC", 50.0, True, _TINY, _FLOAT_MAX),
    DEC: Register("DEC", -50.0, True, -_FLOAT_MAX, -_TINY),
    MAX_SPD: Register("MAX_SPD", 20.0, True, _TINY, _FLOAT_MAX),
    MST_ID: Register("MST_ID", 0x18, False, 0, 0x7FF),
    ESC_ID: Register("ESC_ID", 0x08, False, 0, 0x7FF),
    TIMEOUT: Register("TIMEOUT", 2000, False, 0, 0xFFFFFFFF),
    CTRL_MODE: Register("CTRL_MODE", MODE_MIT, False, 1, 4),
    11: _measured("Damp", 2.0e-4),
    12: _measured("Inertia", 1.8e-5),
    HW_VER: Register("hw_ver", 0x0132, False, writable=False),
    SW_VER: Register("sw_ver", 5015, False, writable=False),
    SN: Register("SN", 0x4310_0001, False, writable=False),
    NPP: Register("NPP", 14, False, writable=False),
    RS: _measured("Rs", DM4310.phase_resistance_ohm),
    18: _measured("Ls", 3.4e-4),
    19: _measured("Flux", 0.0045),
    GR: _measured("Gr", DM4310.gear_ratio),
    PMAX: Register("PMAX", DM4310.ranges.position_rad, True, 0.1, _FLOAT_MAX),
    VMAX: Register("VMAX", DM4310.ranges.velocity_rad_s, True, 0.1, _FLOAT_MAX),
    TMAX: Register("TMAX", DM4310.ranges.torque_nm, True, 0.1, _FLOAT_MAX),
    24: Register("I_BW", 1000.0, True, 100.0, 10000.0),
    KP_ASR: Register("KP_ASR", 0.0035, True, 0.0, _FLOAT_MAX),
    KI_ASR: Register("KI_ASR", 0.05, True, 0.0, _FLOAT_MAX),
    KP_APR: Register("KP_APR", 20.0, True, 0.0, _FLOAT_MAX),
    KI_APR: Register("KI_APR", 0.0, True, 0.0, _FLOAT_MAX),
    OV_VALUE: Register("OV_Value", 32.0, True, 16.0, 60.0),
    30: Register("GREF", 1.0, True, _TINY, 1.0),
    31: Register("Deta", 4.0, True, 1.0, 30.0),
    V_BW: Register("V_BW", 0.0, True, 0.0, SPEED_FILTER_MAX_HZ),
    33: Register("IQ_c1", 1000.0, True, 100.0, 10000.0),
    34: Register("VL_c1", 100.0, True, _TINY, 10000.0),
    CAN_BR: Register("can_br", 4, False, 0, 4),
    SUB_VER: Register("sub_ver", 1, False, writable=False),
    50: _measured("u_off", 0.013),
    51: _measured("v_off", -0.008),
    52: _measured("k1", 1.01),
    53: _measured("k2", 0.99),
    54: _measured("m_off", 1.37),
    55: _measured("dir", 1.0),
    56: _measured("m_off", -0.42),  # the maker's name for two registers
    IMAX: _measured("Imax", DM4310.current_limit_a),
    VBUS: _measured("VBus"),
    TPCB: _measured("Tpcb"),
    TMTR: _measured("Tmtr"),
    63: _measured("Iu_off", 0.011),
    64: _measured("Iv_off", -0.004),
    65: _measured("Iw_off", -0.007),
    P_M: _measured("p_m"),
    XOUT: _measured("xout"),
}


def _of_type(motor_type: MotorType) -> dict[int, float]:
    """Return the registers that depend on the type of the motor."""
    ratio = motor_type.gear_ratio / DM4310.gear_ratio
    return {
        KT_VALUE: motor_type.torque_constant_nm_a,
        RS: motor_type.phase_resistance_ohm,
        GR: motor_type.gear_ratio,
        PMAX: motor_type.ranges.position_rad,
        VMAX: motor_type.ranges.velocity_rad_s,
        TMAX: motor_type.ranges.torque_nm,
        IMAX: motor_type.current_limit_a,
        MAX_SPD: TABLE[MAX_SPD].first / ratio,
    }


class Registers:
    """The registers of one motor. Writes live in RAM until they are saved to the flash.

    `sources` returns the value of each register that is measured on request. What every frame needs
    is an attribute, noted after each change of the live values.
    """

    can_id: int
    """The id that the motor listens to (ESC_ID)."""
    master_id: int
    """The id that the motor answers on (MST_ID)."""
    mode: int
    """The control mode: 1 MIT, 2 position, 3 velocity, 4 force and position."""
    command_id: int
    """The id of command frames: ESC_ID in MIT mode, 0x100 more in each further mode."""
    timeout_s: float
    """How long the motor stays armed without a command frame; 0 means for ever."""
    ranges: Ranges
    """The ranges that frames are coded in."""

    def __init__(
        self,
        *,
        can_id: int,
        master_id: int,
        watchdog_s: float = 0.1,
        speed_filter_hz: float = 0.0,
        motor_type: MotorType = DM4310,
        sources: Mapping[int, Callable[[], float]] | None = None,
    ) -> None:
        self._live: dict[int, float] = {rid: entry.first for rid, entry in TABLE.items()}
        self._live |= _of_type(motor_type)
        self._live[ESC_ID] = can_id
        self._live[MST_ID] = master_id
        self._live[TIMEOUT] = round(watchdog_s / TIMEOUT_UNIT_S)
        self._live[V_BW] = speed_filter_hz
        self._flash = dict(self._live)
        self._sources = {} if sources is None else dict(sources)
        self._note_live()

    def __getitem__(self, rid: int) -> float:
        source = self._sources.get(rid)
        return self._live[rid] if source is None else source()

    def _note_live(self) -> None:
        live = self._live
        self.can_id, self.master_id = int(live[ESC_ID]), int(live[MST_ID])
        self.mode = int(live[CTRL_MODE])
        self.command_id = self.can_id + (self.mode - MODE_MIT) * _ID_STEP
        self.timeout_s = live[TIMEOUT] * TIMEOUT_UNIT_S
        self.ranges = Ranges(live[PMAX], live[VMAX], live[TMAX])

    def read(self, rid: int) -> bytes | None:
        """Return the 4 bytes of a register, or None when there is no such register."""
        if rid not in TABLE:
            return None
        value = self[rid]
        return struct.pack("<f", value) if TABLE[rid].is_float else struct.pack("<I", int(value))

    def write(self, rid: int, raw: bytes) -> bool:
        """Write 4 bytes to a register; return True if the firmware took them."""
        entry = TABLE.get(rid)
        if entry is None or not entry.writable:
            return False
        value = struct.unpack("<f" if entry.is_float else "<I", raw)[0]
        if not math.isfinite(value) or not entry.low <= value <= entry.high:
            return False
        self._live[rid] = value
        self._note_live()
        return True

    def save(self) -> None:
        """Copy the live values to the flash."""
        self._flash = dict(self._live)

    def power_cycle(self) -> None:
        """Forget what was not saved."""
        self._live = dict(self._flash)
        self._note_live()
