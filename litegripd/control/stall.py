"""Notices that the jaws no longer move, by the vendor's windowed test.

The DM4310 has no stall protection. A test of single samples would misfire on the stick-slip of
the closing side, so the net movement over a whole window counts.
"""

from collections import deque

from litegripd.model.motion_config import MotionConfig


class StallDetector:
    """Samples the position every `sample_interval` and judges windows of `stall_cycles`."""

    def __init__(self, config: MotionConfig, speed_rad_s: float) -> None:
        self._config = config
        self._speed_rad_s = speed_rad_s
        self._samples: deque[tuple[float, float]] = deque(maxlen=config.stall_cycles + 1)

    def add(self, now_s: float, position_rad: float) -> bool:
        """Take the position of this tick; tell whether the latest full window is a stall.

        The expected distance follows from the window's own duration, so that samples of late
        ticks neither hide a stall nor feign one.
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
