"""What can happen to single frames on their way in one direction: lost, late, doubled, changed.

It decides what arrives and when; who sends and who receives is elsewhere. No clock: times are
arguments. The same seed, settings and frames give the same faults.
"""

from __future__ import annotations

import math
import random
import threading

from litegripd.model.frame import CanFrame


class FrameFaults:
    """The faults of one direction, all off at first; they may be set at any time, by any thread.

    A frame may suffer several of them at once: it is lost, else changed, doubled and late.
    """

    def __init__(self, direction: str, seed: int = 0) -> None:
        self.is_used = False
        """Whether any fault was ever set: until then nobody needs to ask `arrivals`."""
        self._direction = direction
        self._lock = threading.Lock()
        self._latest_s = -math.inf
        self._switch_off()
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Begin the sequence of chances anew."""
        with self._lock:
            self._random = random.Random(f"{self._direction} {seed}")  # noqa: S311 - no secret

    def clear(self) -> None:
        """Switch all off. Frames that are late already still arrive."""
        with self._lock:
            self._switch_off()

    def drop(self, probability: float) -> None:
        """Lose each frame with this probability, 0 to 1. Raises `ValueError` for another."""
        _check_probability(probability)
        with self._lock:
            self._drop = probability
            self.is_used = True

    def drop_next(self, count: int) -> None:
        """Lose the next `count` frames. Raises `ValueError` for a negative number."""
        if count < 0:
            raise ValueError(f"the number of frames to drop must not be negative, but is {count!r}")
        with self._lock:
            self._drop_next = count
            self.is_used = True

    def delay(self, seconds: float, *, in_order: bool = True) -> None:
        """Let frames arrive late by this time, from now on; 0 ends it.

        In order, none overtakes another, not even when the delay ends. Else each is late by a
        random share of the time, and overtakes. Raises `ValueError` for a negative time or one
        that is not finite.
        """
        if not math.isfinite(seconds) or seconds < 0:
            raise ValueError(f"the delay must be finite and not negative, but is {seconds!r} s")
        with self._lock:
            self._delay_s = seconds
            self._in_order = in_order
            self.is_used = True

    def double(self, probability: float) -> None:
        """Let each frame arrive twice with this probability, 0 to 1. Raises `ValueError`."""
        _check_probability(probability)
        with self._lock:
            self._double = probability
            self.is_used = True

    def corrupt(self, probability: float) -> None:
        """Change the data of each frame with this probability, 0 to 1. Raises `ValueError`.

        At least one byte is changed. The bus itself would notice that; adapters and gateways
        are known to do it.
        """
        _check_probability(probability)
        with self._lock:
            self._corrupt = probability
            self.is_used = True

    def arrivals(self, due_s: float, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        """Return what arrives, and when, of a frame that is due at `due_s`."""
        with self._lock:
            if self._is_lost():
                return []
            if self._happens(self._corrupt):
                frame = self._changed(frame)
            count = 2 if self._happens(self._double) else 1
            return [(self._arrives_at(due_s), frame) for _ in range(count)]

    def _switch_off(self) -> None:
        self._drop = self._double = self._corrupt = self._delay_s = 0.0
        self._drop_next = 0
        self._in_order = True

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability

    def _is_lost(self) -> bool:
        if self._drop_next > 0:
            self._drop_next -= 1
            return True
        return self._happens(self._drop)

    def _arrives_at(self, due_s: float) -> float:
        if not self._in_order:
            return due_s + self._delay_s * self._random.random()
        self._latest_s = max(self._latest_s, due_s + self._delay_s)
        return self._latest_s

    def _changed(self, frame: CanFrame) -> CanFrame:
        data = bytearray(frame.data)
        for place in self._random.sample(range(len(data)), self._random.randint(0, len(data))):
            data[place] ^= self._random.randrange(256)
        if data and data == frame.data:
            data[self._random.randrange(len(data))] ^= self._random.randrange(1, 256)
        return CanFrame(frame.can_id, bytes(data))


def _check_probability(probability: float) -> None:
    if not 0.0 <= probability <= 1.0:
        raise ValueError(f"a probability must be 0 to 1, not {probability!r}")
