"""The leader: its jaws are slack, a hand moves them, and their openness is published.

Until a follower is ready they hold where they are (`ready.py`), with the command and the bounds of
a follower that waits for its leader.

A frame leaves in the tick in which its measurement came, and never twice: a leader whose motor does
not answer is silent, so that its followers know.

On request, the jaws push back a little with the followers' force (`PushBack`). The hand is a
person's, and the force comes over a network: the torque is small, and begins and ends gently. It
never does more work on the hand than the hand has done on the jaws before, except for an allowance
too small to feel. So the loop through the network cannot feed an oscillation, whatever the delay:
seen from the hand, the jaws are passive (time-domain passivity, with the energy counted at the
leader's own motor).
"""

import math
from dataclasses import replace

from litegripd.control.holds import Slack
from litegripd.control.motions.base import Step, progress_of
from litegripd.model.gripper import FASTEST_RAD_S, Geometry
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.state import Progress, TeleopResult
from litegripd.model.teleop import (
    LinkOptions,
    TeleopFrame,
    TeleopSettings,
    TeleopStatus,
    encode_frame,
)
from litegripd.teleop.follower import FollowerCommand
from litegripd.teleop.intake import ForceIntake
from litegripd.teleop.link import Link, ReportEvent, TeleopAction
from litegripd.teleop.ready import ReadyGate

MOST_N = 10.0
"""No leader pushes back with more, on any request: a finger holds it without effort."""

DEAD_BAND_N = 2.0
"""A follower measures this as its own friction (0.15 to 0.21 N·m) with empty jaws."""

RAMP_S = 0.1
"""From nothing to the most, and from the most to nothing when no follower is heard any more."""

FASTEST_MM_S = 100.0
"""Released jaws are pushed no faster: damping in the motor ensures it, where there is no delay."""

GRANT_J = 0.005
"""What may be given before anything was taken: 10 N along 0.5 mm. With much less, the position's
quantum alone would switch the torque on and off."""

MOST_STORED_J = 0.05
"""Energy taken longer ago is not given back: 10 N along 5 mm."""

_SMOOTHING_S = 0.02
_LONGEST_TICK_S = 0.05


class PushBack:
    """Makes the leader's command. `most_n` is 0 to `MOST_N`; `gain` the share of the force felt."""

    def __init__(self, most_n: float, gain: float, geometry: Geometry) -> None:
        self.force_n = 0.0
        """The force with which the jaws push now, opening positive."""
        self._most_n = min(most_n, MOST_N)
        self._gain = gain
        self._geometry = geometry
        self._smooth_n = 0.0
        self._ramped_n = 0.0
        self._stored_j = 0.0
        self._share = 1.0
        self._was_s: float | None = None
        self._was_rad = 0.0

    def step(self, now_s: float, felt_n: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick; `felt_n` is the followers' force, squeezing positive."""
        elapsed_s = 0.0 if self._was_s is None else max(now_s - self._was_s, 0.0)
        moved_rad = 0.0 if self._was_s is None else feedback.position_rad - self._was_rad
        self._was_s, self._was_rad = now_s, feedback.position_rad
        gave_j = self._torque_nm(self.force_n) * moved_rad
        self._stored_j = min(self._stored_j - gave_j, MOST_STORED_J)
        elapsed_s = min(elapsed_s, _LONGEST_TICK_S)
        self._ramp(felt_n, elapsed_s)
        # A hand that presses against it may get all of the force. Its share drops at once when no
        # work is left to give back, and returns by the ramp.
        is_against = self._torque_nm(self._ramped_n) * moved_rad < 0.0
        left = 1.0 if is_against else min(max(self._stored_j / GRANT_J + 1.0, 0.0), 1.0)
        self._share = min(left, self._share + elapsed_s / RAMP_S)
        self.force_n = self._ramped_n * self._share
        torque_nm = self._torque_nm(self.force_n)
        fastest_rad_s = min(self._geometry.to_rad(FASTEST_MM_S), FASTEST_RAD_S)
        kd_nm_s_rad = abs(torque_nm) / fastest_rad_s
        return MitCommand(feedback.position_rad, 0.0, 0.0, kd_nm_s_rad, torque_nm)

    def _ramp(self, felt_n: float, elapsed_s: float) -> None:
        """Go towards the wanted force: smoothed, bounded, and no faster than the ramp."""
        beyond_n = math.copysign(max(abs(felt_n) - DEAD_BAND_N, 0.0), felt_n)
        wanted_n = min(max(self._gain * beyond_n, -self._most_n), self._most_n)
        share = 1.0 - math.exp(-elapsed_s / _SMOOTHING_S)
        self._smooth_n += share * (wanted_n - self._smooth_n)
        step_n = self._most_n * elapsed_s / RAMP_S
        self._ramped_n += min(max(self._smooth_n - self._ramped_n, -step_n), step_n)
        if wanted_n == 0.0 and abs(self._ramped_n) < 1e-3:  # too little to pack: a new contact
            self._smooth_n = self._ramped_n = self._stored_j = 0.0
            self._share = 1.0

    def _torque_nm(self, force_n: float) -> float:
        """Return the motor's torque for a force that opens the jaws."""
        return -self._geometry.close_sign * self._geometry.torque_nm(force_n)


_EARLY_S = 0.00025
"""A tick that is early by this little counts as the one that is due."""


class TeleopLeader(TeleopAction):
    """Publishes `rate_hz` times a second; when it ends, the jaws hold where they are."""

    def __init__(
        self,
        link: Link,
        options: LinkOptions,
        report: ReportEvent,
        *,
        geometry: Geometry,
        rate_hz: float,
        settings: TeleopSettings,
        holding: FollowerCommand,
    ) -> None:
        """Store the collaborators; `holding` makes the commands until a follower is ready."""
        super().__init__(link, options, report)
        self._geometry = geometry
        self._every_s = 1.0 / rate_hz
        self._settings = settings
        self._gate = ReadyGate(
            settings.ready_timeout_s, is_required=settings.require_ready and options.has_ready
        )
        self._holding = holding
        self._held_rad: float | None = None
        self._forces = ForceIntake()
        self._push = PushBack(settings.reflect_n, settings.reflect_gain, geometry)
        self._due_s: float | None = None
        self._frame: TeleopFrame | None = None
        self._sent_s = 0.0
        self._frames = 0

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Hold the jaws, or keep them slack except for the felt force; publish the measurement."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self.loop.tick(now_s)
        for arrival in self.link.receive(now_s):  # this also brings the link's status
            if not (self.options.has_ready and self._gate.take(arrival.payload)):
                self._forces.take(arrival, now_s)
        self.note_link()
        is_new = self.feedback is None or feedback.at_s > self.feedback.at_s
        self.feedback = feedback
        may_leave = self.link.status.state != "opening"
        if is_new and may_leave and self._is_due(now_s):
            self._publish(now_s, feedback)
        if self._gate.step(now_s):
            self._report_open()
        return Step(self._command(now_s, feedback))

    def progress(self) -> Progress | None:
        """Return where the jaws are."""
        feedback = self.feedback
        if feedback is None:
            return None
        return progress_of(self._phase, self._frames, 0, feedback.position_rad, feedback)

    def result(self) -> TeleopResult:
        """Return the result so far."""
        return TeleopResult(
            True, "master", self._frames, self._forces.rejected, self.send_failed, 0
        )

    def status(self, now_s: float) -> TeleopStatus:
        """Return the status."""
        status, frame, forces = self.base_status(), self._frame, self._forces
        reach = self.link.status.reach
        status = replace(
            status,
            phase=self._phase,
            ready=self._gate.is_ready,
            ready_rx=self._gate.heard,
            ready_timed_out=self._gate.has_timed_out,
            rejected=forces.rejected,
            link_reach=None if reach is None else reach.state,
            link_unreached=None if reach is None else reach.problem(now_s),
        )
        if self.options.reflects:
            trip_s = forces.round_trip_s if forces.followers(now_s) else None
            status = replace(
                status,
                reflected_n=self._push.force_n,
                followers=forces.followers(now_s),
                round_trip_ms=None if trip_s is None else trip_s * 1e3,
                out_of_order=forces.out_of_order,
                late=forces.late,
            )
        if frame is None:
            return status
        return replace(
            status,
            frames=self._frames,
            last_frame_age_ms=(now_s - self._sent_s) * 1e3,
            openness=frame.openness,
            position_mm=frame.position_mm,
            force_n=frame.force_n,
        )

    def _command(self, now_s: float, feedback: Feedback) -> MitCommand:
        """Return jaws that hold, slack ones, or those that push back with the followers' force."""
        if not self._gate.is_open:
            self._held_rad = feedback.position_rad if self._held_rad is None else self._held_rad
            return self._holding.command(self._held_rad, 0.0, feedback)
        if not self.options.reflects:
            return Slack().command(now_s, feedback)
        return self._push.step(now_s, self._forces.force_n(now_s), feedback)

    @property
    def _phase(self) -> str:
        return "leading" if self._gate.is_open else "waiting"

    def _report_open(self) -> None:
        if not self._gate.has_timed_out:
            self.report("a follower is ready: the jaws are slack now", ready=True)
            return
        text = (
            f"no follower was ready within {self._settings.ready_timeout_s:g} s: the jaws are slack"
            " now; there is none, it has not aligned, or it is too old to say so"
        )
        self.report(text, warning=True, ready=False)

    def _is_due(self, now_s: float) -> bool:
        """Keep the rate on average; missed frames are not made up for."""
        due_s = now_s if self._due_s is None else self._due_s
        if now_s < due_s - _EARLY_S:
            return False
        self._due_s = max(due_s + self._every_s, now_s)
        return True

    def _publish(self, now_s: float, feedback: Feedback) -> None:
        geometry, position_rad = self._geometry, feedback.position_rad
        self._frame = TeleopFrame(
            geometry.openness(position_rad),
            geometry.opening_mm(position_rad),
            geometry.force_n(feedback.torque_nm),
            feedback.at_s,
        )
        self._sent_s = now_s
        if self.link.publish(encode_frame(self._frame), now_s):
            self._frames += 1
        else:
            self.send_failed += 1
