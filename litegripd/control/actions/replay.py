"""Replaying a trajectory: to its start first, then along its path by the clock, then a hold.

It commands positions: recorded torques are never fed forward. The path is one of openness, gone by
the calibration in use now, whatever it was taught on. With `force` "replay" the jaws leave the path
for each grip that is kept with it, hold by its force, and come back.
"""

from collections.abc import Callable
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step
from litegripd.control.actions.replay_grips import ReplayGrips
from litegripd.control.actions.replay_request import (
    ReplayRequest,
    fastest_rad_s,
    grips_refusal,
    speed_refusal,
    unfit,
)
from litegripd.control.follower import Follower
from litegripd.control.gains import Gains
from litegripd.control.loading import Loading
from litegripd.control.rest import Rest
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.path import Path
from litegripd.model.results import Progress, ReplayOutcome, ReplayProgress, ReplayResult

Phase: TypeAlias = Literal["load", "align", "play", "approach", "hold", "settle"]
_GIVE_UP_S = 2.0
_ROUNDING_RAD = 1e-9


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
        self.grips = ReplayGrips(geometry, config, gains, period_s)
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
        before_s = now_s if self._last_s is None or self.is_paused else self._last_s
        self._last_s, elapsed_s = now_s, max(now_s - before_s, 0.0)
        if self.phase in ("approach", "hold"):
            return self._grip(now_s, elapsed_s, motor, feedback, self._path)
        return self._go(now_s, elapsed_s, feedback, self._path)

    def rest(self) -> Rest | None:
        """Go on pressing, or holding what it has come to; before the first tick, as before.

        Jaws that it is broken off on their way stop where they are.
        """
        if self._path is None:
            return self._resting()
        hold, feedback = self._follower.rest, self._feedback
        if self.grips.held is not None or hold is None or feedback is None:
            return self.grips.held
        return hold if self.phase == "settle" or hold.presses(feedback) else None

    def progress(self) -> Progress | None:
        """Tell where it is on its path."""
        feedback, path = self._feedback, self._path
        if feedback is None:
            return None
        duration_s = 0.0 if path is None else path.duration_s
        here = self._geometry.openness(feedback.position_rad)
        at_s = self._at_s if self.phase in ("play", "approach", "hold") else 0.0
        return ReplayProgress(
            phase="paused" if self.is_paused else self.phase,
            step=round(min(at_s, duration_s) / self._period_s),
            total_steps=round(duration_s / self._period_s),
            command_rad=self._command_rad(),
            position_rad=feedback.position_rad,
            torque_nm=feedback.torque_nm,
            frames=self.frames,
            speed=self.speed,
            openness=here if self.openness is None else self.openness,
            loops=self.loops,
            grips=self.grips.done,
            width_mm=self.grips.width_mm,
        )

    def _load(self, now_s: float, feedback: Feedback) -> Step:
        loading = self._loading
        errand = loading.step(now_s)
        if loading.failure is not None:
            return Step(outcome=loading.failure)
        if loading.path is None:
            return Step(errand=errand)
        refusal = unfit(
            self._request, loading.path, self._geometry, self._config, feedback.position_rad
        )
        refusal = refusal or self._speed_refusal(self.speed)
        refusal = refusal or grips_refusal(self._request.force, loading)
        if refusal is not None:
            return Step(outcome=refusal)
        self._path = loading.path
        if self._request.force == "replay":
            self.grips.take(loading.grips)
        self.phase = "align" if self._request.align else "play"
        return Step()

    def _speed_refusal(self, speed: float) -> Refusal | None:
        return speed_refusal(speed, self._loading.max_rate_s, self._geometry)

    def _go(self, now_s: float, elapsed_s: float, feedback: Feedback, path: Path) -> Step:
        if self.phase == "align":
            return self._align(now_s, elapsed_s, feedback, path)
        if self.phase == "play":
            self._at_s += elapsed_s * self.speed
            self.openness = path.openness_at(self._at_s)
            wanted = self.grips.beside(self.openness)
            step = self._lead(now_s, feedback, wanted, self._fastest_rad_s())
            lag_rad = abs(self._geometry.position_rad(wanted) - feedback.position_rad)
            self._largest_lag_rad = max(self._largest_lag_rad, lag_rad)
            if self.grips.is_due(self._at_s):
                self.phase = "approach"
            elif self._at_s >= path.duration_s:
                self._pass_over(path)
            return step
        self._at_s += elapsed_s
        end = path.openness_at(path.duration_s)
        step = self._lead(now_s, feedback, self.grips.beside(end), self._fastest_rad_s())
        if self._is_at(end, feedback):
            return Step(step.command, outcome=self._result("completed"))
        if self._at_s < _GIVE_UP_S:
            return step
        return Step(step.command, outcome=self._result("blocked"))

    def _align(self, now_s: float, elapsed_s: float, feedback: Feedback, path: Path) -> Step:
        """Go to the start of the path, at the speed of a move."""
        first = self.openness = path.openness_at(0.0)
        is_open = self._geometry.openness(feedback.position_rad) >= first
        if is_open and self.grips.is_due(0.0) and not self.is_paused:
            # It begins with a grip: close as a grasp does, and do not press onto its position.
            self.phase, self._at_s = "approach", 0.0
        speed_rad_s = self._geometry.to_rad(self._config.speed_mm_s)
        step = self._lead(now_s, feedback, first, speed_rad_s)
        self._at_s += elapsed_s
        reference_rad = self._follower.reference_rad
        is_led = (
            reference_rad is not None
            and abs(reference_rad - self._geometry.position_rad(first)) < _ROUNDING_RAD
        )
        if is_led and self._is_at(first, feedback):
            self.phase, self._at_s = "play", 0.0
        elif self._at_s > self._geometry.travel_rad / speed_rad_s + _GIVE_UP_S:
            return Step(step.command, outcome=self._result("not_aligned"))
        return step

    def _pass_over(self, path: Path) -> None:
        """Begin the next pass, or settle; a pose that shall be repeated for ever is held."""
        if self._is_endless_pose(path):
            self._at_s = path.duration_s
            return
        self.loops += 1
        if self.loops == self._request.repeat:
            self.phase, self._at_s = "settle", 0.0
            return
        self._at_s -= path.duration_s
        self.grips.rewind()
        jump_rad = self._geometry.position_rad(
            path.openness_at(path.duration_s)
        ) - self._geometry.position_rad(path.openness_at(0.0))
        if abs(jump_rad) > self._config.reach_tol or self._is_pose(path):
            self.phase, self._at_s = "align", 0.0
            self.grips.let_go()

    def _grip(
        self, now_s: float, elapsed_s: float, motor: MotorView, feedback: Feedback, path: Path
    ) -> Step:
        """Close until something is gripped, then hold it as long as it was taught.

        The path's time stands still while they close.
        """
        grips = self.grips
        if self.phase == "approach" and self.is_paused:
            grips.let_go()
            return self._lead(now_s, feedback, 0.0, self._fastest_rad_s())
        self._follower.reset()
        self.frames += 1
        command, missed = grips.step(now_s, motor)
        if missed is not None:
            return Step(command, outcome=self._result(missed))
        if self.phase == "hold":
            self._at_s += elapsed_s * self.speed
        elif grips.held is not None:
            self.phase, self._at_s = "hold", grips.present.start_s
        self.openness = path.openness_at(self._at_s)
        if self.phase == "approach" or self._at_s < grips.present.end_s:
            return Step(command)
        return self._end_grip(command, feedback, path)

    def _end_grip(self, command: MitCommand | None, feedback: Feedback, path: Path) -> Step:
        """Go on along the path, or in the next grip; at the end of the path the hold lasts."""
        if self._is_endless_pose(path):
            return Step(command)
        self.grips.end()
        if self._at_s >= path.duration_s and not self.grips.is_due(self._at_s):
            self._pass_over(path)
            if self.phase == "settle":
                return Step(command, outcome=self._result("completed"))
        if self.phase == "hold" and not self.grips.keep(self._at_s):
            self.phase = "play"
            self.grips.let_go(self._geometry.openness(feedback.position_rad))
        return Step(command)

    def _lead(self, now_s: float, feedback: Feedback, openness: float, speed_rad_s: float) -> Step:
        """Lead the jaws towards an openness; while paused, nowhere."""
        self.frames += 1
        wanted_rad = self._geometry.position_rad(openness)
        target_rad = self._command_rad() if self.is_paused else wanted_rad
        return Step(self._follower.step(now_s, feedback, target_rad, speed_rad_s))

    def _command_rad(self) -> float:
        """Return where the latest command was; where the jaws are, if it was none to a position."""
        here_rad = 0.0 if self._feedback is None else self._feedback.position_rad
        reference_rad = self._follower.reference_rad
        return here_rad if reference_rad is None else reference_rad

    def _fastest_rad_s(self) -> float:
        """Return how fast the command may move: enough for the path, and to catch up with it."""
        return fastest_rad_s(self.speed, self._loading.max_rate_s, self._geometry, self._config)

    def _is_pose(self, path: Path) -> bool:
        """Whether the path is over before a tick has passed."""
        return path.duration_s < self._period_s

    def _is_endless_pose(self, path: Path) -> bool:
        return self._is_pose(path) and self._request.repeat == 0

    def _is_at(self, openness: float, feedback: Feedback) -> bool:
        return (
            abs(self._geometry.position_rad(openness) - feedback.position_rad)
            <= self._config.reach_tol
        )

    def _result(self, outcome: ReplayOutcome) -> ReplayResult:
        return ReplayResult(
            ok=outcome == "completed",
            outcome=outcome,
            loops=self.loops,
            frames=self.frames,
            largest_lag_mm=self._largest_lag_rad * self._geometry.rad_to_mm,
            final_command_rad=self._command_rad(),
            grips=self.grips.done,
            width_mm=self.grips.width_mm,
            width_difference_mm=self.grips.width_difference_mm,
        )
