"""Holds that swing: their gains are bounded so that none does, and one that does is calmed.

A motor filters the speed that it damps with, and its current follows its command late. With much
damping a light motor then swings for ever after a push, at 30 to 130 Hz, from one end of its torque
to the other; with little damping so does a stiff hold. Friction hides it until something moves the
jaws. The limiter cannot help: the motor itself closes this loop, thousands of times a second.
"""

from collections import deque
from dataclasses import replace

from litegripd.control.detectors import WINDOW_S, Lasting, SpeedWindow
from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motion_config import MOVING_KP_NM_RAD
from litegripd.model.motor import Feedback, MitCommand
from litegripd.model.plain import Carried

HOLDING_KP_NM_RAD = MOVING_KP_NM_RAD
HOLDING_KD_NM_S_RAD = 0.6
"""The most of a hold, on a DM4310. Of the 1000 random plants of `tests/plants`, the 18 with the
least inertia for their lags swung after a push or a pull in 0 of 108 holds with 0.8 and up to 100
N·m/rad; with 1 in 1, with 2 in 26 (`python -m tests.plants.holds`, docs/gains.md)."""
HOLDING_LEAST_KD_NM_S_RAD = 0.4

TURN_RAD_S = 0.5
"""Jaws that turn round swing if they are faster than this, 26 mm/s, both ways. A noisy measurement
of the speed is wrong by up to 0.3 rad/s."""
UNSEEN_RAD_S = 1.0
"""Jaws whose speed differs so much from how far they have come swing between the measurements: at
100 Hz a swing of 100 Hz seems to stand still."""
TURN_WITHIN_S = 0.04
"""The longest half-wave of a swing. A hand shakes jaws at no more than 8 Hz, 0.06 s."""
SWINGS_S = 0.35
"""How long a swing must last: the jaws ring down after a bump within 0.1 s."""
CALMER = 0.5
LEAST_SHARE = CALMER**3
"""Each time half of both gains, three times at most: less stiffness and less damping, in the same
ratio, calm any motor."""


class SwingDetector:
    """Detects jaws that turn round again and again, each time within `TURN_WITHIN_S`."""

    _seen_s: Carried[float] = 0.0
    _speeds: Carried[deque[tuple[float, float]]]
    _side: Carried[int] = 0
    _turned_s: Carried[float | None] = None
    _moved: Carried[SpeedWindow]
    _lasts: Carried[Lasting]

    def __init__(self) -> None:
        self._speeds = deque()
        self._moved = SpeedWindow()
        self._lasts = Lasting(SWINGS_S)

    def see(self, feedback: Feedback) -> bool:
        """Take a measurement, each once; return True if the jaws have swung for long enough."""
        at_s, speed_rad_s = feedback.at_s, feedback.velocity_rad_s
        if at_s == self._seen_s:
            return False
        self._seen_s = at_s
        moved_rad_s = self._moved.add(at_s, feedback.position_rad)
        self._keep(at_s, speed_rad_s)
        if moved_rad_s is not None and self._is_unseen(moved_rad_s):
            self._turned_s = at_s
        if abs(speed_rad_s) >= TURN_RAD_S:
            side = 1 if speed_rad_s > 0.0 else -1
            if side == -self._side:
                self._turned_s = at_s
            self._side = side
        turned_s = self._turned_s
        return self._lasts.step(turned_s is not None and at_s - turned_s <= TURN_WITHIN_S, at_s)

    def _keep(self, at_s: float, speed_rad_s: float) -> None:
        """Keep the speeds that the motor reports for as long as `_moved` keeps positions."""
        self._speeds.append((at_s, speed_rad_s))
        while at_s - self._speeds[0][0] > 1.5 * WINDOW_S:
            self._speeds.popleft()

    def _is_unseen(self, moved_rad_s: float) -> bool:
        """Return True if the jaws came another way than any of the reported speeds says."""
        speeds_rad_s = [speed_rad_s for _, speed_rad_s in self._speeds]
        low_rad_s, high_rad_s = min(speeds_rad_s), max(speeds_rad_s)
        return not low_rad_s - UNSEEN_RAD_S <= moved_rad_s <= high_rad_s + UNSEEN_RAD_S

    def reset(self) -> None:
        """Begin again: what was seen before does not count."""
        self._side, self._turned_s = 0, None
        self._moved.clear()
        self._speeds.clear()
        self._lasts.reset()


class SwingGuard:
    """Bounds the gains of holds, and calms what swings: a hold, or a follower at rest.

    `share` is what is left of the gains, 1 unless something has swung since the motor was enabled.
    """

    share: Carried[float] = 1.0
    _detector: Carried[SwingDetector]
    NOT_CARRIED = ("_most_kd",)

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        # A rotor that is heavier by a factor bears as much more damping.
        self._most_kd = HOLDING_KD_NM_S_RAD * motor_type.inertia_kg_m2 / DM4310.inertia_kg_m2
        self._detector = SwingDetector()

    def bound(self, command: MitCommand) -> MitCommand:
        """Return the command of a hold, with gains that are calm on every motor that was tried."""
        kp = min(command.kp_nm_rad, HOLDING_KP_NM_RAD)
        kd = min(max(command.kd_nm_s_rad, HOLDING_LEAST_KD_NM_S_RAD), self._most_kd)
        return replace(command, kp_nm_rad=kp, kd_nm_s_rad=kd)

    def calm(self, command: MitCommand, feedback: Feedback) -> tuple[MitCommand, bool]:
        """Return a command with the gains that are left, and True if they have just been lowered.

        Only what stands still in its command can be judged; another command starts anew (`rest`).
        """
        swings = self._detector.see(feedback)
        if swings:
            self._detector.reset()
        is_lowered = swings and self.share > LEAST_SHARE
        if is_lowered:
            self.share *= CALMER
        if self.share == 1.0:
            return command, is_lowered
        kp, kd = self.share * command.kp_nm_rad, self.share * command.kd_nm_s_rad
        return replace(command, kp_nm_rad=kp, kd_nm_s_rad=kd), is_lowered

    def rest(self) -> None:
        """Take note that nothing is held by stiffness now."""
        self._detector.reset()

    def renew(self) -> None:
        """Begin with the whole gains again: the motor has been enabled anew."""
        self.share = 1.0
        self._detector.reset()
