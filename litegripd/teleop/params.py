"""The parameters of `teleop.start`: their rows, and what of them does not fit together."""

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, FASTEST_RAD_S, FORCE_PER_TORQUE_N_NM
from litegripd.model.motion_config import (
    MOST_PUSH_NM,
    PRESS_NM_PER_MM,
    MotionConfig,
    ranges_of,
)
from litegripd.model.sentence import parameter_name, sentence
from litegripd.model.teleop import (
    DEFAULT_DQ_MAX_RAD_S,
    DEFAULT_GRIP_ID,
    DEFAULT_PORT,
    DEFAULT_READY_PERIOD_S,
    DEFAULT_READY_TIMEOUT_S,
    DEFAULT_READY_TOLERANCE_MM,
    DEFAULT_REFLECT_GAIN,
    DEFAULT_WATCHDOG_S,
    LinkOptions,
    TeleopSettings,
    udp_targets,
)
from litegripd.rpc.method import Param, Refused, config_param

_GRIP_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_HOST = re.compile(r"[A-Za-z0-9_.:%-]{1,253}")
_HOSTS = re.compile(r"[A-Za-z0-9_.:%,\[\] -]{1,1000}")
"""Excludes "/", "#", "?" and "*", which have a meaning in a key or an endpoint."""

MOST_PUSH_N = MOST_PUSH_NM * FORCE_PER_TORQUE_N_NM

_LONGEST_LABEL = 63
"""Of a part of a name between two dots (RFC 1035)."""

_Problem: TypeAlias = tuple[str, str] | None
"""A parameter, and what is wrong with it."""

WHERE = (
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
        "How frames travel: zenoh (the default), udp (a trusted network only), client, with which"
        " this connection carries them (teleop.receive, teleop.send), or none, with which a master"
        " leads nobody.",
        choices=("zenoh", "udp", "client", "none"),
    ),
    Param(
        "fake_leader",
        "boolean",
        "A slave follows a synthetic sweep, open to closed and back, without a network.",
    ),
)
HOW = (
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
        "align",
        "boolean",
        "A slave goes to where its leader is at align_speed_mm_s, at first and after each silence"
        " (default true). Without it, it goes there as fast as the bounds of its lead and its"
        " force let it, which are the same: nothing jumps.",
    ),
    config_param(
        "speed_mm_s",
        "How fast a slave aligns (default: speed_mm_s of the configuration).",
        "align_speed_mm_s",
    ),
    Param(
        "lead_cap_mm",
        "number",
        "How far a slave's command leads its jaws, in place of max_lead_mm of the configuration:"
        f" {PRESS_NM_PER_MM:.3g} N·m a mm, never more than {MOST_PUSH_NM:g} N·m. 0: as far as"
        " that.",
        minimum=0,
        maximum=100,
    ),
    Param(
        "require_ready",
        "boolean",
        "A master's jaws hold until a slave is ready: it follows, and its jaws are where the"
        " master's are (default true). Over udp, and with link none, nobody can say so: they are"
        " slack at once.",
    ),
    Param(
        "ready_timeout_s",
        "number",
        "So long a master's jaws hold at most, then they go slack; 0: for ever (default"
        f" {DEFAULT_READY_TIMEOUT_S:g}).",
        minimum=0,
        maximum=3600,
    ),
    Param(
        "ready_tolerance_mm",
        "number",
        "A slave is ready while its jaws are within this of where it follows to (default"
        f" {DEFAULT_READY_TOLERANCE_MM:g}).",
        minimum=0,
        maximum=100,
    ),
    Param(
        "ready_period_s",
        "number",
        "A slave says so, or not, on each change and at least every so many seconds (default"
        f" {DEFAULT_READY_PERIOD_S:g}).",
        minimum=0.001,
        maximum=10,
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


def settings_of(params: Mapping[str, Any]) -> TeleopSettings:
    """Return how to lead or to follow."""
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
        require_ready=params.get("require_ready", True),
        ready_timeout_s=params.get("ready_timeout_s", DEFAULT_READY_TIMEOUT_S),
        ready_tolerance_mm=params.get("ready_tolerance_mm", DEFAULT_READY_TOLERANCE_MM),
        ready_period_s=params.get("ready_period_s", DEFAULT_READY_PERIOD_S),
        align=params.get("align", True),
    )


_LEAD_MM = ranges_of(DM4310)["max_lead_mm"]
"""The same for all types."""


def config_of(params: Mapping[str, Any], config: MotionConfig) -> MotionConfig:
    """Return the configuration with the speed and the lead of this teleoperation."""
    if "align_speed_mm_s" in params:
        config = replace(config, speed_mm_s=params["align_speed_mm_s"])
    cap_mm, (least_mm, most_mm) = params.get("lead_cap_mm"), _LEAD_MM
    if cap_mm is None:
        return config
    if 0.0 < cap_mm < least_mm:
        text = (
            f"is {cap_mm:g}, it must be 0 (as far as the most torque leads), or {least_mm:g} to 100"
        )
        raise _wrong("lead_cap_mm", text)
    lead_mm = min(cap_mm, most_mm) if cap_mm else most_mm
    return replace(config, max_lead_mm=lead_mm, stop_lead_mm=min(config.stop_lead_mm, lead_mm))


def link_options(params: Mapping[str, Any]) -> LinkOptions:
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
        _of_names(options)
        or _of_reflection(params, fake=fake)
        or _of_ends(options, fake=fake)
        or _of_client(options, params)
    )
    if problem is None:
        return options
    raise _wrong(*problem)


def _wrong(parameter: str, text: str) -> Refused:
    message = sentence(
        "{teleop.start}: {parameter} {text}", parameter=parameter_name(parameter), text=text
    )
    return Refused(Refusal("invalid_params", message, {"parameter": parameter}))


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
            return "reflect", "is for a slave; a master takes reflect_n, its largest force"
        if "reflect_gain" in params and not params.get("reflect_n"):
            return "reflect_gain", "says nothing without reflect_n, the largest force"
        return None
    for name in ("reflect_n", "reflect_gain"):
        if name in params:
            return name, "is for a master; a slave takes reflect, to report its force"
    if fake and params.get("reflect", False):
        return "reflect", "needs a leader with a hand, which a fake one has not"
    return None


def _of_ends(options: LinkOptions, *, fake: bool) -> _Problem:
    """Check the parameters of the end that must know where the other one is."""
    leads, has_host = options.mode == "master", options.host is not None
    if leads and fake:
        return "fake_leader", "is for a slave: a master is a leader itself"
    if not leads and not fake and options.kind == "none":
        return "link", "none brings a slave no frames; for a try: fake_leader"
    if options.kind == "zenoh" and not leads and not has_host:
        return "host", "is missing: a slave connects to its leader and to nobody else"
    if options.kind == "zenoh" and leads and has_host:
        return "host", "is for a slave: a master listens, on all its addresses"
    if options.kind == "udp" and leads and not has_host:
        return "host", "is missing: a master sends its datagrams to its follower"
    return None


def _of_client(options: LinkOptions, params: Mapping[str, Any]) -> _Problem:
    """Check the parameters of a link that ends with its client, and goes where that one knows."""
    if options.kind != "client":
        return None
    if options.host is not None:
        return "host", "is for zenoh and udp: with link client, the client knows the other end"
    if options.reflects:
        name = "reflect_n" if options.mode == "master" else "reflect"
        return name, "is for zenoh and udp: a client carries frames and ready bytes, no forces"
    if params.get("detach", False):
        return "detach", "is not for link client: without its client nobody carries the frames"
    return None
