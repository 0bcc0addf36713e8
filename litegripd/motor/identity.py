"""What the motor is: read from its registers at the start, after a silence, and when in doubt.

Nothing here energises the motor. `RegisterScan` reads all that the motor reports about itself.
`Identification` keeps the finished identity and what follows from it: the id of the motor's
answers, the ranges of its frames, and why the motor cannot be used.

`Verifier` reads the registers again that decide how the motor must be commanded, in any phase. They
may change unnoticed: another program writes them, or a power cycle restores what was not saved. A
register counts as verified once an answer equals its known value, or a value claimed before. Claims
come from another program's write, from the motor's answer to that write, and from an earlier answer
that differed. So one disturbed frame changes nothing for good. Until then every claimed value is
possible. A torque is coded so that none of them makes it larger than wanted.
"""

import math
from dataclasses import dataclass, field, replace

from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, MOTOR_TYPES, MotorType
from litegripd.model.motor import SOONEST_DISARM_S, CanFrame, MotorIdentity, Ranges
from litegripd.model.plain import Carried
from litegripd.model.sentence import method_name, sentence
from litegripd.motor.codec import (
    ANSWER_WITHIN_S,
    CAN_ID,
    CONTROL_MODE,
    ESSENTIAL,
    GEAR_RATIO,
    HARDWARE_VERSION,
    MASTER_ID,
    MIT_MODE,
    PMAX,
    READ_AT_START,
    REGISTERS,
    SOFTWARE_VERSION,
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

TRIES_PER_REGISTER = 3

LONGEST_WATCHDOG_S = 0.4
"""The longest time that register TIMEOUT of a delivered motor was found to hold. A longer one
counts as off: nobody waits that long for jaws that press. What the motor does with it is another
matter (`LATEST_DISARM_S`), on which nothing here depends."""

SMALLEST_RANGE, LARGEST_RANGE = 0.1, 1000.0
"""In rad, rad/s, N·m. Both ends are far beyond any motor of this kind."""

RATIO_WITHIN = 0.05
"""Two ratios that differ by up to this share are the same. Two types differ by far more."""


class RegisterScan:
    """Reads the registers of `READ_AT_START` one after the other, each a few times.

    The first is MST_ID. Its answer comes on the id that it holds, so this read also finds that id.
    A register that only informs is left out when it is not answered. An essential one is read until
    two answers in a row are equal: a disturbed answer must neither give every later frame a wrong
    scale nor reject the motor. The same holds for a gear ratio that is not the type's.
    """

    def __init__(self, can_id: int, motor_type: MotorType = DM4310) -> None:
        self._can_id = can_id
        self._motor_type = motor_type
        self._values: dict[Register, float | int | None] = {}
        self._first: bytes | None = None
        """The latest answer for the awaited register, until a second one confirms it."""
        self._is_asked = False
        self._tries = 0
        self._asked_at_s = float("-inf")

    @property
    def awaited(self) -> Register | None:
        """The register whose answer is awaited; None when all have been read."""
        return next((reg for reg in READ_AT_START if reg not in self._values), None)

    @property
    def master_id(self) -> int | None:
        """The id on which the motor answers, once it is known."""
        value = self._values.get(MASTER_ID)
        return None if value is None else int(value)

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the request that is due, if any."""
        register = self.awaited
        if register is None or now_s - self._asked_at_s < ANSWER_WITHIN_S:
            return []
        if self._tries >= TRIES_PER_REGISTER and register not in ESSENTIAL:
            self._values[register] = None
            self._tries = 0
            return self.step(now_s)
        self._tries += 1
        self._is_asked = True
        self._asked_at_s = now_s
        return [read_request(self._can_id, register)]

    def take(self, answer: Answer, can_id: int) -> bool:
        """Take an answer that came on `can_id`; return True if it was the awaited one.

        Another process's read request looks like an answer of zero, but has another id.
        """
        register = self.awaited
        is_wrong = answer.is_write or register is None or answer.number != register.number
        if register is None or is_wrong or not self._is_asked:  # a doubled frame confirms nothing
            return False
        value = register.decode(answer.raw)
        if can_id != (value if register is MASTER_ID else self.master_id):
            return False
        self._is_asked = False
        self._asked_at_s = float("-inf")
        is_odd = register is GEAR_RATIO and not _has_ratio(self._motor_type, value)
        if (register in ESSENTIAL or is_odd) and answer.raw != self._first:
            self._first = answer.raw
            return True
        self._values[register] = value
        self._first = None
        self._tries = 0
        return True

    def identity(self) -> MotorIdentity | None:
        """Return the identity, once all registers have been read."""
        if self.awaited is not None:
            return None
        values = {register.number: value for register, value in self._values.items()}
        return MotorIdentity(
            can_id=self._can_id,
            master_id=int(_known(values, MASTER_ID)),
            ranges=Ranges(_known(values, PMAX), _known(values, VMAX), _known(values, TMAX)),
            timeout_s=_known(values, TIMEOUT) * TIMEOUT_UNIT_S,
            control_mode=int(_known(values, CONTROL_MODE)),
            registers={REGISTERS[number].name: value for number, value in values.items()},
        )


def has_usable_ranges(identity: MotorIdentity) -> bool:
    """Return True if frames can be decoded with the motor's ranges."""
    ranges = identity.ranges
    return all(map(is_usable_range, (ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm)))


def is_usable_range(limit: float) -> bool:
    """Return True if a range is finite and of a sensible size."""
    return SMALLEST_RANGE <= limit <= LARGEST_RANGE


_CORRECT = sentence(
    "correct the configuration and start the daemon again; or correct the register with the maker's"
    " tool, then {motor.clear_fault} reads it again"
)
_AGAIN = method_name("motor.clear_fault")


def unsuitable(
    identity: MotorIdentity, configured_master_id: int | None, motor_type: MotorType = DM4310
) -> Refusal | None:
    """Return why the motor must not be enabled, or None."""
    refusal = uncontrollable(identity) or wrong_type(identity, motor_type)
    if refusal is not None:
        return refusal
    if configured_master_id not in (None, identity.master_id):
        return Refusal(
            "motor_unsuitable",
            sentence(
                "the motor answers on 0x{found:02X} (register MST_ID), but [motor] master_id is"
                " 0x{configured:02X}: {correct}",
                found=identity.master_id,
                configured=configured_master_id,
                correct=_CORRECT,
            ),
            {"register": "MST_ID", "value": identity.master_id, "hint": _AGAIN},
        )
    listens_to = identity.registers.get(CAN_ID.name)
    if listens_to not in (None, identity.can_id):
        return Refusal(
            "motor_unsuitable",
            sentence(
                "the motor's register ESC_ID holds {found}, but [motor] can_id is 0x{can_id:02X}:"
                " {correct}",
                found=listens_to,
                can_id=identity.can_id,
                correct=_CORRECT,
            ),
            {"register": "ESC_ID", "value": listens_to, "hint": _AGAIN},
        )
    return None


def uncontrollable(identity: MotorIdentity) -> Refusal | None:
    """Return why a motor cannot be commanded, or None; if so, an enabled one must be disabled."""
    if identity.master_id == identity.can_id:
        return Refusal(
            "motor_unsuitable",
            sentence(
                "the motor answers on 0x{can_id:02X}, the id of its own commands (registers MST_ID"
                " and ESC_ID are equal), so answers and commands collide on the bus: set MST_ID to"
                " another id, 0x18 for instance, with the maker's tool; then {motor.clear_fault}"
                " reads it again",
                can_id=identity.can_id,
            ),
            {"register": "MST_ID", "value": identity.master_id, "hint": _AGAIN},
        )
    if identity.control_mode != MIT_MODE:
        return Refusal(
            "motor_unsuitable",
            sentence(
                "the motor is in control mode {mode} (register CTRL_MODE); set it to {mit}, MIT,"
                " with the maker's tool; then {motor.clear_fault} reads it again",
                mode=identity.control_mode,
                mit=MIT_MODE,
            ),
            {"register": "CTRL_MODE", "value": identity.control_mode, "hint": _AGAIN},
        )
    if not has_usable_ranges(identity):
        ranges = identity.ranges
        limits = (ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm)
        return Refusal(
            "motor_unsuitable",
            sentence(
                "the motor's ranges PMAX, VMAX, TMAX are {limits}: set them with the maker's tool;"
                " then {motor.clear_fault} reads them again",
                limits=limits,
            ),
            {"register": "PMAX", "hint": _AGAIN},
        )
    return None


def wrong_type(identity: MotorIdentity, motor_type: MotorType) -> Refusal | None:
    """Return a refusal if the motor is not of the configured type.

    The gear ratio shows the type, and nobody can write it. Ranges show it, too, if they are another
    type's and not this one's: a motor may not answer the ratio, or may have been exchanged since.
    """
    ratio = identity.registers.get(GEAR_RATIO.name)
    by_ranges = [row.name for row in MOTOR_TYPES.values() if row.ranges == identity.ranges]
    has_ratio = ratio is None or _has_ratio(motor_type, ratio)
    if has_ratio and (not by_ranges or motor_type.name in by_ranges):
        return None
    register, value, fits = TMAX, identity.ranges.torque_nm, by_ranges
    if ratio is not None and not has_ratio:
        register, value = GEAR_RATIO, ratio
        fits = [row.name for row in MOTOR_TYPES.values() if _has_ratio(row, ratio)]
    other = f'set [motor] type = "{fits[0]}" and start the daemon again, or ' if fits else ""
    hardware, software = (
        identity.registers.get(version.name) for version in (HARDWARE_VERSION, SOFTWARE_VERSION)
    )
    return Refusal(
        "motor_unsuitable",
        sentence(
            "the motor is no {name}, the configured type: its Gr, PMAX, VMAX, TMAX are {found}"
            " (hw_ver {hardware}, sw_ver {software}), a {name} has {usual}: {other}connect a"
            " {name}; then {motor.clear_fault} reads it again",
            name=motor_type.name,
            found=_figures(ratio, identity.ranges),
            hardware=hardware,
            software=software,
            usual=_figures(motor_type.gear_ratio, motor_type.ranges),
            other=other,
        ),
        {
            "register": register.name,
            "value": value,
            "motor_type": motor_type.name,
            "fits": fits,
            "hint": _AGAIN,
        },
    )


def _has_ratio(motor_type: MotorType, ratio: float) -> bool:
    """Return True if a gear ratio may be the type's.

    A ratio that no gear has, for example 0 or a NaN, fits any type: a firmware that does not know
    its gear must not reject the motor. Then the ranges decide.
    """
    is_of_a_gear = math.isfinite(ratio) and ratio > 1.0
    return not is_of_a_gear or math.isclose(ratio, motor_type.gear_ratio, rel_tol=RATIO_WITHIN)


def _figures(ratio: float | None, ranges: Ranges) -> str:
    listed = (ratio, ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm)
    return ", ".join("unknown" if figure is None else f"{figure:g}" for figure in listed)


def warnings(identity: MotorIdentity, motor_type: MotorType = DM4310) -> list[str]:
    """Return what is unusual about a motor, usable or not."""
    found = []
    if (wrong := wrong_type(identity, motor_type)) is not None:
        found.append(wrong.message)
    elif identity.ranges != motor_type.ranges:
        read, usual = identity.ranges, motor_type.ranges
        found.append(
            f"the motor's ranges are ±{read.position_rad:g} rad, ±{read.velocity_rad_s:g} rad/s,"
            f" ±{read.torque_nm:g} N·m instead of ±{usual.position_rad:g},"
            f" ±{usual.velocity_rad_s:g}, ±{usual.torque_nm:g}; the motor's own are used"
        )
    if not 0.0 < identity.timeout_s <= LONGEST_WATCHDOG_S:
        found.append(
            f"the motor's register TIMEOUT, its watchdog, reads {identity.timeout_s:g} s, 0 meaning"
            " off; it is set before enabling"
        )
    return found


def _known(values: dict[int, float | int | None], register: Register) -> float | int:
    value = values[register.number]
    if value is None:
        raise ValueError(f"register {register.name} was not answered")
    return value


WATCHDOG_S = SOONEST_DISARM_S
"""Written (not saved) if the motor's own watchdog is off by its register. That watchdog is the last
protection when the daemon itself dies."""

WATCHDOG_UNITS = round(WATCHDOG_S / TIMEOUT_UNIT_S)
_RANGES = {PMAX: "position_rad", VMAX: "velocity_rad_s", TMAX: "torque_nm"}
_BY_NUMBER = {register.number: register for register in VERIFIED}


@dataclass(slots=True)
class _Check:
    """One register that is not verified yet."""

    claims: set[bytes] = field(default_factory=set)
    """The values that it may hold, beside the known one."""
    is_asked: bool = False
    asked_s: float = -math.inf


class Verifier:
    """Reads the registers of `VERIFIED` again, after each `begin`.

    It keeps no values: it takes what is known as a `MotorIdentity`, and returns another one if
    something has changed.
    """

    def __init__(self, can_id: int) -> None:
        self._can_id = can_id
        self._open: dict[Register, _Check] = {}
        self._wrote_s = -math.inf
        self._awaited_writes = 0

    @property
    def is_open(self) -> bool:
        """True if any register is still to be verified."""
        return bool(self._open)

    def is_in_doubt(self, register: Register) -> bool:
        """Return True if a register may hold another value than the known one."""
        check = self._open.get(register)
        return check is not None and bool(check.claims)

    @property
    def doubts_ranges(self) -> bool:
        """True if a range of the frames' fields may differ from the known one."""
        return bool(self._open) and any(map(self.is_in_doubt, _RANGES))

    @property
    def has_written(self) -> bool:
        """True if the watchdog was set since the latest `begin`."""
        return self._wrote_s > -math.inf

    def reset(self) -> None:
        """Forget what is to be verified, because other code reads all of it again."""
        self._open.clear()

    def begin(self) -> None:
        """Read all registers again; answers to earlier requests no longer count."""
        self._wrote_s = -math.inf
        for register in VERIFIED:
            check = self._open.setdefault(register, _Check())
            check.is_asked, check.asked_s = False, -math.inf

    def note_request(self, request: Answer, known: MotorIdentity) -> None:
        """Take another program's write request; the motor may or may not have received it."""
        self.begin()
        register = _BY_NUMBER.get(request.number)
        if register is None or request.is_save or request.raw == raw_of(known, register):
            return
        self._open[register].claims.add(request.raw)

    def note_written(self, answer: Answer, can_id: int, known: MotorIdentity) -> MotorIdentity:
        """Take the motor's answer to another program's write; return what is known from now on.

        A usable range counts at once, and so does the id on which the answer came. The former
        values stay possible until the register is verified.
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
        """Return True if a write answer is the awaited one to a write of this verifier."""
        if self._awaited_writes == 0 or answer.number != TIMEOUT.number or answer.is_save:
            return False
        self._awaited_writes -= 1
        return True

    def take(self, answer: Answer, can_id: int, known: MotorIdentity) -> MotorIdentity | None:
        """Take an answer to a read that came on `can_id`; return what is known from now on.

        Returns None if the answer was not awaited.
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
        """Return the requests that are due, at most `most`; registers in doubt come first.

        If `sets_watchdog` is True, a watchdog that is off or too long is set and read again.
        """
        frames: list[CanFrame] = []
        is_due = TIMEOUT not in self._open and now_s - self._wrote_s >= ANSWER_WITHIN_S
        if sets_watchdog and is_due and not is_watchdog_on(known):
            self._wrote_s = now_s
            self._awaited_writes += 1
            self._open[TIMEOUT] = _Check({TIMEOUT.encode(WATCHDOG_UNITS)})
            frames.append(write_request(self._can_id, TIMEOUT, WATCHDOG_UNITS))
        if not self._open:
            return frames
        in_order = sorted(
            self._open, key=lambda reg: (not self._open[reg].claims, VERIFIED.index(reg))
        )
        for register in in_order:
            check = self._open[register]
            if len(frames) < most and now_s - check.asked_s >= ANSWER_WITHIN_S:
                check.is_asked, check.asked_s = True, now_s
                frames.append(read_request(self._can_id, register))
        return frames

    def widest(self, ranges: Ranges) -> Ranges:
        """Return the largest velocity and torque ranges that the motor may have."""
        if not self._open:
            return ranges
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


def is_watchdog_on(known: MotorIdentity) -> bool:
    """Return True if the motor disarms itself by its register, and that is not set too late."""
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
    """Return what is known once a register holds `raw`; the same object if nothing is new.

    The motor is still commanded by the id that it answers to, whatever its ESC_ID says.
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


STILL_READ = Refusal("motor_silent", "the motor's registers are still being read: try again")


class Identification:
    """The identity of the motor `can_id`, as far as it is known."""

    identity: Carried[MotorIdentity | None] = None
    NOT_CARRIED = (
        "can_id",
        "motor_type",
        "verifier",
        "_configured_master_id",
        "_is_uncontrollable",
        "_judged",
        "_refusal",
        "_scan",
        "_usable",
    )

    def __init__(
        self, can_id: int, configured_master_id: int | None, motor_type: MotorType = DM4310
    ) -> None:
        self.verifier = Verifier(can_id)
        self.can_id = can_id
        self.motor_type = motor_type
        self._configured_master_id = configured_master_id
        self._judged: MotorIdentity | None = None
        """The motor of which the next three tell. It is judged once, and they are read in every
        tick."""
        self._usable: Ranges | None = None
        self._is_uncontrollable = False
        self._refusal: Refusal | None = STILL_READ
        self._scan = RegisterScan(can_id, motor_type)

    @property
    def master_id(self) -> int | None:
        """The id on which the motor answers, once it is known."""
        return self._scan.master_id if self.identity is None else self.identity.master_id

    @property
    def usable_ranges(self) -> Ranges | None:
        """The motor's own ranges; None while they are unknown, and if they make no sense."""
        if self.identity is not self._judged:
            self._judge()
        return self._usable

    @property
    def ranges(self) -> Ranges:
        """The ranges for decoding frames; the status does not depend on them."""
        return self.usable_ranges or self.motor_type.ranges

    @property
    def ranges_to_send(self) -> Ranges:
        """The ranges for coding commands: no possible range makes a torque larger than wanted."""
        usable = self.usable_ranges
        return self.motor_type.ranges if usable is None else self.verifier.widest(usable)

    def begin(self) -> None:
        """Forget everything and read all registers."""
        self._scan = RegisterScan(self.can_id, self.motor_type)
        self.identity = None
        self.verifier.reset()

    def expect_another(self) -> None:
        """Read the id of the answers again: another motor may replace a silent one."""
        if self._scan.master_id is not None:
            self._scan = RegisterScan(self.can_id, self.motor_type)

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the read request that is due, if any."""
        return self._scan.step(now_s)

    def take(self, answer: Answer, can_id: int) -> bool:
        """Take an answer that came on `can_id`; return True if it was the awaited one."""
        return self._scan.take(answer, can_id)

    def note_request(self, request: Answer) -> None:
        """Take another program's request to write registers, and verify all of them after it."""
        if self.identity is None:
            self.verifier.begin()  # what the scan has read already may be outdated
        else:
            self.verifier.note_request(request, self.identity)

    def note_written(self, answer: Answer, can_id: int) -> None:
        """Take the motor's answer to another program's write, which came on `can_id`."""
        if self.identity is None:
            self.verifier.begin()
        else:
            self.identity = self.verifier.note_written(answer, can_id, self.identity)

    def verify(self, answer: Answer, can_id: int) -> bool:
        """Take an answer to a read; return True if the verifier awaited it."""
        found = self.identity and self.verifier.take(answer, can_id, self.identity)
        self.identity = found or self.identity
        return found is not None

    def finish(self) -> bool:
        """Set the identity when all registers have been read; return True if it is known."""
        self.identity = self._scan.identity()
        return self.identity is not None

    def problem(self) -> Refusal | None:
        """Return why the motor cannot be used, or None; while it is unknown, that is the reason."""
        if self.identity is not self._judged:
            self._judge()
        return self._refusal

    @property
    def is_uncontrollable(self) -> bool:
        """True if the motor is known and cannot be commanded."""
        if self.identity is not self._judged:
            self._judge()
        return self._is_uncontrollable

    def _judge(self) -> None:
        identity = self._judged = self.identity
        self._usable, self._is_uncontrollable, self._refusal = None, False, STILL_READ
        if identity is not None:
            self._usable = identity.ranges if has_usable_ranges(identity) else None
            self._is_uncontrollable = uncontrollable(identity) is not None
            self._refusal = unsuitable(identity, self._configured_master_id, self.motor_type)
