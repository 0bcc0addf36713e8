"""The motor's registers: a live copy that frames read and write, and a flash that outlives power.

Only the values and their rules; what a register means for the motion is in `motor` and `cascade`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from litegripd.model.motor_types import DM4310, MotorType
from litegripd.sim.codec import Ranges
from litegripd.sim.parameters import SPEED_FILTER_MAX_HZ

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


def encode(rid: int, value: float) -> bytes:
    """Return the 4 bytes that write a value.

    Raises `ValueError` for a number that no register has, or a value that 4 bytes cannot hold.
    """
    entry = TABLE.get(rid)
    if entry is None:
        raise ValueError(f"there is no register {rid}")
    if not entry.is_float and value % 1.0 != 0.0:
        raise ValueError(f"register {rid} cannot hold {value:g}")
    try:
        return struct.pack("<f", value) if entry.is_float else struct.pack("<I", int(value))
    except (struct.error, OverflowError):
        raise ValueError(f"register {rid} cannot hold {value:g}") from None


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

    `sources` returns the value of each register that is measured on request.
    """

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

    def __getitem__(self, rid: int) -> float:
        source = self._sources.get(rid)
        return self._live[rid] if source is None else source()

    @property
    def can_id(self) -> int:
        """The id that the motor listens to (ESC_ID)."""
        return int(self._live[ESC_ID])

    @property
    def master_id(self) -> int:
        """The id that the motor answers on (MST_ID)."""
        return int(self._live[MST_ID])

    @property
    def command_id(self) -> int:
        """The id of command frames: ESC_ID in MIT mode, 0x100 more in each further mode."""
        return self.can_id + (self.mode - MODE_MIT) * _ID_STEP

    @property
    def mode(self) -> int:
        """The control mode: 1 MIT, 2 position, 3 velocity, 4 force and position."""
        return int(self._live[CTRL_MODE])

    @property
    def timeout_s(self) -> float:
        """How long the motor stays armed without a command frame; 0 means for ever."""
        return self._live[TIMEOUT] * TIMEOUT_UNIT_S

    @property
    def ranges(self) -> Ranges:
        """The ranges that frames are coded in."""
        return Ranges(self._live[PMAX], self._live[VMAX], self._live[TMAX])

    def read(self, rid: int) -> bytes | None:
        """Return the 4 bytes of a register, or None when there is no such register."""
        return encode(rid, self[rid]) if rid in TABLE else None

    def write(self, rid: int, raw: bytes) -> bool:
        """Write 4 bytes to a register; return whether the firmware took them."""
        entry = TABLE.get(rid)
        if entry is None or not entry.writable:
            return False
        value = struct.unpack("<f" if entry.is_float else "<I", raw)[0]
        if not math.isfinite(value) or not entry.low <= value <= entry.high:
            return False
        self._live[rid] = value
        return True

    def save(self) -> None:
        """Copy the live values to the flash."""
        self._flash = dict(self._live)

    def power_cycle(self) -> None:
        """Forget what was not saved."""
        self._live = dict(self._flash)
