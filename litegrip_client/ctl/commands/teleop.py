"""Teleoperation from a terminal: begun, watched in one line, ended by Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Mapping

from litegrip_client.ctl import render_teleop as render
from litegrip_client.ctl.parser import LateParser, count, positive
from litegrip_client.ctl.run import NOT_OK, OK, Command, Fill, Run

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

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
    "reflect_force": "reflect_n",
    "reflect_gain": "reflect_gain",
}
_FLAGS = ("fake_leader", "reflect")


_TELEOP = """\
Let one gripper follow another one. Enable both before.

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
    """Take what to do."""
    parser.description, parser.epilog = _TELEOP, _EXAMPLES
    add = parser.add_subparsers(
        dest="action", required=True, metavar="ACTION", parser_class=LateParser
    ).add_parser
    # Behind these, --host is the other end of the link: so its machine is named in front.
    own: dict[str, Any] = {"conflict_handler": "resolve"}
    add(
        "master", help="lead: the jaws go slack, and are moved by hand", fill=_master_options, **own
    )
    add("slave", help="follow a leader", fill=_slave_options, **own)
    add("status", help="show how it goes")
    add("stop", help="end it")


def _master_options(parser: LateParser) -> None:
    _link_options(parser)
    parser.add_argument(
        "--host", help="with --link udp: the follower's machine, or several: A,B,C:PORT"
    )
    parser.add_argument(
        "--rate", type=positive, metavar="HZ", help="frames a second (default: the control rate)"
    )
    parser.add_argument(
        "--reflect-force",
        type=positive,
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
        type=positive,
        metavar="NM",
        help="let go at or over so much torque, in N·m (default: never)",
    )
    parser.add_argument(
        "--force-limit", type=positive, metavar="N", help="push by no more than this, in newtons"
    )
    parser.add_argument("--reflect", action="store_true", help="tell the leader that force")
    parser.add_argument(
        "--watchdog", type=positive, metavar="S", help="hold after so long without a frame (0.2)"
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
        run.output.result(data, render.status(data))
        return OK
    if action == "stop":
        return _stop(run)
    return _start(run, action)


def _start(run: Run, mode: str) -> int:
    options = run.options
    params: dict[str, Any] = {"mode": mode}
    for option, name in _OPTIONS.items():
        value = getattr(options, option, None)
        if value is not None:
            params[name] = value
    params |= {name: True for name in _FLAGS if getattr(options, name, False)}
    if options.detach:
        params["detach"] = True
    data = run.connection.run(run.connection.prepare_guarded("teleop.start", params))
    if options.detach:
        return _leave(run, data)
    try:
        return _watch(run)
    except KeyboardInterrupt:
        run.output.end_line()
        return _stop(run, holding=True)


def _leave(run: Run, data: dict[str, Any]) -> int:
    """Leave it running once its link is open; end it where that cannot be opened."""
    ends_s = time.monotonic() + _OPEN_WITHIN_S
    while data["active"] and data.get("link_state") == "opening" and time.monotonic() < ends_s:
        time.sleep(_LOOK_EVERY_S)
        data = run.connection.call("teleop.status")
    if data["active"] and data.get("link_state") == "failed":
        why = data.get("link_error")
        data = run.connection.call("teleop.stop")
        told = f"the link has failed: {why}"
        run.output.result({**data, "link_error": why}, f"{data['mode']}: ended, {told}")
        return NOT_OK
    if not data["active"]:
        run.output.result(data, render.status(data))
        return NOT_OK
    opening = ", its link is still opening" if data.get("link_state") == "opening" else ""
    text = f"{data['mode']}: it runs{opening}; end it with: litegripctl teleop stop"
    run.output.result(data, text)
    return OK


def _watch(run: Run) -> int:
    """Show how it goes until it ends."""
    while True:
        data = run.connection.call("teleop.status")
        if not data["active"]:
            run.output.result(data, render.ended(data))
            return NOT_OK
        if run.output.live:
            run.output.line(render.line(data))
        time.sleep(_LOOK_EVERY_S)


def _stop(run: Run, *, holding: bool = False) -> int:
    data = run.connection.call("teleop.stop")
    run.output.result(data, render.ended(data, holding=holding))
    return OK


COMMANDS: Mapping[str, Command] = {"teleop": teleop}
OPTIONS: Mapping[str, Fill] = {
    "teleop": teleop_options,
}
