"""Slack jaws while a hand teaches a motion; what is recorded of it is the capture's business."""

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.capture import Capture
from litegripd.control.rest import Relax
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import Progress, RecordOutcome, RecordResult


class Teach(PlainAction):
    """Lets the jaws go until the capture is over; then they hold where they are."""

    def __init__(self, capture: Capture) -> None:
        self._capture = capture
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Keep the jaws slack."""
        feedback = motor.feedback
        if self._capture.is_over:
            outcome: RecordOutcome = "full" if self._capture.error is None else "failed"
            return Step(outcome=result_of(self._capture, outcome))
        if feedback is None:
            return Step()
        self._feedback = feedback
        return Step(Relax().command(now_s, feedback))

    def progress(self) -> Progress | None:
        """Tell how many samples there are, and where the jaws are."""
        if self._feedback is None:
            return None
        capture, here_rad = self._capture, self._feedback.position_rad
        total = capture.max_samples
        return progress_of("record", capture.samples, total, here_rad, self._feedback)


def result_of(capture: Capture, outcome: RecordOutcome) -> RecordResult:
    """Tell how a capture ended."""
    return RecordResult(
        ok=capture.error is None,
        outcome=outcome,
        samples=capture.samples,
        missed=capture.missed,
        message=capture.error,
    )
