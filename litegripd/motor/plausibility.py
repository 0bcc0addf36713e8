"""What one frame alone does not prove of an enabled motor: a jump of the position, another status.

`Plausibility` compares each measured position with what is physically possible since the last one.
A doubtful position counts once the next one agrees. A command pulls to a position, so an encoder
that jumps (or wraps at ±PMAX) would turn a hold into a blow. While the motor is driven, a jump that
stays is a fault. Slack jaws that a hand throws against a stop bounce faster than any motor could
make them, so there the jump is believed in the end.

`StatusJudge` decides whether to believe that the motor is no longer enabled. Believing it means to
let go of what is held, and not every bus has checksums (a line of SLCAN has none). So one frame
alone proves nothing, and its other fields are as doubtful.
"""

from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, Status
from litegripd.model.motor_types import DM4310, MotorType
from litegripd.model.plain import Carried
from litegripd.motor.exchange import USUAL_PERIOD_S
from litegripd.motor.phases import implausible_refusal

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
        self._before, self._last = (None if feedback is None else self._last), feedback
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
