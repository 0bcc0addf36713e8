"""Teleoperation on one controller: begun, ended and reported by these methods."""

import ipaddress
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any, TypeAlias

from litegripd.control.admission import (
    conflict_refusal,
    motor_refusal,
    position_refusal,
    trajectory_or_teleop_refusal,
)
from litegripd.control.controller import Controller
from litegripd.control.limiter import Gains
from litegripd.model.errors import Refusal
from litegripd.model.gripper import FASTEST_RAD_S, FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.motion_config import (
    MOST_PUSH_NM,
    MotionConfig,
    damping_conflict,
    fast_conflict,
)
from litegripd.model.sentence import parameter_name, sentence
from litegripd.model.state import Event, Job, Owner
from litegripd.model.teleop import (
    DEFAULT_DQ_MAX_RAD_S,
    DEFAULT_GRIP_ID,
    DEFAULT_PORT,
    DEFAULT_REFLECT_GAIN,
    DEFAULT_WATCHDOG_S,
    Arrival,
    LinkOptions,
    LinkStatus,
    TeleopFrame,
    TeleopSettings,
    TeleopStatus,
    encode_frame,
    udp_targets,
)
from litegripd.rpc.method import CONFIG, DETACH, Answer, Call, Method, Param, Refused, accepted
from litegripd.rpc.reports import Reporter
from litegripd.teleop.follower import Course, TeleopFollower
from litegripd.teleop.leader import TeleopLeader
from litegripd.teleop.link import Link, Links, TeleopAction, ended

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
            conflict or fast_conflict(config.speed_mm_s, geometry, controller.gripper_id.motor_type)
        )
        if refusal is not None:
            return refusal
        warning = None if fake_leader else self._links.warning(options)
        if warning is not None:
            self._report(Event("teleop", f"teleop: {warning}", {"warning": True}))
        link: Link = FakeLeader(geometry, rate_hz) if fake_leader else self._links.open(options)
        if options.mode == "master":
            action: TeleopAction = TeleopLeader(
                link, options, self._report, geometry=geometry, rate_hz=rate_hz, settings=settings
            )
        else:
            course = Course(
                geometry, config, gains.usual(), settings, controller.period_s, self._sender
            )
            action = TeleopFollower(link, options, self._report, course)
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
        """Return the caller's gains, else the calibration's within 55 to 100 N·m/rad."""
        own, kp, kd = self._controller.gains.following(), settings.kp_nm_rad, settings.kd_nm_s_rad
        return Gains(own.kp_nm_rad if kp is None else kp, own.kd_nm_s_rad if kd is None else kd)

    def _ready(self) -> Geometry | Refusal:
        """Return the travel if teleoperation may begin; raise the refusal otherwise."""
        controller = self._controller
        refusal = controller.why_busy() or controller.recording_refusal()
        if refusal is not None and refusal.reason == "busy":
            refusal = trajectory_or_teleop_refusal(controller.in_the_way()) or refusal
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


def _not_ready(why: Refusal) -> Refusal:
    """Raise a refusal that applies to any motion."""
    text = sentence("teleoperation cannot begin: {why}", why=why.message)
    return Refusal("teleop_not_ready", text, {**why.data, "cause": why.reason})


_GRIP_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HOST = re.compile(r"[A-Za-z0-9_.:%-]{1,253}")
_HOSTS = re.compile(r"[A-Za-z0-9_.:%,\[\] -]{1,1000}")
"""Excludes "/", "#", "?" and "*", which have a meaning in a key or an endpoint."""

MOST_PUSH_N = MOST_PUSH_NM * FORCE_PER_TORQUE_N_NM

_LONGEST_LABEL = 63
"""Of a part of a name between two dots (RFC 1035)."""

_Problem: TypeAlias = tuple[str, str] | None
"""A parameter, and what is wrong with it."""

_WHERE = (
    Param(
        "mode",
        "string",
        "Lead (master: the jaws go slack, a hand moves them) or follow (slave).",
        required=True,
        choices=("master", "slave"),
    ),
    Param(
        "host",
        "string",
        "A slave's leader (with udp: the only one that is listened to; default: anyone who sends)."
        " With udp a master needs it, too: whom it sends to, one or several (HOST or HOST:PORT,"
        " separated by commas).",
    ),
    Param(
        "port",
        "integer",
        f"Where the leader listens, with udp the follower (default {DEFAULT_PORT}).",
        minimum=1,
        maximum=65_535,
    ),
    Param(
        "bind",
        "string",
        "The address at which a slave over udp listens (default: all of this machine's).",
    ),
    Param("grip_id", "string", f"Both ends share it (default {DEFAULT_GRIP_ID})."),
    Param(
        "link",
        "string",
        "How frames travel: zenoh (the default), udp (a trusted network only), or none, with which"
        " a master leads nobody.",
        choices=("zenoh", "udp", "none"),
    ),
    Param(
        "fake_leader",
        "boolean",
        "A slave follows a synthetic sweep, open to closed and back, without a network.",
    ),
)
_HOW = (
    Param(
        "rate_hz",
        "number",
        "How often a master publishes (default: the control rate). A slave follows at the control"
        " rate in any case.",
        minimum=1,
        maximum=1000,
    ),
    Param(
        "watchdog_s",
        "number",
        f"So long without a frame makes a slave hold (default {DEFAULT_WATCHDOG_S:g}).",
        minimum=0.02,
        maximum=10,
    ),
    Param(
        "torque_limit_nm",
        "number",
        "A slave lets go when its torque is at or over it for 60 ms; 0, the default: never.",
        minimum=0,
        maximum=10,
        maximum_of=lambda motor: motor.ranges.torque_nm,
    ),
    Param(
        "force_limit_n",
        "number",
        "A slave pushes by no more, for as long as it takes. No slave pushes with more than"
        f" {MOST_PUSH_NM:g} N·m, {MOST_PUSH_N:g} N unless the calibration has another nm_to_n:"
        f" more counts as that (default: {MOST_PUSH_NM:g} N·m, and after 0.5 s on the same thing"
        " no more than the torque of a press, stop_lead_mm).",
        minimum=1,
        maximum=55,
    ),
    Param(
        "kp",
        "number",
        "A slave's stiffness, N·m/rad, more than 100 counts as that (default: the calibration's,"
        " within 55 to 100).",
        False,
        1,
        500,
    ),
    Param(
        "kd",
        "number",
        "A slave's damping, N·m·s/rad, at least kp · 0.002 s, more than 2 counts as that (default:"
        " the calibration's).",
        minimum=0,
        maximum=5,
    ),
    Param(
        "dq_max",
        "number",
        "Most of the leader's velocity that is fed forward, rad/s; 0: none"
        f" (default {DEFAULT_DQ_MAX_RAD_S:g}; never more than {FASTEST_RAD_S:g}).",
        minimum=0,
        maximum=30,
        maximum_of=lambda motor: motor.ranges.velocity_rad_s,
    ),
    Param(
        "reflect",
        "boolean",
        "A slave reports to its leader the force that it presses with (default false).",
    ),
    Param(
        "reflect_n",
        "number",
        "A master's jaws push back with what its slaves report, by no more than this; 0, the"
        " default: they stay slack.",
        minimum=0,
        maximum=10,
    ),
    Param(
        "reflect_gain",
        "number",
        f"Which share of it a master's hand feels (default {DEFAULT_REFLECT_GAIN:g}).",
        minimum=0.05,
        maximum=1,
    ),
)


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
        (*_WHERE, *_HOW, CONFIG, DETACH),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    )
    def _start(self, call: Call) -> Answer:
        controller, params = self._controller, call.params
        config = call.config(
            controller.config, controller.period_s, controller.gripper_id.motor_type
        )
        options = _link_options(params)
        job = self._teleoperation.start(
            options,
            _settings(params),
            call.owner,
            config,
            fake_leader=params.get("fake_leader", False),
            detached=call.detached,
        )
        self._reporter.refresh()
        accepted(job)
        return self._status(call)

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


def _settings(params: Mapping[str, Any]) -> TeleopSettings:
    return TeleopSettings(
        rate_hz=params.get("rate_hz"),
        watchdog_s=params.get("watchdog_s", DEFAULT_WATCHDOG_S),
        torque_limit_nm=params.get("torque_limit_nm", 0.0),
        force_limit_n=params.get("force_limit_n"),
        kp_nm_rad=params.get("kp"),
        kd_nm_s_rad=params.get("kd"),
        dq_max_rad_s=params.get("dq_max", DEFAULT_DQ_MAX_RAD_S),
        reflect_n=params.get("reflect_n", 0.0),
        reflect_gain=params.get("reflect_gain", DEFAULT_REFLECT_GAIN),
    )


def _link_options(params: Mapping[str, Any]) -> LinkOptions:
    """Return the requested link; reject a wrong parameter."""
    mode, fake = params["mode"], params.get("fake_leader", False)
    options = LinkOptions(
        mode,
        "none" if fake else params.get("link", "zenoh"),
        params.get("host"),
        params.get("port", DEFAULT_PORT),
        params.get("grip_id", DEFAULT_GRIP_ID),
        params.get("reflect_n", 0.0) > 0.0 if mode == "master" else params.get("reflect", False),
        params.get("bind"),
    )
    problem = (
        _of_names(options) or _of_reflection(params, fake=fake) or _of_ends(options, fake=fake)
    )
    if problem is None:
        return options
    parameter, text = problem
    message = sentence(
        "{teleop.start}: {parameter} {text}", parameter=parameter_name(parameter), text=text
    )
    raise Refused(Refusal("invalid_params", message, {"parameter": parameter}))


def _of_names(options: LinkOptions) -> _Problem:
    """Check what becomes a part of keys and endpoints."""
    if not _GRIP_ID.fullmatch(options.grip_id):
        return "grip_id", f"is {options.grip_id!r}; it has letters, digits, _ . - (1 to 64)"
    if options.bind is not None:
        if (options.mode, options.kind) != ("slave", "udp"):
            return "bind", "is for a slave over udp: the only end that listens for datagrams"
        if not _HOST.fullmatch(options.bind):
            return "bind", f"is {options.bind!r}; it must be an address of this machine"
    if options.host is None:
        return None
    if options.mode == "master" and options.kind == "udp":
        return _of_targets(options)
    if re.fullmatch(r"\[[0-9A-Fa-f:.%\w]+\]", options.host):
        return "host", f"is {options.host!r}, in brackets: give {options.host[1:-1]!r} as host"
    if not _HOST.fullmatch(options.host):
        return "host", f"is {options.host!r}; it must be a host's name or address, without a port"
    return _of_host(options.host, is_leader=options.mode == "slave")


def _of_host(host: str, *, is_leader: bool) -> _Problem:
    """Check that a machine may be called so: what can be none would only be waited for."""
    name, _, port = host.rpartition(":")
    if name and ":" not in name and port.isdecimal():
        return "host", f"is {host!r}, with a port in it: give that as port, and {name!r} as host"
    if ":" in host or re.fullmatch(r"[0-9.]+", host):
        try:
            address = ipaddress.ip_address(host)
        except ValueError:
            return "host", f"is {host!r}, which is no address of IPv4 or IPv6"
        is_nobody = address.is_unspecified or address.is_multicast or host == "255.255.255.255"
        if is_leader and is_nobody:
            return "host", f"is {host!r}, which is the address of no single machine"
        return None
    if not all(0 < len(label) <= _LONGEST_LABEL for label in host.removesuffix(".").split(".")):
        return "host", f"is {host!r}, which can be no machine's name: a part is empty or too long"
    return None


def _of_targets(options: LinkOptions) -> _Problem:
    if not _HOSTS.fullmatch(options.host or ""):
        text = "it must be hosts' names or addresses, separated by commas"
        return "host", f"is {options.host!r}; {text}"
    try:
        targets = udp_targets(options)
    except ValueError as error:
        return "host", str(error)
    problems = (_of_host(host, is_leader=False) for host, _port in targets)
    return next((problem for problem in problems if problem is not None), None)


def _of_reflection(params: Mapping[str, Any], *, fake: bool) -> _Problem:
    """Check the parameters of only one end."""
    if params["mode"] == "master":
        if "reflect" in params:
            return "reflect", sentence(
                "is for a slave; a master takes {.reflect_n}, its largest force"
            )
        if "reflect_gain" in params and not params.get("reflect_n"):
            text = sentence("says nothing without {.reflect_n}, the largest force")
            return "reflect_gain", text
        return None
    for name in ("reflect_n", "reflect_gain"):
        if name in params:
            return name, sentence("is for a master; a slave takes {.reflect}, to report its force")
    if fake and params.get("reflect", False):
        return "reflect", "needs a leader with a hand, which a fake one has not"
    return None


def _of_ends(options: LinkOptions, *, fake: bool) -> _Problem:
    """Check the parameters of the end that must know where the other one is."""
    leads, has_host = options.mode == "master", options.host is not None
    if leads and fake:
        return "fake_leader", "is for a slave: a master is a leader itself"
    if not leads and not fake and options.kind == "none":
        return "link", sentence("none brings a slave no frames; for a try: {.fake_leader}")
    if options.kind == "zenoh" and not leads and not has_host:
        return "host", "is missing: a slave connects to its leader and to nobody else"
    if options.kind == "zenoh" and leads and has_host:
        return "host", "is for a slave: a master listens, on all its addresses"
    if options.kind == "udp" and leads and not has_host:
        return "host", "is missing: a master sends its datagrams to its follower"
    return None
