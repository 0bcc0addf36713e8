"""Notices a jam that yields slowly, which the windowed position test never calls a stall.

Independent of that test: much torque, and the jaws slower than half of what is commanded, for
several samples in a row (field use of the gripper).
"""

from litegripd.model.motion_config import MotionConfig

SLOW_SHARE = 0.5


class TorqueGuard:
    """Samples torque and speed every `sample_interval`; trips after `stop_torque_cycles`."""

    def __init__(self, config: MotionConfig, speed_rad_s: float) -> None:
        self._config = config
        self._slow_rad_s = SLOW_SHARE * speed_rad_s
        self._sampled: tuple[float, float] | None = None
        self._cycles = 0

    def add(self, now_s: float, position_rad: float, torque_nm: float) -> bool:
        """Take what was measured in this tick; tell whether the jaws must let go."""
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

    def rest(self) -> None:
        """Forget what was seen: where the jaws are now, torque and stillness are expected."""
        self._sampled, self._cycles = None, 0
