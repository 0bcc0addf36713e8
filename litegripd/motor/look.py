"""Reading what the motor tells about itself, without energising it."""

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import MotorIdentity, Ranges
from litegripd.motor.registers import (
    CAN_ID,
    CONTROL_MODE,
    ESSENTIAL,
    MASTER_ID,
    MIT_MODE,
    PMAX,
    READ_AT_START,
    REGISTERS,
    TIMEOUT,
    TIMEOUT_UNIT_S,
    TMAX,
    VMAX,
    Answer,
    Register,
    read_request,
)

ANSWER_WITHIN_S = 0.02
TRIES_PER_REGISTER = 3

LONGEST_WATCHDOG_S = 0.4
"""The longest that motors are known to come with. A longer one counts as off: nobody waits that
long for jaws that press."""

SMALLEST_RANGE, LARGEST_RANGE = 0.1, 1000.0
"""rad, rad/s, N·m: far beyond any motor of this kind, at either end."""

MODEL_RANGES = Ranges()
"""What a DM4310 leaves the factory with."""


class Look:
    """Reads the registers of `READ_AT_START` one after the other, each a few times.

    The first is MST_ID, whose answer comes on the very id that it names: so it is also the way
    to find that id. A register that only informs is left out when it is not answered; one that
    is essential is asked for until two answers on end are the same: a disturbed one must neither
    scale every later frame wrongly nor rule the motor out.
    """

    def __init__(self, can_id: int) -> None:
        self._can_id = can_id
        self._values: dict[Register, float | int | None] = {}
        self._first: bytes | None = None
        """The awaited register's latest answer, as long as it is not confirmed."""
        self._is_asked = False
        self._tries = 0
        self._asked_at_s = float("-inf")

    @property
    def awaited(self) -> Register | None:
        """The register whose answer is awaited, None when all have been asked for."""
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
        """Take an answer that came on `can_id`; tell whether it was the awaited one.

        Another process's read request has the shape of an answer of zero, but not its id.
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
        if register in ESSENTIAL and answer.raw != self._first:
            self._first = answer.raw
            return True
        self._values[register] = value
        self._first = None
        self._tries = 0
        return True

    def identity(self) -> MotorIdentity | None:
        """Return what was read, once all has been asked for."""
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
    """Whether frames can be decoded with the motor's ranges: finite and of no absurd size."""
    ranges = identity.ranges
    return all(map(is_usable_range, (ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm)))


def is_usable_range(limit: float) -> bool:
    """Whether a range is finite and of no absurd size."""
    return SMALLEST_RANGE <= limit <= LARGEST_RANGE


def unsuitable(identity: MotorIdentity, configured_master_id: int | None) -> Refusal | None:
    """Say why a motor must not be enabled, if its registers forbid it."""
    refusal = uncontrollable(identity)
    if refusal is not None:
        return refusal
    if configured_master_id not in (None, identity.master_id):
        return Refusal(
            "motor_unsuitable",
            f"the motor answers on 0x{identity.master_id:02X} (register MST_ID), but"
            f" [motor] master_id is 0x{configured_master_id:02X}: correct one of them",
            {"register": "MST_ID", "value": identity.master_id},
        )
    listens_to = identity.registers.get(CAN_ID.name)
    if listens_to not in (None, identity.can_id):
        return Refusal(
            "motor_unsuitable",
            f"the motor's register ESC_ID holds {listens_to}, but [motor] can_id is"
            f" 0x{identity.can_id:02X}: correct one of them",
            {"register": "ESC_ID", "value": listens_to},
        )
    return None


def uncontrollable(identity: MotorIdentity) -> Refusal | None:
    """Say why a motor cannot be commanded, if so: one that is enabled must be disabled then."""
    if identity.master_id == identity.can_id:
        return Refusal(
            "motor_unsuitable",
            f"the motor answers on 0x{identity.can_id:02X}, the id of its own commands (registers"
            " MST_ID and ESC_ID are equal), so answers and commands collide on the bus: set MST_ID"
            " to another id, 0x18 for instance, with the maker's tool; then motor.clear_fault"
            " reads it again",
            {"register": "MST_ID", "value": identity.master_id, "hint": "motor.clear_fault"},
        )
    if identity.control_mode != MIT_MODE:
        return Refusal(
            "motor_unsuitable",
            f"the motor is in control mode {identity.control_mode} (register CTRL_MODE); set it"
            f" to {MIT_MODE}, MIT, with the maker's tool; then motor.clear_fault reads it again",
            {"register": "CTRL_MODE", "value": identity.control_mode, "hint": "motor.clear_fault"},
        )
    if not has_usable_ranges(identity):
        ranges = identity.ranges
        limits = (ranges.position_rad, ranges.velocity_rad_s, ranges.torque_nm)
        return Refusal(
            "motor_unsuitable",
            f"the motor's ranges PMAX, VMAX, TMAX are {limits}: set them with the"
            " maker's tool; then motor.clear_fault reads them again",
            {"register": "PMAX", "hint": "motor.clear_fault"},
        )
    return None


def warnings(identity: MotorIdentity) -> list[str]:
    """Say what is unusual about a motor that can be used all the same."""
    found = []
    if identity.ranges != MODEL_RANGES:
        read, usual = identity.ranges, MODEL_RANGES
        found.append(
            f"the motor's ranges are ±{read.position_rad:g} rad, ±{read.velocity_rad_s:g} rad/s,"
            f" ±{read.torque_nm:g} N·m instead of ±{usual.position_rad:g},"
            f" ±{usual.velocity_rad_s:g}, ±{usual.torque_nm:g}; the motor's own are used"
        )
    if not 0.0 < identity.timeout_s <= LONGEST_WATCHDOG_S:
        found.append(
            f"the motor's watchdog (register TIMEOUT) is {identity.timeout_s:g} s, 0 meaning off;"
            " it is set before enabling"
        )
    return found


def _known(values: dict[int, float | int | None], register: Register) -> float | int:
    value = values[register.number]
    if value is None:
        raise ValueError(f"register {register.name} was not answered")
    return value
