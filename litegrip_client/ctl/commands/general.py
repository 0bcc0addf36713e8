"""The commands that look at things, switch the motor, and see to jobs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.output import Output
from litegrip_client.ctl.parser import LateParser, count
from litegrip_client.ctl.render import (
    Data,
    age,
    aligned,
    figure,
    is_unheard,
    owner,
    plain,
    state_rows,
)
from litegrip_client.ctl.run import ENDING, NOT_OK, OK, Command, Fill, Run, installing
from litegrip_client.errors import CommandError, LiteGripError
from litegrip_client.voices import in_shell

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

_LABEL_WIDTH = 12
_DATA = Path(__file__).resolve().parents[2] / "data"


def state(run: Run) -> int:
    """Show the state."""
    data = run.connection.call("state.get")
    run.output.result(data, _state_text(data))
    return OK


def _state_text(data: Data) -> str:
    """Show a state in aligned lines."""
    lines = [f"{label:<{_LABEL_WIDTH}} {plain(text)}" for label, text in state_rows(data)]
    if is_unheard(data):
        lines.insert(0, "the motor has not answered yet: nothing is known of it")
    elif data.get("stale"):
        lines.insert(0, f"{age(data)}: these are the last known figures")
    return "\n".join(lines)


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
    run.output.result(data, "enabled" if data["ok"] else plain(failure))
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
    run.output.result(data, plain(f"{text}; it is disabled"))
    return OK


def hold(run: Run) -> int:
    """Hold the measured position."""
    data = run.connection.run(run.connection.prepare_guarded("motion.hold", {}))
    opening = figure(data["state"].get("opening_mm"), ".2f", "mm")
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
    run.output.result(data, _jobs_text(data["jobs"]) if data["jobs"] else "no jobs")
    return OK


def _jobs_text(rows: list[Data]) -> str:
    """Show jobs as a table."""
    table = [("JOB", "KIND", "STATE", "PHASE", "OWNER")]
    table += [
        (
            str(row.get("job")),
            plain(row.get("kind")),
            plain(row.get("state")),
            plain(row.get("phase") or "-"),
            plain(owner(row.get("owner") or {})),
        )
        for row in rows
    ]
    return aligned(table)


def cancel_options(parser: LateParser) -> None:
    """Take the job."""
    parser.add_argument("job", type=count, metavar="JOB", help="the number that 'jobs' shows")


def cancel(run: Run) -> int:
    """Cancel a job."""
    data = run.connection.call("job.cancel", {"job": run.options.job})
    done = data["state"] in ENDING
    text = "cancelled, the jaws hold" if done else f"had ended already: {data['state']}"
    run.output.result(data, plain(f"job {data['job']} {text}"))
    return OK if done else NOT_OK


def health(run: Run) -> int:
    """Show the daemon's verdict and figures; the exit code gives the verdict."""
    data = run.connection.call("health")
    run.output.result(data, _health_text(data))
    return {"ok": 0, "degraded": 1}.get(data["verdict"], 2)


def _health_text(data: Data) -> str:
    """Show the daemon's verdict and its reasons, and then the figures."""
    figures = {name: value for name, value in data.items() if name not in ("verdict", "reasons")}
    lines = [f"verdict: {plain(data.get('verdict'))}"]
    lines += [f"- {plain(in_shell(str(reason)))}" for reason in data.get("reasons", ())]
    return "\n".join([*lines, "", _tree_text(figures)] if figures else lines)


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
    run.output.result(data, plain(text))
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
    return f"{kept} (no command for {figure(gap_s * 1e3, '.1f', 'ms')})"


def _tree(data: Mapping[str, Any], output: Output) -> int:
    output.result(data, _tree_text(data))
    return OK


def _tree_text(data: Data) -> str:
    """Show nested figures, one in a line, with dotted names."""
    rows = list(_leaves(data, ""))
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join(f"{name:<{width}}  {plain(value)}" for name, value in rows)


def _leaves(value: object, name: str) -> Iterator[tuple[str, object]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{name}[{index}]")
    else:
        yield name, "--" if value is None or value in ({}, []) else value


def discover(run: Run) -> int:
    """Show which methods the daemon has."""
    data = run.connection.call("rpc.discover")
    run.output.result(data, _methods_text(data))
    return OK


def _methods_text(document: Data) -> str:
    """Show the methods of an OpenRPC document."""
    rows = {row.get("name", ""): row.get("summary", "") for row in document.get("methods", [])}
    return _tree_text(dict(sorted(rows.items())))


_COMPLETION = """\
Print the script by which a shell completes commands, options and their values:
running channels, files.
"""
_COMPLETION_EXAMPLES = """\
examples:
  eval "$(litegripctl completion bash)"      for this shell, or in ~/.bashrc
  eval "$(litegripctl completion zsh)"       in ~/.zshrc, behind compinit
  litegripctl completion fish | source       in ~/.config/fish/config.fish
"""


def completion_options(parser: LateParser) -> None:
    """Take which shell."""
    parser.description, parser.epilog = _COMPLETION, _COMPLETION_EXAMPLES
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="the shell")


def completion(run: Run) -> int:
    """Print the script of a shell."""
    shell = run.options.shell
    script = (_DATA / f"litegripctl.{shell}").read_text(encoding="utf-8")
    run.output.result({"shell": shell, "script": script}, script.rstrip("\n"))
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
    "completion": completion,
}
OPTIONS: Mapping[str, Fill] = {
    "enable": enable_options,
    "cancel": cancel_options,
    "restart": restart_options,
    "completion": completion_options,
}
