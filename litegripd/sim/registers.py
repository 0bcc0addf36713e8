"""The motor's registers: a live copy that frames read and write, and a flash that outlives power.

Only the values and their rules; what a register means for the motion is in `motor`.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from litegripd.sim.codec import Ranges

UV_VALUE, KT_VALUE, OT_VALUE, OC_VALUE = 0, 1, 2, 3
MST_ID, ESC_ID, TIMEOUT, CTRL_MODE = 7, 8, 9, 10
HW_VER, SW_VER, SN, NPP, RS, GR = 13, 14, 15, 16, 17, 20
PMAX, VMAX, TMAX = 21, 22, 23
OV_VALUE, CAN_BR, SUB_VER = 29, 35, 36

TIMEOUT_UNIT_S = 50e-6
MODE_MIT = 1

_FLOAT_MAX = 3.4e38


@dataclass(frozen=True, slots=True)
class Register:
    """One register: its name, first value, whether it may be written, and in which range."""

    name: str
    first: float
    is_float: bool
    low: float = 0.0
    high: float = 0.0
    writable: bool = True


# Names, types and ranges: motor's manual. Values: those of a DM4310 set up for this gripper.
TABLE: dict[int, Register] = {
    UV_VALUE: Register("UV_Value", 15.0, True, 10.0, _FLOAT_MAX),
    KT_VALUE: Register("KT_Value", 0.945, True, 0.0, _FLOAT_MAX),
    OT_VALUE: Register("OT_Value", 100.0, True, 80.0, 199.0),
    OC_VALUE: Register("OC_Value", 0.98, True, 0.01, 0.99),
    MST_ID: Register("MST_ID", 0x18, False, 0, 0x7FF),
    ESC_ID: Register("ESC_ID", 0x08, False, 0, 0x7FF),
    TIMEOUT: Register("TIMEOUT", 2000, False, 0, 0xFFFFFFFF),
    CTRL_MODE: Register("CTRL_MODE", MODE_MIT, False, 1, 4),
    HW_VER: Register("hw_ver", 0x0132, False, writable=False),
    SW_VER: Register("sw_ver", 5015, False, writable=False),
    SN: Register("SN", 0x4310_0001, False, writable=False),
    NPP: Register("NPP", 14, False, writable=False),
    RS: Register("Rs", 0.85, True, writable=False),
    GR: Register("Gr", 10.0, True, writable=False),
    PMAX: Register("PMAX", 12.5, True, 0.1, _FLOAT_MAX),
    VMAX: Register("VMAX", 30.0, True, 0.1, _FLOAT_MAX),
    TMAX: Register("TMAX", 10.0, True, 0.1, _FLOAT_MAX),
    OV_VALUE: Register("OV_Value", 32.0, True, 16.0, 60.0),
    CAN_BR: Register("can_br", 4, False, 0, 4),
    SUB_VER: Register("sub_ver", 1, False, writable=False),
}


class Registers:
    """The registers of one motor. Writes live in RAM until they are saved to the flash."""

    def __init__(self, *, can_id: int, master_id: int, watchdog_s: float = 0.1) -> None:
        self._live: dict[int, float] = {rid: entry.first for rid, entry in TABLE.items()}
        self._live[ESC_ID] = can_id
        self._live[MST_ID] = master_id
        self._live[TIMEOUT] = round(watchdog_s / TIMEOUT_UNIT_S)
        self._flash = dict(self._live)

    def __getitem__(self, rid: int) -> float:
        return self._live[rid]

    @property
    def can_id(self) -> int:
        """The id that the motor listens to (ESC_ID)."""
        return int(self._live[ESC_ID])

    @property
    def master_id(self) -> int:
        """The id that the motor answers on (MST_ID)."""
        return int(self._live[MST_ID])

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
        entry = TABLE.get(rid)
        if entry is None:
            return None
        value = self._live[rid]
        return struct.pack("<f", value) if entry.is_float else struct.pack("<I", int(value))

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
