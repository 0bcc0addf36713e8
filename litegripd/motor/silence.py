"""Noticing that the motor does not answer, by the measure of each phase.

Counts requests without an answer; what a silence leads to is the business of the phases.
"""

from litegripd.motor.phases import Event, Phase

POLL_INTERVAL_S = 0.05  # 20 Hz keep the state of a disabled motor fresh
SILENT_AFTER_POLLS = 3
SILENT_AFTER_S = SILENT_AFTER_POLLS * POLL_INTERVAL_S
REPEATED_COMMANDS = 3
"""So many unanswered commands are repeated without feed-forward; then commands are withheld,
for frames queued for a dead bus are replayed when power returns."""
LOST_GIVES_UP_S = 1.0  # by then the motor's own watchdog has long disarmed it
DISABLE_GIVES_UP_S = 0.5


class Silence:
    """Counts what was asked since the last answer, in the present phase."""

    def __init__(self) -> None:
        self.unanswered = 0
        self._bus_is_usable = True
        self._was_total = False

    def note_bus(self, phase: Phase, *, is_usable: bool) -> None:
        """Count anew, for a motor out of reach, once the bus can carry anything again.

        What was asked before that reached nobody, and tells nothing of a motor that was not silent
        when the bus was lost. The phase stays: one that was lost while enabled is treated alike.
        """
        if is_usable is self._bus_is_usable:
            return
        self._bus_is_usable = is_usable
        if not is_usable:
            self._was_total = self.is_total(phase)
        elif phase in (Phase.LOOKING, Phase.LOST) and not self._was_total:
            self.unanswered = 0

    def begin_phase(self, event: Event) -> None:
        """Count anew; a motor that is looked for because of its silence is known to be silent."""
        is_known = event in (Event.NO_ANSWER, Event.GAVE_UP)
        self.unanswered = SILENT_AFTER_POLLS + 1 if is_known else 0

    def is_total(self, phase: Phase) -> bool:
        """Whether the motor that is looked for does not answer at all."""
        return phase is Phase.LOOKING and self.unanswered > SILENT_AFTER_POLLS

    def event(self, phase: Phase, in_phase_s: float, silent_s: float) -> Event | None:
        """Return what the silence leads to, if anything.

        `silent_s` is for how long no feedback has come, in this phase or since before it.
        """
        if phase is Phase.LOST:
            return Event.GAVE_UP if in_phase_s >= LOST_GIVES_UP_S else None
        if phase is Phase.DISABLING:
            is_long = in_phase_s >= DISABLE_GIVES_UP_S and silent_s >= SILENT_AFTER_S
            return Event.NO_ANSWER if is_long else None
        if phase is Phase.LOOKING:
            return None
        allowed = REPEATED_COMMANDS if phase is Phase.ENABLED else SILENT_AFTER_POLLS
        return Event.NO_ANSWER if self.unanswered > allowed else None
