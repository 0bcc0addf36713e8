"""One enabling of the motor: its registers first, then a fault cleared, then armed and confirmed.

The registers that decide how the motor must be commanded are read before every enabling. A power
cycle undoes what was written, another program may have written, and either may have gone unnoticed.

The motor must answer a command with zero gains before the first enable frame, and one such command
goes just before each enable frame. The motor stores a command that comes while it is disabled, and
applies it as soon as it is enabled. A jump on enable is the commonest complaint about such
grippers.

`FaultClearing` clears a latched fault without enabling. It repeats the request until the motor
reports that the fault is gone. Clearing disarms, so it energises nothing. A fault whose cause lasts
comes back at once.
"""

from litegripd.model.bus import CanFrame
from litegripd.model.errors import Refusal
from litegripd.model.motor import EnableMotor, Feedback, is_fault
from litegripd.motor import codec
from litegripd.motor.faults import SILENT, fault_refusal
from litegripd.motor.identity import Identification, is_watchdog_on
from litegripd.motor.phases import Phase
from litegripd.motor.registers import VERIFIED, status_request

RETRY_S = 0.02
GIVES_UP_S = 0.25


class FaultClearing:
    """One clearing of a fault, from its request to its end."""

    def __init__(self, can_id: int, now_s: float) -> None:
        self._can_id = can_id
        self._began_s = now_s
        self._next_try_s = now_s

    def has_failed(self, now_s: float) -> bool:
        """Return True if the fault has lasted for so long that it will not go away."""
        return now_s - self._began_s >= GIVES_UP_S

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the frame that is due, if any; the motor answers it with its status."""
        if now_s < self._next_try_s:
            return []
        self._next_try_s = now_s + RETRY_S
        return [CanFrame(self._can_id, codec.CLEAR_FAULT)]


_PREPARE_WITHIN_S = 0.4
"""Time for twenty tries of each register. With half of the frames lost each way, 98 % succeed."""
_NO_WATCHDOG = Refusal(
    "motor_unsuitable",
    "the motor's watchdog (register TIMEOUT) is off, or longer than 0.4 s, and could not be"
    " set, so the motor would keep pushing if the daemon died: set it with the maker's tool",
    {"register": "TIMEOUT"},
)


_WRITTEN = Refusal(
    "second_master",
    "another program wrote the motor's registers while it was being enabled: end that program,"
    " then enable again",
)


class Arming:
    """Builds the frames of one enabling, and keeps the number of tries and the failure."""

    def __init__(self, known: Identification, request: EnableMotor, now_s: float) -> None:
        self.tries = 0
        self.failure: Refusal | None = None
        self._known = known
        self._can_id = known.can_id
        self._request = request
        self._began_s = now_s
        self._next_try_s = now_s
        self._outstanding = 1  # a status request may be unanswered
        self._until_zero: int | None = None

    @property
    def has_stored_zero(self) -> bool:
        """True if the motor has answered a zero-gain frame since the last other frame.

        The motor may be enabled only then, because it applies the command that it has stored. All
        answers look alike, so answers to earlier frames are counted out. A lost answer costs one
        more frame.
        """
        return self._until_zero is not None and self._until_zero <= 0

    def note_answer(self) -> None:
        """Count one feedback frame."""
        self._outstanding = max(self._outstanding - 1, 0)
        if self._until_zero is not None:
            self._until_zero -= 1

    @property
    def is_prepared(self) -> bool:
        """True if all registers are verified, and the motor may be enabled with them."""
        identity = self._known.identity
        if self._known.verifier.is_open or identity is None:
            return False
        return is_watchdog_on(identity) and self._known.problem() is None

    def step(
        self, now_s: float, phase: Phase, feedback: Feedback | None, *, is_silent: bool
    ) -> list[CanFrame]:
        """Return the frames of this tick; set `failure` when all tries are used up.

        A silent motor gets only status requests. An enable frame that lay in a queue would arm it
        at a time when nobody expects it.
        """
        if phase is Phase.PREPARING:
            return self._prepare(now_s)
        if self._known.verifier.is_open:
            self.failure = _WRITTEN
            return []
        clearing = phase is Phase.CLEARING
        frames = self._clear(now_s, feedback) if clearing else self._arm(now_s, feedback)
        return self._probe() if is_silent and self.failure is None else frames

    def _prepare(self, now_s: float) -> list[CanFrame]:
        """Read all registers at once, and set the watchdog if it is off."""
        identity, verifier = self._known.identity, self._known.verifier
        if identity is None:
            return []
        if not verifier.is_open:
            self.failure = self._known.problem()
        if self.failure is None and now_s - self._began_s > _PREPARE_WITHIN_S:
            is_off = verifier.has_written and not is_watchdog_on(identity)
            self.failure = _NO_WATCHDOG if is_off else SILENT
        if self.failure is not None:
            return []
        return verifier.step(now_s, identity, len(VERIFIED), sets_watchdog=True)

    def _probe(self) -> list[CanFrame]:
        """Ask for the status; the answer does not count as one to a zero-gain frame."""
        self._outstanding += 1
        if self._until_zero is not None:
            self._until_zero += 1
        return [status_request(self._can_id)]

    def _clear(self, now_s: float, feedback: Feedback | None) -> list[CanFrame]:
        """Clear a fault, if there is one; the motor's answer shows whether that worked."""
        faulty = feedback is not None and is_fault(feedback.status)
        if now_s - self._began_s > self._request.tries * self._request.interval_s:
            silent = self._not_confirmed() if self.tries else SILENT
            self.failure = fault_refusal(feedback) if feedback and faulty else silent
            return []
        if faulty:
            self._outstanding += 1
            self._until_zero = None
            return [CanFrame(self._can_id, codec.CLEAR_FAULT)]
        return [self._zero_gains(feedback)]

    def _arm(self, now_s: float, feedback: Feedback | None) -> list[CanFrame]:
        frames = [self._zero_gains(feedback)]
        if now_s >= self._next_try_s:
            if self.tries >= self._request.tries:
                self.failure = self._not_confirmed()
                return []
            self.tries += 1
            self._next_try_s = now_s + self._request.interval_s
            frames.append(CanFrame(self._can_id, codec.ENABLE))
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
        data = codec.encode_zero_gains(position_rad, self._known.ranges)
        return CanFrame(self._can_id, data)
