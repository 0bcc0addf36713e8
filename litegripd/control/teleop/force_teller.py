"""How a follower tells its leader's hand what its jaws press with, where that is wished for."""

from litegripd.control.teleop.link import Link
from litegripd.model.force_frame import ForceFrame, encode_force
from litegripd.model.motor import Feedback

TELL_EVERY_S = 0.01
"""A hundred times a second: more than a hand can tell apart."""
_EARLY_S = 0.00025


class ForceTeller:
    """Sends a force frame every `TELL_EVERY_S`.

    `sender` is the number by which a leader of several followers tells this one from the others.
    """

    def __init__(self, link: Link, sender: int) -> None:
        self.reported_n: float | None = None
        """What was reported last, None while nothing is reported."""
        self._link = link
        self._sender = sender
        self._next_s = float("-inf")

    def step(
        self, now_s: float, feedback: Feedback, force_n: float, echo_s: float, leader: str
    ) -> bool:
        """Tell `force_n` to the leader that is followed, if it is time to; whether it failed."""
        if now_s < self._next_s - _EARLY_S:
            return False
        self._next_s = now_s + TELL_EVERY_S
        frame = ForceFrame(self._sender, force_n, feedback.at_s, echo_s)
        self.reported_n = force_n
        return not self._link.reply(encode_force(frame), leader, now_s)
