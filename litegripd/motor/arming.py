"""One enabling of the motor: its watchdog first, then a fault cleared, then armed and confirmed.

Before the first enable frame the motor has answered one with zero gains, and one goes just before
each: a command that arrived while the motor was disabled is stored and applied by enable at once,
and a jump on enable is the commonest complaint about such grippers.
"""

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import EnableMotor, Feedback, MotorIdentity, is_fault
from litegripd.motor import codec
from litegripd.motor.faults import SILENT, fault_refusal
from litegripd.motor.look import ANSWER_WITHIN_S, LONGEST_WATCHDOG_S
from litegripd.motor.phases import Phase
from litegripd.motor.registers import (
    TIMEOUT,
    TIMEOUT_UNIT_S,
    Answer,
    read_request,
    status_request,
    write_request,
)

WATCHDOG_S = 0.1
"""Written (not saved) where the motor's own watchdog is off: it is the last line when the daemon
itself dies."""

_WATCHDOG_UNITS = round(WATCHDOG_S / TIMEOUT_UNIT_S)
_LONGEST_UNITS = round(LONGEST_WATCHDOG_S / TIMEOUT_UNIT_S)
_PREPARE_WITHIN_S = 0.2
_NO_WATCHDOG = Refusal(
    "motor_unsuitable",
    "the motor's watchdog (register TIMEOUT) is off, or longer than 0.4 s, and could not be"
    " set, so the motor would keep pushing if the daemon died: set it with the maker's tool",
    {"register": "TIMEOUT"},
)


class Arming:
    """Gives the frames of one enabling, and keeps its attempts and its failure."""

    def __init__(self, identity: MotorIdentity, request: EnableMotor, now_s: float) -> None:
        self.tries = 0
        self.failure: Refusal | None = None
        self.is_prepared = False
        self._watchdog_units: int | None = None
        self._identity = identity
        self._request = request
        self._began_s = now_s
        self._next_try_s = now_s
        self._next_request_s = now_s
        self._outstanding = 1  # a status request may be under way
        self._until_zero: int | None = None

    @property
    def has_stored_zero(self) -> bool:
        """Whether the motor has answered a zero-gain frame since the last other frame.

        Only then may it be enabled: what it has stored is what enable applies. Answers look all
        alike, so those to earlier frames are counted out; a lost one costs a frame more.
        """
        return self._until_zero is not None and self._until_zero <= 0

    def note_answer(self) -> None:
        """Count one feedback frame."""
        self._outstanding = max(self._outstanding - 1, 0)
        if self._until_zero is not None:
            self._until_zero -= 1

    def take(self, answer: Answer) -> bool:
        """Take a register answer; the watchdog counts as set once reading it says so.

        It is read before every enabling: a power cycle undoes what was written, and may have
        gone unnoticed.
        """
        if self.is_prepared or answer.number != TIMEOUT.number or answer.is_write:
            return False
        if self._watchdog_units is None:
            self._next_request_s = self._began_s  # no need to wait before writing
        self._watchdog_units = int(TIMEOUT.decode(answer.raw))
        self.is_prepared = 0 < self._watchdog_units <= _LONGEST_UNITS
        return True

    def step(
        self, now_s: float, phase: Phase, feedback: Feedback | None, *, is_silent: bool
    ) -> list[CanFrame]:
        """Return the frames of this tick; `failure` is set when the attempts are used up.

        A silent motor gets status requests alone: an enable frame that lay in a queue would arm
        it when nobody expects that any more.
        """
        if phase is Phase.PREPARING:
            return self._prepare(now_s)
        clearing = phase is Phase.CLEARING
        frames = self._clear(now_s, feedback) if clearing else self._arm(now_s, feedback)
        return self._probe() if is_silent and self.failure is None else frames

    def _prepare(self, now_s: float) -> list[CanFrame]:
        if now_s - self._began_s > _PREPARE_WITHIN_S:
            self.failure = SILENT if self._watchdog_units is None else _NO_WATCHDOG
            return []
        if now_s < self._next_request_s:
            return []
        self._next_request_s = now_s + ANSWER_WITHIN_S
        can_id = self._identity.can_id
        if self._watchdog_units is None:
            return [read_request(can_id, TIMEOUT)]
        return [write_request(can_id, TIMEOUT, _WATCHDOG_UNITS), read_request(can_id, TIMEOUT)]

    def _probe(self) -> list[CanFrame]:
        """Ask for the status; the answer is not one to a zero-gain frame."""
        self._outstanding += 1
        if self._until_zero is not None:
            self._until_zero += 1
        return [status_request(self._identity.can_id)]

    def _clear(self, now_s: float, feedback: Feedback | None) -> list[CanFrame]:
        """Clear a fault, where there is one; the frame's answer tells whether that worked."""
        faulty = feedback is not None and is_fault(feedback.status)
        if now_s - self._began_s > self._request.tries * self._request.interval_s:
            silent = self._not_confirmed() if self.tries else SILENT
            self.failure = fault_refusal(feedback) if feedback and faulty else silent
            return []
        if faulty:
            self._outstanding += 1
            self._until_zero = None
            return [CanFrame(self._identity.can_id, codec.CLEAR_FAULT)]
        return [self._zero_gains(feedback)]

    def _arm(self, now_s: float, feedback: Feedback | None) -> list[CanFrame]:
        frames = [self._zero_gains(feedback)]
        if now_s >= self._next_try_s:
            if self.tries >= self._request.tries:
                self.failure = self._not_confirmed()
                return []
            self.tries += 1
            self._next_try_s = now_s + self._request.interval_s
            frames.append(CanFrame(self._identity.can_id, codec.ENABLE))
        return frames

    def _not_confirmed(self) -> Refusal:
        return Refusal(
            "not_confirmed",
            f"the motor did not confirm that it is enabled, after {self.tries} tries:"
            " check the CAN wiring",
            {"tries": self.tries},
        )

    def _zero_gains(self, feedback: Feedback | None) -> CanFrame:
        if self._until_zero is None:
            self._until_zero = self._outstanding + 1
        self._outstanding += 1
        position_rad = 0.0 if feedback is None else feedback.position_rad
        data = codec.encode_zero_gains(position_rad, self._identity.ranges)
        return CanFrame(self._identity.can_id, data)
