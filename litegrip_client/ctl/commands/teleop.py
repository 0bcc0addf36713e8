"""Teleoperation from a terminal: begun, watched in one line, ended by Ctrl-C."""

from __future__ import annotations

import re
import time

from litegrip_client.ctl.parser import LateParser, count, in_unit, not_negative, positive
from litegrip_client.ctl.run import Commands, Run
from litegrip_client.values.figures import Data, figure, plain

_LOOK_EVERY_S = 0.2
_OPEN_WITHIN_S = 5.0

_OPTIONS = {
    "host": "host",
    "port": "port",
    "grip_id": "grip_id",
    "link": "link",
    "rate": "rate_hz",
    "torque_limit": "torque_limit_nm",
    "force_limit": "force_limit_n",
    "watchdog": "watchdog_s",
    "align_speed": "align_speed_mm_s",
    "lead_cap": "lead_cap_mm",
    "ready_timeout": "ready_timeout_s",
    "reflect_force": "reflect_n",
    "reflect_gain": "reflect_gain",
}
_FLAGS = ("fake_leader", "reflect")

_LABEL_WIDTH = 17
_COUNTS = (
    "torque_trips",
    "rejected",
    "out_of_order",
    "other_leaders",
    "late",
    "dropped",
    "send_failed",
)


_TELEOP = """\
Let one gripper follow another one. Enable both before.

The master's jaws hold until the slave is where they are; then they are loose.
Without --detach it shows how it goes until Ctrl-C ends it. Then the jaws hold;
those that the torque guard has let go of stay loose.
"""
_EXAMPLES = """\
examples:
  litegripctl teleop master                    lead: move these jaws by hand
  litegripctl teleop slave --host 10.0.0.20    follow that machine's gripper
  litegripctl teleop slave --fake-leader --torque-limit 1.0
                                               try the guard on a rigid object
  litegripctl teleop master --reflect-force 4
  litegripctl teleop slave --host 10.0.0.20 --reflect
                                               feel what is gripped, 4 N at most
"""


def teleop_options(parser: LateParser) -> None:
    """Add the arguments of `teleop`."""
    parser.description, parser.epilog = _TELEOP, _EXAMPLES
    add = parser.add_subparsers(
        dest="action", required=True, metavar="ACTION", parser_class=LateParser
    ).add_parser
    add("master", help="lead: the jaws are moved by hand", fill=_master_options)
    add("slave", help="follow a leader", fill=_slave_options)
    add("status", help="show how it goes")
    add("stop", help="end it")


def _master_options(parser: LateParser) -> None:
    _link_options(parser)
    parser.add_argument(
        "--host", help="with --link udp: the follower's machine, or several: A,B,C:PORT"
    )
    parser.add_argument(
        "--rate",
        type=in_unit(positive, "Hz"),
        metavar="HZ",
        help="frames a second (default: the control rate)",
    )
    parser.add_argument(
        "--no-require-ready", action="store_true", help="go slack at once, whoever follows"
    )
    parser.add_argument(
        "--ready-timeout",
        type=in_unit(not_negative, "s"),
        metavar="S",
        help="go slack after so long, though no slave is ready (10; 0: never)",
    )
    parser.add_argument(
        "--reflect-force",
        type=in_unit(positive, "N"),
        metavar="N",
        help="push back with what slaves press with, by N newtons at most (default: slack)",
    )
    parser.add_argument(
        "--reflect-gain", type=positive, metavar="SHARE", help="how much of it is felt (0.5)"
    )


def _slave_options(parser: LateParser) -> None:
    _link_options(parser)
    leader = parser.add_mutually_exclusive_group()
    leader.add_argument("--host", help="the leader's machine")
    leader.add_argument(
        "--fake-leader", action="store_true", help="follow a synthetic sweep, without a network"
    )
    parser.add_argument(
        "--torque-limit",
        type=in_unit(positive, "N·m"),
        metavar="NM",
        help="let go at this torque or more, in N·m (default: never)",
    )
    parser.add_argument(
        "--force-limit",
        type=in_unit(positive, "N"),
        metavar="N",
        help="push by no more than this, in newtons; more than 20 (2 N·m) counts as that",
    )
    parser.add_argument(
        "--align-speed",
        type=in_unit(positive, "mm/s"),
        metavar="MM_S",
        help="go to where the leader is at this speed (default: speed_mm_s of the configuration)",
    )
    parser.add_argument(
        "--lead-cap",
        type=in_unit(not_negative, "mm"),
        metavar="MM",
        help="lead the jaws by no more than this, 1.34 N·m a mm (max_lead_mm); 0: 2 N·m, the most",
    )
    parser.add_argument("--reflect", action="store_true", help="report that force to the leader")
    parser.add_argument(
        "--watchdog",
        type=in_unit(positive, "s"),
        metavar="S",
        help="hold after so long without a frame (0.2)",
    )


def _link_options(parser: LateParser) -> None:
    parser.add_argument(
        "--link", choices=("zenoh", "udp"), help="how frames travel (zenoh); udp is not protected"
    )
    parser.add_argument("--port", type=count, metavar="N", help="the leader's port (17448)")
    parser.add_argument("--grip-id", metavar="ID", help="shared by both ends (gripA)")
    parser.add_argument(
        "--detach", action="store_true", help="leave it running, until 'teleop stop'"
    )


def teleop(run: Run) -> int:
    """Do what `options.action` says."""
    action = run.options.action
    if action == "status":
        data = run.connection.call("teleop.status")
        return run.done(data, status_text(data))
    if action == "stop":
        return _stop(run)
    return _start(run, action)


def _start(run: Run, mode: str) -> int:
    options = run.options
    params: dict[str, object] = {"mode": mode}
    for option, name in _OPTIONS.items():
        value = getattr(options, option, None)
        if value is not None:
            params[name] = value
    params |= {name: True for name in _FLAGS if getattr(options, name, False)}
    if getattr(options, "no_require_ready", False):
        params["require_ready"] = False
    if options.detach:
        params["detach"] = True
    data = run.connection.command("teleop.start", params)
    if options.detach:
        return _leave(run, data)
    seen = dict(data)
    try:
        return _watch(run, seen)
    except KeyboardInterrupt:
        run.output.end_line()
        return _stop(run, holding=True, before=seen)


def _leave(run: Run, data: Data) -> int:
    """Leave it running once its link is open; end it where that cannot be opened."""
    ends_s = time.monotonic() + _OPEN_WITHIN_S
    while data["active"] and _is_on_its_way(data) and time.monotonic() < ends_s:
        time.sleep(_LOOK_EVERY_S)
        data = run.connection.call("teleop.status")
    if data["active"] and data.get("link_state") == "failed":
        why = data.get("link_error")
        data = run.connection.call("teleop.stop")
        text = f"{data['mode']}: ended, the link has failed: {why}"
        run.output.note(f"the link has failed, and nothing runs: {why}")
        return run.done({**data, "link_error": why}, text, ok=False)
    if not data["active"]:
        return run.done(data, status_text(data), ok=False)
    opening = ", its link is still opening" if data.get("link_state") == "opening" else ""
    if data.get("link_unreached"):
        whom = "a follower" if data.get("mode") == "master" else "its leader"
        opening = f", but {whom} is not reached: {plain(data['link_unreached'])}"
    text = f"{data['mode']}: it runs{opening}; {run.here('end it with: litegripctl teleop stop')}"
    return run.done(data, text)


def _is_on_its_way(data: Data) -> bool:
    """Return True while it is not known if the link can be opened, or its leader be reached."""
    is_reaching = data.get("link_reach") in ("resolving", "connecting")
    return data.get("link_state") == "opening" or (is_reaching and not data.get("link_unreached"))


def _watch(run: Run, seen: dict[str, object]) -> int:
    """Show how it goes until it ends; `seen` is kept as what was seen last while it ran.

    Where no line can be written over, each change of the link gets a line.
    """
    before = None
    while True:
        data = run.connection.call("teleop.status")
        if not data["active"]:
            return run.done(data, ended_text(data, before=seen), ok=False)
        seen.update(data)
        if run.output.live:
            run.output.line(status_line(data))
        elif not run.output.as_json and (now := _link_of(data)) != before:
            run.output.write(f"{status_line(data)}\n")
            before = now
        time.sleep(_LOOK_EVERY_S)


def _link_of(data: Data) -> tuple[object, ...]:
    """Return how the link is and why, without for how long."""
    why = re.sub(r" \(for \d+ s\)$", "", str(data.get("link_unreached")))
    names = ("phase", "link_state", "link_reach", "link_error", "stale")
    return (why, *map(data.get, names))


def _stop(run: Run, *, holding: bool = False, before: Data | None = None) -> int:
    data = run.connection.call("teleop.stop")
    return run.done(data, ended_text(data, holding=holding, before=before))


def status_line(data: Data) -> str:
    """Return the status in one line; what is wrong stands before the figures."""
    whose, own = _owners(data)
    parts = [
        f"{data.get('mode')!s} {data.get('phase')!s:<9}",
        *_troubles(data),
        f"{whose}{_percent(data):>6}",
        f"{figure(_of_frame(data, 'position_mm'), '7.2f', 'mm'):>10}",
        f"{own}{figure(data.get('torque_nm'), '+.2f', 'N·m'):>10}",
        *_felt(data),
        f"{figure(data.get('loop_hz'), '.0f', 'Hz'):>6}",
        f"frames {data.get('frames')}",
        *_counts(data),
    ]
    return plain("  ".join(parts))


def ended_text(data: Data, *, holding: bool = False, before: Data | None = None) -> str:
    """Return how it ended, in one line. With `holding` a command ended it, and the jaws hold.

    What was wrong with its link to the end is in the status `before`: the end closes the link.
    """
    if data.get("mode") is None:
        return "no teleoperation so far"
    by = f" by {data['fault']}" if data.get("fault") else ""
    parts = [f"{data['mode']} ended{by} after {data.get('frames')} frames", *_counts(data)]
    why = "".join(f"; {text}" for text in _link_troubles(before or {}))
    return plain(", ".join(parts) + why) + ("; the jaws hold" if holding and not by else "")


def status_text(data: Data) -> str:
    """Return a status in aligned lines."""
    if data.get("mode") is None:
        return "no teleoperation so far"
    verdict = "runs" if data.get("active") else "does not run"
    whose, own = _owners(data)
    rows = [
        ("teleop", f"{data.get('mode')}, {verdict} ({data.get('phase')})"),
        ("link", f"{data.get('link')} {_link_state(data)}{_where(data)}"),
        ("topic", f"{data.get('topic')}"),
        (
            f"{whose}opening",
            f"{figure(_of_frame(data, 'position_mm'), '.2f', 'mm')}, {_percent(data)} open",
        ),
        (f"{whose}force", figure(_of_frame(data, "force_n"), "+.1f", "N")),
        (f"{own}torque", figure(data.get("torque_nm"), "+.2f", "N·m")),
        ("frames", f"{data.get('frames')}, the last {_age(data)} ago"),
        ("loop", figure(data.get("loop_hz"), ".0f", "Hz")),
    ]
    if data.get("mode") == "master" and data.get("active"):
        rows.append(("followers", _followers(data)))
    rows += [("felt", text) for text in _felt(data)]
    if data.get("active") and data.get("link_protected") is False:
        rows.append(("open to", "everyone who reaches the link"))
    troubles = _troubles(data) + _counts(data)
    if troubles:
        rows.append(("note", ", ".join(troubles)))
    if data.get("fault"):
        rows.append(("ended by" if not data.get("active") else "fault", str(data["fault"])))
    return "\n".join(f"{label:<{_LABEL_WIDTH}} {plain(text)}" for label, text in rows)


_REACH = {
    "connected": "connected, no frame yet",
    "bound": "bound, no frame comes",
    "frames": "connected, frames come",
}


def _link_state(data: Data) -> str:
    """Return how far the link is: of an end that goes to another one, how far it has come."""
    state, reach = data.get("link_state") or "closed", data.get("link_reach")
    return str(state) if reach is None or state != "open" else _REACH.get(str(reach), str(reach))


def _owners(data: Data) -> tuple[str, str]:
    """Name the owners of what is in frames and of what is measured here, where they differ."""
    return ("leader's ", "own ") if data.get("mode") == "slave" else ("", "")


def _followers(data: Data) -> str:
    """Return how many follow, as far as a leader can know: each is heard only with reflection."""
    count = data.get("followers")
    if count is not None:
        return f"{count} heard"
    if data.get("matching") is None:
        return "not known: they are not heard"
    return "at least one" if data["matching"] else "none"


def _where(data: Data) -> str:
    """Name the other end where this one goes to it, else the port at which it listens."""
    host, port = data.get("host"), data.get("port")
    if port is None:
        return ""
    return f", port {port}" if host is None else f", {_address(host, port)}"


def _leader(data: Data) -> str:
    host, port = data.get("host"), data.get("port")
    if host is None:
        return "a leader" if port is None else f"a leader at port {port}"
    return _address(host, port)


def _address(host: object, port: object) -> str:
    """Put the port behind a host; several hosts may have ports of their own."""
    text = str(host)
    return f"[{text}]:{port}" if text.count(":") > 1 and "," not in text else f"{text}:{port}"


def _felt(data: Data) -> list[str]:
    """Return force reflection: the slave's last report, or the master's present push."""
    force_n = data.get("reflected_n")
    if force_n is None:
        return []
    trip = figure(data.get("round_trip_ms"), ".0f", "ms")
    on_time = f" ({trip} round)" if data.get("mode") == "master" else ""
    return [f"reflects {figure(force_n, '+.1f', 'N')}{on_time}"]


def _troubles(data: Data) -> list[str]:
    """Name what is not as it should be."""
    found = _link_troubles(data)
    if data.get("active") and data.get("mode") == "slave" and not data.get("frames"):
        found.append(f"nothing heard from {_leader(data)} yet")
    if data.get("stale"):
        found.append(f"STALE {_age(data)}")
    if data.get("over_torque"):
        found.append("RELEASED")
    if data.get("force_limited"):
        found.append("force limited")
    if data.get("followers") == 0:
        found.append("nobody sends a force")
    if data.get("mode") == "master" and data.get("matching") is False:
        found.append("nobody follows")
    return found + _gate(data)


def _link_troubles(data: Data) -> list[str]:
    """Name what keeps frames from travelling."""
    found = []
    if data.get("link_unreached"):
        found.append(f"not reached: {data['link_unreached']}")
    if data.get("link_state") == "failed":
        found.append(f"link failed: {data.get('link_error')}")
    return found


def _gate(data: Data) -> list[str]:
    """Say of a master if its jaws hold, and if they went slack though no slave was ready."""
    if data.get("mode") != "master" or data.get("ready"):
        return []
    if data.get("active") and data.get("phase") == "waiting":
        return ["holds until a slave is ready"]
    return ["no slave was ready"] if data.get("ready_timed_out") else []


def _counts(data: Data) -> list[str]:
    return [f"{name} {data[name]}" for name in _COUNTS if data.get(name)]


def _of_frame(data: Data, name: str) -> object:
    """Return a figure of the newest frame, None before the first one."""
    return data.get(name) if data.get("frames") else None


def _percent(data: Data) -> str:
    openness = _of_frame(data, "openness")
    return f"{100.0 * openness:.1f} %" if isinstance(openness, int | float) else "--"


def _age(data: Data) -> str:
    return figure(data.get("last_frame_age_ms"), ".0f", "ms")


COMMANDS: Commands = {
    "teleop": (teleop, teleop_options),
}
