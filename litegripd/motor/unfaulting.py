"""Clearing a latched fault for its own sake: asked again until the motor says that it is gone.

Clearing disarms, so it energises nothing. A fault whose cause lasts comes back at once.
"""

from litegripd.model.frame import CanFrame
from litegripd.motor import codec

RETRY_S = 0.02
GIVES_UP_S = 0.25


class Unfaulting:
    """One clearing, from its request to its end."""

    def __init__(self, can_id: int, now_s: float) -> None:
        self._can_id = can_id
        self._began_s = now_s
        self._next_try_s = now_s

    def has_failed(self, now_s: float) -> bool:
        """Whether the fault has lasted for so long that it will not go."""
        return now_s - self._began_s >= GIVES_UP_S

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the frame that is due, if any; the motor answers it with its status."""
        if now_s < self._next_try_s:
            return []
        self._next_try_s = now_s + RETRY_S
        return [CanFrame(self._can_id, codec.CLEAR_FAULT)]
