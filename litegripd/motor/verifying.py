"""Reading again the registers that decide how the motor is talked to, in whatever phase it is.

They may change unheard: another program writes them, a power cycle takes back what was not saved.
A register counts as verified once an answer equals what is known of it, or what has been claimed
of it before: by another program's write, by the motor's own answer to that, or by an earlier answer
that differed. So one disturbed frame changes nothing for good. Until then all that was claimed is
possible, and a torque is coded so that it is no larger than wanted by any of it.
"""

import math
from dataclasses import dataclass, field, replace

from litegripd.model.frame import CanFrame
from litegripd.model.motor import MotorIdentity, Ranges
from litegripd.motor.look import ANSWER_WITHIN_S, LONGEST_WATCHDOG_S, is_usable_range
from litegripd.motor.registers import (
    CAN_ID,
    CONTROL_MODE,
    MASTER_ID,
    PMAX,
    TIMEOUT,
    TIMEOUT_UNIT_S,
    TMAX,
    VERIFIED,
    VMAX,
    Answer,
    Register,
    read_request,
    write_request,
)

WATCHDOG_S = 0.1
"""Written (not saved) where the motor's own watchdog is off: it is the last line when the daemon
itself dies."""

_WATCHDOG_UNITS = round(WATCHDOG_S / TIMEOUT_UNIT_S)
_RANGES = {PMAX: "position_rad", VMAX: "velocity_rad_s", TMAX: "torque_nm"}
_BY_NUMBER = {register.number: register for register in VERIFIED}


@dataclass(slots=True)
class _Check:
    """One register that is not verified yet."""

    claims: set[bytes] = field(default_factory=set)
    """What it may hold, beside what is known."""
    is_asked: bool = False
    asked_s: float = -math.inf


class Verifier:
    """Reads the registers of `VERIFIED` again, once it is asked to `begin`.

    It keeps no values: what is known is given as a `MotorIdentity`, and what has changed returned
    as another.
    """

    def __init__(self, can_id: int) -> None:
        self._can_id = can_id
        self._open: dict[Register, _Check] = {}
        self._wrote_s = -math.inf
        self._awaited_writes = 0

    @property
    def is_open(self) -> bool:
        """Whether any register is still to be verified."""
        return bool(self._open)

    def is_verified(self, register: Register) -> bool:
        """Whether a register is as known."""
        return register not in self._open

    def is_in_doubt(self, register: Register) -> bool:
        """Whether a register may hold something else than is known."""
        check = self._open.get(register)
        return check is not None and bool(check.claims)

    @property
    def doubts_ranges(self) -> bool:
        """Whether any range of the frames' fields may be another than is known."""
        return any(self.is_in_doubt(register) for register in _RANGES)

    @property
    def has_written(self) -> bool:
        """Whether the watchdog was set since all was begun to be read."""
        return self._wrote_s > -math.inf

    def reset(self) -> None:
        """Forget what is to be verified: other code reads all of it again."""
        self._open.clear()

    def begin(self) -> None:
        """Read all again; answers to what was asked before count no longer."""
        self._wrote_s = -math.inf
        for register in VERIFIED:
            check = self._open.setdefault(register, _Check())
            check.is_asked, check.asked_s = False, -math.inf

    def note_request(self, request: Answer, known: MotorIdentity) -> None:
        """Take another program's write request, which the motor may or may not have heard."""
        self.begin()
        register = _BY_NUMBER.get(request.number)
        if register is None or request.is_save or request.raw == raw_of(known, register):
            return
        self._open[register].claims.add(request.raw)

    def note_written(self, answer: Answer, can_id: int, known: MotorIdentity) -> MotorIdentity:
        """Take the motor's answer to another program's write; return what is known from now on.

        A range is taken at once, where it can be used, and so is the id that the answer came on;
        what was known before stays possible until the register is verified.
        """
        self.note_request(answer, known)
        register = _BY_NUMBER.get(answer.number)
        if register is None or not self.is_in_doubt(register) or answer.is_save:
            return known
        value = register.decode(answer.raw)
        is_certain = register is MASTER_ID and value == can_id
        if not is_certain and not (register in _RANGES and is_usable_range(float(value))):
            return known
        claims = self._open[register].claims
        claims.add(raw_of(known, register))
        claims.discard(answer.raw)
        return changed(known, register, answer.raw)

    def is_own_write(self, answer: Answer) -> bool:
        """Tell whether a write answer is the awaited one to a write of this verifier."""
        if self._awaited_writes == 0 or answer.number != TIMEOUT.number or answer.is_save:
            return False
        self._awaited_writes -= 1
        return True

    def take(self, answer: Answer, can_id: int, known: MotorIdentity) -> MotorIdentity | None:
        """Take an answer to a read that came on `can_id`; return what is known from now on.

        None for one that is not awaited.
        """
        register = _BY_NUMBER.get(answer.number)
        check = None if register is None else self._open.get(register)
        if register is None or check is None or not check.is_asked or answer.is_write:
            return None
        value = register.decode(answer.raw)
        if can_id != (value if register is MASTER_ID else known.master_id):
            return None
        check.is_asked, check.asked_s = False, -math.inf
        if answer.raw != raw_of(known, register) and answer.raw not in check.claims:
            check.claims.add(answer.raw)
            return known
        del self._open[register]
        if register is TIMEOUT:
            self._awaited_writes = 0
        return changed(known, register, answer.raw)

    def step(
        self, now_s: float, known: MotorIdentity, most: int, *, sets_watchdog: bool
    ) -> list[CanFrame]:
        """Return the requests that are due, at most so many; those in doubt come first.

        Where it `sets_watchdog`, a watchdog that is off, or too long, is set and read again.
        """
        frames: list[CanFrame] = []
        if sets_watchdog and self._must_set_watchdog(now_s, known):
            self._wrote_s = now_s
            self._awaited_writes += 1
            self._open[TIMEOUT] = _Check({TIMEOUT.encode(_WATCHDOG_UNITS)})
            frames.append(write_request(self._can_id, TIMEOUT, _WATCHDOG_UNITS))
        in_order = sorted(self._open, key=lambda reg: (not self._open[reg].claims, _rank(reg)))
        for register in in_order:
            check = self._open[register]
            if len(frames) < most and now_s - check.asked_s >= ANSWER_WITHIN_S:
                check.is_asked, check.asked_s = True, now_s
                frames.append(read_request(self._can_id, register))
        return frames

    def widest(self, ranges: Ranges) -> Ranges:
        """Return the largest ranges of velocity and torque that the motor may have."""
        return replace(
            ranges,
            velocity_rad_s=self._largest(VMAX, ranges.velocity_rad_s),
            torque_nm=self._largest(TMAX, ranges.torque_nm),
        )

    def _largest(self, register: Register, known: float) -> float:
        check = self._open.get(register)
        if check is None or not check.claims:
            return known
        claimed = (float(register.decode(raw)) for raw in check.claims)
        return max(known, *(value for value in claimed if is_usable_range(value)), known)

    def _must_set_watchdog(self, now_s: float, known: MotorIdentity) -> bool:
        is_due = now_s - self._wrote_s >= ANSWER_WITHIN_S
        return is_due and self.is_verified(TIMEOUT) and not is_watchdog_on(known)


def is_watchdog_on(known: MotorIdentity) -> bool:
    """Whether the motor disarms itself soon enough when nobody commands it."""
    return 0.0 < known.timeout_s <= LONGEST_WATCHDOG_S


def raw_of(known: MotorIdentity, register: Register) -> bytes:
    """Return the four bytes that a register holds, as far as is known."""
    if register in _RANGES:
        return register.encode(getattr(known.ranges, _RANGES[register]))
    values: dict[Register, float] = {
        TIMEOUT: round(known.timeout_s / TIMEOUT_UNIT_S),
        CONTROL_MODE: known.control_mode,
        MASTER_ID: known.master_id,
        CAN_ID: known.registers.get(CAN_ID.name) or known.can_id,
    }
    return register.encode(values[register])


def changed(known: MotorIdentity, register: Register, raw: bytes) -> MotorIdentity:
    """Return what is known once a register holds `raw`; the same object where that is nothing new.

    The motor goes on being commanded by the id that it answers to, whatever its ESC_ID says.
    """
    if raw == raw_of(known, register):
        return known
    value = register.decode(raw)
    known = replace(known, registers={**known.registers, register.name: value})
    if register in _RANGES:
        return replace(known, ranges=replace(known.ranges, **{_RANGES[register]: float(value)}))
    if register is TIMEOUT:
        return replace(known, timeout_s=value * TIMEOUT_UNIT_S)
    if register is CONTROL_MODE:
        return replace(known, control_mode=int(value))
    return replace(known, master_id=int(value)) if register is MASTER_ID else known


def _rank(register: Register) -> int:
    return VERIFIED.index(register)
