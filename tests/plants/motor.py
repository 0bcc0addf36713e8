"""The firmware of a DM4310: frames in, frames out, as the maker and the field describe it.

It never sends a frame that nobody asked for. What happens to frames on their way is not its matter.
"""

import math
import random
import struct
from typing import NamedTuple

from litegripd.model.motor import CanFrame
from tests.plants.codec import Command, Scale, read_command, write_feedback
from tests.plants.mechanics import STEPS_PER_S, Mechanics
from tests.plants.parameters import LIMITS_RAD, PlantParameters

ENABLED, COMMUNICATION_LOST = 0x1, 0xD
FOR_ALL_ID = 0x7FF
TIMEOUT_UNIT_S = 50e-6
MST_ID, ESC_ID, TIMEOUT, CTRL_MODE, GR, PMAX, VMAX, TMAX, V_BW = 7, 8, 9, 10, 20, 21, 22, 23, 32

# Number, name, type (with r: read-only), first value, lowest, highest.
_TABLE = """
0 UV_Value f 15 10 1e9 | 1 KT_Value f 0.945 0 1e9 | 2 OT_Value f 100 80 199 | 3 OC_Value f 0.98 0 1
4 ACC f 10 0 1e9 | 5 DEC f -10 -1e9 0 | 6 MAX_SPD f 30 0 1e9 | 7 MST_ID u 24 0 2047
8 ESC_ID u 8 0 2047 | 9 TIMEOUT u 2000 0 4294967295 | 10 CTRL_MODE u 1 1 4 | 11 Damp fr 0.001
12 Inertia fr 1.8e-5 | 13 hw_ver ur 306 | 14 sw_ver ur 5015 | 15 SN ur 77 | 16 NPP ur 14
17 Rs fr 0.85 | 18 Ls fr 4e-4 | 19 Flux fr 0.004 | 20 Gr fr 10 | 21 PMAX f 12.5 0.1 1e6
22 VMAX f 30 0.1 1e6 | 23 TMAX f 10 0.1 1e6 | 24 I_BW f 1000 100 10000 | 25 KP_ASR f 0.003 0 1e9
26 KI_ASR f 0.002 0 1e9 | 27 KP_APR f 50 0 1e9 | 28 KI_APR f 0 0 1e9 | 29 OV_Value f 32 16 60
30 GREF f 0.5 0 1 | 31 Deta f 4 1 30 | 32 V_BW f 500 0 500 | 33 IQ_c1 f 0.95 0 1e9
34 VL_c1 f 0.95 0 1e9 | 35 can_br u 4 0 4 | 36 sub_ver ur 1 | 50 u_off fr 0 | 51 v_off fr 0
52 k1 fr 0 | 53 k2 fr 0 | 54 m_off fr 0 | 55 dir fr 0 | 56 m_off fr 0 | 59 Imax fr 10.26
60 VBus fr 24 | 61 Tpcb fr 30 | 62 Tmtr fr 30 | 63 Iu_off fr 0 | 64 Iv_off fr 0 | 65 Iw_off fr 0
80 p_m fr 0 | 81 xout fr 0
"""


class Register(NamedTuple):
    """One register; its range is empty when it is read-only."""

    form: str
    first: float
    low: float
    high: float


def _row(number: str, _name: str, kind: str, first: str, *ends: str) -> tuple[int, Register]:
    low, high = (float(end) for end in ends or ("inf", "-inf"))
    return int(number), Register("<I" if kind[0] == "u" else "<f", float(first), low, high)


REGISTERS = dict(_row(*row.split()) for row in _TABLE.strip().replace("\n", "|").split("|"))


class PlantMotor:
    """A motor with its gripper in one mount; the same inputs at the same times do the same."""

    def __init__(
        self, parameters: PlantParameters, mount: str = "normal", opening_mm: float = 60.0
    ) -> None:
        self.mechanics = Mechanics(parameters, opening_mm)
        self.registers = {number: row.first for number, row in REGISTERS.items()}
        self.registers[TIMEOUT] = round(parameters.timeout_s / TIMEOUT_UNIT_S)
        self.registers[GR] = parameters.gear
        self.registers |= zip((PMAX, VMAX, TMAX), parameters.ranges, strict=True)
        lag_s = parameters.speed_lag_s
        self.registers[V_BW] = min(500.0, 1.0 / (2.0 * math.pi * lag_s)) if lag_s else 500.0
        self.status = 0
        self.closed_rad, open_rad = LIMITS_RAD[mount]
        self.sign = 1 if self.closed_rad > open_rad else -1
        self._noise_rad_s = parameters.speed_noise_rad_s
        self._noise_nm = parameters.torque_noise_nm
        self._chance = random.Random(f"noise {parameters.seed}")
        self._zero_rad = 0.0
        self._stored = Command()
        self._began_s: float | None = None
        self._step = 0
        self._expires: int | None = None

    @property
    def scale(self) -> Scale:
        """The ranges of the frames now."""
        return Scale(self.registers[PMAX], self.registers[VMAX], self.registers[TMAX])

    @property
    def reported_rad(self) -> float:
        """The position as the motor reports it."""
        return self.closed_rad + self.sign * self.mechanics.encoder_rad - self._zero_rad

    def advance(self, now_s: float) -> None:
        """Let time pass; the first call says when it begins."""
        if self._began_s is None:
            self._began_s = now_s
        until = int((now_s - self._began_s) * STEPS_PER_S + 1e-3)
        if self._expires is not None and self._expires <= until:
            self.mechanics.run(self._expires - self._step)
            self._step = self._expires
            self._disarm(COMMUNICATION_LOST)
        self.mechanics.run(until - self._step)
        self._step = max(self._step, until)

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        """Take a frame that arrives now; return the answers."""
        self.advance(now_s)
        if frame.can_id == FOR_ALL_ID:
            return self._about_registers(frame.data)
        if frame.can_id != self.registers[ESC_ID] or len(frame.data) != 8:
            return []
        if frame.data[:7] == b"\xff" * 7 and 0xFB <= frame.data[7] <= 0xFE:
            self._special(frame.data[7])
        elif self.registers[CTRL_MODE] == 1:
            self._stored = read_command(frame.data, self.scale)
            if self.status == ENABLED:
                self._obey()
        else:
            return []
        timeout_s = self.registers[TIMEOUT] * TIMEOUT_UNIT_S
        if self.status == ENABLED and timeout_s > 0.0:
            self._expires = self._step + max(math.ceil(timeout_s * STEPS_PER_S), 1)
        return [self._feedback()]

    def _special(self, code: int) -> None:
        if code == 0xFC and self.status in (0, ENABLED):
            self.status = ENABLED
            self._obey()
        elif code == 0xFD:
            self._disarm(0 if self.status == ENABLED else self.status)
        elif code == 0xFB:
            self._disarm(0)
        elif code == 0xFE and self.status != ENABLED:
            self._zero_rad += self.reported_rad

    def _disarm(self, status: int) -> None:
        self.status = status
        self._expires = None
        self.mechanics.brake()

    def _obey(self) -> None:
        at, speed, kp, kd, torque = self._stored
        at = self.sign * (at + self._zero_rad - self.closed_rad)
        self.mechanics.drive(at, self.sign * speed, kp, kd, self.sign * torque)

    def _about_registers(self, data: bytes) -> list[CanFrame]:
        if len(data) < 4 or int.from_bytes(data[:2], "little") != self.registers[ESC_ID]:
            return []
        what, number = data[2], data[3]
        if what == 0xCC:
            return [self._feedback()]
        if what == 0xAA:
            return [] if self.status == ENABLED else [self._answer(data[:4] + bytes(4))]
        if number not in self.registers or what not in (0x33, 0x55):
            return []
        row = REGISTERS[number]
        if what == 0x55 and len(data) == 8:
            value = struct.unpack(row.form, data[4:])[0]
            if row.low <= value <= row.high:
                self.registers[number] = value
        value = self.registers[number]
        raw = struct.pack(row.form, int(value) if row.form == "<I" else value)
        return [self._answer(data[:4] + raw)]

    def _answer(self, data: bytes) -> CanFrame:
        return CanFrame(int(self.registers[MST_ID]), data)

    def _feedback(self) -> CanFrame:
        noise = self._noise_rad_s
        speed = self.sign * self.mechanics.speed_rad_s
        if noise:
            speed += self._chance.uniform(-noise, noise)
        torque = self.sign * self.mechanics.reported_nm
        if self._noise_nm:
            torque += self._chance.uniform(-self._noise_nm, self._noise_nm)
        head = self.status << 4 | int(self.registers[ESC_ID]) & 15
        return self._answer(write_feedback(head, self.reported_rad, speed, torque, self.scale))
