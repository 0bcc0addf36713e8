"""The leader: its jaws are slack, a hand moves them, and how far they are open is published.

A frame goes out in the tick in which its measurement came, and never twice: a leader whose motor
does not answer falls silent, so that its followers know. Where it is wished for, the jaws push back
a little with what the followers press with (`push_back`).
"""

from dataclasses import replace

from litegripd.control.actions.base import Step, progress_of
from litegripd.control.rest import Relax
from litegripd.control.teleop.base import TeleopAction, Tell
from litegripd.control.teleop.force_intake import ForceIntake
from litegripd.control.teleop.link import Link
from litegripd.control.teleop.push_back import PushBack
from litegripd.model.geometry import Geometry
from litegripd.model.motor import Feedback, MitCommand, MotorView
from litegripd.model.results import Progress, TeleopResult
from litegripd.model.teleop import LinkWish, TeleopSettings, TeleopStatus
from litegripd.model.teleop_frame import TeleopFrame, encode_frame

_EARLY_S = 0.00025
"""A tick that comes so little early, as ticks do, is the one that is due."""


class Lead(TeleopAction):
    """Publishes `rate_hz` times a second; when it ends, the jaws hold where they are."""

    def __init__(
        self,
        link: Link,
        wish: LinkWish,
        tell: Tell,
        *,
        geometry: Geometry,
        rate_hz: float,
        settings: TeleopSettings,
    ) -> None:
        super().__init__(link, wish, tell)
        self._geometry = geometry
        self._every_s = 1.0 / rate_hz
        self._forces = ForceIntake()
        self._push = PushBack(settings.reflect_n, settings.reflect_gain, geometry)
        self._due_s: float | None = None
        self._frame: TeleopFrame | None = None
        self._sent_s = 0.0
        self._frames = 0

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Keep the jaws slack, but for what is felt, and publish what was measured."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self.loop.tick(now_s)
        for arrival in self.link.receive(now_s):  # that also brings news of the link
            self._forces.take(arrival, now_s)
        self.note_link()
        is_new = self.feedback is None or feedback.at_s > self.feedback.at_s
        self.feedback = feedback
        may_leave = self.link.status.state != "opening"
        if is_new and may_leave and self._is_due(now_s):
            self._publish(now_s, feedback)
        return Step(self._command(now_s, feedback))

    def progress(self) -> Progress | None:
        """Tell where the jaws are."""
        feedback = self.feedback
        if feedback is None:
            return None
        return progress_of("leading", self._frames, 0, feedback.position_rad, feedback)

    def result(self) -> TeleopResult:
        """Return what it has come to so far."""
        return TeleopResult(
            True, "master", self._frames, self._forces.rejected, self.send_failed, 0
        )

    def status(self, now_s: float) -> TeleopStatus:
        """Return how it goes."""
        status, frame, forces = self.base_status(), self._frame, self._forces
        status = replace(status, phase="leading", rejected=forces.rejected)
        if self.wish.reflects:
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
        """Return slack jaws, or jaws that push back with what the followers press with."""
        if not self.wish.reflects:
            return Relax().command(now_s, feedback)
        return self._push.step(now_s, self._forces.force_n(now_s), feedback)

    def _is_due(self, now_s: float) -> bool:
        """Keep the rate on average; what was missed is not made up for."""
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
