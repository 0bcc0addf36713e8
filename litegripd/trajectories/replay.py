"""Replays a trajectory: first to its start, then along its path by the clock, then a hold.

It commands positions: recorded torques are never fed forward. The path is a path of openness,
converted by the calibration in use now. With `force` "replay" the jaws leave the path for each of
its grips, hold with its force, and come back.

`Follower` leads the jaws along a moving target, with a limited torque and a limited speed: jaws
that were blocked do not jump when they come free. `ReplayGrips` does the grips one after the other,
each a normal grasp with the taught force. It knows no path: the replay decides when a grip begins
and ends.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegrip_client.values.trajectory_format import TaughtGrip
from litegripd.control.admission import force_refusal
from litegripd.control.holds import Grip, Hold, Idle
from litegripd.control.limiter import Gains, budgeted, clamp_lead
from litegripd.control.motions.base import PlainAction, Step
from litegripd.control.motions.grasp import Grasp, GraspRequest
from litegripd.control.motions.move import SPEED_UP_RAD_S2
from litegripd.model.errors import Refusal, at_most
from litegripd.model.gripper import Geometry, MotorType
from litegripd.model.motion_config import MotionConfig, fastest_mm_s
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.state import (
    GraspResult,
    Progress,
    ReplayOutcome,
    ReplayProgress,
    ReplayResult,
)
from litegripd.trajectories.values import Loading, Path

_SLOWEST_RAD_S = 1e-3


class Follower:
    """Makes the commands of one motion; `hold` continues to press as the latest one did."""

    def __init__(self, gains: Gains, torque_nm: float, period_s: float) -> None:
        self.hold: Hold | None = None
        self._gains = gains
        self._torque_nm = torque_nm
        self._period_s = period_s
        self._was_s: float | None = None
        self._was_rad = 0.0
        self._velocity_rad_s = 0.0

    @property
    def reference_rad(self) -> float | None:
        """The position of the latest command, None before the first one."""
        return None if self._was_s is None else self._was_rad

    def reset(self) -> None:
        """Begin at the next step from where the jaws are then."""
        self.hold, self._was_s, self._velocity_rad_s = None, None, 0.0

    def step(
        self, now_s: float, feedback: Feedback, target_rad: float, speed_rad_s: float
    ) -> MitCommand:
        """Return the command of this tick; it moves towards the target at `speed_rad_s` at most.

        The stiffness follows from the command's present speed, so that a path's fastest part does
        not make the slow parts soft.
        """
        if self._was_s is None:
            self._was_s, self._was_rad = now_s, feedback.position_rad
        elapsed_s = max(now_s - self._was_s, 0.0)
        faster_rad_s = abs(self._velocity_rad_s) + SPEED_UP_RAD_S2 * elapsed_s
        most_rad = min(speed_rad_s, faster_rad_s) * elapsed_s
        step_rad = min(max(target_rad - self._was_rad, -most_rad), most_rad)
        velocity_rad_s = step_rad / elapsed_s if elapsed_s > 0.0 else 0.0
        self._velocity_rad_s = velocity_rad_s
        speed = max(abs(velocity_rad_s), _SLOWEST_RAD_S)
        gains, lead_rad = budgeted(self._torque_nm, speed, self._gains, self._period_s)
        reference_rad = clamp_lead(self._was_rad + step_rad, feedback.position_rad, lead_rad)
        self._was_s, self._was_rad = now_s, reference_rad
        self.hold = Hold(reference_rad, gains)
        return gains.at(reference_rad, velocity_rad_s)


Force: TypeAlias = Literal["path", "replay"]

CATCH_UP = 1.2
"""Jaws that were blocked move faster by this factor than the path's fastest part, to catch up."""

LONGEST_S = 86_400.0


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """A caller's options of a replay: `repeat` passes, 0 without end.

    `name` is the trajectory's; `torque_nm` is the largest torque on the
    path; with `force` "replay" the taught grips are repeated.
    """

    name: str
    speed: float = 1.0
    torque_nm: float = 2.0
    repeat: int = 1
    align: bool = True
    force: Force = "path"


AT_START_MM = 4.0
"""Without `align`, jaws this near are where a path begins (the vendor's default lead)."""


def check_fits(
    request: ReplayRequest, path: Path, geometry: Geometry, here_rad: float
) -> Refusal | None:
    """Return a refusal if the path is too long, or starts too far away and `align` is off."""
    if not path.duration_s <= LONGEST_S:
        text = f"the trajectory takes {path.duration_s:g} s, at most {LONGEST_S:g} s are played"
        return Refusal("out_of_limits", text)
    distance_rad = abs(geometry.position_rad(path.openness_at(0.0)) - here_rad)
    distance_mm, most_mm = distance_rad * geometry.rad_to_mm, AT_START_MM
    if request.align or distance_mm <= most_mm:
        return None
    text = (
        f"the trajectory begins {distance_mm:.1f} mm from where the jaws are, without align"
        f" at most {most_mm:g} mm: leave align on, or move there first"
    )
    data = {"field": "align", "requested": distance_mm, "limit": most_mm}
    return Refusal("out_of_limits", text, data)


def grips_refusal(
    force: Force, loading: Loading, geometry: Geometry, motor_type: MotorType
) -> Refusal | None:
    """Return a refusal if the grips are to be repeated and cannot be, or None."""
    if force == "path":
        return None
    if loading.grips:
        hardest_n = max(grip.force_n for grip in loading.grips)
        return force_refusal(hardest_n, geometry, motor_type)
    hint = "only its path can be replayed"
    if loading.grip_problem is not None:
        text = f"the grips of this trajectory cannot be used: {loading.grip_problem}; {hint}"
        return Refusal("trajectory_unreadable", text)
    text = f"no grip is kept with this trajectory; {hint}"
    return Refusal("out_of_limits", text, {"field": "force"})


_MISSED: Mapping[str, ReplayOutcome] = {
    "motor_weak": "motor_weak",
    "no_object": "no_object",
    "object_lost": "object_lost",
    "timed_out": "timed_out",
}


class ReplayGrips:
    """The grips of a replay; `held` is the hold while there is one.

    `done` counts the successful grips of all passes.
    """

    def __init__(
        self,
        geometry: Geometry,
        config: MotionConfig,
        period_s: float,
        motor_type: MotorType,
    ) -> None:
        self._motor_type = motor_type
        self.done = 0
        self.width_mm: float | None = None
        self.width_difference_mm: float | None = None
        self.held: Grip | None = None
        self._geometry = geometry
        self._config = config
        self._period_s = period_s
        self._grips: Sequence[TaughtGrip] = ()
        self._number = 0
        self._grasp: Grasp | None = None
        self._let_go_at: float | None = None

    def take(self, grips: Sequence[TaughtGrip]) -> None:
        """Take the grips of a path; their times count from its start."""
        self._grips = grips

    @property
    def present(self) -> TaughtGrip:
        """The grip that is next, or under way."""
        return self._grips[self._number]

    def is_due(self, at_s: float) -> bool:
        """Return True if the next grip has begun at `at_s`."""
        return self._number < len(self._grips) and self.present.closing_s <= at_s

    def rewind(self) -> None:
        """Begin with the first grip again."""
        self._number = 0

    def step(
        self, now_s: float, motor: MotorView
    ) -> tuple[MitCommand | None, ReplayOutcome | None]:
        """Close or hold; return the command, and the outcome if nothing is held."""
        if self._grasp is None:
            self._grasp = Grasp(
                GraspRequest(self.present.force_n, self._config.grasp_speed_mm_s),
                geometry=self._geometry,
                config=self._config,
                period_s=self._period_s,
                motor_type=self._motor_type,
            )
            self._let_go_at = None
        step = self._grasp.step(now_s, motor)
        idle = self._grasp.idle_after()
        before, self.held = self.held, idle if isinstance(idle, Grip) else None
        if before is None and self.held is not None and motor.feedback is not None:
            self._note(self._geometry.opening_mm(motor.feedback.position_rad))
        return step.command, _missed(step.outcome)

    def end(self) -> None:
        """Go to the next grip; the hold continues."""
        self._number += 1

    def keep(self, at_s: float) -> bool:
        """Continue the hold if the next grip is due already: letting go would drop the object."""
        if not self.is_due(at_s) or self.held is None:
            return False
        self.held.squeeze(self.present.force_n)
        return True

    def let_go(self, openness: float | None = None) -> None:
        """Hold nothing, and stop closing; the next step begins where the jaws are then.

        `openness` is where they released an object.
        """
        self._grasp = self.held = None
        self._let_go_at = openness

    def beside(self, openness: float) -> float:
        """Return the target openness that does not press on the object just released.

        If the object is wider than the taught one, the jaws wait until the path opens beyond it.
        """
        if self._let_go_at is not None and openness >= self._let_go_at:
            self._let_go_at = None
        return openness if self._let_go_at is None else self._let_go_at

    def _note(self, width_mm: float) -> None:
        self.done += 1
        self.width_mm = width_mm
        difference_mm = width_mm - self.present.width_mm
        largest_mm = self.width_difference_mm
        if largest_mm is None or abs(difference_mm) > abs(largest_mm):
            self.width_difference_mm = difference_mm


def _missed(outcome: object) -> ReplayOutcome | None:
    """Return why a grasp holds nothing; a grasp that holds something has not ended."""
    return _MISSED[outcome.outcome] if isinstance(outcome, GraspResult) else None


Phase: TypeAlias = Literal["load", "align", "play", "approach", "hold", "settle"]
_GIVE_UP_S = 2.0
_ROUNDING_RAD = 1e-9


class Replay(PlainAction):
    """One replay; while it is loading, the jaws do what `idle` returns."""

    def __init__(
        self,
        request: ReplayRequest,
        *,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        period_s: float,
        motor_type: MotorType,
        idle: Callable[[], Idle],
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
        self._idle = idle
        self._follower = Follower(gains.reaching(), request.torque_nm, period_s)
        self._motor_type = motor_type
        self.grips = ReplayGrips(geometry, config, period_s, motor_type)
        self._loading = Loading(request.name)
        self._path: Path | None = None
        self._last_s: float | None = None
        self._at_s = 0.0
        self._largest_lag_rad = 0.0
        self._feedback: Feedback | None = None

    @property
    def samples(self) -> int:
        """The number of samples; 0 until the trajectory is loaded."""
        return 0 if self._path is None else self._path.samples

    def change_speed(self, speed: float) -> Refusal | None:
        """Continue at another speed, a multiple of the taught one, or return a refusal."""
        refusal = None if self._path is None else self._speed_refusal(speed)
        if refusal is None:
            self.speed = speed
        return refusal

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Continue to load, or move along the path."""
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

    def idle_after(self) -> Idle | None:
        """Return what continues to press or to hold; before the first tick, what the jaws did.

        If the replay is cancelled, moving jaws stop where they are.
        """
        if self._path is None:
            return self._idle()
        hold, feedback = self._follower.hold, self._feedback
        if self.grips.held is not None or hold is None or feedback is None:
            return self.grips.held
        return hold if self.phase == "settle" or hold.presses(feedback) else None

    def progress(self) -> Progress | None:
        """Return the place on the path."""
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
            coil_temperature_c=feedback.coil_temperature_c,
            frames=self.frames,
            speed=self.speed,
            openness=here if self.openness is None else self.openness,
            loops=self.loops,
            grips=self.grips.done,
            width_mm=self.grips.width_mm,
        )

    def _load(self, now_s: float, feedback: Feedback) -> Step:
        loading = self._loading
        task = loading.step(now_s)
        if loading.failure is not None:
            return Step(outcome=loading.failure)
        if loading.path is None:
            return Step(task=task)
        refusal = check_fits(self._request, loading.path, self._geometry, feedback.position_rad)
        refusal = refusal or self._speed_refusal(self.speed)
        refusal = refusal or grips_refusal(
            self._request.force, loading, self._geometry, self._motor_type
        )
        if refusal is not None:
            return Step(outcome=refusal)
        self._path = loading.path
        if self._request.force == "replay":
            self.grips.take(loading.grips)
        self.phase = "align" if self._request.align else "play"
        return Step()

    def _speed_refusal(self, speed: float) -> Refusal | None:
        """Return a refusal if the path would be faster than any other motion may be."""
        most_mm_s = fastest_mm_s(self._geometry, self._motor_type)
        rate_mm_s = self._loading.max_rate_s * self._geometry.travel_mm
        if rate_mm_s * speed <= most_mm_s:
            return None
        most = most_mm_s / rate_mm_s
        text = (
            f"speed is {speed:g}, with which the fastest part of the trajectory has"
            f" {rate_mm_s * speed:.4g} mm/s; at most {at_most(most, 3)} goes, {most_mm_s:.4g} mm/s"
        )
        return Refusal("out_of_limits", text, {"field": "speed", "requested": speed, "limit": most})

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
        """Move to the start of the path, at the speed of a move."""
        first = self.openness = path.openness_at(0.0)
        is_open = self._geometry.openness(feedback.position_rad) >= first
        if is_open and self.grips.is_due(0.0) and not self.is_paused:
            # It begins with a grip: close as a grasp does, and do not press to the taught position.
            self.phase, self._at_s = "approach", 0.0
        speed_rad_s = min(self._geometry.to_rad(self._config.speed_mm_s), self._fastest_rad_s())
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
        """Begin the next pass, or settle; a pose that is repeated without end is held."""
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
        """Close until something is gripped, then hold it for the taught time.

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
        """Continue along the path, or with the next grip; at the end of the path the hold stays."""
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
        """Lead the jaws towards an openness; while paused, keep the command."""
        self.frames += 1
        wanted_rad = self._geometry.position_rad(openness)
        target_rad = self._command_rad() if self.is_paused else wanted_rad
        return Step(self._follower.step(now_s, feedback, target_rad, speed_rad_s))

    def _command_rad(self) -> float:
        """Return the position of the latest command, or of the jaws if it commanded no position."""
        here_rad = 0.0 if self._feedback is None else self._feedback.position_rad
        reference_rad = self._follower.reference_rad
        return here_rad if reference_rad is None else reference_rad

    def _fastest_rad_s(self) -> float:
        """Return the highest speed of the command: enough for the path, and to catch up with it."""
        geometry = self._geometry
        taught_rad_s = self._loading.max_rate_s * geometry.travel_rad * self.speed
        usual_rad_s = geometry.to_rad(self._config.speed_mm_s)
        most_rad_s = geometry.to_rad(fastest_mm_s(geometry, self._motor_type))
        return min(CATCH_UP * max(taught_rad_s, usual_rad_s), most_rad_s)

    def _is_pose(self, path: Path) -> bool:
        """Return True if the path is shorter than a tick."""
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
