"""What takes several exchanges with the motor: enabling it, and moving its zero."""

from litegripd.model.errors import Refusal
from litegripd.model.motor import CanFrame, EnableMotor, Feedback, Ranges, ZeroView, is_fault
from litegripd.model.plain import Carried
from litegripd.model.sentence import sentence
from litegripd.motor import codec
from litegripd.motor.codec import TIMEOUT_UNIT_S, VERIFIED, status_request
from litegripd.motor.identity import (
    WATCHDOG_S,
    WATCHDOG_UNITS,
    Identification,
    is_watchdog_on,
)
from litegripd.motor.phases import SILENT, Phase, fault_refusal

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


def no_watchdog(read_units: int) -> Refusal:
    """Return a refusal of a motor whose watchdog is off by its register, and cannot be set."""
    meaning = f"{read_units * TIMEOUT_UNIT_S:g} s" if read_units else "off"
    return Refusal(
        "motor_unsuitable",
        f"the motor's register TIMEOUT, its watchdog, reads {read_units} ({meaning}) after"
        f" {WATCHDOG_UNITS} ({WATCHDOG_S * 1e3:.0f} ms) was written, so the motor might keep"
        " pushing if the daemon died: set it with the maker's tool to 1 to 8000 (0.4 s), and save"
        " it; a motor whose register cannot be set is not enabled",
        {"register": "TIMEOUT", "value": read_units},
    )


_WRITTEN = Refusal(
    "second_master",
    sentence(
        "another program wrote the motor's registers while it was being enabled: end that program,"
        " then enable again ({motor.enable})"
    ),
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
            read_units = round(identity.timeout_s / TIMEOUT_UNIT_S)
            self.failure = no_watchdog(read_units) if is_off else SILENT
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
        """Clear a fault, if there is one; the motor's answer shows if that worked."""
        faulty = feedback is not None and is_fault(feedback.status)
        if now_s - self._began_s > self._request.tries * self._request.interval_s:
            silent = self._not_confirmed() if self.tries else SILENT
            self.failure = fault_refusal(feedback.status) if feedback and faulty else silent
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


ZERO_TRIES = 3
"""The most tries; fewer if answers are lost as well, because the time is limited to that of
three."""
ZERO_RETRY_S = 0.05
CONFIRM_AFTER_S = 0.01  # earlier answers may still be on their way when the frame is sent
ZERO_WITHIN_RAD = 0.01  # less than 1 mm
REST_S = 0.05
REST_WITHIN_RAD = 0.002
REST_GIVES_UP_S = 0.5  # springs have long relaxed by then: a hand moves the jaws
SILENT_AFTER_S = 0.05
NOISE_CODES = 4
"""Two measured positions of jaws at rest differ by less. In a wide range one code is much."""

NOT_DISABLED = Refusal(
    "not_confirmed", "the motor takes a new zero only while it is disabled: disable it first"
)
UNDER_WAY = Refusal("busy", "the motor's zero is being set: try again")
LEFT = "the motor did not stay disabled while its zero was being set"

_IDLE = ZeroView()
_MOVING = "the jaws do not rest, so the zero was not set: keep them still and try again"
_MOVED = "the jaws were moved while the zero was being set: keep them still and try again"
_UNCERTAIN = "; it may or may not be set: find out where the jaws are before they are moved"


class Zeroing:
    """One setting of the zero, from the request to its end; only a pending `view` acts."""

    view: Carried[ZeroView]
    NOT_CARRIED = (
        "_answered_s",
        "_before_rad",
        "_began_s",
        "_can_id",
        "_first_try_s",
        "_is_due",
        "_is_unchanged",
        "_last_try_s",
        "_position_rad",
        "_rest_rad",
        "_rest_within_rad",
        "_rests_since_s",
        "_tries",
        "_zero_within_rad",
    )  # they count only while it is pending

    def __init__(self, can_id: int, ranges: Ranges, now_s: float, view: ZeroView = _IDLE) -> None:
        self.view = view
        noise_rad = NOISE_CODES * 2.0 * ranges.position_rad / 65535
        self._zero_within_rad = max(ZERO_WITHIN_RAD, noise_rad)
        self._rest_within_rad = max(REST_WITHIN_RAD, noise_rad)
        self._can_id = can_id
        self._began_s = self._answered_s = now_s
        self._rest_rad = float("inf")
        self._rests_since_s = now_s
        self._position_rad = self._before_rad = 0.0
        self._is_due = False
        self._tries = 0
        self._first_try_s = self._last_try_s = now_s
        self._is_unchanged = False

    @property
    def is_pending(self) -> bool:
        """True if it has not ended."""
        return self.view.state == "pending"

    def take(self, feedback: Feedback, now_s: float) -> None:
        """Take feedback that reports "disabled"; call it before `step`."""
        if not self.is_pending:
            return
        self._answered_s = now_s
        self._position_rad = feedback.position_rad
        if self._tries == 0:  # it is due once the jaws have not moved for a while
            if abs(self._position_rad - self._rest_rad) > self._rest_within_rad:
                self._rest_rad, self._rests_since_s = self._position_rad, now_s
            self._is_due = now_s - self._rests_since_s >= REST_S
        elif now_s - self._last_try_s >= CONFIRM_AFTER_S:
            self._judge()
            self._is_due = now_s - self._last_try_s >= ZERO_RETRY_S

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the frames of this tick; the zero is set only right after an answer."""
        if self.is_pending:
            self._watch_time(now_s)
        if not self.is_pending:
            return []
        frames = [status_request(self._can_id)]
        if self._is_due:
            if self._tries == 0:
                self._before_rad = self._position_rad
                self._first_try_s = now_s
            self._tries += 1
            self._last_try_s = now_s
            self._is_due = self._is_unchanged = False
            self.view = ZeroView("pending", is_uncertain=True)
            frames.insert(0, CanFrame(self._can_id, codec.SET_ZERO))
        return frames

    def leave(self) -> None:
        """End it, because the motor is no longer disabled."""
        if self.is_pending:
            self._fail(LEFT)

    def _judge(self) -> None:
        """Judge by the position what became of the frame: taken, lost, or unknown."""
        shift_rad = self._before_rad - self._position_rad
        self._is_unchanged = False
        if abs(self._position_rad) <= self._zero_within_rad:
            self.view = ZeroView("done", shift_rad, self._position_rad)
        elif abs(shift_rad) <= self._zero_within_rad:
            self._is_unchanged = True
        else:
            self._fail(_MOVED)

    def _watch_time(self, now_s: float) -> None:
        is_silent = now_s - self._answered_s >= SILENT_AFTER_S
        if self._tries == 0 and now_s - self._began_s >= REST_GIVES_UP_S:
            if is_silent:
                self.view = ZeroView("failed", failure=SILENT)
            else:
                self._fail(_MOVING)
        elif self._tries and now_s - self._first_try_s >= ZERO_TRIES * ZERO_RETRY_S:
            says = "does not answer" if is_silent else f"says {self._position_rad:.3f} rad"
            self._fail(f"the motor did not confirm its new zero, it {says}: check the CAN wiring")

    def _fail(self, message: str) -> None:
        is_uncertain = self._tries > 0 and not self._is_unchanged
        refusal = Refusal(
            "not_confirmed",
            message + (_UNCERTAIN if is_uncertain else ""),
            {"tries": self._tries},
        )
        self.view = ZeroView("failed", failure=refusal, is_uncertain=is_uncertain)
