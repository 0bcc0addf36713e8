"""Detectors of what the jaws do, from measured positions. They count time, not ticks.

`Lasting` detects that a condition has held for some time. `SpeedWindow` returns the speed over a
short window: the motor filters its own speed by more than that, and may report a noisy one;
positions are exact to 0.4 mrad.

`StallDetector` is the vendor's windowed test. The DM4310 has no stall protection. A test of single
samples would misfire on the stick-slip of the closing side, so the net movement over a whole window
counts. `TorqueGuard` detects a jam that yields slowly, which that test never calls a stall: a large
torque, and jaws slower than half of the commanded speed, for several samples in a row (field use of
the gripper).
"""

from collections import deque

from litegripd.model.motion_config import MotionConfig
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
