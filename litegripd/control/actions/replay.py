"""Replaying a trajectory: to its start first, then along its path by the clock, then a hold.

It commands positions, not forces: recorded torques are never fed forward. The path is one of
openness, gone by the calibration in use now, whatever it was taught on.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step
from litegripd.control.follower import Follower
from litegripd.control.gains import Gains
from litegripd.control.loading import Loading
from litegripd.control.rest import Rest
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import RANGES, MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.path import Path
from litegripd.model.results import Progress, ReplayOutcome, ReplayProgress, ReplayResult

Phase: TypeAlias = Literal["load", "align", "play", "settle"]

FASTEST_MM_S = RANGES["speed_mm_s"][1]
"""No path is replayed faster than any other motion may be."""

LONGEST_S = 86_400.0
CATCH_UP = 1.2
"""Jaws that were held up go so much faster than the path's fastest part, to reach it again."""

_GIVE_UP_S = 2.0
_ROUNDING_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """What a caller wants of a replay: `repeat` passes, 0 for ever.

    `source` is the trajectory as the helper process knows it; `torque_nm` the most to press with.
    """

    source: Mapping[str, object]
    speed: float = 1.0
    torque_nm: float = 2.0
    repeat: int = 1
    align: bool = True


class Replay(PlainAction):
    """One replay; while it is loaded, the jaws do what `resting` tells."""

    def __init__(
        self,
        request: ReplayRequest,
        *,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        period_s: float,
        resting: Callable[[], Rest],
    ) -> None:
        self.speed = request.speed
        self.is_paused = False
        self.loops = 0
        self.frames = 0
        self.openness: float | None = None
        self.phase: Phase = "load"
        self._request = request
        self._geometry = geometry
        self._config = config
        self._period_s = period_s
        self._resting = resting
        self._follower = Follower(gains, request.torque_nm, period_s)
        self._loading = Loading(request.source)
        self._path: Path | None = None
        self._last_s: float | None = None
        self._at_s = 0.0
        self._largest_lag_rad = 0.0
        self._feedback: Feedback | None = None

    @property
    def samples(self) -> int:
        """How many samples the trajectory has; 0 until it is loaded."""
        return 0 if self._path is None else self._path.samples

    def change_speed(self, speed: float) -> Refusal | None:
        """Go on at another speed, a multiple of the one that was taught."""
        refusal = None if self._path is None else self._speed_refusal(speed)
        if refusal is None:
            self.speed = speed
        return refusal

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Go on loading, or along the path."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        if self._path is None:
            refused = self._load(now_s, feedback)
            if self._path is None:
                return refused
        elapsed_s = 0.0 if self._last_s is None or self.is_paused else now_s - self._last_s
        self._last_s = now_s
        return self._go(now_s, max(elapsed_s, 0.0), feedback, self._path)

    def rest(self) -> Rest | None:
        """Go on pressing as in the latest tick; before the first one, as before."""
        return self._resting() if self._path is None else self._follower.rest

    def progress(self) -> Progress | None:
        """Tell where it is on its path."""
        feedback, path = self._feedback, self._path
        if feedback is None:
            return None
        duration_s = 0.0 if path is None else path.duration_s
        at_s = self._at_s if self.phase == "play" else 0.0
        reference_rad = self._follower.reference_rad
        return ReplayProgress(
            phase="paused" if self.is_paused else self.phase,
            step=round(min(at_s, duration_s) / self._period_s),
            total_steps=round(duration_s / self._period_s),
            command_rad=feedback.position_rad if reference_rad is None else reference_rad,
            position_rad=feedback.position_rad,
            torque_nm=feedback.torque_nm,
            frames=self.frames,
            speed=self.speed,
            openness=self._geometry.openness(feedback.position_rad)
            if self.openness is None
            else self.openness,
            loops=self.loops,
        )

    # Loading

    def _load(self, now_s: float, feedback: Feedback) -> Step:
        loading = self._loading
        errand = loading.step(now_s)
        if loading.failure is not None:
            return Step(outcome=loading.failure)
        if loading.path is None:
            return Step(errand=errand)
        refusal = self._unfit(loading.path, feedback)
        if refusal is not None:
            return Step(outcome=refusal)
        self._path = loading.path
        self.phase = "align" if self._request.align else "play"
        return Step()

    def _unfit(self, path: Path, feedback: Feedback) -> Refusal | None:
        """Say why this path cannot be gone, if so."""
        if not path.duration_s <= LONGEST_S:
            text = f"the trajectory takes {path.duration_s:g} s, at most {LONGEST_S:g} s are played"
            return Refusal("out_of_limits", text)
        distance_mm = abs(self._rad(path.openness_at(0.0)) - feedback.position_rad)
        distance_mm *= self._geometry.rad_to_mm
        most_mm = self._config.max_lead_mm
        if not self._request.align and distance_mm > most_mm:
            text = (
                f"the trajectory begins {distance_mm:.1f} mm from where the jaws are, without align"
                f" at most {most_mm:g} mm (max_lead_mm): leave align on, or move there first"
            )
            data = {"field": "align", "requested": distance_mm, "limit": most_mm}
            return Refusal("out_of_limits", text, data)
        return self._speed_refusal(self.speed, path)

    def _speed_refusal(self, speed: float, path: Path | None = None) -> Refusal | None:
        path = path or self._path
        if path is None or self._is_pose(path):
            return None
        rate_mm_s = self._loading.max_rate_s * self._geometry.travel_mm
        if rate_mm_s * speed <= FASTEST_MM_S:
            return None
        most = FASTEST_MM_S / rate_mm_s
        text = (
            f"speed is {speed:g}, with which the fastest part of the trajectory has"
            f" {rate_mm_s * speed:.4g} mm/s; at most {most:.3g} goes, {FASTEST_MM_S:g} mm/s"
        )
        return Refusal("out_of_limits", text, {"field": "speed", "requested": speed, "limit": most})

    # On the way

    def _go(self, now_s: float, elapsed_s: float, feedback: Feedback, path: Path) -> Step:
        if self.phase == "align":
            return self._align(now_s, elapsed_s, feedback, path)
        if self.phase == "play":
            self._at_s += elapsed_s * self.speed
            self.openness = path.openness_at(self._at_s)
            step = self._lead(now_s, feedback, self.openness, self._fastest_rad_s())
            lag_rad = abs(self._rad(self.openness) - feedback.position_rad)
            self._largest_lag_rad = max(self._largest_lag_rad, lag_rad)
            if self._at_s >= path.duration_s:
                self._pass_over(path)
            return step
        self._at_s += elapsed_s
        end = path.openness_at(path.duration_s)
        step = self._lead(now_s, feedback, end, self._fastest_rad_s())
        if self._is_at(end, feedback):
            return Step(step.command, outcome=self._result("completed"))
        if self._at_s < _GIVE_UP_S:
            return step
        return Step(step.command, outcome=self._result("blocked"))

    def _align(self, now_s: float, elapsed_s: float, feedback: Feedback, path: Path) -> Step:
        """Go to the start of the path, at the speed of a move."""
        first = self.openness = path.openness_at(0.0)
        speed_rad_s = self._geometry.to_rad(self._config.speed_mm_s)
        step = self._lead(now_s, feedback, first, speed_rad_s)
        self._at_s += elapsed_s
        reference_rad = self._follower.reference_rad
        is_led = reference_rad is not None and abs(reference_rad - self._rad(first)) < _ROUNDING_RAD
        if is_led and self._is_at(first, feedback):
            self.phase, self._at_s = "play", 0.0
        elif self._at_s > self._geometry.travel_rad / speed_rad_s + _GIVE_UP_S:
            return Step(step.command, outcome=self._result("not_aligned"))
        return step

    def _pass_over(self, path: Path) -> None:
        """Begin the next pass, or settle; a pose that shall be repeated for ever is held."""
        repeat = self._request.repeat
        if self._is_pose(path) and repeat == 0:
            self._at_s = path.duration_s
            return
        self.loops += 1
        if self.loops == repeat:
            self.phase, self._at_s = "settle", 0.0
            return
        self._at_s -= path.duration_s
        jump_rad = self._rad(path.openness_at(path.duration_s)) - self._rad(path.openness_at(0.0))
        if abs(jump_rad) > self._config.reach_tol or self._is_pose(path):
            self.phase, self._at_s = "align", 0.0

    def _lead(self, now_s: float, feedback: Feedback, openness: float, speed_rad_s: float) -> Step:
        """Lead the jaws towards an openness; while paused, nowhere."""
        self.frames += 1
        target_rad = self._rad(openness)
        if self.is_paused:
            reference_rad = self._follower.reference_rad
            target_rad = feedback.position_rad if reference_rad is None else reference_rad
        return Step(self._follower.step(now_s, feedback, target_rad, speed_rad_s))

    def _fastest_rad_s(self) -> float:
        """Return how fast the command may move: enough for the path, and to catch up with it."""
        taught_rad_s = self._loading.max_rate_s * self._geometry.travel_rad * self.speed
        usual_rad_s = self._geometry.to_rad(self._config.speed_mm_s)
        most_rad_s = self._geometry.to_rad(FASTEST_MM_S)
        return min(CATCH_UP * max(taught_rad_s, usual_rad_s), most_rad_s)

    def _is_pose(self, path: Path) -> bool:
        """Whether the path is over before a tick has passed."""
        return path.duration_s < self._period_s

    def _is_at(self, openness: float, feedback: Feedback) -> bool:
        return abs(self._rad(openness) - feedback.position_rad) <= self._config.reach_tol

    def _rad(self, openness: float) -> float:
        geometry = self._geometry
        return geometry.closed_rad - geometry.close_sign * openness * geometry.travel_rad

    def _result(self, outcome: ReplayOutcome) -> ReplayResult:
        return ReplayResult(
            ok=outcome == "completed",
            outcome=outcome,
            loops=self.loops,
            frames=self.frames,
            largest_lag_mm=self._largest_lag_rad * self._geometry.rad_to_mm,
            final_command_rad=self._follower.reference_rad or 0.0,
        )
