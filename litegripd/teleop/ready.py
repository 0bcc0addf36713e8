"""The ready handshake: a leader's jaws hold until its follower is where they are.

Slack jaws would move before anybody follows, and the follower would have to catch up. So a follower
says in one byte, on a key of its own, whether it is ready; the vendor's SDK does the same. The
first ready opens the leader's gate for the whole session: later ones change nothing, for the hand
has the jaws then. An older follower does not know of it and never says so: the gate opens after a
while.
"""

from litegripd.model.teleop import decode_ready, encode_ready
from litegripd.teleop.link import Link

_EARLY_S = 0.00025
"""A tick that is early by this little counts as the one that is due."""


class ReadyGate:
    """The leader's side: `is_open` once a follower is ready, or has not been for `timeout_s`.

    With a `timeout_s` of 0 it waits for ever.
    """

    def __init__(self, timeout_s: float, *, is_required: bool) -> None:
        self.is_open = not is_required
        self.is_ready = False
        """True once a follower has said that it is ready."""
        self.has_timed_out = False
        self.heard = 0
        self._timeout_s = timeout_s
        self._began_s: float | None = None

    def take(self, payload: bytes) -> bool:
        """Take what has arrived; return True if it was a ready frame."""
        is_ready = decode_ready(payload)
        if is_ready is None:
            return False
        self.heard += 1
        self.is_ready = self.is_ready or is_ready
        return True

    def step(self, now_s: float) -> bool:
        """Return True in the tick in which the gate opens."""
        if self.is_open:
            return False
        self._began_s = now_s if self._began_s is None else self._began_s
        waited_s = now_s - self._began_s
        self.has_timed_out = not self.is_ready and 0.0 < self._timeout_s <= waited_s + _EARLY_S
        self.is_open = self.is_ready or self.has_timed_out
        return self.is_open


class ReadySender:
    """The follower's side: sends each change at once, and again every `period_s`.

    Its first word, and its last one, is that it is not ready.
    """

    def __init__(self, link: Link, period_s: float) -> None:
        self.is_ready = False
        self.sent = 0
        self._link = link
        self._period_s = period_s
        self._next_s = float("-inf")

    def step(self, now_s: float, *, is_ready: bool) -> None:
        """Say it, if it is news or if it is time to."""
        if is_ready != self.is_ready or now_s >= self._next_s - _EARLY_S:
            self._say(now_s, is_ready=is_ready)

    def end(self, now_s: float) -> None:
        """Say that this follower follows no more."""
        self._say(now_s, is_ready=False)

    def _say(self, now_s: float, *, is_ready: bool) -> None:
        self.is_ready = is_ready
        self._next_s = now_s + self._period_s
        self.sent += self._link.tell(encode_ready(is_ready), now_s)
