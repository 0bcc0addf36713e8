"""The commands that look at things, switch the motor, and see to jobs."""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl import render
from litegrip_client.ctl.output import Output
from litegrip_client.ctl.parser import LateParser, count
from litegrip_client.ctl.run import ENDING, NOT_OK, OK, Command, Fill, Run, installing
from litegrip_client.errors import CommandError, LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


def state(run: Run) -> int:
    """Show the state."""
    data = run.connection.call("state.get")
    run.output.result(data, render.state(data))
    return OK


def enable_options(parser: LateParser) -> None:
    """Take the number of attempts."""
    parser.add_argument("--retries", type=count, metavar="N", help="attempts at most, 1 to 20")


def enable(run: Run) -> int:
    """Enable the motor, for longer than this program runs."""
    params: dict[str, Any] = {"detach": True}
    if run.options.retries is not None:
        params["retries"] = run.options.retries
    data = run.connection.run(
        run.connection.prepare_guarded("motor.enable", params), ACTION_TIMEOUT_S
    )
    failure = f"NOT enabled: {data.get('message') or data.get('reason')} (tries: {data['tries']})"
    run.output.result(data, "enabled" if data["ok"] else render.plain(failure))
    return OK if data["ok"] else NOT_OK


def disable(run: Run) -> int:
    """Disable the motor."""
    data = run.connection.call("motor.disable", {"detach": True}, ACTION_TIMEOUT_S)
    run.output.result(
        data, "disabled" if data["ok"] else "NOT disabled: the motor does not confirm it"
    )
    return OK if data["ok"] else NOT_OK


def clear_fault(run: Run) -> int:
    """Clear what the motor has latched."""
    data = run.connection.call("motor.clear_fault", {"detach": True}, ACTION_TIMEOUT_S)
    cleared = data.get("cleared")
    text = "the motor had no fault" if cleared is None else f"cleared: {cleared}"
    run.output.result(data, render.plain(f"{text}; it is disabled"))
    return OK


def hold(run: Run) -> int:
    """Hold the measured position."""
    data = run.connection.run(run.connection.prepare_guarded("motion.hold", {}))
    opening = render.figure(data["state"].get("opening_mm"), ".2f", "mm")
    run.output.result(data, f"holding at {opening}")
    return OK


def clear(run: Run) -> int:
    """Clear a stop."""
    data = run.connection.run(run.connection.prepare_guarded("stop.clear", {}))
    run.output.result(data, "cleared: motions are allowed")
    return OK


def jobs(run: Run) -> int:
    """List the jobs."""
    data = run.connection.call("job.list")
    run.output.result(data, render.jobs(data["jobs"]) if data["jobs"] else "no jobs")
    return OK


def cancel_options(parser: LateParser) -> None:
    """Take the job."""
    parser.add_argument("job", type=count, metavar="JOB", help="the number that 'jobs' shows")
    parser.words["job"] = "jobs"


def cancel(run: Run) -> int:
    """Cancel a job."""
    data = run.connection.call("job.cancel", {"job": run.options.job})
    done = data["state"] in ENDING
    text = "cancelled, the jaws hold" if done else f"had ended already: {data['state']}"
    run.output.result(data, render.plain(f"job {data['job']} {text}"))
    return OK if done else NOT_OK


def health(run: Run) -> int:
    """Show the daemon's verdict and figures; the exit code gives the verdict."""
    data = run.connection.call("health")
    run.output.result(data, render.health(data))
    return {"ok": 0, "degraded": 1}.get(data["verdict"], 2)


def metrics(run: Run) -> int:
    """Show the daemon's figures as OpenMetrics text."""
    try:
        from litegrip_client import metrics as exposition  # noqa: PLC0415 - needs another library
    except ImportError as error:
        raise CommandError(
            f"metrics needs the library prometheus_client: {error}",
            reason="library_missing",
            data={"hint": installing("prometheus_client")},
        ) from error
    health, hello = run.connection.call("health"), run.connection.call("hello")
    text = exposition.text(health, channel=hello["channel"], version=hello["version"])
    run.output.result({"format": exposition.CONTENT_TYPE, "text": text}, text.rstrip("\n"))
    return OK


def info(run: Run) -> int:
    """Show what does not change."""
    return _tree(run.connection.call("info.get"), run.output)


_RESTART = """\
Start a successor of the daemon, which reads the configuration anew and takes
over. The motor stays enabled, with the same pose and force. For admins, while
no motion runs."""


def restart_options(parser: LateParser) -> None:
    """Take that the jaws are to be held; without it nothing is done."""
    parser.description = _RESTART
    parser.add_argument("--hold", action="store_true", help="hold through the restart; required")


def restart(run: Run) -> int:
    """Have a successor take the daemon's place, while the jaws are held."""
    if not run.options.hold:
        channel = run.connection.call("hello")["channel"]
        return run.refuse(
            "a restart that disables the motor is the service manager's to do",
            f"systemctl restart litegripd@{channel}; to hold all the while: --hold",
        )
    data = run.connection.call("daemon.restart", {"hold_through_restart": True}, ACTION_TIMEOUT_S)
    text = f"restarted: pid {data['pid']} has taken over, {_kept(run, data['gap_s'])}"
    run.output.result(data, render.plain(text))
    return OK


def _kept(run: Run, gap_s: float) -> str:
    """Say what became of the jaws: a successor holds only what was held before."""
    try:
        with run.way.connect() as successor:
            state = successor.call("state.get")
    except LiteGripError as error:
        return f"whether the jaws are held is not known: {error.message}"
    if not state["enabled"]:
        return f"nothing is held: the motor is {state['motor']}"
    slack = state["mode"] == "relaxed"
    kept = "the motor stays enabled, and slack" if slack else "the jaws are held"
    return f"{kept} (no command for {render.figure(gap_s * 1e3, '.1f', 'ms')})"


def _tree(data: Mapping[str, Any], output: Output) -> int:
    output.result(data, render.tree(data))
    return OK


def discover(run: Run) -> int:
    """Show which methods the daemon has."""
    data = run.connection.call("rpc.discover")
    run.output.result(data, render.methods(data))
    return OK


COMMANDS: Mapping[str, Command] = {
    "state": state,
    "enable": enable,
    "disable": disable,
    "clear-fault": clear_fault,
    "hold": hold,
    "clear": clear,
    "jobs": jobs,
    "cancel": cancel,
    "health": health,
    "metrics": metrics,
    "info": info,
    "discover": discover,
    "restart": restart,
}
OPTIONS: Mapping[str, Fill] = {
    "enable": enable_options,
    "cancel": cancel_options,
    "restart": restart_options,
}
