"""One motor: takes frames, keeps its phase, and gives the frames to send in each tick.

Pure: time is an argument, frames are values. What the engine wants comes in as a `MotorOrder`;
what is known goes out as a `MotorView`. Nothing in here decides to energise the motor.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    Feedback,
    MitCommand,
    MotorIdentity,
    MotorOrder,
    MotorPhase,
    MotorView,
    Ranges,
    Status,
    is_fault,
)
from litegripd.motor import codec
from litegripd.motor.arming import Arming
from litegripd.motor.faults import SILENT, fault_refusal
from litegripd.motor.look import Look, has_usable_ranges, unsuitable
from litegripd.motor.phases import PUBLIC, TRANSITIONS, Event, Phase
from litegripd.motor.registers import Answer, parse_answer, status_request

POLL_INTERVAL_S = 0.05  # 20 Hz keep the state of a disabled motor fresh
SILENT_AFTER_POLLS = 3
SILENT_AFTER_S = SILENT_AFTER_POLLS * POLL_INTERVAL_S
REPEATED_COMMANDS = 3
"""So many unanswered commands are repeated without feed-forward; then commands are withheld,
for frames queued for a dead bus are replayed when power returns."""
LOST_GIVES_UP_S = 1.0  # by then the motor's own watchdog has long disarmed it
DISABLE_CONFIRM_AFTER_S = 0.01  # older answers may have been under way when disable was sent
DISABLE_GIVES_UP_S = 0.5


@dataclass(slots=True)
class MotorCounters:
    """What went by since the start."""

    commands: int = 0
    missed_replies: int = 0
    withheld_commands: int = 0
    ignored_frames: int = 0
    foreign_commands: int = 0
    """Frames to our motor that somebody else on the bus sent."""


class Motor:
    """The motor `can_id`; its answers are found by register MST_ID, or must come on `master_id`."""

    def __init__(self, can_id: int, master_id: int | None = None) -> None:
        self.counters = MotorCounters()
        self._can_id = can_id
        self._configured_master_id = master_id
        self._phase = Phase.LOOKING
        self._entered_s = 0.0
        self._look = Look(can_id)
        self._arming: Arming | None = None
        self._identity: MotorIdentity | None = None
        self._feedback: Feedback | None = None
        self._fresh = False
        self._polled_at_s = float("-inf")
        self._asked_s = 0.0
        self._unanswered = 0
        self._last_command: MitCommand | None = None
        self._tries = 0
        self._failure: Refusal | None = None

    def receive(self, now_s: float, frames: Iterable[CanFrame]) -> None:
        """Take what came over the bus since the last tick; call it once per tick, before `step`."""
        for frame in frames:
            self._receive(frame)
        if self._fresh:
            self._fresh = False
            self._unanswered = 0
            self._take_status(now_s)
        elif self._phase is Phase.ENABLED and self._unanswered:
            self.counters.missed_replies += 1
        self._watch_silence(now_s)

    def view(self) -> MotorView:
        """Return what is known now."""
        return MotorView(
            phase=self._public_phase(),
            feedback=None if self._usable_ranges() is None else self._feedback,
            identity=self._identity,
            enable_tries=self._tries,
            problem=self._problem(),
            failure=self._failure,
            fault=self._fault(),
        )

    def step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        """Do what the engine wants and return the frames to send, in their order."""
        frames = self._step(now_s, order)
        if frames:
            self._asked_s = now_s
        return frames

    def _step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        if isinstance(order.request, EnableMotor):
            self._begin_enable(order.request, now_s)
        elif isinstance(order.request, DisableMotor):
            self._failure = None
            self._go(Event.DISABLE, now_s)
        if self._phase is Phase.ENABLED:
            return self._stream(order, now_s)
        if self._phase in (Phase.PREPARING, Phase.CLEARING, Phase.ARMING):
            return self._arm(now_s)
        if self._phase is Phase.DISABLING:
            return self._disable(now_s)
        return self._poll(now_s) + (self._look_again(now_s) if self._phase is Phase.LOOKING else [])

    def _receive(self, frame: CanFrame) -> None:
        if frame.can_id == self._can_id:
            self.counters.foreign_commands += 1
            return
        answer = parse_answer(frame.data, self._can_id)
        if answer is not None:
            self.counters.ignored_frames += not self._take_answer(answer, frame.can_id)
        elif frame.can_id == self._master_id() and codec.is_from_motor(frame.data, self._can_id):
            self._feedback = codec.decode_feedback(frame.data, self._ranges(), self._asked_s)
            self._fresh = True
            if self._arming is not None:
                self._arming.note_answer()
        else:
            self.counters.ignored_frames += 1

    def _take_answer(self, answer: Answer, can_id: int) -> bool:
        """Give a register answer to whoever awaits it; one that nobody awaits is never feedback."""
        if self._arming is not None:
            return can_id == self._master_id() and self._arming.take(answer)
        if self._phase is not Phase.LOOKING or not self._look.take(answer, can_id):
            return False
        self._unanswered = 0
        self._polled_at_s = float("-inf")  # ask for the status, too: it may be enabled
        self._note_identity()
        return True

    def _note_identity(self) -> None:
        self._identity = self._look.identity()
        if self._identity is not None:  # what came before may have been coded in other ranges
            self._feedback = None
            self._fresh = False

    def _master_id(self) -> int | None:
        return self._look.master_id if self._identity is None else self._identity.master_id

    def _usable_ranges(self) -> Ranges | None:
        identity = self._identity
        return identity.ranges if identity is not None and has_usable_ranges(identity) else None

    def _ranges(self) -> Ranges:
        """Return what frames are decoded with; the status does not depend on it."""
        return self._usable_ranges() or Ranges()

    def _take_status(self, now_s: float) -> None:
        if self._feedback is None or (self._phase is Phase.LOOKING and self._identity is None):
            return
        if self._phase is Phase.DISABLING and now_s < self._entered_s + DISABLE_CONFIRM_AFTER_S:
            return
        status = self._feedback.status
        if status == Status.ENABLED:
            self._go(Event.SAW_ENABLED, now_s)
        elif is_fault(status):
            self._go(Event.SAW_FAULT, now_s)
        elif self._arming is None or self._arming.has_stored_zero:
            self._go(Event.SAW_DISABLED, now_s)

    def _go(self, event: Event, now_s: float) -> None:
        following = TRANSITIONS.get((self._phase, event))
        if following is None:
            return
        if self._phase is Phase.ENABLED:
            self._last_command = None  # whoever is enabled next begins anew
        self._phase = following
        self._entered_s = now_s
        self._unanswered = 0
        if following is Phase.LOOKING:
            self._look = Look(self._can_id)
            self._identity = self._feedback = None
            if event in (Event.NO_ANSWER, Event.GAVE_UP):
                self._unanswered = SILENT_AFTER_POLLS + 1  # it is known to be silent
        if following not in (Phase.PREPARING, Phase.CLEARING, Phase.ARMING):
            self._arming = None

    def _watch_silence(self, now_s: float) -> None:
        """Notice that the motor does not answer, by the measure of each phase."""
        in_phase_s = now_s - self._entered_s
        if self._phase is Phase.LOST:
            if in_phase_s >= LOST_GIVES_UP_S:
                self._go(Event.GAVE_UP, now_s)
        elif self._phase is Phase.DISABLING:
            silent_s = in_phase_s if self._feedback is None else now_s - self._feedback.at_s
            if in_phase_s >= DISABLE_GIVES_UP_S and silent_s >= SILENT_AFTER_S:
                self._go(Event.NO_ANSWER, now_s)
        elif self._phase is Phase.LOOKING:
            if self._is_silent() and self._look.master_id is not None:
                self._look = Look(self._can_id)  # another motor may come in its place
        else:
            allowed = REPEATED_COMMANDS if self._phase is Phase.ENABLED else SILENT_AFTER_POLLS
            if self._unanswered > allowed:
                self._go(Event.NO_ANSWER, now_s)

    def _public_phase(self) -> MotorPhase:
        return MotorPhase.SILENT if self._is_silent() else PUBLIC[self._phase]

    def _is_silent(self) -> bool:
        return self._phase is Phase.LOOKING and self._unanswered > SILENT_AFTER_POLLS

    def _problem(self) -> Refusal | None:
        """Say why the motor could not be enabled now."""
        if self._public_phase() is MotorPhase.SILENT:
            return SILENT
        if self._identity is None or self._phase is Phase.LOOKING:
            return Refusal("motor_silent", "the motor's registers are still being read: try again")
        return unsuitable(self._identity, self._configured_master_id)

    def _fault(self) -> Refusal | None:
        feedback = self._feedback
        if self._phase is not Phase.FAULT or feedback is None:
            return None
        return fault_refusal(feedback)

    def _begin_enable(self, request: EnableMotor, now_s: float) -> None:
        self._failure = self._problem()
        self._tries = 0
        is_off = self._phase in (Phase.DISABLED, Phase.FAULT)
        if self._identity is None or self._failure is not None or not is_off:
            return
        self._arming = Arming(self._identity, request, now_s)
        self._go(Event.ENABLE, now_s)

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
            self._failure = Refusal(
                "not_confirmed", "the motor does not confirm that it is disabled: cut its power"
            )
        return [self._to_motor(codec.DISABLE)]

    def _stream(self, order: MotorOrder, now_s: float) -> list[CanFrame]:
        """Give one command; while answers fail, a motion's last one again, without feed-forward.

        What is no motion is what a stop has led to, or a hold: that goes out as it is.
        """
        command = order.command
        if command is None:
            return self._poll(now_s)
        if self._unanswered:
            last = self._last_command if order.is_motion else None
            command = replace(last or command, velocity_rad_s=0.0)
        self._last_command = command
        self._unanswered += 1
        self.counters.commands += 1
        return [self._to_motor(codec.encode_command(command, self._ranges()))]

    def _poll(self, now_s: float) -> list[CanFrame]:
        """Ask for the status at 20 Hz; in every tick while an enabled motor does not answer."""
        lost = self._phase is Phase.LOST
        if lost:
            self.counters.withheld_commands += 1
        elif now_s - self._polled_at_s < POLL_INTERVAL_S:
            return []
        self._polled_at_s = now_s
        if not lost:
            self._unanswered += 1
        return [status_request(self._can_id)]

    def _look_again(self, now_s: float) -> list[CanFrame]:
        """Read registers; a motor that is found enabled is disabled at once, whoever enabled it."""
        frames = self._look.step(now_s)
        if self._identity is None:
            self._note_identity()
        if self._feedback is not None and self._feedback.status == Status.ENABLED:
            frames.append(self._to_motor(codec.DISABLE))
        return frames

    def _to_motor(self, data: bytes) -> CanFrame:
        return CanFrame(self._can_id, data)
