"""Calibrating by probing both mechanical stops, the open one first, and confirming each.

The direction is declared before: a stall cannot distinguish one stop from the other.

`Probe` feels for a stop with little torque, before any travel is known. In every tick it derives
its command from the measured position. An accumulated target kept increasing its lead at a stop
until the structure gave way (field use of the gripper). The torque ceiling does not depend on
standing still, which a structure that yields never does. Only torque towards the probed side
counts: the first feedback still has the torque of the motion before, for example of a press on the
other stop.

`Stroke` comes to a stop with a run-up, and confirms or corrects what a probe has found. Standing
and slow jaws may stick where moving ones pass (the closing side does, in front of its stop), and a
probe that pushes gently is slow. So the jaws come with the speed of an `open` or `close`, bounded
by a torque whatever they meet. Where they slow down, a probe takes over. It presses no harder than
the first one did, so a stop that yields is met at the same depth.

`Pressing` presses on a stop that was found. An end stays where it is; jaws that only stick come
loose. They may stick by more than a probe's push, also after a stroke with a run-up. So they are
pressed harder, but slowly, and below the ceiling of a calibration. Ends are soft. After the press
is taken back, the same probe as before shows where the jaws are met again: that distinguishes an
end from jaws that came loose. The press is taken back by what friction keeps.

`Confirming` repeats strokes until two in a row end at the same place, and presses there. A stop is
saved only if two finds in a row agree.

`CalibrateByHand` makes no stroke: the jaws are slack, and a person marks the two stops. The marks
alone decide which way closing runs.
"""

from collections import deque
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from litegripd.control.calibration import Saving, failed
from litegripd.control.holds import Slack
from litegripd.control.limiter import Bounds, Gains, probe_bounds
from litegripd.control.motions.base import PlainAction, Step, progress_of
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.sentence import sentence
from litegripd.model.state import Progress, ZeroResult

ProbeVerdict: TypeAlias = Literal["found", "not_found"]


class Probe:
    """Pushes towards one side (`sign` of the motor's radians) until the jaws stand still."""

    def __init__(self, sign: int, config: MotionConfig) -> None:
        self._sign = sign
        self._config = config
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._sampled: tuple[float, float] | None = None
        self._still = 0
        self.iterations = 0

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, ProbeVerdict | None]:
        """Push, and judge whether the jaws have met the stop."""
        config, position_rad = self._config, feedback.position_rad
        if self._sign * feedback.torque_nm >= config.calib_tau_limit:
            return self._gains.at(position_rad), "found"
        command = self._gains.at(position_rad + self._sign * config.calib_step_rad)
        if self._sampled is None:
            self._sampled = (now_s, position_rad)
            return command, None
        since_s, from_rad = self._sampled
        if now_s - since_s < config.sample_interval * 0.999:
            return command, None
        self._sampled = (now_s, position_rad)
        self.iterations += 1
        still = abs(position_rad - from_rad) < config.calib_stall_delta
        self._still = self._still + 1 if still else 0
        if self._still >= config.calib_stall_cycles:
            return command, "found"
        return command, "not_found" if self.iterations >= config.calib_max_iter else None


StrokeVerdict: TypeAlias = Literal["at_stop", "stuck", "not_found"]

RUN_SHARE = 0.85
"""Share of `calib_tau_limit`. The rest is for jaws that bounce, and for the lag of measurements."""
DAMPING_SHARE = 0.5
"""The largest share of the torque that comes from the velocity; the rest comes from the lead."""

WINDOW_S = 0.02
SLOWED_SHARE = 0.5
LEAST_RAD_S = 0.1
"""Slower jaws may still stick; this is 5 mm/s of the gripper that ships."""
START_WITHIN_S = 0.5


class Stroke:
    """Drives the jaws towards one side (`sign` of the motor's radians) until they stand still.

    `friction_nm` is the mean torque while they moved, None before.
    """

    def __init__(self, sign: int, config: MotionConfig, speed_rad_s: float) -> None:
        torque_nm = RUN_SHARE * config.calib_tau_limit
        self._sign = sign
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._speed_rad_s = speed_rad_s
        self._torque_limit_nm = config.calib_tau_limit
        self._fed_rad_s = min(speed_rad_s, DAMPING_SHARE * torque_nm / config.calib_kd)
        left_nm = torque_nm - config.calib_kd * self._fed_rad_s
        self._lead_rad = min(config.calib_step_rad, left_nm / config.calib_kp)
        self._probe = Probe(sign, config)
        self._probing = False
        self._sent: tuple[float, float] | None = None
        self._began_s: float | None = None
        self._window: deque[tuple[float, float]] = deque()
        self._fastest_rad_s = 0.0
        self._torque_sum_nm = 0.0
        self._torques = 0
        self.ticks = 0

    @property
    def friction_nm(self) -> float | None:
        """The mean torque of the way."""
        return self._torque_sum_nm / self._torques if self._torques else None

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, StrokeVerdict | None]:
        """Drive or press the jaws, and judge whether they are at the end."""
        self.ticks += 1
        if self._probing:
            command, verdict = self._probe.step(now_s, feedback)
            return command, "at_stop" if verdict == "found" else verdict
        if self._began_s is None:
            self._began_s = now_s
        pushed_nm = self._sign * feedback.torque_nm
        has_slowed = self._has_slowed(now_s, feedback)
        if has_slowed or pushed_nm >= self._torque_limit_nm:
            self._probing = True
            return self._gains.at(feedback.position_rad), None
        if self._fastest_rad_s < LEAST_RAD_S and now_s - self._began_s > START_WITHIN_S:
            return self._gains.at(feedback.position_rad), "stuck"
        if self._fastest_rad_s >= LEAST_RAD_S:
            self._torque_sum_nm += pushed_nm
            self._torques += 1
        return self._lead_command(now_s, feedback.position_rad), None

    def _lead_command(self, now_s: float, position_rad: float) -> MitCommand:
        """Advance the target by the speed, but never beyond the largest lead."""
        since_s, target_rad = self._sent or (now_s, position_rad)
        ahead_rad = (target_rad - position_rad) * self._sign
        ahead_rad += self._speed_rad_s * (now_s - since_s)
        ahead_rad = min(max(ahead_rad, -self._lead_rad), self._lead_rad)
        target_rad = position_rad + self._sign * ahead_rad
        self._sent = (now_s, target_rad)
        return self._gains.at(target_rad, self._sign * self._fed_rad_s)

    def _has_slowed(self, now_s: float, feedback: Feedback) -> bool:
        """Return True if moving jaws have lost half of their speed, over some 20 ms."""
        window = self._window
        window.append((now_s, feedback.position_rad))
        while len(window) > 2 and now_s - window[1][0] >= WINDOW_S * 0.999:
            window.popleft()
        since_s, from_rad = window[0]
        if now_s - since_s < WINDOW_S * 0.999:
            return False
        speed_rad_s = self._sign * (feedback.position_rad - from_rad) / (now_s - since_s)
        self._fastest_rad_s = max(self._fastest_rad_s, speed_rad_s)
        is_slow = speed_rad_s < SLOWED_SHARE * self._fastest_rad_s
        return is_slow and self._fastest_rad_s >= LEAST_RAD_S


PressVerdict: TypeAlias = Literal["held", "gave_way", "not_found"]

HARD_SHARE = 0.95
"""Share of `calib_tau_limit`. The jaws stand, so only noise needs the rest."""
LEFT_SHARE = 0.3
"""The largest share of the probe's push that remains while the press is taken back, so that the
jaws stay in touch."""
RATE_NM_S = 4.0
REST_S = 0.1
FAR_TOLERANCES = 1.5
"""Times `stop_tol`: jaws that give way this far need no harder press."""


class Pressing:
    """Presses towards one side (`sign` of the motor's radians) from `stop_rad`, and probes again.

    `friction_nm` is the mean torque that moved the jaws.
    """

    def __init__(
        self, sign: int, stop_rad: float, friction_nm: float, config: MotionConfig
    ) -> None:
        self._sign = sign
        self._stop_rad = stop_rad
        self._tolerance_rad = config.stop_tol
        self._gains = Gains(config.calib_kp, config.calib_kd)
        limit_nm = HARD_SHARE * config.calib_tau_limit
        self._push_nm = min(config.calib_kp * config.calib_step_rad, limit_nm)
        self._most_nm = limit_nm
        self._least_nm = min(LEFT_SHARE * self._push_nm, self._push_nm - 2.0 * friction_nm)
        self._probe = Probe(sign, config)
        self._up_nm = self._push_nm
        self._up_since_s: float | None = None
        self._down_since_s: float | None = None

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, PressVerdict | None]:
        """Press, take the press back, or probe; judge by where the jaws are met again."""
        if self._down_since_s is None:
            return self._press(now_s, feedback), None
        down_s = now_s - self._down_since_s
        fallen_nm = self._up_nm - RATE_NM_S * down_s
        if fallen_nm > self._least_nm - RATE_NM_S * REST_S:
            return self._pushed(feedback, max(fallen_nm, self._least_nm)), None
        command, verdict = self._probe.step(now_s, feedback)
        if verdict is None or verdict == "not_found":
            return command, verdict
        apart_rad = abs(feedback.position_rad - self._stop_rad)
        return command, "held" if apart_rad <= self._tolerance_rad else "gave_way"

    def _press(self, now_s: float, feedback: Feedback) -> MitCommand:
        if self._up_since_s is None:
            self._up_since_s = now_s
        wanted_nm = self._push_nm + RATE_NM_S * (now_s - self._up_since_s)
        self._up_nm = min(wanted_nm, self._most_nm)
        gave_rad = (feedback.position_rad - self._stop_rad) * self._sign
        if gave_rad >= FAR_TOLERANCES * self._tolerance_rad:
            self._up_nm = self._push_nm  # the end may throw them back: damping adds to it
            self._down_since_s = now_s
        elif wanted_nm >= self._most_nm + RATE_NM_S * REST_S:
            self._down_since_s = now_s
        return self._pushed(feedback, self._up_nm)

    def _pushed(self, feedback: Feedback, torque_nm: float) -> MitCommand:
        """Return the command that makes a torque, and brakes all movement."""
        held = self._gains.at(feedback.position_rad)
        return MitCommand(
            held.position_rad, 0.0, held.kp_nm_rad, held.kd_nm_s_rad, self._sign * torque_nm
        )


Confirmed: TypeAlias = Literal["confirmed", "stuck", "not_found", "apart"]

MOST_STROKES = 4
RUN_UP_RAD = 0.34
"""Longer than the zone in which slow jaws stick, some 0.2 rad, and long enough to reach the
speed."""
RUN_UP_WITHIN_S = 1.5
SPEED_RANGE_RAD_S = (0.34, 1.34)
"""Slower jaws may stick where a `close` from afar passes. Faster ones would only hit harder."""


@dataclass(frozen=True, slots=True)
class StrokePlan:
    """What all strokes of a calibration have in common."""

    config: MotionConfig
    rad_to_mm: float

    @property
    def speed_rad_s(self) -> float:
        """The configured speed, within what a stroke can use."""
        low, high = SPEED_RANGE_RAD_S
        return min(max(self.config.speed_mm_s / self.rad_to_mm, low), high)

    def stroke(self, sign: int) -> Stroke:
        """Return a stroke towards one side."""
        return Stroke(sign, self.config, self.speed_rad_s)


class Confirming:
    """Strokes towards one side (`sign` of the motor's radians), the first from where the jaws are.

    `stop_rad` is the latest find, at first the probe's.
    """

    def __init__(self, sign: int, found_rad: float, plan: StrokePlan) -> None:
        self.stop_rad = found_rad
        self.friction_nm = 0.0
        self._sign = sign
        self._plan = plan
        self._stroke = plan.stroke(sign)
        self.iterations = 1
        """The number of the present stroke."""
        self._backing_since_s: float | None = None
        self._pressing: Pressing | None = None

    def step(self, now_s: float, feedback: Feedback) -> tuple[MitCommand, Confirmed | None]:
        """Continue the stroke, the way back before the next stroke, or the press."""
        if self._pressing is not None:
            return self._press(self._pressing, now_s, feedback)
        command, verdict = self._stroke.step(now_s, feedback)
        if self._backing_since_s is not None:
            is_far = (self.stop_rad - feedback.position_rad) * self._sign >= RUN_UP_RAD
            is_late = now_s - self._backing_since_s >= RUN_UP_WITHIN_S
            if is_far or is_late or verdict is not None:
                self._backing_since_s = None
                self._stroke = self._plan.stroke(self._sign)
            return command, None
        if verdict is None:
            return command, None
        if verdict != "at_stop":
            return command, verdict
        self.friction_nm = max(self.friction_nm, self._stroke.friction_nm or 0.0)
        config, here_rad = self._plan.config, feedback.position_rad
        if abs(here_rad - self.stop_rad) <= config.stop_tol:
            self._pressing = Pressing(self._sign, here_rad, self.friction_nm, config)
            return command, None
        return command, self._again(now_s, feedback)

    def _press(
        self, pressing: Pressing, now_s: float, feedback: Feedback
    ) -> tuple[MitCommand, Confirmed | None]:
        command, verdict = pressing.step(now_s, feedback)
        if verdict is None:
            return command, None
        self._pressing = None
        if verdict == "held":
            return command, "confirmed"
        return command, verdict if verdict == "not_found" else self._again(now_s, feedback)

    def _again(self, now_s: float, feedback: Feedback) -> Confirmed | None:
        """Set the stop to here, and begin the way back for another stroke, if one is left."""
        self.stop_rad = feedback.position_rad
        if self.iterations >= MOST_STROKES:
            return "apart"
        self.iterations += 1
        self._backing_since_s = now_s
        self._stroke = self._plan.stroke(-self._sign)
        return None


Phase: TypeAlias = Literal[
    "probe_open", "probe_closed", "confirm_open", "confirm_closed", "back_off", "saving"
]

BACK_OFF_WITHIN_S = 1.0


class Calibrate(PlainAction):
    """Probes open, probes closed, confirms both, backs off by one probe step, saves."""

    def __init__(self, close_sign: int, config: MotionConfig, saving: Saving) -> None:
        self.bounds: Bounds | None = probe_bounds(config)
        self._close_sign = close_sign
        self._config = config
        self._saving = saving
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._phase: Phase = "probe_open"
        self._active: Probe | Confirming = Probe(-close_sign, config)
        self._plan = StrokePlan(config, saving.rad_to_mm)
        self._open_rad = 0.0
        self._closed_rad = 0.0
        self._friction_nm = 0.0
        self._backed_off_s = 0.0
        self._held_rad = 0.0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Probe, confirm, back off, or wait for the file."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        step = self._advance(now_s, motor, feedback)
        if step.command is not None:
            self._command_rad = step.command.position_rad
        if step.outcome is None:
            return step
        return replace(step, command=None)  # the following hold has other bounds

    def progress(self) -> Progress | None:
        """Return the phase, the probe's samples or the strokes, and where command and jaws are."""
        if self._feedback is None:
            return None
        iterations = self._active.iterations
        return progress_of(self._phase, iterations, 0, self._command_rad, self._feedback)

    def _advance(self, now_s: float, motor: MotorView, feedback: Feedback) -> Step:
        if self._phase == "saving":
            command = self._gains.at(self._held_rad)
            return replace(self._saving.step(now_s, motor), command=command)
        if self._phase == "back_off":
            return self._back_off(now_s, feedback)
        if isinstance(self._active, Probe):
            return self._feel(self._active, now_s, feedback)
        return self._confirm(self._active, now_s, feedback)

    def _feel(self, probe: Probe, now_s: float, feedback: Feedback) -> Step:
        command, verdict = probe.step(now_s, feedback)
        if verdict == "not_found":
            text = (
                f"the {self._side} stop was not met within {probe.iterations} samples: check that"
                " the jaws move freely, or raise calib_max_iter"
            )
            return Step(command, outcome=failed("not_found", text))
        if verdict == "found" and self._phase == "probe_open":
            self._open_rad = feedback.position_rad
            self._phase = "probe_closed"
            self._active = Probe(self._close_sign, self._config)
        elif verdict == "found":
            self._closed_rad = feedback.position_rad
            self._phase = "confirm_open"
            self._active = Confirming(-self._close_sign, self._open_rad, self._plan)
            config = self._config
            if abs(self._closed_rad - self._open_rad) >= config.calib_step_rad:
                return Step(command, outcome=self._judged())
            push_nm = min(config.calib_kp * config.calib_step_rad, config.calib_tau_limit)
            text = (
                f"the probe pushes with {push_nm:.2g} N·m, which did not move the jaws: clear their"
                " way and clean their guides, or raise calib_kp"
            )
            return Step(command, outcome=failed("not_found", text))
        return Step(command)

    def _confirm(self, confirming: Confirming, now_s: float, feedback: Feedback) -> Step:
        command, verdict = confirming.step(now_s, feedback)
        if verdict is None:
            return Step(command)
        if verdict != "confirmed":
            return Step(command, outcome=failed("not_confirmed", self._unconfirmed(verdict)))
        self._friction_nm = max(self._friction_nm, confirming.friction_nm)
        if self._phase == "confirm_open":
            self._open_rad = confirming.stop_rad
            self._phase = "confirm_closed"
            self._active = Confirming(self._close_sign, self._closed_rad, self._plan)
            return Step(command)
        self._closed_rad = confirming.stop_rad
        self._phase, self._backed_off_s = "back_off", now_s
        press_nm = self._config.stop_nm
        if self._friction_nm < press_nm:
            return Step(command)
        text = (
            f"moving the jaws takes {self._friction_nm:.2f} N·m, and a close presses with"
            f" {press_nm:.2f}, which would not reach the stop: clean the guides, or raise"
            " stop_lead_mm"
        )
        return Step(command, outcome=failed("not_confirmed", text))

    def _judged(self) -> ZeroResult | None:
        """Return a failure if the stops cannot be right, or None."""
        return self._saving.begin(self._closed_rad, self._open_rad, plausible=True)

    @property
    def _side(self) -> str:
        return "open" if self._phase.endswith("open") else "closed"

    def _unconfirmed(self, verdict: Confirmed) -> str:
        """Return why no stop can be saved, and what to do."""
        if verdict == "apart":
            what = f"{MOST_STROKES} strokes to the {self._side} stop ended at different places"
        elif verdict == "stuck":
            limit_nm = RUN_SHARE * self._config.calib_tau_limit
            what = f"{limit_nm:.2g} N·m do not move the jaws to the {self._side} stop"
        else:
            what = f"a stroke did not come to rest at the {self._side} stop"
        return f"{what}: clear the jaws' way and clean their guides, then try again"

    def _back_off(self, now_s: float, feedback: Feedback) -> Step:
        """Open by one probe step: the jaws must not stay pressed against each other."""
        step_rad = self._config.calib_step_rad
        backed_rad = (self._closed_rad - feedback.position_rad) * self._close_sign
        position_rad = feedback.position_rad - self._close_sign * step_rad
        if backed_rad < step_rad and now_s - self._backed_off_s < BACK_OFF_WITHIN_S:
            return Step(self._gains.at(position_rad))
        self._held_rad = feedback.position_rad
        self._phase = "saving"
        return Step(self._gains.at(self._held_rad), outcome=self._judged())


Side: TypeAlias = Literal["closed", "open"]


class CalibrateByHand(PlainAction):
    """Releases the jaws until `finish`; then saves what was marked."""

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
            text = sentence("{why}; mark them again", why=failure.message)
            return Refusal("out_of_limits", text)
        self._saving = saving
        return None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Keep the jaws slack."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        command = Slack().command(now_s, feedback)
        if self._saving is None:
            return Step(command)
        return replace(self._saving.step(now_s, motor), command=command)

    def progress(self) -> Progress | None:
        """Return how many stops are marked, and where the jaws are."""
        if self._feedback is None:
            return None
        phase = "by_hand" if self._saving is None else "saving"
        here_rad = self._feedback.position_rad
        return progress_of(phase, len(self.marks), 2, here_rad, self._feedback)
