"""The commands about the daemon itself: how it is, what it is, what it can, and its restart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.parser import LateParser
from litegrip_client.ctl.render import Data, figure, plain
from litegrip_client.ctl.run import OK, Commands, Run, installing
from litegrip_client.errors import CommandError, LiteGripError
from litegrip_client.voices import in_shell

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    pass


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
    data = run.connection.call("info.get")
    run.output.result(data, _tree_text(data))
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


_RESTART = """\
Start a successor of the daemon, which reads the configuration again and takes
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


def discover(run: Run) -> int:
    """Show which methods the daemon has."""
    data = run.connection.call("rpc.discover")
    run.output.result(data, _methods_text(data))
    return OK


def _methods_text(document: Data) -> str:
    """Show the methods of an OpenRPC document."""
    rows = {row.get("name", ""): row.get("summary", "") for row in document.get("methods", [])}
    return _tree_text(dict(sorted(rows.items())))


COMMANDS: Commands = {
    "health": (health, None),
    "metrics": (metrics, None),
    "info": (info, None),
    "discover": (discover, None),
    "restart": (restart, restart_options),
}
