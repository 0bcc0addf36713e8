"""Commands about the daemon: its health, figures, settings, and a restart."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Collection
from difflib import get_close_matches

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.parser import NUMBER, LateParser
from litegrip_client.ctl.run import Commands, Run, connected, installing
from litegrip_client.ctl.state_view import UNITS
from litegrip_client.values.errors import CommandError, LiteGripError
from litegrip_client.values.figures import Data, figure, plain
from litegrip_client.values.printed import HealthReport, tree
from litegrip_client.values.terms import told_all

_SETTING = re.compile(rf"([a-z][a-z0-9_]*)=({NUMBER}(?:e[+-]?[0-9]+)?)", re.IGNORECASE)

_FIELDS_PAGE = "docs/configuration.md says what they are"
_UNITS = (
    *UNITS,
    *(("_interval", "s"), ("_tol", "rad"), ("_delta", "rad"), ("tau_limit", "N·m")),
    *(("_kp", "N·m/rad"), ("_kd", "N·m·s/rad"), ("stall_ratio", "of the way")),
    *(("margin", "of the travel"), ("press_overshoot", "of the travel")),
)
"""With the settings' own. What has none are numbers of samples and attempts."""
_CONFIG = """\
Show or change the defaults that the daemon uses for motions. Without an action
all are shown, with what is allowed.
"""


def config_options(parser: LateParser) -> None:
    """Add the arguments of `config`."""
    parser.description = _CONFIG
    parser.set_defaults(field=None)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser)
    actions.add_parser("get", help="show all fields, or one", fill=_get_options)
    actions.add_parser("set", help="change fields", fill=_set_options)


def _setting(text: str) -> tuple[str, float]:
    """Read FIELD=NUMBER."""
    found = _SETTING.fullmatch(text)
    if found is None:
        example = f"{text}=NUMBER" if text.isidentifier() else "FIELD=NUMBER, force_n=15 for one"
        raise ArgumentTypeError(f"{text!r} is no setting: say {example}")
    # Some fields are whole numbers, and the daemon takes a whole number for the others, too.
    return found[1], int(found[2]) if re.fullmatch(r"[+-]?[0-9]+", found[2]) else float(found[2])


def _get_options(parser: LateParser) -> None:
    parser.description = "Show all fields with what is allowed, or the value of one."
    parser.add_argument("field", nargs="?", metavar="FIELD", help="force_n, for one")


def _set_options(parser: LateParser) -> None:
    parser.description = "Change fields for all clients, until the daemon restarts."
    parser.epilog = "example:\n  litegripctl config set force_n=15 speed_mm_s=30 --keep"
    parser.add_argument("fields", nargs="+", type=_setting, metavar="FIELD=VALUE", help="numbers")
    parser.add_argument("--keep", action="store_true", help="also for after a restart")


def config(run: Run) -> int:
    """Show or change the daemon's defaults for motions."""
    if run.options.action == "set":
        return _set(run)
    data = run.connection.call("config.get")
    field = run.options.field
    if field is None:
        return run.done(data, f"{_config_text(data)}\n{_FIELDS_PAGE}")
    if field not in data["config"]:
        return _no_field(run, field, data["config"])
    only = _only(data, (field,))
    return run.done(only, plain(only["config"][field]))


def _config_text(data: Data) -> str:
    """Return fields, their values, what is allowed and in which unit, one in a line."""
    rows = []
    for name, value in data["config"].items():
        allowed = data.get("ranges", {}).get(name)
        limits = f"{allowed[0]:g} to {allowed[1]:g}" if allowed else ""
        unit = next((unit for end, unit in _UNITS if name.endswith(end)), "")
        rows.append((plain(name), plain(value), limits, unit))
    wide = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, wide, strict=True)) for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


def _set(run: Run) -> int:
    fields = dict(run.options.fields)
    if len(fields) < len(run.options.fields):
        return run.refuse("a field is given twice", "give each field one value")
    known = run.connection.call("config.get")["config"]
    for name in fields:
        if name not in known:
            return _no_field(run, name, known)
    data = run.connection.call(
        "config.set", {"config": fields, "keep": run.options.keep}, ACTION_TIMEOUT_S
    )
    text = _config_text(_only(data, fields))
    how_long = "for good" if run.options.keep else "until the daemon restarts; for longer: --keep"
    return run.done(data, f"{text}\n{how_long}")


def _no_field(run: Run, name: str, known: Collection[str]) -> int:
    close = get_close_matches(name, known, 1, 0.5)  # "sped" is speed_mm_s
    meant = f"did you mean {close[0]!r}? " if close else ""
    hint = f"{meant}All fields: {run.here('litegripctl config')}; {_FIELDS_PAGE}"
    return run.refuse(f"there is no field {name!r}", hint)


def _only(data: Data, names: Collection[str]) -> Data:
    """Leave the named fields of a configuration."""
    return {
        **data,
        "config": {name: data["config"][name] for name in names},
        "ranges": {name: data["ranges"][name] for name in names if name in data["ranges"]},
    }


def health(run: Run) -> int:
    """Show the daemon's verdict, why, and its figures; the exit code gives the verdict."""
    data = run.connection.call("health")
    told = {name: told_all(data, name, run.voice) for name in ("reasons", "notes")}
    run.output.result(data, str(HealthReport({**data, **told})))
    return {"ok": 0, "degraded": 1}.get(data["verdict"], 2)


_METRICS = """\
Print the figures of health for Prometheus: as OpenMetrics, which its server
scrapes, or as its older text format, which node_exporter's textfile collector
reads.
"""


def metrics_options(parser: LateParser) -> None:
    """Add the arguments of `metrics`."""
    parser.description = _METRICS
    parser.add_argument(
        "--format",
        choices=("openmetrics", "text"),
        default="openmetrics",
        help="the format (default: openmetrics)",
    )


def metrics(run: Run) -> int:
    """Show the daemon's figures as monitoring reads them."""
    try:
        from litegrip_client.ctl import metrics as exposition  # noqa: PLC0415 - needs another library
    except ImportError as error:
        raise CommandError(
            f"metrics needs the library prometheus_client: {error}",
            reason="library_missing",
            data={"hint": installing("prometheus_client")},
        ) from error
    health, hello = run.connection.call("health"), run.connection.call("hello")
    form = run.options.format
    text = exposition.text(health, form, channel=hello["channel"], version=hello["version"])
    content_type = exposition.FORMATS[form].CONTENT_TYPE_LATEST
    return run.done({"format": content_type, "text": text}, text.rstrip("\n"))


def info(run: Run) -> int:
    """Show what does not change."""
    data = run.connection.call("info.get")
    return run.done(data, tree(data))


_RESTART = """\
Start a successor of the daemon, which reads the configuration again and takes
over. The motor stays enabled, with the same pose and force. For admins, while
no motion runs."""


def restart_options(parser: LateParser) -> None:
    """Add the arguments of `restart`."""
    parser.description = _RESTART
    parser.add_argument("--hold", action="store_true", help="hold through the restart; required")


def restart(run: Run) -> int:
    """Have a successor take the daemon's place, while the jaws are held."""
    if not run.options.hold:
        hello = run.connection.call("hello")
        remote = hello.get("remote")
        channel = hello["channel"] if remote is None else remote["channel"]
        where = "" if remote is None else "on the gripper's machine: "
        # A gripper that the daemon itself simulates ends with it: nothing is held then.
        hold = "" if hello.get("simulated") else "; to hold all the while: --hold"
        return run.refuse(
            "a restart that disables the motor is the service manager's to do",
            f"{where}systemctl restart litegripd@{channel}; one that was started by hand: end it"
            f" and start it again{hold}",
        )
    data = run.connection.call("daemon.restart", {"hold_through_restart": True}, ACTION_TIMEOUT_S)
    text = f"restarted: pid {data['pid']} has taken over, {_kept(run, data['gap_s'])}"
    return run.done(data, plain(text))


def _kept(run: Run, gap_s: float) -> str:
    """Return what became of the jaws: a successor holds only what was held before."""
    try:
        with connected(run.options) as successor:
            state = successor.call("state.get")
    except LiteGripError as error:
        return f"but it is not known if the jaws are held: {error.message}"
    if not state["enabled"]:
        return f"nothing is held: the motor is {state['motor']}"
    slack = state["mode"] == "relaxed"
    kept = "the motor stays enabled, and slack" if slack else "the jaws are held"
    return f"{kept} (no command for {figure(gap_s * 1e3, '.1f', 'ms')})"


def discover(run: Run) -> int:
    """Show which methods the daemon has."""
    data = run.connection.call("rpc.discover")
    rows = {row.get("name", ""): row.get("summary", "") for row in data.get("methods", [])}
    return run.done(data, tree(dict(sorted(rows.items()))))


COMMANDS: Commands = {
    "config": (config, config_options),
    "health": (health, None),
    "metrics": (metrics, metrics_options),
    "info": (info, None),
    "discover": (discover, None),
    "restart": (restart, restart_options),
}
