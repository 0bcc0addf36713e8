"""The firmware of the DM4310: frames in, frames out.

In MIT mode the torque law of a command is followed as it is; `cascade` turns the commands of the
control modes 2 to 4 into such laws. Each mode has its own id for commands and ignores the others'.

It behaves as field reports say that the real one does, including what surprises drivers: a
set-point stored while disabled, a watchdog that register traffic does not feed, positions that
wrap. It answers what it is asked; while it is enabled it may also report by itself. The mechanics
are behind `drive`; buses and clocks are elsewhere, time is an argument.
"""

from __future__ import annotations

import math
import random
from collections import deque
from typing import NamedTuple

from litegripd.model.motor import CanFrame
from litegripd.sim import registers as reg
from litegripd.sim.drive import Drive
from litegripd.sim.plant import STEP_S, STEPS_PER_S, SimulatorParameters
from litegripd.sim.registers import (
    MitCommand,
    SetPoint,
    decode_command,
    decode_set_point,
    encode_feedback,
    position_code,
    to_code,
)


class Thermal:
    """Temperatures of coil and driver in °C, advanced in steps of one fixed duration.

    First-order lags, driven by the loss in the windings. The figures are estimates from the motor's
    data.
    """

    def __init__(self, parameters: SimulatorParameters, step_s: float) -> None:
        p = parameters
        # Loss in three phases at a current amplitude I: 1.5·R·I², with I = torque / constant.
        self._watts_per_nm2 = 1.5 * p.phase_resistance_ohm / p.torque_constant_nm_a**2
        self._ambient_c = p.ambient_c
        self._gains = (p.winding_k_w, p.housing_k_w, p.driver_k_w)
        times = (p.winding_time_s, p.housing_time_s, p.driver_time_s)
        self._decays = tuple(math.exp(-step_s / time_s) for time_s in times)
        self._winding = self._housing = self._driver = 0.0

    @property
    def coil_c(self) -> float:
        """Temperature of the coil: the winding above its housing, the housing above the room."""
        return self._ambient_c + self._housing + self._winding

    @property
    def driver_c(self) -> float:
        """Temperature of the driver's transistors."""
        return self._ambient_c + self._driver

    def set_coil(self, coil_c: float) -> None:
        """Let the coil have this temperature now, by the winding alone; the housing keeps its."""
        self._winding = coil_c - self._ambient_c - self._housing

    def step(self, mean_square_torque_nm2: float) -> None:
        """Advance by one step over which the squared torque had this mean."""
        watts = self._watts_per_nm2 * mean_square_torque_nm2
        winding_k_w, housing_k_w, driver_k_w = self._gains
        winding_decay, housing_decay, driver_decay = self._decays
        self._winding = _lag(self._winding, winding_k_w * watts, winding_decay)
        self._housing = _lag(self._housing, housing_k_w * watts, housing_decay)
        self._driver = _lag(self._driver, driver_k_w * watts, driver_decay)


def _lag(value: float, towards: float, decay: float) -> float:
    """Return a first-order lag after one step: exact for a constant input."""
    return towards + (value - towards) * decay


PERIOD_STEPS = 4
"""The loops run every 1 ms."""

_PERIOD_S = PERIOD_STEPS * STEP_S


class SpeedLaw(NamedTuple):
    """The law kd·(dq - dq_measured) + tau for the time until the next step."""

    velocity_rad_s: float
    kd_nm_s_rad: float
    torque_nm: float


class Cascade:
    """The loops of the control modes 2 to 4: from a position or a speed to a torque.

    Position to speed, speed to torque, one inside the other, as the family's motors have them. The
    registers' names and ids are the maker's; how they enter the loops is an estimate, because the
    maker does not say it:

    - KP_APR turns a position error (rad) into a speed (rad/s), at most the commanded one, MAX_SPD,
      and what DEC can still stop. KI_APR is held and does nothing.
    - The speed that is aimed at changes by at most ACC, or DEC towards standstill, both in rad/s².
    - KP_ASR and KI_ASR are gains of the speed error at the rotor, in N·m·s/rad and N·m/rad; at the
      output they are Gr² times as large.

    It computes the law's figures once in `PERIOD_STEPS` steps; `drive` follows them in every step.
    """

    def __init__(self, registers: reg.Registers) -> None:
        self._registers = registers
        self.reset(0.0)

    def reset(self, velocity_rad_s: float) -> None:
        """Forget the past; begin at this speed."""
        self._aim_rad_s = velocity_rad_s
        self._integral_nm = 0.0

    def step(
        self, set_point: SetPoint, *, position_rad: float, velocity_rad_s: float, most_nm: float
    ) -> SpeedLaw:
        """Advance by 1 ms at the measured position and speed.

        The integral holds at most `most_nm`, which is what the motor may make.
        """
        gear = self._registers[reg.GR] ** 2
        self._approach(self._wanted_speed(set_point, position_rad))
        error_rad_s = self._aim_rad_s - velocity_rad_s
        integral = self._integral_nm + gear * self._registers[reg.KI_ASR] * error_rad_s * _PERIOD_S
        self._integral_nm = min(max(integral, -most_nm), most_nm)
        return SpeedLaw(self._aim_rad_s, gear * self._registers[reg.KP_ASR], self._integral_nm)

    def _wanted_speed(self, set_point: SetPoint, position_rad: float) -> float:
        most = self._registers[reg.MAX_SPD]
        if set_point.position_rad is None:
            return min(max(set_point.velocity_rad_s, -most), most)
        error_rad = set_point.position_rad - position_rad
        stoppable = math.sqrt(2.0 * -self._registers[reg.DEC] * abs(error_rad))
        most = min(most, abs(set_point.velocity_rad_s), stoppable)
        return min(max(self._registers[reg.KP_APR] * error_rad, -most), most)

    def _approach(self, wanted_rad_s: float) -> None:
        """Let the speed that is aimed at change as ACC and DEC allow."""
        aim = self._aim_rad_s
        is_slowing = abs(wanted_rad_s) < abs(aim) or wanted_rad_s * aim < 0.0
        rate = -self._registers[reg.DEC] if is_slowing else self._registers[reg.ACC]
        change = rate * _PERIOD_S
        self._aim_rad_s += min(max(wanted_rad_s - aim, -change), change)


REGISTER_CAN_ID = 0x7FF
READ, WRITE, SAVE, STATUS = 0x33, 0x55, 0xAA, 0xCC
ENABLE, DISABLE, ZERO, CLEAR = 0xFC, 0xFD, 0xFE, 0xFB

# Status nibbles (motor's manual). 0 and 1 are states, the others latch as faults.
DISABLED, ENABLED = 0x0, 0x1
OVER_VOLTAGE, UNDER_VOLTAGE, OVER_CURRENT = 0x8, 0x9, 0xA
DRIVER_HOT, COIL_HOT, COMMUNICATION_LOST, OVERLOAD = 0xB, 0xC, 0xD, 0xE
FAULTS = range(OVER_VOLTAGE, OVERLOAD + 1)

_SPECIAL = b"\xff" * 7
_FREE = MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)
_HEAT_STEPS = 40  # temperatures and their trips every 10 ms
_NEVER = 1 << 62
_UNASKED_KEPT = 1000  # about what a receiver keeps


class SimulatedMotor:
    """One motor on the bus. Not thread-safe; the owner serialises calls.

    With a `seed`, reported position, velocity and torque carry a noise of at most one code that
    is the same for the same seed; without one the reports are exact.
    """

    def __init__(
        self, drive: Drive, parameters: SimulatorParameters, *, seed: int | None = None
    ) -> None:
        self._drive = drive
        self._driver_trip_c = parameters.driver_trip_c
        self._registers = reg.Registers(
            can_id=parameters.can_id,
            master_id=parameters.master_id,
            watchdog_s=parameters.watchdog_s,
            speed_filter_hz=parameters.speed_filter_hz,
            motor_type=parameters.motor_type,
            sources={
                reg.VBUS: lambda: self._supply_v,
                reg.TPCB: lambda: self.driver_c,
                reg.TMTR: lambda: self.coil_c,
                reg.P_M: lambda: self.reported_position_rad,
                reg.XOUT: lambda: self.reported_position_rad,
            },
        )
        self._cascade = Cascade(self._registers)
        self._most_nm = parameters.torque_limit_nm
        self._ranges = self._registers.ranges
        self._thermal = Thermal(parameters, _HEAT_STEPS * STEP_S)
        self._noise = None if seed is None else random.Random(seed)  # noqa: S311 - not a secret
        self._supply_v = parameters.rated_supply_v
        self._offset_rad = 0.0  # reported position minus mechanical position
        self._stored: MitCommand | SetPoint = _FREE
        self._enabled = False
        self.is_powered = True
        """True if it is switched on; else it hears and answers nothing."""
        self._fault = 0
        self._comm_loss_s = parameters.comm_loss_s
        self._idle_loss_s = parameters.idle_loss_s
        self._unasked_hz = parameters.unasked_hz
        self._unasked: deque[tuple[float, CanFrame]] = deque(maxlen=_UNASKED_KEPT)
        self._origin_s: float | None = None
        self._step = 0
        self._heat_step = _HEAT_STEPS
        self._watchdog_step = _NEVER
        self._unasked_step = _NEVER
        self._cascade_step = _NEVER
        self._plan_idle_loss()

    @property
    def status(self) -> int:
        """The status nibble: 0 disabled, 1 enabled, 8 to E a latched fault."""
        return self._fault or (ENABLED if self._enabled else DISABLED)

    @property
    def registers(self) -> reg.Registers:
        """The motor's registers."""
        return self._registers

    @property
    def coil_c(self) -> float:
        """Temperature of the coil in °C."""
        return self._thermal.coil_c

    @property
    def driver_c(self) -> float:
        """Temperature of the driver in °C."""
        return self._thermal.driver_c

    @property
    def reported_position_rad(self) -> float:
        """Position as the firmware counts it, before it is coded (and wrapped)."""
        return self._drive.measured_position_rad + self._offset_rad

    def advance(self, now_s: float) -> None:
        """Let time pass until `now_s`; the first call sets where time begins.

        A time in the past changes nothing. Raises `ValueError` for a time that is not finite.
        """
        if not math.isfinite(now_s):
            raise ValueError(f"now_s must be a finite time in seconds, not {now_s!r}")
        if self._origin_s is None:
            self._origin_s = now_s
        # A time meant to fall on a step may be a rounding error before it.
        until = int((now_s - self._origin_s) * STEPS_PER_S + 1e-4)
        while self._step < until:
            stop = min(
                until,
                self._heat_step,
                self._watchdog_step,
                self._unasked_step,
                self._cascade_step,
            )
            self._drive.run(stop - self._step)
            self._step = stop
            if stop == self._watchdog_step:
                self._trip(self._fault or COMMUNICATION_LOST)
            if stop == self._heat_step:
                self._heat_step += _HEAT_STEPS
                self._thermal.step(self._drive.take_mean_square_torque(_HEAT_STEPS * STEP_S))
                self._check_limits()
            if stop == self._cascade_step:
                self._run_cascade()
            if stop == self._unasked_step:
                self._unasked.append((self._time_s(stop), self._feedback()))
                self._plan_unasked()

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        """Take one frame off the bus at `now_s` and return the motor's immediate answers."""
        self.advance(now_s)
        if not self.is_powered:
            return []
        if frame.can_id in (self._registers.can_id, self._registers.command_id):
            return self._receive_own(now_s, frame)
        if frame.can_id == REGISTER_CAN_ID:
            return self._receive_register(frame.data)
        return []

    @property
    def disarms_after_s(self) -> float:
        """After how long without a command it disarms; 0 is never."""
        return self._registers.timeout_s if self._comm_loss_s is None else self._comm_loss_s

    @property
    def next_unasked_s(self) -> float:
        """When there is a report of its own to take; infinite if none is planned."""
        if self._unasked:
            return self._unasked[0][0]
        return math.inf if self._unasked_step == _NEVER else self._time_s(self._unasked_step)

    def take_unasked(self, now_s: float) -> list[tuple[float, CanFrame]]:
        """Return, once, what the motor has reported by itself until `now_s`, with the times."""
        self.advance(now_s)
        unasked = list(self._unasked)
        self._unasked.clear()
        return unasked

    def set_comm_loss(self, seconds: float | None) -> None:
        """Let it disarm so long after its next command; 0 is never, None what TIMEOUT holds."""
        self._comm_loss_s = seconds

    def set_idle_loss(self, seconds: float) -> None:
        """Let it latch the same fault while it is disabled, after so long without a command."""
        self._idle_loss_s = seconds
        if not self._enabled:
            self._plan_idle_loss()

    def set_unasked(self, rate_hz: float) -> None:
        """Let it report so often by itself while it is enabled; 0 is never."""
        self._unasked_hz = rate_hz
        self._plan_unasked()

    def set_supply(self, volts: float) -> None:
        """Set the voltage of the power stage; the logic has its own supply and keeps answering."""
        self._supply_v = volts
        self._drive.set_supply(volts)
        self._check_limits()

    def latch_fault(self, status: int) -> None:
        """Latch a fault as if its cause had been there for a moment; it disarms."""
        self._trip(status)

    def jump(self, angle_rad: float) -> None:
        """Let the encoder count on by this angle without any motion; an armed motor follows it."""
        self._offset_rad += angle_rad
        if self._enabled:
            self._apply()

    def set_coil(self, coil_c: float) -> None:
        """Let the coil have this temperature from now on; a limit trips at once."""
        self._thermal.set_coil(coil_c)
        self._check_limits()

    def power_off(self) -> None:
        """Switch off, logic and power stage: no answers, and nothing that drives or brakes."""
        self.is_powered = False
        self._fault = 0
        self._stored = _FREE
        self._disarm()
        self._apply()

    def power_on(self, *, turns: int = 0) -> None:
        """Switch on: disabled, no fault, unsaved registers and the turn count lost.

        The position comes back within one turn, [-π, π), plus `turns` whole turns. A motor that
        was on has been switched off for no time.
        """
        self.is_powered = True
        self._registers.power_cycle()
        self._heed_registers()
        reported = self.reported_position_rad
        within = (reported + math.pi) % math.tau - math.pi
        self._offset_rad += within - reported + turns * math.tau
        self._stored = _FREE
        self._fault = 0
        self._disarm()
        self._check_limits()

    def _receive_own(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        data = frame.data
        if len(data) == 8 and data[:7] == _SPECIAL and CLEAR <= data[7] <= ZERO:
            self._special(data[7])
        elif frame.can_id == self._registers.command_id:
            command = self._decode(data)
            if command is None:
                return []
            self._stored = command
            if self._enabled:
                self._apply()
        else:
            return []
        self._feed_watchdog(now_s)
        return [self._feedback()]

    def _decode(self, data: bytes) -> MitCommand | SetPoint | None:
        mode = self._registers.mode
        if mode != reg.MODE_MIT:
            return decode_set_point(data, mode)
        return decode_command(data, self._ranges) if len(data) == 8 else None

    def _special(self, code: int) -> None:
        if code == ENABLE:
            if not self._fault:
                is_new = not self._enabled
                self._enabled = True
                self._apply()
                if is_new:
                    self._plan_unasked()
        elif code == DISABLE:
            self._disarm()
        elif code == ZERO:
            if not self._enabled:
                self._offset_rad = -self._drive.measured_position_rad
        else:
            self._fault = 0
            self._disarm()
            self._check_limits()

    def _receive_register(self, data: bytes) -> list[CanFrame]:
        if len(data) < 4 or int.from_bytes(data[:2], "little") != self._registers.can_id:
            return []
        operation, rid = data[2], data[3]
        if operation == STATUS:
            return [self._feedback()]
        if operation == SAVE:
            if self._enabled:
                return []
            self._registers.save()
            return [self._answer(data[:4], bytes(4))]
        if operation == WRITE and len(data) == 8:
            mode = self._registers.mode
            self._registers.write(rid, data[4:])
            self._heed_registers()
            if self._registers.mode != mode:
                # No mode takes over another mode's command. That is an estimate; the maker does not
                # say what a change of the mode does while enabled.
                self._stored = _FREE
                if self._enabled:
                    self._apply()
        elif operation != READ:
            return []
        value = self._registers.read(rid)
        return [] if value is None else [self._answer(data[:4], value)]

    def _answer(self, head: bytes, value: bytes) -> CanFrame:
        return CanFrame(self._registers.master_id, head + value)

    def _heed_registers(self) -> None:
        """Let the values of the registers count that are not looked up when they are used."""
        self._ranges = self._registers.ranges
        self._drive.set_speed_filter(self._registers[reg.V_BW])

    def _apply(self) -> None:
        command = self._stored
        if isinstance(command, SetPoint):
            if self._cascade_step == _NEVER:
                self._cascade.reset(self._drive.measured_velocity_rad_s)
                self._run_cascade()
            return
        self._cascade_step = _NEVER
        self._drive.drive(
            position_rad=command.position_rad - self._offset_rad,
            velocity_rad_s=command.velocity_rad_s,
            kp_nm_rad=command.kp_nm_rad,
            kd_nm_s_rad=command.kd_nm_s_rad,
            torque_nm=command.torque_nm,
        )

    def _run_cascade(self) -> None:
        """Follow the stored set-point for one period of the cascade."""
        set_point = self._stored
        if not isinstance(set_point, SetPoint):
            self._cascade_step = _NEVER
            return
        most_nm = self._most_nm * set_point.current_share
        law = self._cascade.step(
            set_point,
            position_rad=self.reported_position_rad,
            velocity_rad_s=self._drive.measured_velocity_rad_s,
            most_nm=most_nm,
        )
        self._drive.drive(
            position_rad=0.0,
            velocity_rad_s=law.velocity_rad_s,
            kp_nm_rad=0.0,
            kd_nm_s_rad=law.kd_nm_s_rad,
            torque_nm=law.torque_nm,
            most_nm=most_nm,
        )
        self._cascade_step = self._step + PERIOD_STEPS

    def _feed_watchdog(self, now_s: float) -> None:
        if not self._enabled:
            self._plan_idle_loss()
            return
        timeout_s = self.disarms_after_s
        if timeout_s == 0.0:
            self._watchdog_step = _NEVER
            return
        elapsed_s = now_s - (self._origin_s or 0.0)
        expiry = math.ceil((elapsed_s + timeout_s) * STEPS_PER_S - 1e-4)
        self._watchdog_step = max(expiry, self._step + 1)

    def _plan_idle_loss(self) -> None:
        """Plan when a disabled motor without commands latches a communication loss, if ever."""
        is_planned = self.is_powered and not self._fault and self._idle_loss_s > 0.0
        wait_steps = max(round(self._idle_loss_s * STEPS_PER_S), 1)
        self._watchdog_step = self._step + wait_steps if is_planned else _NEVER

    def _plan_unasked(self) -> None:
        """Plan the next report that nobody asks for, if it makes any."""
        is_planned = self._enabled and self._unasked_hz > 0.0
        period_steps = max(round(STEPS_PER_S / self._unasked_hz), 1) if is_planned else 0
        self._unasked_step = self._step + period_steps if is_planned else _NEVER

    def _time_s(self, step: int) -> float:
        return (self._origin_s or 0.0) + step * STEP_S

    def _trip(self, fault: int) -> None:
        self._fault = fault
        self._disarm()

    def _disarm(self) -> None:
        self._enabled = False
        self._unasked_step = self._cascade_step = _NEVER
        self._plan_idle_loss()
        self._drive.brake()

    def _check_limits(self) -> None:
        """Latch the first limit that is exceeded; a latched fault stays until it is cleared."""
        if self._fault or not self.is_powered:
            return
        if self._supply_v < self._registers[reg.UV_VALUE]:
            self._trip(UNDER_VOLTAGE)
        elif self._supply_v > self._registers[reg.OV_VALUE]:
            self._trip(OVER_VOLTAGE)
        elif self._thermal.driver_c >= self._driver_trip_c:
            self._trip(DRIVER_HOT)
        elif self._thermal.coil_c >= self._registers[reg.OT_VALUE]:
            self._trip(COIL_HOT)

    def _feedback(self) -> CanFrame:
        drive, ranges = self._drive, self._ranges
        codes = (
            position_code(self.reported_position_rad, ranges.position_rad),
            to_code(
                drive.measured_velocity_rad_s, -ranges.velocity_rad_s, ranges.velocity_rad_s, 12
            ),
            to_code(drive.measured_torque_nm, -ranges.torque_nm, ranges.torque_nm, 12),
        )
        if self._noise is not None:
            codes = self._with_noise(self._noise, codes)
        data = encode_feedback(
            motor_id=self._registers.can_id,
            status=self.status,
            codes=codes,
            driver_c=self._thermal.driver_c,
            coil_c=self._thermal.coil_c,
        )
        return CanFrame(self._registers.master_id, data)

    @staticmethod
    def _with_noise(noise: random.Random, codes: tuple[int, int, int]) -> tuple[int, int, int]:
        position, velocity, torque = (code + int(noise.random() * 3) - 1 for code in codes)
        return position & 0xFFFF, min(max(velocity, 0), 0xFFF), min(max(torque, 0), 0xFFF)
