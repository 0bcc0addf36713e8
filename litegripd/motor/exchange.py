"""The regular exchange with the motor: what goes out in each tick, and what silence means.

`Traffic` builds commands and status requests. `Silence` counts those without an answer; the phases
decide what follows. `Standstill` measures how long the daemon itself sent nothing before the
motor's watchdog reported a fault. Nothing here decides a phase or energises.
"""

from dataclasses import dataclass, replace

from litegripd.model.motor import CanFrame, MitCommand, Ranges
from litegripd.model.plain import Carried
from litegripd.motor import codec
from litegripd.motor.codec import status_request
from litegripd.motor.phases import Event, Phase

USUAL_PERIOD_S = 0.005
"""The usual period of ticks. What is counted in ticks or frames lasts as long at any other one."""
POLL_INTERVAL_S = 0.05  # 20 Hz keep the state of a disabled motor fresh
SILENT_AFTER_POLLS = 3
SILENT_AFTER_S = SILENT_AFTER_POLLS * POLL_INTERVAL_S
PATIENCE_S = 0.02
"""How long unanswered commands are repeated without feed-forward: three times at 200 Hz. Then
commands are withheld: frames queued for a dead bus would be replayed when power returns."""
REPEATED_AT_ONCE = 3
REPEAT_INTERVAL_S = 0.005
"""The first repeats go out in every tick, the others at this interval. So at most seven commands
lie in a queue, at any rate. A queue holds ten frames."""
LOST_GIVES_UP_S = 1.0  # by then the motor's own watchdog has long disarmed it
DISABLE_GIVES_UP_S = 0.5


class Silence:
    """Counts the requests since the last answer, in the present phase.

    Commands are counted by ticks, so that a late daemon does not take its own delay for a silence.
    The number of ticks follows from `period_s`.
    """

    unanswered: Carried[int] = 0
    NOT_CARRIED = ("repeats", "_ticks_apart", "_bus_is_usable", "_was_total")

    def __init__(self, period_s: float) -> None:
        self.repeats = max(round(PATIENCE_S / period_s) - 1, 1)
        """How many unanswered commands are repeated before the motor counts as lost."""
        self._ticks_apart = max(round(REPEAT_INTERVAL_S / period_s), 1)
        self._bus_is_usable = True
        self._was_total = False

    def note_bus(self, phase: Phase, *, is_usable: bool) -> None:
        """Count from zero for a motor out of reach, once the bus can carry frames again.

        Earlier requests reached nobody, and prove nothing about a motor that was not silent when
        the bus was lost. The phase stays: a motor that was lost while enabled is treated alike.
        """
        if is_usable is self._bus_is_usable:
            return
        self._bus_is_usable = is_usable
        if not is_usable:
            self._was_total = self.is_total(phase)
        elif phase in (Phase.LOOKING, Phase.LOST) and not self._was_total:
            self.unanswered = 0

    def begin_phase(self, event: Event) -> None:
        """Count from zero; a motor that is searched because it was silent is still silent."""
        is_known = event in (Event.NO_ANSWER, Event.GAVE_UP)
        self.unanswered = SILENT_AFTER_POLLS + 1 if is_known else 0

    def is_total(self, phase: Phase) -> bool:
        """Return True if the motor that is searched does not answer at all."""
        return phase is Phase.LOOKING and self.unanswered > SILENT_AFTER_POLLS

    @property
    def may_repeat(self) -> bool:
        """True if a command may go out in this tick, given those without an answer."""
        beyond = self.unanswered - REPEATED_AT_ONCE
        return beyond <= 0 or beyond % self._ticks_apart == 0

    def event(self, phase: Phase, in_phase_s: float, silent_s: float) -> Event | None:
        """Return the event that the silence leads to, or None.

        `silent_s` is the time since the last feedback, in this phase or before it.
        """
        if phase is Phase.LOST:
            return Event.GAVE_UP if in_phase_s >= LOST_GIVES_UP_S else None
        if phase is Phase.DISABLING:
            is_long = in_phase_s >= DISABLE_GIVES_UP_S and silent_s >= SILENT_AFTER_S
            return Event.NO_ANSWER if is_long else None
        if phase is Phase.LOOKING:
            return None
        allowed = self.repeats if phase is Phase.ENABLED else SILENT_AFTER_POLLS
        return Event.NO_ANSWER if self.unanswered > allowed else None


RECENT_S = 1.0
"""How long a standstill explains a communication loss after it. The motor reports the loss in
its first answer; if that answer is lost, the motor is searched first."""

_TICKS_BESIDE = 2
"""A command may leave one tick before the standstill, and one after it."""


class Standstill:
    """Detects a tick so late that the motor's own watchdog ran out before it."""

    _ticked_s: Carried[float | None] = None
    _ended_s: Carried[float | None] = None
    _lasted_s: Carried[float] = 0.0
    NOT_CARRIED = ("_period_s",)

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s

    def tick(self, now_s: float, watchdog_s: float) -> None:
        """Take the time of a tick; `watchdog_s` is the motor's timeout, 0 if it is off."""
        before_s, self._ticked_s = self._ticked_s, now_s
        if before_s is None or watchdog_s <= 0.0:
            return
        lasted_s = now_s - before_s
        if lasted_s > max(watchdog_s - _TICKS_BESIDE * self._period_s, self._period_s):
            self._ended_s, self._lasted_s = now_s, lasted_s

    def before(self, now_s: float) -> float | None:
        """Return how long the daemon stood still shortly before `now_s`; None if it did not."""
        if self._ended_s is None or now_s - self._ended_s > RECENT_S:
            return None
        return self._lasted_s


@dataclass(slots=True)
class MotorCounters:
    """Counts since the start."""

    commands: int = 0
    missed_replies: int = 0
    withheld_commands: int = 0
    ignored_frames: int = 0
    foreign_commands: int = 0
    """Frames to our motor from another sender on the bus."""
    implausible_frames: int = 0
    """Feedback of an enabled motor with a position that no jaw can have reached."""


class Traffic:
    """The regular frames to the motor `can_id`."""

    _polled_at_s: Carried[float] = float("-inf")
    _last_command: Carried[MitCommand | None] = None
    is_stored: Carried[bool] = False
    """True if the motor may have stored a command."""
    NOT_CARRIED = ("_can_id", "_silence", "_counters")

    def __init__(self, can_id: int, silence: Silence, counters: MotorCounters) -> None:
        self._can_id = can_id
        self._silence = silence
        self._counters = counters

    @property
    def is_driven(self) -> bool:
        """True if the last command drives the motor; otherwise the jaws are slack."""
        last = self._last_command
        return last is not None and any((last.kp_nm_rad, last.kd_nm_s_rad, last.torque_nm))

    def forget_command(self) -> None:
        """Forget the last command, so that the next enabling does not repeat it."""
        self._last_command = None

    def poll_soon(self) -> None:
        """Ask for the status in the next tick that polls."""
        self._polled_at_s = float("-inf")

    def command(self, command: MitCommand, is_motion: bool, ranges: Ranges) -> list[CanFrame]:
        """Return one command; while answers fail, repeat a motion's last one without feed-forward.

        A command that is no motion comes from a stop or a hold, and goes out as it is. In some
        ticks of a silence no command goes out.
        """
        may_send = self._silence.may_repeat
        if self._silence.unanswered:
            last = self._last_command if is_motion else None
            command = replace(last or command, velocity_rad_s=0.0)
        self._last_command = command
        self.is_stored = True
        self._silence.unanswered += 1
        if not may_send:
            self._counters.withheld_commands += 1
            return []
        self._counters.commands += 1
        return [CanFrame(self._can_id, codec.encode_command(command, ranges))]

    def unstore(self, position_rad: float, ranges: Ranges) -> list[CanFrame]:
        """Return zero gains once after commands, for a motor that is off or about to be.

        The motor stores its last command: another program that enables it next would start what is
        left of a motion. It is sent only once, because any command feeds the motor's own watchdog.
        """
        self.is_stored = False
        return [CanFrame(self._can_id, codec.encode_zero_gains(position_rad, ranges))]

    def poll(self, now_s: float) -> list[CanFrame]:
        """Return a status request 20 times a second."""
        if now_s - self._polled_at_s < POLL_INTERVAL_S:
            return []
        self._polled_at_s = now_s
        self._silence.unanswered += 1
        return [status_request(self._can_id)]

    def probe(self, now_s: float) -> list[CanFrame]:
        """Return a status request in every tick, in place of the commands to a lost motor."""
        self._counters.withheld_commands += 1
        self._polled_at_s = now_s
        self._silence.unanswered += 1
        return [status_request(self._can_id)]
