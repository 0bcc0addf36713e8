"""What presses without an end: `PressWatch` detects it, `Easing` lowers it to a gentle press.

Jaws press if they stand while the motor makes more torque than friction explains. That is the same
for a motion, a hold, a stream, a follower and a grip.

A finite motion may press hard on its way, since it ends by itself. What has no end and no set force
may not: a hold that a blocked motion leaves behind, one that something has pushed away, a follower
whose leader stays closed. `Easing` gives it some time, because a short push is to be resisted.
Then it lowers the torque gradually. An elastic object pushes the jaws back meanwhile. They are not
let go: what they hold must not drop.
"""

import math
from dataclasses import dataclass

from litegripd.control.detectors import STILL_RAD_S, Lasting, SpeedWindow
from litegripd.model.gripper import MotorType
from litegripd.model.motor import Feedback
from litegripd.model.plain import Carried

LASTING_S = 0.5
"""A push of this length is resisted; what presses on for longer is an object, or a finger."""
EASE_NM_S = 8.0
"""How fast the torque is lowered: 5.4 N·m in 0.6 s. An object of 20 N·m/rad opens the jaws by 21
mm/s then. At once, it would throw them open by up to 470 mm/s."""
BACK_S = 0.5
"""How long a press must be gentle by itself until a push is resisted again."""
ANOTHER_S = 0.1
"""After so long without a step it is another hold, or another press."""


class Easing:
    """Bounds the torque of one hold or follower; `most_nm` is infinite while nothing is bounded."""

    most_nm: Carried[float] = math.inf
    _sign: Carried[float] = 0.0
    _over: Carried[Lasting]
    _gentle: Carried[Lasting]
    _stepped_s: Carried[float | None] = None

    def __init__(self) -> None:
        self._over = Lasting(LASTING_S)
        self._gentle = Lasting(BACK_S)

    @property
    def is_active(self) -> bool:
        """True while the torque is bounded."""
        return self.most_nm < math.inf

    def reset(self) -> None:
        """Bound nothing, and begin to count again."""
        self.most_nm, self._stepped_s = math.inf, None
        self._over.reset()
        self._gentle.reset()

    def begin(self, torque_nm: float, press_nm: float) -> None:
        """Lower the present torque to `press_nm` from now on: it has lasted already."""
        self.reset()
        self.most_nm, self._sign = max(abs(torque_nm), press_nm), math.copysign(1.0, torque_nm)

    def step(
        self, now_s: float, asked_nm: float, press_nm: float, torque_nm: float, *, stands: bool
    ) -> float:
        """Return the bound for a lead that asks for `asked_nm`; `torque_nm` is the present torque.

        Only a lead that asks for more than `press_nm` for `LASTING_S` is bounded, while the jaws
        stand. One that turns round is another one.
        """
        before_s = self._stepped_s
        is_over = abs(asked_nm) > press_nm
        has_turned = is_over and asked_nm * self._sign < 0.0
        if has_turned or (before_s is not None and now_s - before_s > ANOTHER_S):
            self.reset()
        self._stepped_s = now_s
        if not self.is_active:
            self._sign = math.copysign(1.0, asked_nm)
            if not self._over.step(is_over and stands, now_s):
                return math.inf
            self.most_nm = max(min(abs(asked_nm), abs(torque_nm)), press_nm)
        elif self._gentle.step(not is_over, now_s):
            self.reset()
            return math.inf
        elapsed_s = 0.0 if before_s is None else max(now_s - before_s, 0.0)
        self.most_nm = max(self.most_nm - EASE_NM_S * elapsed_s, press_nm)
        return self.most_nm


STANDS_S = 0.05
PRESSES_S = 0.05
FRICTIONS = 2.0
"""Times what it usually takes to move standing jaws: that much torque, friction may take. Jaws
that came to rest were held by less, 0.45 N·m on the stiffest gripper considered."""
TELL_AFTER_S = 1.5
"""A motion that looks for a stop presses on it for up to 1.0 s: nothing to report."""
GAP_S = 1.0
"""Jaws that stop pressing for less than this continue the episode: eased ones move back a bit."""
TELL_EVERY_S = 60.0
TELL_MORE = 1.5
"""How often the same kind of motion is reported at most, and by how much more force at once."""


@dataclass(frozen=True, slots=True)
class Pressing:
    """What presses for longer than a moment: with `torque_nm` now, and `most_nm` at most so far."""

    torque_nm: float
    most_nm: float


class PressWatch:
    """Detects jaws that press, from measurements alone, whatever commands them."""

    torque_nm: Carried[float | None] = None
    """The torque with which standing jaws press (motor's direction), None while they do not."""
    stands: Carried[bool] = False
    _window: Carried[SpeedWindow]
    _presses: Carried[Lasting]
    _seen_s: Carried[float] = 0.0
    _began_s: Carried[float | None] = None
    _pressed_s: Carried[float] = 0.0
    _most_nm: Carried[float] = 0.0
    _is_told: Carried[bool] = False
    NOT_CARRIED = ("_friction_nm", "_told")

    def __init__(self, motor_type: MotorType) -> None:
        self._friction_nm = FRICTIONS * motor_type.breakaway_nm
        self._window = SpeedWindow(STANDS_S)
        self._presses = Lasting(PRESSES_S)
        self._told: dict[str, tuple[float, float]] = {}

    def reset(self) -> None:
        """Forget all: the motor is not known to make any torque."""
        self._window.clear()
        self._presses.reset()
        self.torque_nm, self.stands, self._began_s = None, False, None

    def see(self, feedback: Feedback, *, is_held: bool) -> None:
        """Take a measurement, each once; jaws that hold an object by force press at any torque."""
        at_s, torque_nm = feedback.at_s, feedback.torque_nm
        if at_s == self._seen_s:
            return
        self._seen_s = at_s
        speed_rad_s = self._window.add(at_s, feedback.position_rad)
        self.stands = speed_rad_s is not None and abs(speed_rad_s) < STILL_RAD_S
        presses = self.stands and (is_held or abs(torque_nm) > self._friction_nm)
        self.torque_nm = torque_nm if self._presses.step(presses, at_s) else None
        if self.torque_nm is None:
            if at_s - self._pressed_s > GAP_S:
                self._began_s = None
            return
        self._pressed_s = at_s
        if self._began_s is None:
            self._began_s, self._most_nm, self._is_told = at_s, 0.0, False
        self._most_nm = max(self._most_nm, abs(torque_nm))

    def take_lasting(self, now_s: float, kind: str) -> Pressing | None:
        """Return what has pressed for `TELL_AFTER_S`, once; `kind` is the motion that caused it.

        A kind that was reported lately is not reported again, unless it presses much harder.
        """
        if self.torque_nm is None or self._began_s is None or self._is_told:
            return None
        if self._seen_s - self._began_s < TELL_AFTER_S:
            return None
        self._is_told = True
        told_s, told_nm = self._told.get(kind, (-math.inf, 0.0))
        if now_s - told_s < TELL_EVERY_S and self._most_nm < TELL_MORE * told_nm:
            return None
        self._told[kind] = (now_s, self._most_nm)
        return Pressing(self.torque_nm, self._most_nm)
