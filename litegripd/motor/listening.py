"""What a motor tells, and what follows from it: its feedback, its phase, its silence.

It sends nothing, and decides nothing but which phase follows from what was heard.
"""

from collections.abc import Iterable

from litegripd.model.frame import CanFrame
from litegripd.model.motor import Feedback, Ranges, Status, is_fault
from litegripd.motor import codec
from litegripd.motor.arming import Arming
from litegripd.motor.identification import Identification
from litegripd.motor.phases import ARMING_PHASES, TRANSITIONS, Event, Phase
from litegripd.motor.plausibility import Plausibility
from litegripd.motor.reading import READABLE, Reading
from litegripd.motor.registers import Answer, parse_answer
from litegripd.motor.silence import Silence
from litegripd.motor.traffic import MotorCounters, Traffic
from litegripd.motor.zeroing import Zeroing

_JUDGED = frozenset({*ARMING_PHASES, Phase.ENABLED, Phase.LOST})
"""Where a hold at the position is about to begin, or is under way. Elsewhere whatever a motor tells
counts at once, above all that it is enabled."""
_FASTEST_SHARE = 0.99  # of the range of speeds: beyond it, a code may stand for more
DISABLE_CONFIRM_AFTER_S = 0.01  # older answers may have been under way when disable was sent


class Listener:
    """The motor `can_id` as far as it is heard; see `Motor`."""

    def __init__(self, can_id: int, master_id: int | None) -> None:
        self.counters = MotorCounters()
        self._can_id = can_id
        self._identification = Identification(can_id, master_id)
        self._phase = Phase.LOOKING
        self._entered_s = 0.0
        self._arming: Arming | None = None
        self._zeroing = Zeroing(can_id, Ranges(), 0.0)
        self._reading = Reading(can_id)
        self._plausibility = Plausibility()
        self._feedback: Feedback | None = None
        self._fresh = False
        self._asked_s = 0.0
        self._silence = Silence()
        self._traffic = Traffic(can_id, self._silence, self.counters)

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

    def note_bus(self, *, is_usable: bool) -> None:
        """Take whether the bus can carry frames; call it after `receive`."""
        self._silence.note_bus(self._phase, is_usable=is_usable)

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
        """Keep it, unless its position is in doubt: nothing is to be derived from that."""
        if self._arming is not None:
            self._arming.note_answer()
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
            self._plausibility.believe(None)

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
            self._plausibility.believe(None)
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
