"""The follower: its jaws go where a leader's are, as a share of its own travel.

It aligns to the first frame at a bounded speed, follows then with the leader's velocity fed
forward, holds its last target when frames stop coming, and aligns again when they come back. The
command's lead over the measured position is capped as in every motion: whatever the frames say,
the jaws are pushed by no more than that.
"""

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from litegripd.control.actions.base import Step, progress_of
from litegripd.control.gains import Gains
from litegripd.control.lead import lead_cap_rad, led
from litegripd.control.rest import Hold, Relax, Rest
from litegripd.control.teleop.base import TeleopAction, Tell
from litegripd.control.teleop.force_teller import ForceTeller
from litegripd.control.teleop.intake import Intake
from litegripd.control.teleop.link import Link
from litegripd.control.teleop.press_guard import PressGuard
from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.results import Progress, TeleopResult
from litegripd.model.teleop import LinkWish, TeleopSettings, TeleopStatus

Phase: TypeAlias = Literal["waiting", "aligning", "following", "stale", "released"]

MOST_NM = 5.5
"""By no more the jaws are pushed, however stiff the follow gains are: what the lead cap of 4 mm is
with the calibration's 100 N·m/rad."""

_STANDING_RAD_S = 0.05
"""Jaws that press on something are slower than this, 4 mm/s."""

_OTHERS_TOLD_EVERY_S = 5.0
_PHASE_TOLD_EVERY_S = 1.0
"""A bad network may take a leader away and bring it back many times a second."""


@dataclass(frozen=True, slots=True)
class Course:
    """What a follower is made of, besides its link: all that holds for its whole course."""

    geometry: Geometry
    config: MotionConfig
    gains: Gains
    settings: TeleopSettings
    sender: int = 0
    """What tells this follower from others to its leader, where it tells its force."""


class Follow(TeleopAction):
    """Follows until it is finished; leaves a hold behind, or, after a trip, free jaws."""

    def __init__(self, link: Link, wish: LinkWish, tell: Tell, course: Course) -> None:
        super().__init__(link, wish, tell)
        self._course = course
        self._intake = Intake(course.settings.watchdog_s)
        self._guard = PressGuard(course.settings.torque_limit_nm)
        self._teller = ForceTeller(link, course.sender)
        self._phase: Phase = "waiting"
        self._reference_rad: float | None = None
        self._commanded_rad: float | None = None
        self._dq_rad_s = 0.0
        self._is_limited = False
        self._stepped_s = 0.0
        self._phases_told_s: dict[Phase, float] = {}
        self._begins = 0
        self._others_told = 0
        self._others_told_s = float("-inf")

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Take what has come, and lead the jaws on."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self.loop.tick(now_s)
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
        if self.wish.reflects and is_new:
            self._tell_force(now_s, feedback)
        return Step(command)

    def rest(self) -> Rest | None:
        """Finished, it holds where the jaws are; broken off, what they press on is not dropped.

        Jaws on their way stop where they are. What the guard has let go of stays free: a hold
        would press it anew.
        """
        if self._guard.is_tripped:
            return Relax()
        feedback = self.feedback
        if self.is_finished or self._commanded_rad is None or feedback is None:
            return None
        if abs(feedback.velocity_rad_s) > _STANDING_RAD_S:
            return None
        return Hold(self._commanded_rad, self._course.gains)

    def progress(self) -> Progress | None:
        """Tell the phase, and where command and jaws are."""
        if self.feedback is None or self._commanded_rad is None:
            return None
        frames = self._intake.frames
        return progress_of(self._phase, frames, 0, self._commanded_rad, self.feedback)

    def result(self) -> TeleopResult:
        """Return what it has come to so far."""
        intake = self._intake
        return TeleopResult(
            True, "slave", intake.frames, intake.rejected, self.send_failed, self._guard.trips
        )

    def status(self, now_s: float) -> TeleopStatus:
        """Return how it goes; the opening is the leader's, in the frame that was followed last."""
        intake, frame = self._intake, self._intake.latest
        age_s = intake.age_s(now_s)
        return replace(
            self.base_status(),
            phase=self._phase,
            frames=intake.frames,
            last_frame_age_ms=None if age_s is None else age_s * 1e3,
            stale=intake.is_stale(now_s),
            openness=None if frame is None else frame.openness,
            position_mm=None if frame is None else frame.position_mm,
            force_n=None if frame is None else frame.force_n,
            dq_cmd=self._dq_rad_s,
            rejected=intake.rejected,
            out_of_order=intake.out_of_order,
            other_leaders=intake.other_leaders,
            late=intake.late,
            over_torque=self._guard.is_tripped,
            torque_trips=self._guard.trips,
            force_limited=self._is_limited,
            reflected_n=self._teller.told_n,
        )

    # The command of a tick

    def _command(self, now_s: float, elapsed_s: float, feedback: Feedback) -> MitCommand:
        """Return what the jaws are told, by the frames so far."""
        here_rad = feedback.position_rad
        self._is_limited = False
        if self._reference_rad is None:
            self._reference_rad = here_rad
        frame = self._intake.latest
        if frame is None:
            return self._led(self._reference_rad, 0.0, feedback)
        if self._guard.step(now_s, feedback.torque_nm, frame.openness):
            self._tell_guard(feedback.torque_nm, frame.openness)
        if self._guard.is_tripped:
            self._enter("released")
            self._reference_rad = self._commanded_rad = here_rad
            self._dq_rad_s = 0.0
            return Relax().command(now_s, feedback)
        if self._intake.is_stale(now_s):
            self._enter("stale")
            return self._led(self._reference_rad, 0.0, feedback)
        target_rad = self._target_rad(frame.openness)
        if self._intake.begins != self._begins:
            self._begins = self._intake.begins
            self._enter("aligning")
        if self._phase != "following":
            self._enter("aligning")
            self._align(target_rad, elapsed_s, here_rad)
            return self._led(self._reference_rad, 0.0, feedback)
        self._reference_rad = target_rad
        return self._led(target_rad, self._velocity_rad_s(now_s), feedback)

    def _align(self, target_rad: float, elapsed_s: float, here_rad: float) -> None:
        """Go towards the leader at a bounded speed, from where the jaws can be led."""
        geometry, config = self._course.geometry, self._course.config
        from_rad = self._reference_rad if self._reference_rad is not None else here_rad
        from_rad = led(from_rad, here_rad, self._lead_rad(from_rad, here_rad))
        step_rad = geometry.to_rad(config.speed_mm_s) * elapsed_s
        self._reference_rad = led(target_rad, from_rad, step_rad)
        if self._reference_rad == target_rad:
            self._enter("following")

    def _target_rad(self, openness: float) -> float:
        """Return where the leader's openness is in our own travel, and never beyond it."""
        geometry = self._course.geometry
        share = min(max(openness, 0.0), 1.0)
        return geometry.closed_rad - geometry.close_sign * share * geometry.travel_rad

    def _velocity_rad_s(self, now_s: float) -> float:
        """Return the leader's velocity in our own travel, bounded."""
        geometry, most_rad_s = self._course.geometry, self._course.settings.dq_max_rad_s
        rate_1_s = self._intake.rate_1_s(now_s)
        velocity_rad_s = -geometry.close_sign * rate_1_s * geometry.travel_rad
        return min(max(velocity_rad_s, -most_rad_s), most_rad_s)

    def _lead_rad(self, wanted_rad: float, here_rad: float) -> float:
        """Return how far the command may lead: less at the stop that lies ahead."""
        course = self._course
        geometry = course.geometry
        closing = (wanted_rad - here_rad) * geometry.close_sign > 0.0
        limit_rad = geometry.closed_rad if closing else geometry.open_rad
        cap_rad = lead_cap_rad(abs(limit_rad - here_rad), geometry, course.config)
        most_nm = MOST_NM
        if course.settings.force_limit_n is not None:
            most_nm = min(most_nm, course.settings.force_limit_n / FORCE_PER_TORQUE_N_NM)
        kp = course.gains.kp_nm_rad
        return min(cap_rad, most_nm / kp) if kp > 0.0 else cap_rad

    def _led(self, wanted_rad: float, velocity_rad_s: float, feedback: Feedback) -> MitCommand:
        """Return the command, its lead capped; the feed-forward gets what torque the lead leaves.

        From one tick to the next it steps by no more than the lead's cap either, unless the jaws
        themselves are elsewhere: frames that come late and at once do not turn it round.
        Damping relative to a velocity is a torque as well: jaws that are held up would be pushed
        by kd times the leader's whole speed. It may always brake.
        """
        gains, here_rad = self._course.gains, feedback.position_rad
        lead_rad, before_rad = self._lead_rad(wanted_rad, here_rad), self._commanded_rad
        self._is_limited = led(wanted_rad, here_rad, lead_rad) != wanted_rad
        step_to_rad = wanted_rad if before_rad is None else led(wanted_rad, before_rad, lead_rad)
        self._commanded_rad = led(step_to_rad, here_rad, lead_rad)
        if gains.kd_nm_s_rad > 0.0 and velocity_rad_s != 0.0:
            sign = 1.0 if velocity_rad_s > 0.0 else -1.0
            ahead_rad = sign * (self._commanded_rad - here_rad)
            left_nm = gains.kp_nm_rad * (lead_rad - ahead_rad)
            most_rad_s = sign * feedback.velocity_rad_s + left_nm / gains.kd_nm_s_rad
            velocity_rad_s = sign * min(sign * velocity_rad_s, max(most_rad_s, 0.0))
        self._dq_rad_s = velocity_rad_s
        return gains.at(self._commanded_rad, velocity_rad_s)

    # Telling

    def _tell_force(self, now_s: float, feedback: Feedback) -> None:
        """Tell the leader's hand what the jaws press with while they go where it wants them."""
        intake, frame = self._intake, self._intake.latest
        if frame is None:
            return
        is_felt = self._phase in ("aligning", "following")
        force_n = self._course.geometry.force_n(feedback.torque_nm) if is_felt else 0.0
        failed = self._teller.step(now_s, feedback, force_n, frame.timestamp_s, intake.source)
        self.send_failed += failed

    def _enter(self, phase: Phase) -> None:
        """Go on to another phase, and tell what a person wants to know of it."""
        before, self._phase = self._phase, phase
        told_s = self._phases_told_s.get(phase, float("-inf"))
        if phase == before or self._stepped_s - told_s < _PHASE_TOLD_EVERY_S:
            return
        self._phases_told_s[phase] = self._stepped_s
        if phase == "stale":
            text = f"no frame for {self._course.settings.watchdog_s:g} s: holding the last target"
            self.tell(text, warning=True, phase=phase)
        elif phase == "aligning":
            self.tell("the leader is heard: aligning", phase=phase)
        elif phase == "following":
            self.tell("aligned: following", phase=phase)

    def _tell_guard(self, torque_nm: float, openness: float) -> None:
        if self._guard.is_tripped:
            limit_nm = self._course.settings.torque_limit_nm
            text = (
                f"{abs(torque_nm):.2f} N·m, at or over the limit of {limit_nm:g}: the jaws are let"
                f" go until the leader, now {openness:.3g} open, has reopened"
            )
            self.tell(text, warning=True, trips=self._guard.trips)
        else:
            self.tell("the leader has reopened: the torque guard is armed again")

    def _note_others(self, now_s: float) -> None:
        """Tell of a second leader, but not all the time."""
        count = self._intake.other_leaders
        is_due = now_s - self._others_told_s >= _OTHERS_TOLD_EVERY_S
        if is_due and count > self._others_told:
            self._others_told, self._others_told_s = count, now_s
            text = (
                f"frames of a second leader, or of a clock that was set back ({count} so far),"
                " are not followed"
            )
            self.tell(text, warning=True, other_leaders=count)
