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
    MitCommand,
    MotorOrder,
    MotorPhase,
    MotorRequest,
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
from litegripd.motor.phases import ARMING_PHASES, PUBLIC, TRANSITIONS, Event, Phase
from litegripd.motor.plausibility import BRAKE_KD_NM_S_RAD, Plausibility
from litegripd.motor.reading import READABLE, Reading
from litegripd.motor.registers import Answer, parse_answer
from litegripd.motor.silence import DISABLE_GIVES_UP_S, REPEATED_COMMANDS, Silence
from litegripd.motor.traffic import MotorCounters, Traffic
from litegripd.motor.unfaulting import Unfaulting
from litegripd.motor.zeroing import NOT_DISABLED, UNDER_WAY, Zeroing

_FASTEST_SHARE = 0.99  # of the range of speeds: beyond it, a code may stand for more
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
        self._unfaulting: Unfaulting | None = None
        self._plausibility = Plausibility()
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
        if self._plausibility.refusal is not None and self._phase is Phase.ENABLED:
            self._go(Event.IMPLAUSIBLE, now_s)
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
            foreign_commands=self.counters.foreign_commands,
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
        if order.request is not None:
            self._begin(order.request, now_s)
        frames = self._step(now_s, order)
        if frames:
            self._asked_s = now_s
        return frames + self._reading.step(now_s, order.register, self._phase)

    def _begin(self, request: MotorRequest, now_s: float) -> None:
        if isinstance(request, EnableMotor):
            self._begin_enable(request, now_s)
        elif isinstance(request, DisableMotor):
            self._failure = None
            self._go(Event.DISABLE, now_s)
        elif isinstance(request, SetZero):
            self._begin_zero(now_s)
        else:
            self._begin_clear(now_s)

    def _step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        if self._phase is Phase.ENABLED and order.command is not None:
            return self._command(order.command, order.is_motion)
        if self._phase in ARMING_PHASES:
            return self._arm(now_s)
        if self._phase is Phase.UNFAULTING:
            return self._unfault(now_s)
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
            self._take_feedback(codec.decode_feedback(frame.data, ranges, self._asked_s))
        else:
            self.counters.ignored_frames += 1

    def _take_feedback(self, feedback: Feedback) -> None:
        """Keep it, unless its position cannot be true: nothing is to be derived from that."""
        if self._arming is not None:
            self._arming.note_answer()
        if self._phase is Phase.ENABLED and not self._plausibility.accepts(
            feedback, _FASTEST_SHARE * self._identification.ranges.velocity_rad_s
        ):
            self.counters.implausible_frames += 1
            self._silence.unanswered = 0
            return
        self._feedback = feedback
        self._fresh = True

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
        self._plausibility.begin()
        self._silence.begin_phase(event)
        if following is Phase.LOOKING:
            self._identification.begin()
            self._feedback = None
        if following not in ARMING_PHASES:
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
        reading = STILL_READ if self._phase is Phase.LOOKING else None
        return self._plausibility.refusal or reading or self._identification.problem()

    def _fault(self) -> Refusal | None:
        is_faulty = self._phase in (Phase.FAULT, Phase.UNFAULTING)
        feedback = self._feedback if is_faulty else None
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

    def _begin_clear(self, now_s: float) -> None:
        """Accept the position as it is, and clear what the motor has latched, if anything."""
        self._failure = None
        self._plausibility.reset()
        self._unfaulting = Unfaulting(self._can_id, now_s)
        self._go(Event.CLEAR, now_s)

    def _unfault(self, now_s: float) -> list[CanFrame]:
        if self._unfaulting is None or self._unfaulting.has_failed(now_s):
            self._failure = self._fault()
            self._go(Event.STAYED, now_s)
            return []
        return self._unfaulting.step(now_s)

    def _command(self, command: MitCommand, is_motion: bool) -> list[CanFrame]:
        """Give the command; while the position is in doubt only brake, which needs none."""
        if self._plausibility.in_a_row:
            command = MitCommand(command.position_rad, 0.0, 0.0, BRAKE_KD_NM_S_RAD, 0.0)
            self._traffic.forget_command()
        return self._traffic.command(command, is_motion, self._identification.ranges)

    def _arm(self, now_s: float) -> list[CanFrame]:
        arming = self._arming
        if arming is None:
            return []
        if self._phase is Phase.PREPARING and arming.is_prepared:
            self._go(Event.PREPARED, now_s)
        if self._phase is not Phase.PREPARING:
            self._silence.unanswered += 1
        is_silent = self._silence.unanswered > REPEATED_COMMANDS
        frames = arming.step(now_s, self._phase, self._feedback, is_silent=is_silent)
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
