"""Whether an enabled motor's word that it is no longer enabled is to be acted upon.

To act upon it is to let go of what is held, and not every bus has checksums (a line of SLCAN has
none): one frame alone proves nothing, and what else it tells is as doubtful.
"""

from litegripd.model.motor import Feedback, Status

CERTAIN_AFTER = 3
"""So many answers in a row that tell anything but "enabled" are believed, though they differ."""


class StatusJudge:
    """Counts the answers in a row in which an enabled motor says that it is not."""

    def __init__(self) -> None:
        self._doubted: Feedback | None = None
        self._in_a_row = 0

    def reset(self) -> None:
        """Forget what was doubted."""
        self._doubted, self._in_a_row = None, 0

    def accepts(self, feedback: Feedback) -> bool:
        """Tell whether to believe the status that `feedback` tells.

        The second answer counts when it agrees. It must be one to another request: a frame that
        came twice proves no more than it did once.
        """
        if feedback.status == Status.ENABLED:
            self.reset()
            return True
        doubted, self._doubted = self._doubted, feedback
        if doubted is None or doubted.at_s != feedback.at_s:
            self._in_a_row += 1
        if doubted is None or doubted.at_s == feedback.at_s:
            return False
        return doubted.status == feedback.status or self._in_a_row >= CERTAIN_AFTER
