"""The regular exchange with the motor: what goes out in each tick, and what its answers prove.

`Traffic` builds commands and status requests. `Silence` counts those without an answer; the phases
decide what follows. `Standstill` measures how long the daemon itself sent nothing before the
motor's watchdog reported a fault.

Some motors report by themselves, too, about 10 times a second while they are enabled. Such a frame
looks like an answer. It is a measurement as good as any, but it does not show that the motor hears:
one alone does not bring a lost motor back. Nothing here decides a phase or energises.

`Plausibility` compares each measured position with what is physically possible since the last one.
A doubtful position counts once the next one agrees. A command pulls to a position, so an encoder
that jumps (or wraps at ±PMAX) would turn a hold into a blow. While the motor is driven, a jump that
stays is a fault. Slack jaws that a hand throws against a stop bounce faster than any motor could
make them, so there the jump is believed in the end.

`StatusJudge` decides whether to believe that the motor is no longer enabled. Believing it means to
let go of what is held, and not every bus has checksums (a line of SLCAN has none). So one frame
alone proves nothing, and its other fields are as doubtful.
"""

from dataclasses import dataclass, replace

from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motor import (
    SOONEST_DISARM_S,
    UNASKED_S,
    CanFrame,
    Feedback,
    MitCommand,
    Ranges,
    Status,
)
from litegripd.model.plain import Carried
from litegripd.motor import codec
from litegripd.motor.codec import status_request
from litegripd.motor.phases import Event, Phase, implausible_refusal

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
LOST_GIVES_UP_S = 1.0
"""By then the motor's own watchdog has disarmed it, as far as is known: `LATEST_DISARM_S`."""
ANSWERS_WITHIN_S = UNASKED_S / 2.0
"""Of two reports that come within this time, the motor made at most one by itself."""
DISABLE_GIVES_UP_S = 0.5


class Silence:
    """Counts the requests since the last answer, in the present phase.

    Commands are counted by ticks, so that a late daemon does not take its own delay for a silence.
    The number of ticks follows from `period_s`.
    """

    unanswered: Carried[int] = 0
    NOT_CARRIED = ("repeats", "_reported_s", "_ticks_apart", "_bus_is_usable", "_was_total")

    def __init__(self, period_s: float) -> None:
        self.repeats = max(round(PATIENCE_S / period_s) - 1, 1)
        """How many unanswered commands are repeated before the motor counts as lost."""
        self._ticks_apart = max(round(REPEAT_INTERVAL_S / period_s), 1)
        self._reported_s = float("-inf")
        """When the motor last reported in the present phase."""
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
        self._reported_s = float("-inf")

    def ends_with_report(self, phase: Phase, now_s: float, *, is_enabled: bool) -> bool:
        """Take a report of a motor that is enabled or not; return True if it ends the silence.

        An enabled motor that is lost may have made it by itself, until another one has come shortly
        before.
        """
        before_s, self._reported_s = self._reported_s, now_s
        is_shown = now_s - before_s < ANSWERS_WITHIN_S
        if phase is Phase.LOST and is_enabled and not is_shown:
            return False
        self.unanswered = 0
        return True

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
    """Detects a tick so late that the motor's own watchdog may have run out before it.

    It may do so sooner or later than its register says. So every standstill counts that some motor
    would not bear, until the motor reports that it is enabled after it.
    """

    _ticked_s: Carried[float | None] = None
    _ended_s: Carried[float | None] = None
    _lasted_s: Carried[float] = 0.0
    NOT_CARRIED = ("_period_s",)

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s

    def tick(self, now_s: float, watchdog_s: float) -> None:
        """Take the time of a tick; `watchdog_s` is what the motor's register says, 0 for off."""
        before_s, self._ticked_s = self._ticked_s, now_s
        if before_s is None:
            return
        lasted_s = now_s - before_s
        shortest_s = min(watchdog_s or SOONEST_DISARM_S, SOONEST_DISARM_S)
        if lasted_s > max(shortest_s - _TICKS_BESIDE * self._period_s, self._period_s):
            self._ended_s, self._lasted_s = now_s, lasted_s

    def note_enabled(self, now_s: float) -> None:
        """Take a report of "enabled": the motor has borne a standstill that ended before this tick.

        What came in the tick that ended it may be older.
        """
        if self._ended_s is not None and now_s > self._ended_s:
            self._ended_s = None

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


CERTAIN_AFTER = 3
"""This many answers in a row other than "enabled" are believed, even if they differ."""


class StatusJudge:
    """Counts the answers in a row in which an enabled motor reports another status."""

    def __init__(self) -> None:
        self._doubted: Feedback | None = None
        self._in_a_row = 0

    def reset(self) -> None:
        """Forget what was doubted."""
        self._doubted, self._in_a_row = None, 0

    def accepts(self, feedback: Feedback) -> bool:
        """Return True if the status of `feedback` is to be believed.

        The second answer counts when it agrees. It must answer another request: a frame that came
        twice proves no more than one.
        """
        if feedback.status == Status.ENABLED:
            self.reset()
            return True
        doubted, self._doubted = self._doubted, feedback
        if doubted is None or doubted.at_s != feedback.at_s:
            self._in_a_row += 1
        if doubted is None or doubted.at_s == feedback.at_s:
            return False
        return doubted.status == feedback.status or self._in_a_row >= CERTAIN_AFTER


TOLERANCE_RAD = 0.05
"""Covers impacts on a stop within one period, two frames in one, and the codes' own width."""

BRAKE_KD_NM_S_RAD = 1.0
"""For a motor that may have followed its encoder for a while: brake no harder than its peak
torque, as far as its speed is known."""

IMPLAUSIBLE_FRAMES = 3
"""This many in a row at 200 Hz are not a disturbed frame: the encoder has lost its count. At
another rate it is the number that comes in the same time, and at least two."""

ALONE_S = 0.005
"""One frame alone is believed as far as torque can move the jaws in this time. After a longer
gap more could have happened, so two frames must agree."""


class Plausibility:
    """Judges each feedback frame by the one before it."""

    in_a_row: Carried[int] = 0
    """How many doubtful frames have been left out since the last believed one."""
    refusal: Carried[Refusal | None] = None
    """Why the position is not believed; set by the last of `lasting_frames`, until `reset`."""
    _last: Carried[Feedback | None] = None
    _doubted: Carried[Feedback | None] = None
    _told_s: Carried[float] = 0.0
    _silent_s: Carried[float] = 0.0
    """How long no frame had come before the latest; late ones may come together."""
    _gap_s: Carried[float] = 0.0
    """That time for the first doubtful frame: in it the jaws could have moved anywhere."""
    _was_driven: Carried[bool] = False
    NOT_CARRIED = ("lasting_frames", "_acceleration_rad_s2", "_brake_nm", "_before")

    def __init__(self, period_s: float = USUAL_PERIOD_S, motor_type: MotorType = DM4310) -> None:
        self._brake_nm = motor_type.peak_nm
        self._acceleration_rad_s2 = motor_type.largest_acceleration_rad_s2
        self.lasting_frames = max(round(IMPLAUSIBLE_FRAMES * USUAL_PERIOD_S / period_s), 2)
        """This many in a row are not a disturbed frame."""
        self._before: Feedback | None = None
        """The one believed before the last, because the last may have been disturbed."""

    @property
    def brake_kd_nm_s_rad(self) -> float:
        """The damping with which to brake while the position is in doubt."""
        speed_rad_s = 0.0 if self._last is None else abs(self._last.velocity_rad_s)
        return min(BRAKE_KD_NM_S_RAD, self._brake_nm / max(speed_rad_s, self._brake_nm))

    def reset(self) -> None:
        """Believe the position again, as it is reported now."""
        self.refusal = None
        self.believe(None)

    def believe(self, feedback: Feedback | None) -> None:
        """Take `feedback` as it is; with None, take whatever comes next."""
        self._before, self._last = self._last, feedback
        self._doubted = None
        self.in_a_row = 0

    def accepts(self, feedback: Feedback, fastest_rad_s: float, *, is_driven: bool) -> bool:
        """Return True if the position in `feedback` is to be believed.

        Nothing is judged at `fastest_rad_s`, the end of what a frame can express, because the speed
        is unknown there, nor while the motor is not enabled. `is_driven` is True if the motor's
        last command was more than slack.
        """
        last, doubted = self._last, self._doubted
        if feedback.at_s > self._told_s:
            self._silent_s, self._told_s = feedback.at_s - self._told_s, feedback.at_s
        if doubted is None:
            self._gap_s, self._was_driven = self._silent_s, False
        self._was_driven = is_driven or self._was_driven  # braking without damping is no command
        is_judged = (
            last is not None
            and feedback.status == Status.ENABLED
            and max(abs(last.velocity_rad_s), abs(feedback.velocity_rad_s)) < fastest_rad_s
        )
        if not is_judged or last is None or self._is_reachable(last, feedback, ALONE_S):
            self.believe(feedback)
            return True
        is_lasting = self.in_a_row + 1 >= self.lasting_frames
        if doubted is not None and self._is_reachable(doubted, feedback, self._silent_s):
            is_slack = is_lasting and not self._was_driven
            agrees = self._before is not None and self._is_reachable(
                self._before, feedback, ALONE_S
            )
            if is_slack or agrees or self._is_reachable(last, doubted, self._gap_s):
                self.believe(feedback)
                return True
        self.in_a_row += 1
        self._doubted = feedback
        if is_lasting and self._was_driven:
            self.refusal = implausible_refusal(feedback.position_rad - last.position_rad)
        return False

    def _is_reachable(self, last: Feedback, feedback: Feedback, silent_s: float) -> bool:
        """Compare the way with the mean of the two speeds, give or take what torque can do.

        Between two known speeds, full torque one way and then the other gains the most: a·t²/4.
        `silent_s` is the time without any frame: a jump does not become believable by repetition.
        """
        elapsed_s = feedback.at_s - last.at_s
        way_rad = feedback.position_rad - last.position_rad
        mean_rad_s = (feedback.velocity_rad_s + last.velocity_rad_s) / 2.0
        reserve_rad = TOLERANCE_RAD + self._acceleration_rad_s2 * silent_s**2 / 4.0
        return abs(way_rad - mean_rad_s * elapsed_s) <= reserve_rad
