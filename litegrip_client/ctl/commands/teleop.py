"""Teleoperation from a terminal: begun, watched in one line, ended by Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Mapping

from litegrip_client.ctl import render_teleop as render
from litegrip_client.ctl.run import NOT_OK, OK, Command, Run

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
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
