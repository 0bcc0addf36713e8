"""Begins and ends teleoperation.

A synthetic leader, without a second gripper and without a network, sweeps open, closed, open. It
serves to test a single follower and its torque guard, with a rigid object between the jaws.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from litegripd.control.admission import (
    conflict_refusal,
    motor_refusal,
    position_refusal,
    trajectory_or_teleop_refusal,
)
from litegripd.control.controller import Controller
from litegripd.control.gains import Gains
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.jobs import Job, Owner
from litegripd.model.motion_config import MotionConfig, damping_conflict, fast_conflict
from litegripd.model.state import Event
from litegripd.model.teleop import (
    Arrival,
    LinkOptions,
    LinkStatus,
    TeleopFrame,
    TeleopSettings,
    TeleopStatus,
    encode_frame,
)
from litegripd.teleop.base import TeleopAction, ended
from litegripd.teleop.follower import Course, TeleopFollower
from litegripd.teleop.leader import TeleopLeader
from litegripd.teleop.link import Link, Links

SWEEP_S = 6.0
"""From open to closed and back: 63 mm/s at most on a travel of 120 mm."""


class FakeLeader:
    """A link over which a synthetic leader is heard, `rate_hz` times a second."""

    status = LinkStatus("open", is_protected=True)

    def __init__(self, geometry: Geometry, rate_hz: float) -> None:
        self._geometry = geometry
        self._every_s = 1.0 / rate_hz
        self._began_s: float | None = None
        self._sent = 0

    def publish(self, _payload: bytes, _now_s: float) -> bool:
        """Do nothing: nobody listens to a follower."""
        return False

    def reply(self, _payload: bytes, _to: str, _now_s: float) -> bool:
        """Do nothing: a synthetic leader has no hand."""
        return False

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return the frame that is due, if one is."""
        if self._began_s is None:
            self._began_s = now_s
        due = 1 + math.floor((now_s - self._began_s) / self._every_s + 1e-6)
        if due <= self._sent:
            return ()
        self._sent = due
        at_s = (due - 1) * self._every_s
        openness = 0.5 + 0.5 * math.cos(2.0 * math.pi * at_s / SWEEP_S)
        frame = TeleopFrame(openness, openness * self._geometry.travel_mm, 0.0, at_s)
        return (Arrival(encode_frame(frame), now_s),)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""


_RATE_ROUNDING = 1.001


class Teleoperation:
    """Begins and ends teleoperation on one controller, over given links."""

    NOT_CARRIED = ("_action", "_controller", "_job", "_links", "_sender")

    def __init__(self, controller: Controller, links: Links, sender: int = 0) -> None:
        """Store the collaborators; `sender` identifies this daemon's force frames."""
        self._controller = controller
        self._links = links
        self._sender = sender
        self._action: TeleopAction | None = None
        self._job: Job | None = None

    def start(
        self,
        options: LinkOptions,
        settings: TeleopSettings,
        owner: Owner,
        config: MotionConfig,
        *,
        fake_leader: bool,
        detached: bool,
    ) -> Job | Refusal:
        """Begin to lead or to follow; reject it before anything moves."""
        controller, geometry = self._controller, self._ready()
        if isinstance(geometry, Refusal):
            return geometry
        rate_hz = 1.0 / controller.period_s if settings.rate_hz is None else settings.rate_hz
        gains, conflict = self._gains(settings), None
        if options.mode == "slave":
            conflict = damping_conflict(gains.kp_nm_rad, gains.kd_nm_s_rad)
        refusal = self._rate_refusal(rate_hz) or conflict_refusal(
            conflict or fast_conflict(config, config.speed_mm_s, controller.period_s)
        )
        if refusal is not None:
            return refusal
        warning = None if fake_leader else self._links.warning(options)
        if warning is not None:
            self._tell(Event("teleop", f"teleop: {warning}", {"warning": True}))
        link: Link = FakeLeader(geometry, rate_hz) if fake_leader else self._links.open(options)
        if options.mode == "master":
            action: TeleopAction = TeleopLeader(
                link, options, self._tell, geometry=geometry, rate_hz=rate_hz, settings=settings
            )
        else:
            course = Course(geometry, config, gains, settings, controller.period_s, self._sender)
            action = TeleopFollower(link, options, self._tell, course)
        action.is_warned = warning is not None
        self._action = action
        self._job = controller.begin("teleop", action, owner, detached)
        return self._job

    def stop(self) -> None:
        """End it if it runs: the jaws hold where they are, or stay free after a trip."""
        action = self._action
        if action is not None and self.is_active:
            self._controller.end(action.finish())

    @property
    def is_active(self) -> bool:
        """True while it runs."""
        return self._action is not None and self._controller.action is self._action

    def status(self, now_s: float) -> TeleopStatus:
        """Return the present status, or the last one."""
        action, job = self._action, self._job
        if action is None or job is None:
            return TeleopStatus(active=False)
        status = replace(action.status(now_s), job=job.number)
        if not self.is_active:
            status = ended(status, None if job.error is None else job.error.message)
        return status

    def _gains(self, settings: TeleopSettings) -> Gains:
        own, kp, kd = self._controller.gains, settings.kp_nm_rad, settings.kd_nm_s_rad
        return Gains(own.kp_nm_rad if kp is None else kp, own.kd_nm_s_rad if kd is None else kd)

    def _ready(self) -> Geometry | Refusal:
        """Return the travel if teleoperation may begin; raise the refusal otherwise."""
        controller = self._controller
        refusal = controller.why_busy() or controller.recording_refusal()
        if refusal is not None and refusal.reason == "busy":
            refusal = trajectory_or_teleop_refusal(controller.in_the_way) or refusal
        if refusal is not None:
            return refusal
        geometry = controller.geometry
        if geometry is None:
            return _not_ready(controller.calibrated.problem)
        refusal = motor_refusal(controller.motor)
        if refusal is not None:
            return _not_ready(refusal) if refusal.reason == "not_enabled" else refusal
        return position_refusal(controller.motor, geometry) or geometry

    def _rate_refusal(self, rate_hz: float) -> Refusal | None:
        most_hz = 1.0 / self._controller.period_s
        if rate_hz <= most_hz * _RATE_ROUNDING:
            return None
        return Refusal(
            "out_of_limits",
            f"rate_hz is {rate_hz:g}, the daemon's control rate is {most_hz:g}: there is no newer"
            " measurement to publish in between",
            {"field": "rate_hz", "requested": rate_hz, "limit": most_hz},
        )

    def _tell(self, event: Event) -> None:
        self._controller.events.append(event)


def _not_ready(why: Refusal) -> Refusal:
    """Raise a refusal that applies to any motion."""
    text = f"teleoperation cannot begin: {why.message}"
    return Refusal("teleop_not_ready", text, {**why.data, "cause": why.reason})
