"""The regular frames to the motor: commands, or status requests.

Each counts as unanswered until feedback comes. Nothing here decides a phase or energises.
"""

from dataclasses import dataclass, replace

from litegripd.model.bus import CanFrame
from litegripd.model.motor import MitCommand, Ranges
from litegripd.model.plain import Carried
from litegripd.motor import codec
from litegripd.motor.registers import status_request
from litegripd.motor.silence import POLL_INTERVAL_S, Silence


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

        The motor stores its last command: whoever enables it next, with another program, would
        start what is left of a motion. It is sent only once, because any command feeds the motor's
        own watchdog.
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
