"""Detectors of what the jaws do, from measured positions. They count time, not ticks.

`Lasting` detects that a condition has held for some time. `SpeedWindow` returns the speed over a
short window: the motor filters its own speed by more than that, and may report a noisy one;
positions are exact to 0.4 mrad. `SwingDetector` detects jaws that shake by themselves.

`StallDetector` is the vendor's windowed test. The DM4310 has no stall protection. A test of single
samples would misfire on the stick-slip of the closing side, so the net movement over a whole window
counts. `TorqueGuard` detects a jam that yields slowly, which that test never calls a stall: a large
torque, and jaws slower than half of the commanded speed, for several samples in a row (field use of
the gripper).

`GripWatch` decides if a gripped object is still there, by where the jaws stop. Jaws that close
fast while nothing takes their torque are a suspicion and not a verdict: they may come back after a
push, or follow an object that has given way by a millimetre. The squeezing continues with little
torque (`is_searching`) until the jaws press on something again, or are too far beyond the last
contact. Only then is the object lost. Each measurement counts once.

`WayGauge` measures what the jaws took on their way.

`PressWatch` detects jaws that press, whatever commands them: they stand while the motor makes more
torque than friction explains.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from litegripd.model.gripper import MotorType
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback
from litegripd.model.plain import Carried


class Lasting:
    """Detects that a condition has held for `duration_s` at every time at which it was asked."""

    _since_s: Carried[float | None] = None
    NOT_CARRIED = ("_duration_s",)

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s * 0.999  # ticks may be a rounding error too short

    def step(self, is_so: bool, at_s: float) -> bool:
        """Take the condition at `at_s`; return True once it has held for long enough."""
        if not is_so:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = at_s
        return self.has_lasted(at_s)

    @property
    def is_under_way(self) -> bool:
        """True if the condition held when it was asked last, for however long."""
        return self._since_s is not None

    def has_lasted(self, at_s: float) -> bool:
        """Return True if the condition has held for long enough at `at_s`."""
        return self._since_s is not None and at_s - self._since_s >= self._duration_s

    def reset(self) -> None:
        """Begin again."""
        self._since_s = None


WINDOW_S = 0.010
"""Long enough to resolve 0.04 rad/s (3 mm/s) from the codes of a frame's position. Short enough
to detect within two periods of 5 ms that the jaws have stopped or run away."""


class SpeedWindow:
    """Keeps the positions of the last `window_s` and a little more."""

    _samples: Carried[deque[tuple[float, float]]]
    NOT_CARRIED = ("_window_s",)

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s * 0.999
        self._samples = deque()

    def add(self, at_s: float, position_rad: float) -> float | None:
        """Take a measurement; return the mean speed (rad/s), None before the window is full."""
        samples = self._samples
        samples.append((at_s, position_rad))
        while len(samples) > 2 and at_s - samples[1][0] >= self._window_s:
            samples.popleft()
        elapsed_s = at_s - samples[0][0]
        if elapsed_s < self._window_s:
            return None
        return (position_rad - samples[0][1]) / elapsed_s

    @property
    def began_rad(self) -> float:
        """The oldest position in the window."""
        return self._samples[0][1]

    def clear(self) -> None:
        """Forget all measurements: the next one does not continue them."""
        self._samples.clear()


TURN_RAD_S = 0.5
"""Jaws that turn round swing if they are faster than this, 26 mm/s, both ways. A noisy measurement
of the speed is wrong by up to 0.3 rad/s."""
BETWEEN_RAD_S = 1.0
"""Jaws whose speed differs so much from how far they have come swing between the measurements: at
100 Hz a swing of 100 Hz seems to stand still."""
TURN_WITHIN_S = 0.04
"""The longest half-wave of a swing. A hand shakes jaws at no more than 8 Hz, 0.06 s."""
SWINGS_S = 0.35
"""How long a swing must last: the jaws ring down after a bump within 0.1 s."""


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
        self._speeds.append((at_s, speed_rad_s))
        while at_s - self._speeds[0][0] > 1.5 * WINDOW_S:  # as long as `_moved` keeps positions
            self._speeds.popleft()
        if moved_rad_s is not None:
            speeds_rad_s = [speed_rad_s for _, speed_rad_s in self._speeds]
            low_rad_s, high_rad_s = min(speeds_rad_s), max(speeds_rad_s)
            if not low_rad_s - BETWEEN_RAD_S <= moved_rad_s <= high_rad_s + BETWEEN_RAD_S:
                self._turned_s = at_s  # they came another way than any of the speeds says
        if abs(speed_rad_s) >= TURN_RAD_S:
            side = 1 if speed_rad_s > 0.0 else -1
            if side == -self._side:
                self._turned_s = at_s
            self._side = side
        turned_s = self._turned_s
        return self._lasts.step(turned_s is not None and at_s - turned_s <= TURN_WITHIN_S, at_s)

    def reset(self) -> None:
        """Begin again: what was seen before does not count."""
        self._side, self._turned_s = 0, None
        self._moved.clear()
        self._speeds.clear()
        self._lasts.reset()


class StallDetector:
    """Samples the position every `sample_interval` and judges windows of `stall_cycles`."""

    def __init__(self, config: MotionConfig, speed_rad_s: float) -> None:
        self._config = config
        self._speed_rad_s = speed_rad_s
        self._samples: deque[tuple[float, float]] = deque(maxlen=config.stall_cycles + 1)

    def add(self, now_s: float, position_rad: float) -> bool:
        """Take the position of this tick; return True if the latest full window is a stall.

        The expected distance follows from the window's own duration, so that samples of late ticks
        neither hide a stall nor feign one.
        """
        samples = self._samples
        if samples and now_s - samples[-1][0] < self._config.sample_interval * 0.999:
            return False
        samples.append((now_s, position_rad))
        if len(samples) <= self._config.stall_cycles:
            return False
        (began_s, first_rad), (ended_s, last_rad) = samples[0], samples[-1]
        expected_rad = self._speed_rad_s * (ended_s - began_s)
        threshold_rad = max(self._config.stall_delta, self._config.stall_ratio * expected_rad)
        return abs(last_rad - first_rad) < threshold_rad


SLOW_SHARE = 0.5


class TorqueGuard:
    """Samples torque and speed every `sample_interval`; trips after `stop_torque_cycles`."""

    def __init__(self, config: MotionConfig, speed_rad_s: float) -> None:
        self._config = config
        self._slow_rad_s = SLOW_SHARE * speed_rad_s
        self._sampled: tuple[float, float] | None = None
        self._cycles = 0

    def add(self, now_s: float, position_rad: float, torque_nm: float) -> bool:
        """Take the measurement of this tick; return True if the jaws must let go."""
        if self._sampled is None:
            self._sampled = (now_s, position_rad)
            return False
        since_s, from_rad = self._sampled
        elapsed_s = now_s - since_s
        if elapsed_s < self._config.sample_interval * 0.999:
            return False
        self._sampled = (now_s, position_rad)
        slow = abs(position_rad - from_rad) < self._slow_rad_s * elapsed_s
        strong = abs(torque_nm) >= self._config.stop_torque_nm
        self._cycles = self._cycles + 1 if slow and strong else 0
        return self._cycles >= self._config.stop_torque_cycles

    def reset(self) -> None:
        """Forget all samples: where the jaws are now, torque and stillness are expected."""
        self._sampled, self._cycles = None, 0


WatchState: TypeAlias = Literal["held", "searching", "recovering"]
"""`held`: the jaws press. `searching`: they close, and have met nothing yet. `recovering`: they
press again, and the force comes back."""

AGREE_S = 0.004
"""Two measurements at 100 and 200 Hz, five at 1000 Hz: a single one may be disturbed."""
CLOSED_S = 0.010
"""How long jaws must be seen fully closed."""
TOUCH_S = 0.015
"""How long jaws must stand and press to count as having touched something again."""
SETTLED_S = 0.05
"""How long the force must be back before the object counts as held again."""

STILL_RAD_S = 0.1
"""Standing jaws are slower than this, 7 mm/s. A noise of one code over the window is 0.08 rad/s."""

RESIST_SHARE = 0.4
RESIST_FRICTIONS = 1.3
RESIST_NM = 0.2
"""An object that resists takes this share of the commanded torque, and this amount more than
friction. With a larger share a soft object would seem lost when jaws that stuck near the closed
stop break away into it."""
TOUCH_TORQUE_SHARE = 0.5
TOUCH_SPEED_SHARE = 0.4
"""Share of the speed of a search. Jaws that meet nothing exceed it, even with twice the
friction."""


class _Seen(NamedTuple):
    """One measurement, counted in the closing direction, with the torque commanded at that time."""

    at_s: float
    closed_rad: float
    speed_rad_s: float
    torque_nm: float
    applied_nm: float


@dataclass(frozen=True, slots=True)
class WatchLimits:
    """The limits of a watch; positions count in the closing direction."""

    fast_rad_s: float
    """Jaws that press are slower than this, or something takes their torque."""
    search_rad_s: float
    far_rad: float
    """This far beyond the last contact there is nothing between the jaws."""
    lost_at_rad: float
    """Closed this far, there is nothing between the jaws, wherever the last contact was."""
    friction_nm: float
    moved_rad: float
    """A change of the contact by this distance or more is reported."""


class GripWatch:
    """Watches one grip; `moved_rad` is how far the object has moved, once that is certain."""

    limits: Carried[WatchLimits]
    state: Carried[WatchState] = "held"
    is_lost: Carried[bool] = False
    moved_rad: Carried[float | None] = None
    contact_rad: Carried[float | None] = None
    """The most closed position at which the jaws have pressed lately."""
    _pressed_rad: Carried[float | None] = None
    takes_nothing: Carried[bool] = False
    """True while nothing resists the commanded torque, at any speed."""
    speed_rad_s: Carried[float | None] = None
    """The closing speed over the last few measurements, None while there are too few."""
    _seen_s: Carried[float] = 0.0
    _speed: Carried[SpeedWindow]
    _free: Carried[Lasting]
    _far: Carried[Lasting]
    _closed: Carried[Lasting]
    _touching: Carried[Lasting]
    _settled: Carried[Lasting]

    def __init__(self, limits: WatchLimits) -> None:
        self.limits = limits
        self._speed = SpeedWindow()
        self._free = Lasting(AGREE_S)
        self._far = Lasting(AGREE_S)
        self._closed = Lasting(CLOSED_S)
        self._touching = Lasting(TOUCH_S)
        self._settled = Lasting(SETTLED_S)

    @property
    def is_searching(self) -> bool:
        """True while the jaws close and have met nothing yet."""
        return self.state == "searching"

    @property
    def stands(self) -> bool:
        """True while the jaws are known to stand."""
        return self.speed_rad_s is not None and abs(self.speed_rad_s) < STILL_RAD_S

    def continue_from(self, before: "GripWatch") -> None:
        """Take over the state of another watch of the same object."""
        self.state, self.is_lost = before.state, before.is_lost
        self.contact_rad = before.contact_rad

    def resume(self) -> None:
        """Continue after a silence; earlier measurements do not count."""
        self._speed.clear()
        self.speed_rad_s = self._pressed_rad = None
        for lasting in (self._free, self._far, self._closed, self._touching, self._settled):
            lasting.reset()

    def see(self, feedback: Feedback, sign: int, applied_nm: float, *, is_full: bool) -> bool:
        """Judge a measurement, each once; return True for a new one.

        `applied_nm` is the commanded torque; `is_full` is True if that is the whole torque asked
        for.
        """
        at_s = feedback.at_s
        if at_s == self._seen_s:
            return False
        self._seen_s = at_s
        closed_rad = sign * feedback.position_rad
        torque_nm = sign * feedback.torque_nm
        friction_nm = RESIST_FRICTIONS * self.limits.friction_nm
        self.takes_nothing = torque_nm < max(RESIST_SHARE * applied_nm, friction_nm + RESIST_NM)
        if self.contact_rad is None:
            self.contact_rad = closed_rad
        if self._closed.step(closed_rad >= self.limits.lost_at_rad, at_s):
            self.is_lost = True
        self.speed_rad_s = speed_rad_s = self._speed.add(at_s, closed_rad)
        if speed_rad_s is not None:
            seen = _Seen(at_s, closed_rad, speed_rad_s, torque_nm, applied_nm)
            self._judge(seen, is_full=is_full)
        return True

    def _judge(self, seen: _Seen, *, is_full: bool) -> None:
        is_free = seen.speed_rad_s > self.limits.fast_rad_s and self.takes_nothing
        is_suspicious = self._free.step(is_free, seen.at_s)
        if self.state == "searching":
            self._search(seen)
        elif is_suspicious:
            self._enter("searching")
        elif self.state == "recovering":
            self._recover(seen, is_settled=is_full and not is_free)
        elif not is_free:
            self._keep_contact()

    def _enter(self, state: WatchState) -> None:
        self.state = state
        for lasting in (self._far, self._touching, self._settled):
            lasting.reset()

    def _keep_contact(self) -> None:
        """Keep the position where the jaws press; a hand that opens them does not move the object.

        Two windows must agree: a single measurement may be disturbed.
        """
        before_rad, self._pressed_rad = self._pressed_rad, self._speed.began_rad
        pressed_rad = (
            self._pressed_rad if before_rad is None else min(before_rad, self._pressed_rad)
        )
        if self.contact_rad is not None:
            self.contact_rad = max(self.contact_rad, pressed_rad)

    def ease_contact(self, most_rad: float) -> None:
        """Move the contact back to where the jaws press now, by at most `most_rad`.

        A soft object opens the jaws by itself when the force on it is lowered.
        """
        if self.contact_rad is not None and self._pressed_rad is not None:
            self.contact_rad = max(self.contact_rad - most_rad, self._pressed_rad)

    def _search(self, seen: _Seen) -> None:
        """Judge where searching jaws stop: on something again, or too far."""
        contact_rad, limits = self.contact_rad, self.limits
        is_far = contact_rad is not None and seen.closed_rad - contact_rad > limits.far_rad
        if self._far.step(is_far, seen.at_s):
            self.is_lost = True
        is_slow = abs(seen.speed_rad_s) < TOUCH_SPEED_SHARE * limits.search_rad_s
        presses = is_slow and seen.torque_nm >= TOUCH_TORQUE_SHARE * seen.applied_nm
        if self._touching.step(presses, seen.at_s):
            self._enter("recovering")

    def _recover(self, seen: _Seen, *, is_settled: bool) -> None:
        """Wait until the whole force holds; jaws that only stuck would have moved on."""
        if not self._settled.step(is_settled, seen.at_s):
            return
        self._enter("held")
        if self.contact_rad is not None:
            moved_rad = seen.closed_rad - self.contact_rad
            self.moved_rad = moved_rad if moved_rad >= self.limits.moved_rad else None
        self._keep_contact()


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
        if is_held:
            self._began_s = None  # asked for; what presses for long afterwards began there
        elif self._began_s is None:
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


WAY_RAD_S = 0.1
"""Jaws that close at 5 mm/s or faster travel."""
WAY_MEAN_S = 0.03
LATELY_S = 2.0
"""How long a way counts for the next motion: a motion that something blocks takes up to a second to
say so, and nobody hangs a weight on the jaws so fast."""


class WayGauge:
    """Measures the torque that the jaws take while they close, whatever motion closes them.

    The smallest mean over `WAY_MEAN_S` counts: what is pressed at the way's end takes more.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the way: the jaws are not known to be where it ended."""
        self._window = SpeedWindow(WAY_MEAN_S)
        self._seen_s = self._ran_s = -math.inf
        self._torques_nm: list[float] = []
        self._began_s = 0.0
        self._least_nm: float | None = None

    def see(self, feedback: Feedback, close_sign: int) -> None:
        """Take a measurement, each once."""
        at_s = feedback.at_s
        if at_s == self._seen_s:
            return
        self._seen_s = at_s
        speed_rad_s = self._window.add(at_s, feedback.position_rad)
        if speed_rad_s is None or close_sign * speed_rad_s < WAY_RAD_S:
            self._torques_nm.clear()
            return
        if at_s - self._ran_s > LATELY_S:
            self._least_nm = None
        self._ran_s = at_s
        if not self._torques_nm:
            self._began_s = at_s
        self._torques_nm.append(close_sign * feedback.torque_nm)
        if at_s - self._began_s >= WAY_MEAN_S * 0.999:
            mean_nm = sum(self._torques_nm) / len(self._torques_nm)
            self._least_nm = mean_nm if self._least_nm is None else min(self._least_nm, mean_nm)
            self._torques_nm.clear()

    def lately_nm(self, now_s: float) -> float | None:
        """Return what the way has taken within `LATELY_S`, friction and load; None if unknown."""
        if self._least_nm is None or now_s - self._ran_s > LATELY_S:
            return None
        return max(self._least_nm, 0.0)
