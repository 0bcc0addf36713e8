"""Detects a motor that makes less torque than is commanded, by its own report.

A supply that sags, a driver that limits its current or a winding that has burnt leave a motor that
obeys and answers: standing jaws look the same with 20 N and with 2. Only standing jaws are judged.
What is commanded of moving ones depends on where they are by now, and the report of that is up to
30 ms late on a slow bus: at 50 mm/s and 100 N·m/rad that is 3 N·m.
"""

from litegripd.control.detectors import STILL_RAD_S, Lasting, SpeedWindow
from litegripd.model.motor import Feedback, MitCommand
from litegripd.model.plain import Carried

WEAK_SHARE = 0.8
"""Less than this share of the commanded torque is too little. A clamp's interval allows a tenth."""
WHOLE_SHARE = 0.9
"""From this share on a motor that was weak is not any more."""
NOISE_NM = 0.1
"""Twice by how much a reported torque may stray, and 20 codes of a frame."""
LEAST_NM = 0.4
"""Less is not judged: the noise would be a quarter of it."""
STANDS_S = 0.02
"""The time over which positions show that the jaws stand. A noise of one code is 0.04 rad/s then,
which the damping of a hold turns into as many N·m."""
SHORT_S = 0.06
"""How long it must be too little to count in a verdict: a contact has lasted 80 ms by then. The
report is filtered by 3 to 6 ms and a command takes a period; a damaged answer is a single one."""
WEAK_S = 0.15
"""How long to be reported: longer than frames that are 30 ms late each way let it seem so."""
AVERAGE_S = 0.03


class MadeTorque:
    """Compares each report of standing jaws with the command; both count as amounts."""

    is_weak: Carried[bool] = False
    """True if too little was made for `WEAK_S`, until all of it was made for as long."""
    is_judging: Carried[bool] = False
    """True while the jaws stand, and enough is commanded to judge it."""
    commanded_nm: Carried[float] = 0.0
    """The mean of what was commanded lately, while it was judged."""
    made_nm: Carried[float] = 0.0
    """The mean of what was made of it."""
    _before: Carried[MitCommand | None] = None
    _seen_s: Carried[float | None] = None
    _speed: Carried[SpeedWindow]
    _short: Carried[Lasting]
    _weak: Carried[Lasting]
    _whole: Carried[Lasting]

    def __init__(self) -> None:
        self._speed = SpeedWindow(STANDS_S)
        self._short = Lasting(SHORT_S)
        self._weak = Lasting(WEAK_S)
        self._whole = Lasting(WEAK_S)

    @property
    def is_short(self) -> bool | None:
        """True if standing jaws have got too little for `SHORT_S`, and still do; None for less."""
        if self._seen_s is None or not self._short.is_under_way:
            return False
        return self._short.has_lasted(self._seen_s) or None

    def see(self, feedback: Feedback, sent: MitCommand | None) -> bool:
        """Take a tick's measurement and the latest command; return True if `is_weak` changed."""
        before, self._before = self._before, sent
        at_s, seen_s = feedback.at_s, self._seen_s
        if at_s == seen_s:
            return False
        self._seen_s = at_s
        speed_rad_s = self._speed.add(at_s, feedback.position_rad)
        if seen_s is None or speed_rad_s is None or abs(speed_rad_s) >= STILL_RAD_S:
            self._forget()
            return False
        if sent is None or before is None:
            self._forget()
            return False
        now_nm = _commanded_nm(sent, feedback.position_rad, speed_rad_s)
        before_nm = _commanded_nm(before, feedback.position_rad, speed_rad_s)
        commanded_nm = min(now_nm, before_nm, key=abs)
        if now_nm * before_nm <= 0.0 or abs(commanded_nm) < LEAST_NM:
            self._forget()
            return False
        made_nm = feedback.torque_nm if commanded_nm > 0.0 else -feedback.torque_nm
        return self._judge(at_s, at_s - seen_s, abs(commanded_nm), made_nm)

    def reset(self) -> None:
        """Begin again: what was seen does not describe what comes."""
        self.is_weak = False
        self._before = self._seen_s = None
        self._speed.clear()
        self._forget()

    def _judge(self, at_s: float, elapsed_s: float, commanded_nm: float, made_nm: float) -> bool:
        made_nm = min(max(made_nm, 0.0), commanded_nm)  # a damaged answer may say anything
        gain = min(elapsed_s / AVERAGE_S, 1.0) if self.is_judging else 1.0
        self.is_judging = True
        self.commanded_nm += gain * (commanded_nm - self.commanded_nm)
        self.made_nm += gain * (made_nm - self.made_nm)
        is_short = self.made_nm < WEAK_SHARE * self.commanded_nm - NOISE_NM
        is_whole = self.made_nm >= WHOLE_SHARE * self.commanded_nm - NOISE_NM
        self._short.step(is_short, at_s)
        was_weak = self.is_weak
        if self._weak.step(is_short, at_s):
            self.is_weak = True
        elif self._whole.step(is_whole, at_s):
            self.is_weak = False
        return was_weak != self.is_weak

    def _forget(self) -> None:
        self.is_judging = False
        for lasting in (self._short, self._weak, self._whole):
            lasting.reset()


def _commanded_nm(command: MitCommand, position_rad: float, speed_rad_s: float) -> float:
    """Return the torque that a command asks for where the jaws are (MIT protocol)."""
    return (
        command.kp_nm_rad * (command.position_rad - position_rad)
        + command.kd_nm_s_rad * (command.velocity_rad_s - speed_rad_s)
        + command.torque_nm
    )
