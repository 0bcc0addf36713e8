"""One motor: takes frames, keeps its phase, and returns the frames to send in each tick.

Pure: time is an argument, frames are values. What the controller wants comes in as a `MotorInput`;
what is known goes out as a `MotorView`. Nothing in here decides to energise the motor.
"""

from collections.abc import Iterable

from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motor import (
    CanFrame,
    DisableMotor,
    EnableMotor,
    Feedback,
    MitCommand,
    MotorIdentity,
    MotorInput,
    MotorPhase,
    MotorRequest,
    MotorView,
    RegisterWrite,
    SetZero,
    Status,
    ZeroView,
    is_fault,
)
from litegripd.model.plain import Carried
from litegripd.motor import codec
from litegripd.motor.codec import (
    MASTER_ID,
    PMAX,
    READABLE,
    VERIFIED,
    Answer,
    RegisterReader,
    described,
    parse_answer,
    parse_write_request,
)
from litegripd.motor.exchange import (
    DISABLE_GIVES_UP_S,
    USUAL_PERIOD_S,
    MotorCounters,
    Plausibility,
    Silence,
    Standstill,
    StatusJudge,
    Traffic,
)
from litegripd.motor.identity import STILL_READ, Identification
from litegripd.motor.phases import (
    ARMING_PHASES,
    FAULTY,
    PUBLIC,
    RESTING,
    SILENT,
    STILL_ENABLED,
    TRANSITIONS,
    Event,
    Phase,
    fault_refusal,
)
from litegripd.motor.procedures import NOT_DISABLED, UNDER_WAY, Arming, FaultClearing, Zeroing

_JUDGED = frozenset({*ARMING_PHASES, Phase.ENABLED, Phase.LOST})
"""The phases in which the daemon holds the position, or is about to. In the others every report
of the motor counts at once, above all that it is enabled."""
_UNUSED = frozenset({Phase.LOOKING, Phase.DISABLED, Phase.DISABLING, Phase.FAULT})
"""The phases in which a motor may be at rest. A status of `RESTING` is a fault in all others."""
_FASTEST_SHARE = 0.99  # share of the range of speeds: beyond it, a code may stand for more
_HELD = frozenset({Phase.ENABLED, Phase.LOST})
"""The phases in which one single report of "not enabled" is ignored."""
DOUBT_GIVES_UP_S = 0.5
"""How long an enabled motor's ranges may be in doubt; they are read in every tick."""
DISABLE_CONFIRM_AFTER_S = 0.01  # earlier answers may still be on their way when disable is sent


class Motor:
    """The motor `can_id`; it answers on the id in its register MST_ID, or on `master_id`."""

    _identification: Carried[Identification]
    _phase: Carried[Phase] = Phase.LOOKING
    _entered_s: Carried[float] = 0.0
    _zeroing: Carried[Zeroing]
    _plausibility: Carried[Plausibility]
    _feedback: Carried[Feedback | None] = None
    _asked_s: Carried[float] = 0.0
    _silence: Carried[Silence]
    _traffic: Carried[Traffic]
    _standstill: Carried[Standstill]
    _stood_still_s: Carried[float | None] = None
    """How long the daemon sent nothing before the present fault, if it stood still."""
    _tries: Carried[int] = 0
    _failure: Carried[Refusal | None] = None
    _is_used: Carried[bool] = False
    """True from the enabling until a report of "disabled", or a request to disable: a fault in
    between, or found after a silence in between, has taken something away."""
    NOT_CARRIED = (
        "counters",
        "_arming",
        "_can_id",
        "_certain_s",
        "_foreign_requests",
        "_foreign_write",
        "_fresh",
        "_register_reader",
        "_status",
        "_fault_clearing",
        "_last_known",  # a motor is handed over only while it answers
    )

    def __init__(
        self,
        can_id: int,
        master_id: int | None = None,
        period_s: float = USUAL_PERIOD_S,
        motor_type: MotorType = DM4310,
    ) -> None:
        self.counters = MotorCounters()
        self._can_id = can_id
        self._identification = Identification(can_id, master_id, motor_type)
        self._arming: Arming | None = None
        self._zeroing = Zeroing(can_id, motor_type.ranges, 0.0)
        self._register_reader = RegisterReader(can_id)
        self._plausibility = Plausibility(period_s, motor_type)
        self._status = StatusJudge()
        self._fresh = False
        self._silence = Silence(period_s)
        self._traffic = Traffic(can_id, self._silence, self.counters)
        self._foreign_write: RegisterWrite | None = None
        self._foreign_requests: set[int] = set()
        """The registers that others asked to write, until the motor has answered."""
        self._certain_s = 0.0
        """When the motor's ranges were last certain."""
        self._standstill = Standstill(period_s)
        self._fault_clearing: FaultClearing | None = None
        self._last_known: Feedback | None = None

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
            latched=self._latched(),
            last_known=self._last_known,
            register=self._register_reader.reply,
            zero=self._zeroing.view,
            foreign_commands=self.counters.foreign_commands,
            foreign_write=self._foreign_write,
        )

    @property
    def phase(self) -> Phase:
        """The phase, in finer steps than the view's."""
        return self._phase

    @property
    def says_enabled(self) -> bool:
        """True if its latest status was "enabled"; reading it needs no known ranges."""
        return self._feedback is not None and self._feedback.status == Status.ENABLED

    @property
    def unanswered(self) -> int:
        """How many requests have gone out since the last answer."""
        return self._silence.unanswered

    @property
    def is_verifying(self) -> bool:
        """True if registers are being read again."""
        return self._identification.verifier.is_open

    def receive(self, now_s: float, frames: Iterable[CanFrame]) -> None:
        """Take the frames that came since the last tick; call it once per tick, before `step`."""
        for frame in frames:
            self._receive(frame)
        identity = self._identification.identity
        self._standstill.tick(now_s, 0.0 if identity is None else identity.timeout_s)
        self._watch_registers(now_s)
        if self._plausibility.refusal is not None and self._phase is Phase.ENABLED:
            self._go(Event.IMPLAUSIBLE, now_s)
        if self._fresh:
            self._fresh = False
            silence, is_enabled = self._silence, self.says_enabled
            if silence.ends_with_report(self._phase, now_s, is_enabled=is_enabled):
                self._take_status(now_s)
        elif self._phase is Phase.ENABLED and self._silence.unanswered:
            self.counters.missed_replies += 1
        in_phase_s = now_s - self._entered_s
        silent_s = in_phase_s if self._feedback is None else now_s - self._feedback.at_s
        event = self._silence.event(self._phase, in_phase_s, silent_s)
        if event is not None:
            self._go(event, now_s)
        elif self._silence.is_total(self._phase):
            self._identification.expect_another()

    def note_bus(self, *, is_usable: bool) -> None:
        """Take the state of the bus; call it after `receive`."""
        self._silence.note_bus(self._phase, is_usable=is_usable)

    def step(self, now_s: float, wanted: MotorInput) -> list[CanFrame]:
        """Do what the controller wants, and return the frames to send, in their order."""
        if wanted.request is not None:
            self._begin(wanted.request, now_s)
        frames = self._step(now_s, wanted)
        if frames:
            self._asked_s = now_s
        reads = self._register_reader.step(now_s, wanted.register, self._phase)
        known, is_enabled = self._identification, self._phase is Phase.ENABLED
        if not reads and known.identity is not None and self._phase in READABLE:
            most = 1 if is_enabled else len(VERIFIED)  # one frame beside a command
            reads = known.verifier.step(now_s, known.identity, most, sets_watchdog=is_enabled)
        return frames + reads

    # Frames that come

    def _receive(self, frame: CanFrame) -> None:
        if self._register_reader.find(frame):
            return
        answer = parse_answer(frame.data, self._can_id)
        request = parse_write_request(frame, self._can_id)
        if frame.can_id == self._can_id and not self._is_on_own_id(frame, answer):
            self.counters.foreign_commands += 1
        elif request is not None:
            self.counters.foreign_commands += 1
            self._foreign_write = described(request)
            self._foreign_requests.add(request.number)
            self._identification.note_request(request)
        elif answer is not None and answer.is_write:
            self.counters.ignored_frames += not self._take_written(answer, frame.can_id)
        elif answer is not None:
            self.counters.ignored_frames += not self._take_answer(answer, frame.can_id)
        elif frame.can_id == self._identification.master_id and codec.is_from_motor(
            frame.data, self._can_id
        ):
            ranges = self._identification.ranges
            self._take_feedback(codec.decode_feedback(frame.data, ranges, self._asked_s))
        else:
            self.counters.ignored_frames += 1

    def _is_on_own_id(self, frame: CanFrame, answer: Answer | None) -> bool:
        """Return True if a frame on the motor's own id is an answer of the motor, not a command.

        With MST_ID = ESC_ID all answers come there, and any answer may before the registers are
        read. Otherwise it is an answer whose id was damaged on the way. Read as a command, it would
        lead the jaws to where no jaw can be.
        """
        if answer is not None and answer.number == MASTER_ID.number:
            return MASTER_ID.decode(answer.raw) == self._can_id
        if self._identification.master_id not in (None, self._can_id):
            own = self._can_id & 0xF
            return frame.data[:1] in (bytes([own]), bytes([Status.ENABLED << 4 | own]))
        return answer is not None or codec.is_from_motor(frame.data, self._can_id)

    def _take_written(self, answer: Answer, can_id: int) -> bool:
        """Take the motor's answer to a write; if this daemon sent none, another program did."""
        known = self._identification
        is_moved = answer.number == MASTER_ID.number and MASTER_ID.decode(answer.raw) == can_id
        if can_id != known.master_id and not (is_moved and not answer.is_save):
            return False
        if known.verifier.is_own_write(answer):
            return True
        if answer.number not in self._foreign_requests:  # else the request has been counted
            self.counters.foreign_commands += 1
        self._foreign_requests.discard(answer.number)
        self._foreign_write = described(answer)
        before = known.identity
        known.note_written(answer, can_id)
        self._note_changed(before)
        return True

    def _note_changed(self, before: MotorIdentity | None) -> None:
        """Forget what was coded in outdated ranges, unless a hold depends on it."""
        now = self._identification.identity
        if before is None or now is None or now.ranges == before.ranges:
            return
        self._traffic.forget_command()
        if (
            self._phase is not Phase.ENABLED
            and now.ranges.position_rad != before.ranges.position_rad
        ):
            self._feedback, self._fresh = None, False
            self._plausibility.believe(None)

    def _watch_registers(self, now_s: float) -> None:
        """Disable a motor that no longer obeys commands, or whose ranges stay unknown."""
        if not self._identification.verifier.doubts_ranges:
            self._certain_s = now_s
        is_unknown = now_s - self._certain_s >= DOUBT_GIVES_UP_S
        if self._phase is Phase.ENABLED and (self._identification.is_uncontrollable or is_unknown):
            self._go(Event.DISABLE, now_s)

    def _take_feedback(self, feedback: Feedback) -> None:
        """Keep the feedback unless its position is in doubt: nothing may be derived from that."""
        if self._arming is not None:
            self._arming.note_answer()
        is_doubted = self._phase in _HELD and not self._status.accepts(feedback)
        if is_doubted or self._has_no_scale(feedback):
            self.counters.implausible_frames += is_doubted
            self._fresh = self._fresh and self._phase is not Phase.LOST  # "enabled" may be older
            self._silence.unanswered = 0
            return
        if self._phase not in _JUDGED:
            self._plausibility.believe(feedback)
        elif not self._plausibility.accepts(
            feedback,
            _FASTEST_SHARE * self._identification.ranges.velocity_rad_s,
            is_driven=self._traffic.is_driven,
        ):
            self.counters.implausible_frames += 1
            self._silence.unanswered = 0
            return
        self._feedback = feedback
        self._fresh = True

    def _has_no_scale(self, feedback: Feedback) -> bool:
        """Return True if the scale of its position is unknown, by another program's write."""
        is_used = self._phase in _JUDGED or self._zeroing.is_pending
        is_enabled = feedback.status == Status.ENABLED or self._zeroing.is_pending
        return is_used and is_enabled and self._identification.verifier.is_in_doubt(PMAX)

    def _take_answer(self, answer: Answer, can_id: int) -> bool:
        """Pass a register answer to the reader that awaits it; it is never feedback."""
        known = self._identification
        if self._phase is not Phase.LOOKING:
            before = known.identity
            is_awaited = known.verify(answer, can_id)
            self._note_changed(before)
            is_read = self._phase in READABLE and can_id == known.master_id
            return (is_read and self._register_reader.take(answer)) or is_awaited
        if not known.take(answer, can_id):
            return False
        self._silence.unanswered = 0
        self._traffic.poll_soon()  # ask for the status, too: it may be enabled
        self._note_identity()
        return True

    def _note_identity(self) -> None:
        if self._identification.finish():  # earlier feedback may have been coded in other ranges
            self._feedback, self._fresh = None, False
            self._plausibility.believe(None)

    def _take_status(self, now_s: float) -> None:
        feedback = self._feedback
        if feedback is None or self._identification.identity is None:
            return
        if self._phase is Phase.DISABLING and now_s < self._entered_s + DISABLE_CONFIRM_AFTER_S:
            return
        if feedback.status == Status.ENABLED:
            self._standstill.note_enabled(now_s)
            self._go(Event.SAW_ENABLED, now_s)
        elif is_fault(feedback.status) and not self._is_at_rest(feedback.status):
            if self._phase not in FAULTY:
                self._stood_still_s = self._standstill.before(now_s)
            self._go(Event.SAW_FAULT, now_s)
        elif self._arming is None or self._arming.has_stored_zero:
            if is_fault(feedback.status):
                self._zeroing.leave()
            self._zeroing.take(feedback, now_s)
            self._go(Event.SAW_DISABLED, now_s)

    def _is_at_rest(self, status: int) -> bool:
        """Return True if a fault is one that the motor takes by itself while nobody uses it."""
        return status in RESTING and self._phase in _UNUSED and not self._is_used

    def _go(self, event: Event, now_s: float) -> None:
        following = TRANSITIONS.get((self._phase, event))
        if following is None:
            return
        if self._phase is Phase.ENABLED:
            self._traffic.forget_command()
        if self._phase is Phase.LOST and following is Phase.ENABLED:
            self._identification.verifier.begin()  # writes during the silence went unnoticed
        self._status.reset()
        if following is Phase.ENABLED:
            self._is_used = True
        elif event is Event.SAW_DISABLED or following is Phase.DISABLING:
            self._is_used = False
        if following is not Phase.CLEARING_FAULT:
            self._fault_clearing = None
        self._phase = following
        self._entered_s = now_s
        self._silence.begin_phase(event)
        if following is Phase.LOOKING:
            if self._feedback is not None and self._identification.usable_ranges:
                self._last_known = self._feedback
            self._identification.begin()
            self._feedback = None
            self._plausibility.believe(None)
        if following not in ARMING_PHASES:
            self._arming = None
        self._zeroing.leave()

    # Frames that go out

    def _begin(self, request: MotorRequest, now_s: float) -> None:
        if isinstance(request, EnableMotor):
            self._failure = UNDER_WAY if self._zeroing.is_pending else self._problem()
            self._tries = 0
            if self._failure is None and self._phase in (Phase.DISABLED, Phase.FAULT):
                self._identification.verifier.begin()
                self._arming = Arming(self._identification, request, now_s)
                self._go(Event.ENABLE, now_s)
        elif isinstance(request, DisableMotor):
            self._failure = None
            self._go(Event.DISABLE, now_s)
        elif isinstance(request, SetZero):
            if not self._zeroing.is_pending:
                is_disabled = self._phase is Phase.DISABLED and self._latched() is None
                refusal = (
                    self._problem() or self._fault() or (None if is_disabled else NOT_DISABLED)
                )
                view = ZeroView("pending" if refusal is None else "failed", failure=refusal)
                self._zeroing = Zeroing(self._can_id, self._identification.ranges, now_s, view)
        else:  # accept the present position, and clear the fault that the motor has latched, if any
            self._failure = None
            self._plausibility.reset()
            if self._identification.problem() is not None:
                self._go(Event.SCAN, now_s)  # somebody may have corrected its registers
            if self._phase is Phase.FAULT or self._latched() is not None:
                self._fault_clearing = FaultClearing(self._can_id, now_s)
            self._go(Event.CLEAR, now_s)

    def _step(self, now_s: float, wanted: MotorInput) -> list[CanFrame]:
        if self._phase is Phase.ENABLED and wanted.command is not None:
            return self._command(wanted.command, wanted.is_motion)
        if self._phase in ARMING_PHASES:
            return self._arm(now_s)
        if self._phase is Phase.CLEARING_FAULT:
            return self._clear_fault(now_s)
        if self._phase is Phase.DISABLING:
            return self._disable(now_s)
        if self._phase is Phase.LOST:
            return self._traffic.probe(now_s)
        if self._zeroing.is_pending:
            return self._zeroing.step(now_s)
        if self._phase is Phase.DISABLED and self._fault_clearing is not None:
            return self._clear_at_rest(now_s, self._fault_clearing)
        if self._phase is Phase.LOOKING:
            return self._traffic.poll(now_s) + self._scan_again(now_s)
        return self._unstore() + self._traffic.poll(now_s)

    def _public_phase(self) -> MotorPhase:
        is_silent = self._silence.is_total(self._phase)
        return MotorPhase.SILENT if is_silent else PUBLIC[self._phase]

    def _problem(self) -> Refusal | None:
        """Return why the motor could not be enabled now, or None."""
        if self._public_phase() is MotorPhase.SILENT:
            return SILENT
        reading = STILL_READ if self._phase is Phase.LOOKING else None
        if self._identification.verifier.doubts_ranges:
            reading = STILL_READ
        return self._plausibility.refusal or reading or self._identification.problem()

    def _fault(self) -> Refusal | None:
        feedback = self._feedback if self._phase in FAULTY else None
        return None if feedback is None else fault_refusal(feedback.status, self._stood_still_s)

    def _latched(self) -> int | None:
        """Return the status of `RESTING` that a motor at rest reports, or None."""
        feedback = self._feedback if self._phase is Phase.DISABLED else None
        return None if feedback is None or not is_fault(feedback.status) else feedback.status

    def _clear_fault(self, now_s: float) -> list[CanFrame]:
        if self._fault_clearing is None or self._fault_clearing.has_failed(now_s):
            self._failure = self._fault()
            self._go(Event.STAYED, now_s)
            return []
        return self._fault_clearing.step(now_s)

    def _clear_at_rest(self, now_s: float, clearing: FaultClearing) -> list[CanFrame]:
        """Clear what a motor at rest has latched; it stays disabled all the while."""
        feedback = self._feedback
        is_cleared = feedback is None or self._latched() is None
        if is_cleared or clearing.has_failed(now_s):
            self._fault_clearing = None
            if feedback is not None and not is_cleared:
                self._failure = fault_refusal(feedback.status)
            return self._traffic.poll(now_s)
        return clearing.step(now_s)

    def _command(self, command: MitCommand, is_motion: bool) -> list[CanFrame]:
        """Return the command; while the position is in doubt, only the damping of a stiff one.

        A command that is only a force is sent as it is: otherwise a disturbed frame would drop what
        it holds.
        """
        has_no_scale = self._identification.verifier.is_in_doubt(PMAX)
        if (self._plausibility.in_a_row or has_no_scale) and command.kp_nm_rad:
            damping = min(command.kd_nm_s_rad, self._plausibility.brake_kd_nm_s_rad)
            command = MitCommand(command.position_rad, 0.0, 0.0, damping, 0.0)
            self._traffic.forget_command()
        return self._traffic.command(command, is_motion, self._identification.ranges_to_send)

    def _arm(self, now_s: float) -> list[CanFrame]:
        arming = self._arming
        if arming is None:
            return []
        if self._phase is Phase.PREPARING and arming.is_prepared:
            self._go(Event.PREPARED, now_s)
        if self._phase is not Phase.PREPARING:
            self._silence.unanswered += 1
        is_silent = self._silence.unanswered > self._silence.repeats
        if not is_silent and not self._silence.may_repeat:
            return []
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
        return [*self._unstore(), CanFrame(self._can_id, codec.DISABLE)]

    def _unstore(self) -> list[CanFrame]:
        feedback = self._feedback
        if not self._traffic.is_stored or feedback is None:
            return []
        if self._identification.problem() is not None:
            return []
        return self._traffic.unstore(feedback.position_rad, self._identification.ranges)

    def _scan_again(self, now_s: float) -> list[CanFrame]:
        """Read registers; disable a motor at once that turns out to be enabled."""
        frames = self._identification.step(now_s)
        if self._identification.identity is None:
            self._note_identity()
        if self._feedback is not None and self._feedback.status == Status.ENABLED:
            frames.append(CanFrame(self._can_id, codec.DISABLE))
        return frames
