"""Teleoperation on one controller: begun, ended and reported by these methods."""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from litegripd.control.admission import (
    conflict_refusal,
    motor_refusal,
    position_refusal,
    trajectory_or_teleop_refusal,
)
from litegripd.control.calibration import Terms
from litegripd.control.controller import Controller
from litegripd.control.limiter import Gains
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry
from litegripd.model.motion_config import damping_conflict, fast_conflict
from litegripd.model.sentence import sentence
from litegripd.model.state import Event, Job, Owner
from litegripd.model.teleop import (
    Arrival,
    LinkOptions,
    LinkStatus,
    TeleopFrame,
    TeleopSettings,
    TeleopStatus,
    encode_frame,
)
from litegripd.rpc.method import CALIBRATION, CONFIG, DETACH, Answer, Call, Method, Param, accepted
from litegripd.rpc.reports import JobNumber, Reporter
from litegripd.rpc.sessions import Session
from litegripd.teleop.follower import Course, FollowerCommand, TeleopFollower
from litegripd.teleop.leader import TeleopLeader
from litegripd.teleop.link import ClientLink, Link, Links, TeleopAction, ended
from litegripd.teleop.params import HOW, WHERE, config_of, link_options, settings_of

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

    def tell(self, _payload: bytes, _now_s: float) -> bool:
        """Do nothing: a synthetic leader waits for nobody."""
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
_LONGEST_PAYLOAD = 4096
"""A longer one cannot be what anybody sends; from 33 bytes on it is counted as no frame."""


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
        terms: Terms,
        *,
        client: Session,
        fake_leader: bool,
        detached: bool,
    ) -> Job | Refusal:
        """Begin to lead or to follow; reject it before anything moves.

        `client` carries the frames of a link of that kind.
        """
        controller, geometry, config = self._controller, self._ready(terms), terms.config
        if isinstance(geometry, Refusal):
            return geometry
        rate_hz = 1.0 / controller.period_s if settings.rate_hz is None else settings.rate_hz
        gains = _gains(terms.gains, settings)
        refusal = self._rate_refusal(rate_hz) or conflict_refusal(
            damping_conflict(gains.kp_nm_rad, gains.kd_nm_s_rad)
            or fast_conflict(config.speed_mm_s, geometry, controller.gripper_id.motor_type)
        )
        if refusal is not None:
            return refusal
        is_own = fake_leader or options.kind == "client"
        warning = None if is_own else self._links.warning(options)
        if warning is not None:
            self._report(Event("teleop", f"teleop: {warning}", {"warning": True}))
        link: Link
        if fake_leader:
            link = FakeLeader(geometry, rate_hz)
        elif options.kind == "client":
            link = ClientLink(client, options)
        else:
            link = self._links.open(options)
        gains, period_s = gains.usual(), controller.period_s
        if options.mode == "master":
            action: TeleopAction = TeleopLeader(
                link,
                options,
                self._report,
                geometry=geometry,
                rate_hz=rate_hz,
                settings=settings,
                holding=FollowerCommand(geometry, config, gains, None, period_s),
            )
        else:
            course = Course(geometry, config, gains, settings, period_s, self._sender)
            action = TeleopFollower(link, options, self._report, course)
        action.is_warned = warning is not None
        self._action = action
        self._job = controller.begin("teleop", action, owner, detached, terms=terms)
        return self._job

    def stop(self) -> None:
        """End it if it runs: the jaws hold where they are, or stay free after a trip."""
        action = self._action
        if action is not None and self.is_active:
            self._controller.end(action.finish())

    def take(self, session: Session, topic: str, payload: bytes, at_s: float) -> Job | Refusal:
        """Take what a client has brought for the teleoperation that it carries; return its job."""
        link, job = None if self._action is None else self._action.link, self._job
        if isinstance(link, ClientLink) and link.session is session and self.is_active and job:
            link.take(topic, payload, at_s)
            return job
        text = "no teleoperation with link client is running that this connection has begun"
        return Refusal("teleop_not_ready", text)

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

    def _ready(self, terms: Terms) -> Geometry | Refusal:
        """Return the travel if teleoperation may begin, else the refusal.

        What is missing comes before who is in the way, as with the SDK.
        """
        controller = self._controller
        refusal = controller.why_busy() or controller.recording_refusal()
        is_busy = refusal is not None and refusal.reason in _BUSY
        if refusal is not None and not is_busy:
            return refusal
        unpowered = motor_refusal(controller.motor)
        if unpowered is not None:
            return _not_ready(unpowered) if unpowered.reason == "not_enabled" else unpowered
        geometry = terms.geometry
        if geometry is None:
            return _not_ready(controller.calibrated.problem)
        if refusal is not None:
            return trajectory_or_teleop_refusal(controller.in_the_way()) or refusal
        return position_refusal(controller.motor, geometry) or geometry

    def _rate_refusal(self, rate_hz: float) -> Refusal | None:
        most_hz = 1.0 / self._controller.period_s
        if rate_hz <= most_hz * _RATE_ROUNDING:
            return None
        return Refusal(
            "out_of_limits",
            sentence(
                "{.rate_hz} is {rate_hz:g}, the daemon's control rate is {most_hz:g}: there is no"
                " newer measurement to publish in between",
                rate_hz=rate_hz,
                most_hz=most_hz,
            ),
            {"field": "rate_hz", "requested": rate_hz, "limit": most_hz},
        )

    def _report(self, event: Event) -> None:
        self._controller.events.append(event)


_BUSY = ("busy", "teleop_busy", "trajectory_busy")


def _gains(calibrated: Gains, settings: TeleopSettings) -> Gains:
    """Return the caller's gains, else the calibration's within 55 to 100 N·m/rad."""
    own, kp, kd = calibrated.following(), settings.kp_nm_rad, settings.kd_nm_s_rad
    return Gains(own.kp_nm_rad if kp is None else kp, own.kd_nm_s_rad if kd is None else kd)


def _not_ready(why: Refusal) -> Refusal:
    """Return a refusal that applies to any motion."""
    text = sentence("teleoperation cannot begin: {why}", why=why.message)
    return Refusal("teleop_not_ready", text, {**why.data, "cause": why.reason})


class TeleopMethods:
    """Methods on the controller's teleoperation."""

    NOT_CARRIED = ("_controller", "_reporter", "_teleoperation")

    def __init__(
        self, controller: Controller, links: Links, reporter: Reporter, epoch: str
    ) -> None:
        """Store the collaborators; `epoch`, 16 hexadecimal digits, is unique to the daemon."""
        self._controller = controller
        self._reporter = reporter
        self._teleoperation = Teleoperation(controller, links, int(epoch, 16))

    @Method(
        "teleop.start",
        "Begin to lead another gripper, or to follow one, until teleop.stop. It answers at once.",
        "The status.",
        TeleopStatus,
        (*WHERE, *HOW, CONFIG, CALIBRATION, DETACH),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    )
    def _start(self, call: Call) -> Answer:
        params, terms = call.params, call.terms(self._controller)
        options = link_options(params)
        job = self._teleoperation.start(
            options,
            settings_of(params),
            call.owner,
            replace(terms, config=config_of(params, terms.config)),
            client=call.session,
            fake_leader=params.get("fake_leader", False),
            detached=call.detached,
        )
        self._reporter.refresh()
        accepted(job)
        return self._status(call)

    @Method(
        "teleop.receive",
        "With link client: take a payload that has come for this end over the client's own link:"
        " frames for a slave, ready bytes for a master. It may be sent without an id. The newest"
        " counts, from when it was received; what is no frame is counted (rejected, dropped).",
        "The number of teleoperation's job.",
        JobNumber,
        (
            Param("topic", "string", "The key under which it came.", required=True),
            Param(
                "payload",
                "string",
                "The bytes, two hexadecimal digits each.",
                required=True,
                longest=_LONGEST_PAYLOAD,
            ),
        ),
        role="operator",
        stop_voids=True,
        may_notify=True,
    )
    def _receive(self, call: Call) -> Answer:
        try:
            payload = bytes.fromhex(call.params["payload"])
        except ValueError:
            text = sentence(
                "{teleop.receive}: {.payload} must be hexadecimal digits, two for each byte"
            )
            return Refusal("invalid_params", text, {"parameter": "payload"})
        job = self._teleoperation.take(call.session, call.params["topic"], payload, call.received_s)
        return JobNumber(job=accepted(job).number)

    @Method(
        "teleop.stop",
        "End teleoperation, if it runs: the jaws hold where they are, except those that the torque"
        " guard has let go of: they stay free.",
        "The status, as at the end.",
        TeleopStatus,
        role="operator",
        needs_lease=True,
    )
    def _stop(self, call: Call) -> Answer:
        self._teleoperation.stop()
        self._reporter.refresh()
        return self._status(call)

    @Method(
        "teleop.status",
        "Report how teleoperation goes, or how the last one went.",
        "The status.",
        TeleopStatus,
    )
    def _status(self, call: Call) -> dict[str, Any]:
        return asdict(self._teleoperation.status(call.now_s))
