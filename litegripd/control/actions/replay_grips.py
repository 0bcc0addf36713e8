"""The grips of a replay, one after the other: each a grasp like any other, with the taught force.

It knows no path: when a grip begins and ends is the replay's to say.
"""

from collections.abc import Mapping, Sequence

from litegripd.control.actions.grasp import Grasp, GraspRequest
from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.model.geometry import Geometry
from litegripd.model.grips import TaughtGrip
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MitCommand, MotorView
from litegripd.model.results import GraspResult, ReplayOutcome

_MISSED: Mapping[str, ReplayOutcome] = {
    "no_object": "no_object",
    "object_lost": "object_lost",
    "timed_out": "timed_out",
}


class ReplayGrips:
    """What is gripped on the way; `held` is the hold while there is one.

    `done` counts the grips that held something, in all passes.
    """

    def __init__(
        self, geometry: Geometry, config: MotionConfig, gains: Gains, period_s: float
    ) -> None:
        self.done = 0
        self.width_mm: float | None = None
        self.width_difference_mm: float | None = None
        self.held: Grip | None = None
        self._geometry = geometry
        self._config = config
        self._gains = gains
        self._period_s = period_s
        self._grips: Sequence[TaughtGrip] = ()
        self._number = 0
        self._grasp: Grasp | None = None
        self._let_go_at: float | None = None

    def take(self, grips: Sequence[TaughtGrip]) -> None:
        """Take the grips of a path; their times count from its begin."""
        self._grips = grips

    @property
    def present(self) -> TaughtGrip:
        """The grip that is due, or under way."""
        return self._grips[self._number]

    def is_due(self, at_s: float) -> bool:
        """Whether the jaws are to close on something by now."""
        return self._number < len(self._grips) and self.present.closing_s <= at_s

    def rewind(self) -> None:
        """Begin with the first one again."""
        self._number = 0

    def step(
        self, now_s: float, motor: MotorView
    ) -> tuple[MitCommand | None, ReplayOutcome | None]:
        """Close or hold; return the command, and why there is nothing held, if so."""
        if self._grasp is None:
            self._grasp, self._let_go_at = self._new_grasp(), None
        step = self._grasp.step(now_s, motor)
        rest = self._grasp.rest()
        before, self.held = self.held, rest if isinstance(rest, Grip) else None
        if before is None and self.held is not None and motor.feedback is not None:
            self._note(self._geometry.opening_mm(motor.feedback.position_rad))
        return step.command, _missed(step.outcome)

    def end(self) -> None:
        """Go over to the next one; what is held stays so."""
        self._number += 1

    def keep(self, at_s: float) -> bool:
        """Go on holding, if the next grip is due already: letting go would drop the object."""
        if not self.is_due(at_s) or self.held is None:
            return False
        self.held.squeeze(self.present.force_n)
        return True

    def let_go(self, openness: float | None = None) -> None:
        """Hold nothing, and close no further; the next step begins anew from where the jaws are.

        `openness` is where they let go of something.
        """
        self._grasp = self.held = None
        self._let_go_at = openness

    def beside(self, openness: float) -> float:
        """Return where to go instead of pressing on what was just let go of.

        Where it is wider than what was taught, the jaws wait until the path opens beyond it.
        """
        if self._let_go_at is not None and openness >= self._let_go_at:
            self._let_go_at = None
        return openness if self._let_go_at is None else self._let_go_at

    def _new_grasp(self) -> Grasp:
        request = GraspRequest(self.present.force_n, self._config.grasp_speed_mm_s)
        return Grasp(
            request,
            geometry=self._geometry,
            config=self._config,
            gains=self._gains,
            period_s=self._period_s,
        )

    def _note(self, width_mm: float) -> None:
        self.done += 1
        self.width_mm = width_mm
        difference_mm = width_mm - self.present.width_mm
        largest_mm = self.width_difference_mm
        if largest_mm is None or abs(difference_mm) > abs(largest_mm):
            self.width_difference_mm = difference_mm


def _missed(outcome: object) -> ReplayOutcome | None:
    """Return how a grasp ended, which has no end while it holds something."""
    return _MISSED[outcome.outcome] if isinstance(outcome, GraspResult) else None
