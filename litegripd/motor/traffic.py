"""What goes to the motor in every tick while nothing special happens: commands, or status requests.

Each is counted as unanswered until feedback comes. It decides no phase and energises nothing.
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
    """What went by since the start."""

    commands: int = 0
    missed_replies: int = 0
    withheld_commands: int = 0
    ignored_frames: int = 0
    foreign_commands: int = 0
    """Frames to our motor that somebody else on the bus sent."""
    implausible_frames: int = 0
    """Feedback of an enabled motor whose position no jaw can have got to."""


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
        """True if the motor was told last to do anything; else the jaws are slack."""
        last = self._last_command
        return last is not None and any((last.kp_nm_rad, last.kd_nm_s_rad, last.torque_nm))

    def forget_command(self) -> None:
        """Begin anew: whoever is enabled next repeats nothing of before."""
        self._last_command = None

    def poll_soon(self) -> None:
        """Ask for the status in the next tick that polls."""
        self._polled_at_s = float("-inf")

    def command(self, command: MitCommand, is_motion: bool, ranges: Ranges) -> list[CanFrame]:
        """Give one command; while answers fail, a motion's last one again, without feed-forward.

        What is no motion is what a stop has led to, or a hold: that goes out as it is. In some
        ticks of a silence nothing does.
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
        """Give zero gains once after commands, to a motor that is off or about to be.

        It stores the last command: whoever enables it next, with another program, would set off
        what is left of a motion. Only once, for any command feeds the motor's own watchdog.
        """
        self.is_stored = False
        return [CanFrame(self._can_id, codec.encode_zero_gains(position_rad, ranges))]

    def poll(self, now_s: float) -> list[CanFrame]:
        """Ask for the status at 20 Hz."""
        if now_s - self._polled_at_s < POLL_INTERVAL_S:
            return []
        self._polled_at_s = now_s
        self._silence.unanswered += 1
        return [status_request(self._can_id)]

    def probe(self, now_s: float) -> list[CanFrame]:
        """Ask for the status in every tick, in place of the commands to a motor that is lost."""
        self._counters.withheld_commands += 1
        self._polled_at_s = now_s
        self._silence.unanswered += 1
        return [status_request(self._can_id)]
