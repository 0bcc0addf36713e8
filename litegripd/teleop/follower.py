"""The follower: its jaws go where a leader's are, as a share of its own travel.

It aligns to the first frame at a bounded speed. Then it follows, and feeds the leader's velocity
forward as far as the bounds allow. It holds its last target when frames stop, and aligns again when
they return. The command's lead over the measured position is capped as in every motion, whatever
the frames say. Damping relative to a velocity is also a torque: it would push blocked jaws with kd
times the leader's whole speed.

Jaws that stand and press with more than a press, while the leader stays closed, press with no more
than that after a while: a hand at a leader does not feel a finger between the jaws. A force limit
that the caller sets is what may last instead.

A guard releases what the jaws press too hard for too long. Its times and thresholds are those of
the vendor's SDK, but in seconds instead of cycles: they are the same at every rate.
"""

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from litegripd.control.detectors import STILL_RAD_S, Lasting, SpeedWindow
from litegripd.control.holds import Hold, Idle, Slack
from litegripd.control.limiter import (
    CALM_KD_NM_S_RAD,
    Easing,
    Gains,
    budgeted,
    clamp_lead,
    is_in_press_zone,
)
from litegripd.control.motions.base import Step, progress_of
from litegripd.control.motions.move import SPEED_UP_RAD_S2, SPEED_UP_S
from litegripd.model.gripper import FASTEST_RAD_S, Geometry
from litegripd.model.motion_config import MOVING_KP_NM_RAD, REACHING_KP_NM_RAD, MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.state import Progress, TeleopResult
from litegripd.model.teleop import (
    ForceFrame,
    LinkOptions,
    TeleopSettings,
    TeleopStatus,
    encode_force,
)
from litegripd.teleop.intake import MOST_ROUND_TRIP_S, Intake
from litegripd.teleop.link import Link, ReportEvent, TeleopAction
from litegripd.teleop.ready import ReadySender

_SAMPLES = 3
"""A measured velocity is a tick or two old. Used at once, it would make the jaws shake from tick to
tick; the slowest of this many values does not."""

_SLOWEST_RAD_S = 1e-3

_STANDS_S = 0.05
_FREE_RAD_S = 0.15
_FREE_S = 0.05
"""Eased jaws that are this fast, 8 mm/s, meet nothing any more: what yields by itself is slower.
Free jaws come to 0.25 rad/s against the largest friction considered."""


class FollowerCommand:
    """Makes the commands of one follower.

    With `force_limit_n`, stiffness and damping have a budget (`control/limiter.py`): jaws that are
    stopped suddenly are pushed with at most that force, at any speed of the leader.
    """

    def __init__(
        self,
        geometry: Geometry,
        config: MotionConfig,
        gains: Gains,
        force_limit_n: float | None,
        period_s: float,
    ) -> None:
        self.is_limited = False
        self.velocity_rad_s = 0.0
        self.hold: Hold | None = None
        """The command that keeps pressing as the latest one did, None before the first one."""
        self._geometry = geometry
        self._config = config
        self._gains = gains
        self._period_s = period_s
        limit_nm = None if force_limit_n is None else geometry.torque_nm(force_limit_n)
        self._limit_nm = None if limit_nm is None else min(limit_nm, config.travel_nm)
        self._measured: deque[float] = deque(maxlen=_SAMPLES)
        self._window = SpeedWindow(_STANDS_S)
        self._free = Lasting(_FREE_S)
        self._easing = Easing()

    @property
    def commanded_rad(self) -> float | None:
        """The position of the latest command, None before the first one."""
        return None if self.hold is None else self.hold.position_rad

    def let_go(self, here_rad: float) -> None:
        """Start again at the position of the slack jaws."""
        self.hold = Hold(here_rad, self._gains)
        self.velocity_rad_s = 0.0
        self.is_limited = False
        self._easing.reset()

    def within_reach(self, wanted_rad: float, here_rad: float) -> float:
        """Return how far towards `wanted_rad` the command can lead jaws at rest at `here_rad`."""
        _, lead_rad = self._bounds(wanted_rad, 0.0, here_rad)
        return clamp_lead(wanted_rad, here_rad, lead_rad)

    def command(self, wanted_rad: float, velocity_rad_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick.

        The step from one tick to the next also stays within the lead's cap, and within the speed
        of every motion, unless the jaws themselves are elsewhere: frames that arrive late and
        together do not turn the command round.
        """
        # What is fed grows as slowly as in a move, and falls at once: frames that leap to and fro
        # would shake the jaws.
        most_rad_s = max(
            math.copysign(self.velocity_rad_s, velocity_rad_s * self.velocity_rad_s), 0.0
        )
        most_rad_s = min(most_rad_s + SPEED_UP_RAD_S2 * self._period_s, FASTEST_RAD_S)
        velocity_rad_s = min(max(velocity_rad_s, -most_rad_s), most_rad_s)
        here_rad = feedback.position_rad
        before_rad = here_rad if self.hold is None else self.hold.position_rad
        self._measured.append(feedback.velocity_rad_s)
        gains, lead_rad = self._bounds(wanted_rad, velocity_rad_s, here_rad)
        lead_rad = self._eased(feedback, wanted_rad, gains, lead_rad)
        self.is_limited = clamp_lead(wanted_rad, here_rad, lead_rad) != wanted_rad
        if self.is_limited and self._limit_nm is None:  # they must not creep behind their leader
            gains = Gains(gains.kp_nm_rad, min(gains.kd_nm_s_rad, CALM_KD_NM_S_RAD))
        most_rad = min(lead_rad, FASTEST_RAD_S * self._period_s)
        step_to_rad = clamp_lead(wanted_rad, before_rad, most_rad)
        commanded_rad = clamp_lead(step_to_rad, here_rad, lead_rad)
        if self._limit_nm is None:
            ahead_rad = commanded_rad - here_rad
            velocity_rad_s = self._fed(velocity_rad_s, gains, lead_rad, ahead_rad)
        self.velocity_rad_s = velocity_rad_s
        self.hold = Hold(commanded_rad, gains, self._limit_nm)
        return gains.at(commanded_rad, velocity_rad_s)

    def _eased(self, feedback: Feedback, wanted_rad: float, gains: Gains, lead_rad: float) -> float:
        """Return the largest lead: smaller for jaws that have pressed on something for long."""
        here_rad, at_s = feedback.position_rad, feedback.at_s
        speed_rad_s = self._window.add(at_s, here_rad)
        if self._limit_nm is not None:
            return lead_rad
        ahead_rad = clamp_lead(wanted_rad, here_rad, lead_rad) - here_rad
        runs = speed_rad_s is not None and speed_rad_s * ahead_rad > _FREE_RAD_S * abs(ahead_rad)
        if self._free.step(runs, at_s):
            self._easing.reset()
        stands = speed_rad_s is not None and abs(speed_rad_s) < STILL_RAD_S
        asked_nm = gains.kp_nm_rad * ahead_rad
        most_nm = self._easing.step(
            at_s, asked_nm, self._config.stop_nm, feedback.torque_nm, stands=stands
        )
        return lead_rad if abs(asked_nm) <= most_nm else most_nm / gains.kp_nm_rad

    def _bounds(
        self, wanted_rad: float, velocity_rad_s: float, here_rad: float
    ) -> tuple[Gains, float]:
        """Return the gains and the command's largest lead: smaller towards a stop ahead."""
        geometry, gains = self._geometry, self._gains
        closing = (wanted_rad - here_rad) * geometry.close_sign > 0.0
        limit_rad = geometry.closed_rad if closing else geometry.open_rad
        config = self._config
        presses = is_in_press_zone(abs(limit_rad - here_rad), geometry, config)
        push_nm = config.stop_nm if presses else config.travel_nm
        usual_kp = min(max(gains.kp_nm_rad, REACHING_KP_NM_RAD), MOVING_KP_NM_RAD)  # kp may be 0
        cap_rad = push_nm / usual_kp
        if self._limit_nm is None:
            if gains.kp_nm_rad <= usual_kp:
                return gains, cap_rad
            # Far behind, the command follows the measured jaws: stiff gains would shake them. So
            # the lead grows instead, with the same torque.
            lead_rad = min(max(abs(wanted_rad - here_rad), push_nm / gains.kp_nm_rad), cap_rad)
            return Gains(push_nm / lead_rad, gains.kd_nm_s_rad), lead_rad
        speed_rad_s = max(abs(velocity_rad_s), _SLOWEST_RAD_S)
        gains, lead_rad = budgeted(self._limit_nm, speed_rad_s, gains, self._period_s)
        return gains, min(cap_rad, lead_rad)

    def _fed(self, velocity_rad_s: float, gains: Gains, lead_rad: float, ahead_rad: float) -> float:
        """Return how much of the leader's velocity is fed forward: what torque the lead leaves.

        It may always brake.
        """
        kd = gains.kd_nm_s_rad
        if kd == 0.0 or velocity_rad_s == 0.0:
            return velocity_rad_s
        sign = 1.0 if velocity_rad_s > 0.0 else -1.0
        left_nm = gains.kp_nm_rad * (lead_rad - sign * ahead_rad)
        slowest_rad_s = min(sign * measured_rad_s for measured_rad_s in self._measured)
        return sign * min(sign * velocity_rad_s, max(slowest_rad_s + left_nm / kd, 0.0))


TELL_EVERY_S = 0.01
"""A hundred times a second: more than a hand can feel."""
_EARLY_S = 0.00025


class ForceReporter:
    """Sends a force frame every `TELL_EVERY_S`.

    `sender` is the number by which a leader of several followers knows this one.
    """

    def __init__(self, link: Link, sender: int) -> None:
        self.reported_n: float | None = None
        """The latest reported value, None while nothing is reported."""
        self._link = link
        self._sender = sender
        self._next_s = float("-inf")

    def step(
        self, now_s: float, feedback: Feedback, force_n: float, echo_s: float, leader: str
    ) -> bool:
        """Send `force_n` to the leader if it is due; return True if that failed."""
        if now_s < self._next_s - _EARLY_S:
            return False
        self._next_s = now_s + TELL_EVERY_S
        frame = ForceFrame(self._sender, force_n, feedback.at_s, echo_s)
        self.reported_n = force_n
        return not self._link.reply(encode_force(frame), leader, now_s)


TRIP_AFTER_S = 0.06
REARM_OPENNESS = 0.05
RELEASE_AT_LEAST_S = 0.2
"""After a trip the guard releases for at least this time: otherwise a leader at the open stop would
re-arm the guard in the tick of its trip."""


class PressGuard:
    """Trips when the jaws press too hard; a limit of 0 switches it off.

    While `is_tripped`, the jaws must have no stiffness and no damping.
    """

    def __init__(self, limit_nm: float) -> None:
        self.is_tripped = False
        self.trips = 0
        self._limit_nm = limit_nm
        self._over_since_s: float | None = None
        self._tripped_s = 0.0
        self._rearm_openness = 0.0

    def step(self, now_s: float, torque_nm: float, openness: float) -> bool:
        """Take this tick's torque and the leader's openness; return True if the state has changed.

        It re-arms when the leader has reopened by `REARM_OPENNESS` since the trip. Near full open,
        where that way is missing, it re-arms at the open stop.
        """
        if self._limit_nm <= 0.0:
            return False
        if self.is_tripped:
            rested = now_s - self._tripped_s >= RELEASE_AT_LEAST_S * 0.999
            if not rested or openness < self._rearm_openness:
                return False
            self.is_tripped, self._over_since_s = False, None
            return True
        if abs(torque_nm) < self._limit_nm:
            self._over_since_s = None
            return False
        if self._over_since_s is None:
            self._over_since_s = now_s
        if now_s - self._over_since_s < TRIP_AFTER_S * 0.999:
            return False
        self.is_tripped, self._tripped_s = True, now_s
        self.trips += 1
        self._rearm_openness = min(openness + REARM_OPENNESS, 1.0)
        return True


Phase: TypeAlias = Literal["waiting", "aligning", "following", "stale", "released"]

_SILENT_S = 3.0
"""After this time without a frame, the leader is missing or elsewhere: no short disturbance."""
_OTHERS_REPORTED_EVERY_S = 5.0
_PHASE_REPORTED_EVERY_S = 1.0
"""A bad network may lose and find a leader many times a second."""


@dataclass(frozen=True, slots=True)
class Course:
    """The parts of a follower besides its link: constant while it runs."""

    geometry: Geometry
    config: MotionConfig
    gains: Gains
    settings: TeleopSettings
    period_s: float
    sender: int = 0
    """Identifies this follower to its leader when it reports its force."""


class TeleopFollower(TeleopAction):
    """Follows until it is finished; leaves a hold behind or, after a trip, free jaws."""

    def __init__(
        self, link: Link, options: LinkOptions, report: ReportEvent, course: Course
    ) -> None:
        super().__init__(link, options, report)
        self._course = course
        self._intake = Intake(course.settings.watchdog_s)
        self._guard = PressGuard(course.settings.torque_limit_nm)
        self._force_reporter = ForceReporter(link, course.sender)
        self._ready = ReadySender(link, course.settings.ready_period_s)
        self._phase: Phase = "waiting"
        self._reference_rad: float | None = None
        self._ahead_rad = 0.0
        """By how much the leader was ahead of the reference in the tick before, while aligning."""
        self._align_rad_s = 0.0
        self._leading = FollowerCommand(
            course.geometry,
            course.config,
            course.gains,
            course.settings.force_limit_n,
            course.period_s,
        )
        self._began_s: float | None = None
        self._stepped_s = 0.0
        self._phases_reported_s: dict[Phase, float] = {}
        self._begins = 0
        self._others_reported = 0
        self._others_reported_s = float("-inf")

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Take the frames that have arrived, and move the jaws on."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self.loop.tick(now_s)
        self._began_s = now_s if self._began_s is None else self._began_s
        self.note_link()
        is_new = self.feedback is None or feedback.at_s > self.feedback.at_s
        self.send_failed += not is_new
        self.feedback = feedback
        for arrival in self.link.receive(now_s):
            self._intake.take(arrival)
        self._note_others(now_s)
        elapsed_s = max(now_s - self._stepped_s, 0.0) if self._reference_rad is not None else 0.0
        self._stepped_s = now_s
        command = self._command(now_s, elapsed_s, feedback)
        self._ready.step(now_s, is_ready=self._is_ready(feedback.position_rad))
        if self.options.reflects and is_new:
            self._report_force(now_s, feedback)
        return Step(command)

    def close(self) -> None:
        """Tell the leader that nobody follows now, and release the link."""
        self._ready.end(self._stepped_s)
        super().close()

    def idle_after(self) -> Idle | None:
        """Finished, it holds the jaws where they are; interrupted, it keeps what they press on.

        Moving jaws stop where they are. After a trip the jaws stay free: a hold would press again.
        """
        if self._guard.is_tripped:
            return Slack()
        feedback = self.feedback
        hold = self._leading.hold
        if self.is_finished or hold is None or feedback is None or not hold.presses(feedback):
            return None
        return hold

    def progress(self) -> Progress | None:
        """Return the phase, and the positions of command and jaws."""
        commanded_rad = self._leading.commanded_rad
        if self.feedback is None or commanded_rad is None:
            return None
        return progress_of(self._phase, self._intake.frames, 0, commanded_rad, self.feedback)

    def result(self) -> TeleopResult:
        """Return the result so far."""
        intake = self._intake
        return TeleopResult(
            True, "slave", intake.frames, intake.rejected, self.send_failed, self._guard.trips
        )

    def status(self, now_s: float) -> TeleopStatus:
        """Return the status; the opening is the leader's, in the latest frame that was followed."""
        intake, frame = self._intake, self._intake.latest
        age_s = intake.age_s(now_s)
        reach, is_heard = self.link.status.reach, bool(intake.frames) and not intake.is_stale(now_s)
        return replace(
            self.base_status(),
            phase=self._phase,
            link_reach=None if reach is None else "frames" if is_heard else reach.state,
            link_unreached=None if reach is None or is_heard else reach.problem(now_s),
            frames=intake.frames,
            last_frame_age_ms=None if age_s is None else age_s * 1e3,
            stale=intake.is_stale(now_s),
            openness=0.0 if frame is None else frame.openness,
            position_mm=0.0 if frame is None else frame.position_mm,
            force_n=0.0 if frame is None else frame.force_n,
            dq_cmd=self._leading.velocity_rad_s,
            rejected=intake.rejected,
            out_of_order=intake.out_of_order,
            other_leaders=intake.other_leaders,
            late=intake.late,
            over_torque=self._guard.is_tripped,
            torque_trips=self._guard.trips,
            ready=self._ready.is_ready,
            ready_pubs=self._ready.sent,
            force_limited=self._leading.is_limited,
            reflected_n=self._force_reporter.reported_n,
        )

    def complaint(self) -> str | None:
        """Return a warning that the leader is silent, once that has lasted."""
        intake, began_s, now_s = self._intake, self._began_s, self._stepped_s
        if began_s is None:
            return None
        age_s = intake.age_s(now_s)
        silent_s = now_s - began_s if age_s is None else age_s
        if silent_s < _SILENT_S:
            return None
        never = "" if intake.frames else " yet"
        where = "" if self.options.host is None else f" at {self.options.host}"
        reach = self.link.status.reach
        problem = None if reach is None else reach.problem(now_s)
        why = "" if problem is None else f": it is not reached, {problem}"
        return (
            f"teleoperation: nothing heard{never} from a leader{where}, port {self.options.port},"
            f" for {silent_s:.0f} s{why}"
        )

    # The command of a tick

    def _command(self, now_s: float, elapsed_s: float, feedback: Feedback) -> MitCommand:
        """Return this tick's command, from the frames so far."""
        here_rad = feedback.position_rad
        lead = self._leading.command
        if self._reference_rad is None:
            self._reference_rad = here_rad
        frame = self._intake.latest
        if frame is None:
            return lead(self._reference_rad, 0.0, feedback)
        openness = min(max(frame.openness, 0.0), 1.0)  # nothing is followed beyond the travel
        if self._guard.step(now_s, feedback.torque_nm, openness):
            self._report_guard(feedback.torque_nm, openness)
        if self._guard.is_tripped:
            self._enter("released")
            self._reference_rad = here_rad
            self._leading.let_go(here_rad)
            return Slack().command(now_s, feedback)
        if self._intake.is_stale(now_s):
            self._enter("stale")
            return lead(self._reference_rad, 0.0, feedback)
        target_rad = self._course.geometry.position_rad(openness)
        aligns = self._course.settings.align
        if self._intake.begins != self._begins:
            self._begins, self._ahead_rad = self._intake.begins, 0.0
            self._align_rad_s = 0.0
            self._enter("aligning" if aligns else "following")
        if aligns and self._phase != "following":
            if self._phase != "aligning":
                self._ahead_rad = self._align_rad_s = 0.0
            self._enter("aligning")
            velocity_rad_s = self._align(target_rad, elapsed_s, here_rad)
            return lead(self._reference_rad, velocity_rad_s, feedback)
        self._enter("following")
        self._reference_rad = target_rad
        return lead(target_rad, self._velocity_rad_s(now_s), feedback)

    def _align(self, target_rad: float, elapsed_s: float, here_rad: float) -> float:
        """Go towards the leader at a bounded speed, from a position that can lead the jaws.

        Returns the velocity of the way there, 0 once it has been met.
        """
        geometry, config = self._course.geometry, self._course.config
        from_rad = self._reference_rad if self._reference_rad is not None else here_rad
        from_rad = self._leading.within_reach(from_rad, here_rad)
        most_rad_s = geometry.to_rad(config.speed_mm_s)
        self._align_rad_s = min(self._align_rad_s + most_rad_s * elapsed_s / SPEED_UP_S, most_rad_s)
        step_rad, ahead_rad = self._align_rad_s * elapsed_s, target_rad - from_rad
        if self._ahead_rad * ahead_rad < 0.0 and abs(ahead_rad) <= FASTEST_RAD_S * elapsed_s:
            self._reference_rad = target_rad  # it came towards the jaws, and passed them
        else:
            self._reference_rad = clamp_lead(target_rad, from_rad, step_rad)
        self._ahead_rad = target_rad - self._reference_rad
        if self._reference_rad == target_rad:
            self._enter("following")
            return 0.0
        return math.copysign(min(self._align_rad_s, self._course.settings.dq_max_rad_s), ahead_rad)

    def _velocity_rad_s(self, now_s: float) -> float:
        """Return the leader's velocity in our own travel, within bounds."""
        geometry, most_rad_s = self._course.geometry, self._course.settings.dq_max_rad_s
        rate_1_s = self._intake.rate_1_s(now_s)
        velocity_rad_s = -geometry.close_sign * rate_1_s * geometry.travel_rad
        return min(max(velocity_rad_s, -most_rad_s), most_rad_s)

    def _is_ready(self, here_rad: float) -> bool:
        """Return True if the jaws follow, and are where the leader's are."""
        if self._phase != "following" or self._reference_rad is None:
            return False
        apart_mm = abs(self._reference_rad - here_rad) * self._course.geometry.rad_to_mm
        return apart_mm <= self._course.settings.ready_tolerance_mm

    # Reports

    def _report_force(self, now_s: float, feedback: Feedback) -> None:
        """Report the jaws' force to the leader's hand while the jaws go where it wants them.

        No report goes to a silent leader, nor to one that would reject the force as late: if its
        frames were forged, the answers would go to somebody who has not asked for them.
        """
        intake, frame, age_s = self._intake, self._intake.latest, self._intake.age_s(now_s)
        if frame is None or age_s is None or age_s >= MOST_ROUND_TRIP_S or intake.is_stale(now_s):
            self._force_reporter.reported_n = None
            return
        is_felt = self._phase in ("aligning", "following")
        force_n = self._course.geometry.force_n(feedback.torque_nm) if is_felt else 0.0
        failed = self._force_reporter.step(
            now_s, feedback, force_n, frame.timestamp_s, intake.source
        )
        self.send_failed += failed

    def _enter(self, phase: Phase) -> None:
        """Enter another phase, and report what a person needs to know about it."""
        before, self._phase = self._phase, phase
        reported_s = self._phases_reported_s.get(phase, float("-inf"))
        if phase == before or self._stepped_s - reported_s < _PHASE_REPORTED_EVERY_S:
            return
        self._phases_reported_s[phase] = self._stepped_s
        if phase == "stale":
            text = f"no frame for {self._course.settings.watchdog_s:g} s: holding the last target"
            self.report(text, warning=True, phase=phase)
        elif phase == "aligning":
            self.report("the leader is heard: aligning", phase=phase)
        elif phase == "following":
            how = "aligned" if self._course.settings.align else "the leader is heard"
            self.report(f"{how}: following", phase=phase)

    def _report_guard(self, torque_nm: float, openness: float) -> None:
        if self._guard.is_tripped:
            limit_nm = self._course.settings.torque_limit_nm
            text = (
                f"{abs(torque_nm):.2f} N·m, at or over the limit of {limit_nm:g}: the jaws are let"
                f" go until the leader, now {openness:.3g} open, has reopened"
            )
            self.report(text, warning=True, trips=self._guard.trips)
        else:
            self.report("the leader has reopened: the torque guard is armed again")

    def _note_others(self, now_s: float) -> None:
        """Report a second leader, but not all the time."""
        count = self._intake.other_leaders
        is_due = now_s - self._others_reported_s >= _OTHERS_REPORTED_EVERY_S
        if is_due and count > self._others_reported:
            self._others_reported, self._others_reported_s = count, now_s
            text = (
                f"frames of a second leader, or of a clock that was set back ({count} so far),"
                " are not followed"
            )
            self.report(text, warning=True, other_leaders=count)
