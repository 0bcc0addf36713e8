"""The command that shows and changes the daemon's defaults for motions."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Mapping

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.parser import NUMBER, LateParser
from litegrip_client.ctl.render import Data, plain
from litegrip_client.ctl.run import OK, Commands, Run
from litegrip_client.errors import ParameterError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


_SETTING = re.compile(rf"([a-z][a-z0-9_]*)=({NUMBER}(?:e[+-]?[0-9]+)?)", re.IGNORECASE)

_CONFIG = """\
Show or change the defaults that the daemon uses for motions. Without an action
all are shown, with what is allowed.
"""


def config_options(parser: LateParser) -> None:
    """Take what to do."""
    parser.description = _CONFIG
    parser.set_defaults(field=None)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser)
    actions.add_parser("get", help="show all fields, or one", fill=_get_options)
    actions.add_parser("set", help="change fields", fill=_set_options)


def _setting(text: str) -> tuple[str, float]:
    """Read FIELD=NUMBER."""
    found = _SETTING.fullmatch(text)
    if found is None:
        raise ArgumentTypeError(f"{text!r} is no setting: say FIELD=NUMBER, force_n=15 for one")
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
        run.output.result(data, _config_text(data))
        return OK
    if field not in data["config"]:
        raise ParameterError(
            f"there is no field {field!r}",
            reason="invalid_params",
            data={"hint": "all fields: litegripctl config"},
        )
    only = _only(data, (field,))
    run.output.result(only, plain(only["config"][field]))
    return OK


def _config_text(data: Data) -> str:
    """Show fields, their values and what is allowed, one in a line."""
    fields = data["config"]
    names = max(map(len, fields), default=0)
    values = max((len(plain(value)) for value in fields.values()), default=0)
    lines = []
    for name, value in fields.items():
        allowed = data.get("ranges", {}).get(name)
        limits = f"  {allowed[0]:g} to {allowed[1]:g}" if allowed else ""
        lines.append(f"{plain(name):<{names}}  {plain(value):<{values}}{limits}".rstrip())
    return "\n".join(lines)


def _set(run: Run) -> int:
    fields = dict(run.options.fields)
    if len(fields) < len(run.options.fields):
        return run.refuse("a field is given twice", "give each field one value")
    data = run.connection.call(
        "config.set", {"config": fields, "keep": run.options.keep}, ACTION_TIMEOUT_S
    )
    text = _config_text(_only(data, fields))
    if not run.options.keep:
        text += "\nuntil the daemon restarts; for longer: --keep"
    run.output.result(data, text)
    return OK


def _only(data: Mapping[str, Any], names: Mapping[str, Any] | tuple[str, ...]) -> dict[str, Any]:
    """Leave the named fields of a configuration."""
    return {
        **data,
        "config": {name: data["config"][name] for name in names},
        "ranges": {name: data["ranges"][name] for name in names if name in data["ranges"]},
    }


COMMANDS: Commands = {
    "config": (config, config_options),
}
