"""Calibrating by hand: the jaws are slack, and a person marks where the two stops are.

The marks alone say which way closing runs.
"""

from dataclasses import replace
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.filter import Bounds, probe_bounds
from litegripd.control.rest import Relax
from litegripd.control.saving import Saving
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import Progress

Side: TypeAlias = Literal["closed", "open"]


class CalibrateByHand(PlainAction):
    """Lets the jaws go until `finish`; then saves what was marked."""

    def __init__(self, config: MotionConfig) -> None:
        self.bounds: Bounds | None = probe_bounds(config)
        self.marks: dict[Side, float] = {}
        self._saving: Saving | None = None
        self._feedback: Feedback | None = None

    def mark(self, side: Side) -> Refusal | None:
        """Take the measured position as one of the stops."""
        if self._feedback is None or self._saving is not None:
            return Refusal("busy", "the calibration is not ready for a mark: try again")
        self.marks[side] = self._feedback.position_rad
        return None

    def finish(self, saving: Saving) -> Refusal | None:
        """Begin to save; both stops must be marked."""
        if self._saving is not None:
            return Refusal("busy", "the calibration is being saved already: wait for its end")
        missing = [side for side in ("closed", "open") if side not in self.marks]
        if missing:
            text = f"{' and '.join(missing)} not marked yet: push the jaws there and mark it"
            return Refusal("out_of_limits", text)
        failure = saving.begin(self.marks["closed"], self.marks["open"], plausible=False)
        if failure is not None:
            return Refusal("out_of_limits", f"{failure.message}; mark them again")
        self._saving = saving
        return None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Keep the jaws slack."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        command = Relax().command(now_s, feedback)
        if self._saving is None:
            return Step(command)
        return replace(self._saving.step(now_s, motor), command=command)

    def progress(self) -> Progress | None:
        """Tell how many stops are marked, and where the jaws are."""
        if self._feedback is None:
            return None
        phase = "by_hand" if self._saving is None else "saving"
        here_rad = self._feedback.position_rad
        return progress_of(phase, len(self.marks), 2, here_rad, self._feedback)
