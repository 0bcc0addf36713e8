"""One motor: takes frames, keeps its phase, and gives the frames to send in each tick.

Pure: time is an argument, frames are values. What the engine wants comes in as a `MotorOrder`;
what is known goes out as a `MotorView`. Nothing in here decides to energise the motor.
"""

from collections.abc import Iterable

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    Feedback,
    MotorOrder,
    MotorPhase,
    MotorView,
    Ranges,
    SetZero,
    Status,
    ZeroView,
    is_fault,
)
from litegripd.motor import codec
from litegripd.motor.arming import Arming
from litegripd.motor.faults import SILENT, STILL_ENABLED, fault_refusal
from litegripd.motor.identification import STILL_READ, Identification
from litegripd.motor.phases import PUBLIC, TRANSITIONS, Event, Phase
from litegripd.motor.reading import READABLE, Reading
from litegripd.motor.registers import Answer, parse_answer
from litegripd.motor.silence import DISABLE_GIVES_UP_S, Silence
from litegripd.motor.traffic import MotorCounters, Traffic
from litegripd.motor.zeroing import NOT_DISABLED, UNDER_WAY, Zeroing

DISABLE_CONFIRM_AFTER_S = 0.01  # older answers may have been under way when disable was sent


class Motor:
    """The motor `can_id`; its answers are found by register MST_ID, or must come on `master_id`."""

    def __init__(self, can_id: int, master_id: int | None = None) -> None:
        self.counters = MotorCounters()
        self._can_id = can_id
        self._identification = Identification(can_id, master_id)
        self._phase = Phase.LOOKING
        self._entered_s = 0.0
        self._arming: Arming | None = None
        self._zeroing = Zeroing(can_id, Ranges(), 0.0)
        self._reading = Reading(can_id)
        self._feedback: Feedback | None = None
        self._fresh = False
        self._asked_s = 0.0
        self._silence = Silence()
        self._traffic = Traffic(can_id, self._silence, self.counters)
        self._tries = 0
        self._failure: Refusal | None = None

    def receive(self, now_s: float, frames: Iterable[CanFrame]) -> None:
        """Take what came over the bus since the last tick; call it once per tick, before `step`."""
        for frame in frames:
            self._receive(frame)
        if self._fresh:
            self._fresh = False
            self._silence.unanswered = 0
            self._take_status(now_s)
        elif self._phase is Phase.ENABLED and self._silence.unanswered:
            self.counters.missed_replies += 1
        self._watch_silence(now_s)

    def view(self) -> MotorView:
        """Return what is known now."""
        return MotorView(
            phase=self._public_phase(),
            feedback=self._feedback if self._identification.usable_ranges else None,
            identity=self._identification.identity,
            enable_tries=self._tries,
            problem=self._problem(),
            failure=self._failure,
            fault=self._fault(),
            register=self._reading.reply,
            zero=self._zeroing.view,
        )

    @property
    def phase(self) -> Phase:
        """The phase, finer than that of the view."""
        return self._phase

    @property
    def unanswered(self) -> int:
        """How many requests have gone out since the last answer."""
        return self._silence.unanswered

    def step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        """Do what the engine wants and return the frames to send, in their order."""
        frames = self._step(now_s, order)
        if frames:
            self._asked_s = now_s
        return frames + self._reading.step(now_s, order.register, self._phase)

    def _step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        if isinstance(order.request, EnableMotor):
            self._begin_enable(order.request, now_s)
        elif isinstance(order.request, DisableMotor):
            self._failure = None
            self._go(Event.DISABLE, now_s)
        elif isinstance(order.request, SetZero):
            self._begin_zero(now_s)
        if self._phase is Phase.ENABLED and order.command is not None:
            ranges = self._identification.ranges
            return self._traffic.command(order.command, order.is_motion, ranges)
        if self._phase in (Phase.PREPARING, Phase.CLEARING, Phase.ARMING):
            return self._arm(now_s)
        if self._phase is Phase.DISABLING:
            return self._disable(now_s)
        if self._phase is Phase.LOST:
            return self._traffic.probe(now_s)
        if self._zeroing.is_pending:
            return self._zeroing.step(now_s)
        looks = self._phase is Phase.LOOKING
        return self._traffic.poll(now_s) + (self._look_again(now_s) if looks else [])

    def _receive(self, frame: CanFrame) -> None:
        if frame.can_id == self._can_id:
            self.counters.foreign_commands += 1
            return
        answer = parse_answer(frame.data, self._can_id)
        if answer is not None:
            self.counters.ignored_frames += not self._take_answer(answer, frame.can_id)
        elif self._is_feedback(frame):
            ranges = self._identification.ranges
            self._feedback = codec.decode_feedback(frame.data, ranges, self._asked_s)
            self._fresh = True
            if self._arming is not None:
                self._arming.note_answer()
        else:
            self.counters.ignored_frames += 1

    def _take_answer(self, answer: Answer, can_id: int) -> bool:
        """Give a register answer to whoever awaits it; one that nobody awaits is never feedback."""
        known = self._identification
        if self._arming is not None:
            return can_id == known.master_id and self._arming.take(answer)
        if self._phase in READABLE:
            return can_id == known.master_id and self._reading.take(answer)
        if self._phase is not Phase.LOOKING or not known.take(answer, can_id):
            return False
        self._silence.unanswered = 0
        self._traffic.poll_soon()  # ask for the status, too: it may be enabled
        self._note_identity()
        return True

    def _is_feedback(self, frame: CanFrame) -> bool:
        is_ours = frame.can_id == self._identification.master_id
        return is_ours and codec.is_from_motor(frame.data, self._can_id)

    def _note_identity(self) -> None:
        if self._identification.finish():  # what came before may have been coded in other ranges
            self._feedback = None
            self._fresh = False

    def _take_status(self, now_s: float) -> None:
        feedback = self._feedback
        if feedback is None or self._identification.identity is None:
            return
        if self._phase is Phase.DISABLING and now_s < self._entered_s + DISABLE_CONFIRM_AFTER_S:
            return
        if feedback.status == Status.ENABLED:
            self._go(Event.SAW_ENABLED, now_s)
        elif is_fault(feedback.status):
            self._go(Event.SAW_FAULT, now_s)
        elif self._arming is None or self._arming.has_stored_zero:
            self._zeroing.take(feedback, now_s)
            self._go(Event.SAW_DISABLED, now_s)

    def _go(self, event: Event, now_s: float) -> None:
        following = TRANSITIONS.get((self._phase, event))
        if following is None:
            return
        if self._phase is Phase.ENABLED:
            self._traffic.forget_command()
        self._phase = following
        self._entered_s = now_s
        self._silence.begin_phase(event)
        if following is Phase.LOOKING:
            self._identification.begin()
            self._feedback = None
        if following not in (Phase.PREPARING, Phase.CLEARING, Phase.ARMING):
            self._arming = None
        self._zeroing.leave()

    def _watch_silence(self, now_s: float) -> None:
        in_phase_s = now_s - self._entered_s
        silent_s = in_phase_s if self._feedback is None else now_s - self._feedback.at_s
        event = self._silence.event(self._phase, in_phase_s, silent_s)
        if event is not None:
            self._go(event, now_s)
        elif self._silence.is_total(self._phase):
            self._identification.expect_another()

    def _public_phase(self) -> MotorPhase:
        is_silent = self._silence.is_total(self._phase)
        return MotorPhase.SILENT if is_silent else PUBLIC[self._phase]

    def _problem(self) -> Refusal | None:
        """Say why the motor could not be enabled now."""
        if self._public_phase() is MotorPhase.SILENT:
            return SILENT
        return STILL_READ if self._phase is Phase.LOOKING else self._identification.problem()

    def _fault(self) -> Refusal | None:
        feedback = self._feedback if self._phase is Phase.FAULT else None
        return None if feedback is None else fault_refusal(feedback)

    def _begin_enable(self, request: EnableMotor, now_s: float) -> None:
        self._failure = UNDER_WAY if self._zeroing.is_pending else self._problem()
        self._tries = 0
        is_off = self._phase in (Phase.DISABLED, Phase.FAULT)
        identity = self._identification.identity
        if identity is None or self._failure is not None or not is_off:
            return
        self._arming = Arming(identity, request, now_s)
        self._go(Event.ENABLE, now_s)

    def _begin_zero(self, now_s: float) -> None:
        if self._zeroing.is_pending:
            return
        is_disabled = self._phase is Phase.DISABLED
        refusal = self._problem() or self._fault() or (None if is_disabled else NOT_DISABLED)
        view = ZeroView("pending" if refusal is None else "failed", failure=refusal)
        self._zeroing = Zeroing(self._can_id, self._identification.ranges, now_s, view)

    def _arm(self, now_s: float) -> list[CanFrame]:
        arming = self._arming
        if arming is None:
            return []
        if self._phase is Phase.PREPARING and arming.is_prepared:
            self._go(Event.PREPARED, now_s)
        frames = arming.step(now_s, self._phase, self._feedback)
        self._tries = arming.tries
        if arming.failure is not None:
            self._failure = arming.failure
            self._go(Event.GAVE_UP, now_s)
            return self._disable(now_s)
        return frames

    def _disable(self, now_s: float) -> list[CanFrame]:
        if self._failure is None and now_s - self._entered_s >= DISABLE_GIVES_UP_S:
            self._failure = STILL_ENABLED
        return [CanFrame(self._can_id, codec.DISABLE)]

    def _look_again(self, now_s: float) -> list[CanFrame]:
        """Read registers; a motor that is found enabled is disabled at once, whoever enabled it."""
        frames = self._identification.step(now_s)
        if self._identification.identity is None:
            self._note_identity()
        if self._feedback is not None and self._feedback.status == Status.ENABLED:
            frames.append(CanFrame(self._can_id, codec.DISABLE))
        return frames
