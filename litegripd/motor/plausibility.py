"""Whether a measured position can be true, by what is physically possible since the last one.

Only jumps are judged, and only of a motor that is enabled and told to be stiff: its position is
what a command pulls to, so an encoder that jumps (or wraps at ±PMAX) would turn a hold into a blow.
Slack jaws that a hand throws against a stop bounce faster than any motor could make them.
"""

from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, Status
from litegripd.motor.faults import implausible_refusal

LARGEST_ACCELERATION_RAD_S2 = 6000.0
"""10 N·m (the protocol's limit) on the rotor's and the fingers' 1.87e-3 kg·m², and a reserve."""

TOLERANCE_RAD = 0.05
"""Impacts on a stop within one period, two frames in one, and the codes' own width."""

BRAKE_KD_NM_S_RAD = 1.0
BRAKE_NM = 7.0
"""How a motor is braked that may have followed its encoder for a while: no harder than its peak,
as far as its speed is known."""

IMPLAUSIBLE_FRAMES = 3
"""So many in a row are no disturbed frame any more: the encoder has lost its count."""


class Plausibility:
    """Judges each feedback frame by the one before it."""

    def __init__(self) -> None:
        self.in_a_row = 0
        self.refusal: Refusal | None = None
        """Why the position is not to be believed, from the last of so many frames until `reset`."""
        self._last: Feedback | None = None
        self._told_s = 0.0

    @property
    def brake_kd_nm_s_rad(self) -> float:
        """The damping with which to brake while the position is in doubt."""
        speed_rad_s = 0.0 if self._last is None else abs(self._last.velocity_rad_s)
        return min(BRAKE_KD_NM_S_RAD, BRAKE_NM / max(speed_rad_s, BRAKE_NM))

    def reset(self) -> None:
        """Believe the position again, as it is told now."""
        self.refusal = None

    def begin(self) -> None:
        """Take the next frame as it is: the motor was not watched until now."""
        self.in_a_row = 0
        self._last = None

    def accepts(self, feedback: Feedback, fastest_rad_s: float, *, is_stiff: bool = True) -> bool:
        """Tell whether the jaws can have got to where `feedback` says, and count if not.

        At `fastest_rad_s`, the end of what a frame can tell, the speed is not known, and nothing
        is judged; nor is it where the motor `is_stiff` not.
        """
        last = self._last
        silent_s, self._told_s = feedback.at_s - self._told_s, feedback.at_s
        is_judged = (
            last is not None
            and (is_stiff or self.in_a_row > 0)
            and feedback.status == Status.ENABLED
            and max(abs(last.velocity_rad_s), abs(feedback.velocity_rad_s)) < fastest_rad_s
        )
        if is_judged and last is not None and not _is_reachable(last, feedback, silent_s):
            self.in_a_row += 1
            if self.in_a_row >= IMPLAUSIBLE_FRAMES:
                self.refusal = implausible_refusal(feedback.position_rad - last.position_rad)
            return False
        self._last = feedback
        self.in_a_row = 0
        return True


def _is_reachable(last: Feedback, feedback: Feedback, silent_s: float) -> bool:
    """Compare the way with the mean of the two speeds, give or take what torque can do.

    Between two known speeds the most is gained by full torque one way and then the other, which
    makes a·t²/4. The time for that, `silent_s`, is the one without any frame: a jump does not
    become believable by being repeated.
    """
    elapsed_s = feedback.at_s - last.at_s
    way_rad = feedback.position_rad - last.position_rad
    mean_rad_s = (feedback.velocity_rad_s + last.velocity_rad_s) / 2.0
    reserve_rad = TOLERANCE_RAD + LARGEST_ACCELERATION_RAD_S2 * silent_s**2 / 4.0
    return abs(way_rad - mean_rad_s * elapsed_s) <= reserve_rad
