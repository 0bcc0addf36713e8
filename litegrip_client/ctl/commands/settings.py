"""The commands that read and change settings: the daemon's configuration, the motor's registers.

Registers are only read.
"""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl import render_results as render
from litegrip_client.ctl.parser import LateParser, setting
from litegrip_client.ctl.render import plain
from litegrip_client.ctl.run import OK, Command, Fill, Run
from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


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


def _get_options(parser: LateParser) -> None:
    parser.description = "Show all fields with what is allowed, or the value of one."
    parser.add_argument("field", nargs="?", metavar="FIELD", help="force_n, for one")
    parser.words["field"] = "fields"


def _set_options(parser: LateParser) -> None:
    parser.description = "Change fields for all clients, until the daemon restarts."
    parser.epilog = "example:\n  litegripctl config set force_n=15 speed_mm_s=30 --keep"
    parser.add_argument("fields", nargs="+", type=setting, metavar="FIELD=VALUE", help="numbers")
    parser.add_argument("--keep", action="store_true", help="also for after a restart")
    parser.words["fields"] = "settings"


def config(run: Run) -> int:
    """Show or change the daemon's defaults for motions."""
    if run.options.action == "set":
        return _set(run)
    data = run.connection.call("config.get")
    field = run.options.field
    if field is None:
        run.output.result(data, render.config(data))
        return OK
    if field not in data["config"]:
        raise CommandError(
            f"there is no field {field!r}",
            reason="invalid_params",
            data={"hint": "all fields: litegripctl config"},
        )
    only = _only(data, (field,))
    run.output.result(only, plain(only["config"][field]))
    return OK


def _set(run: Run) -> int:
    fields = dict(run.options.fields)
    if len(fields) < len(run.options.fields):
        return run.refuse("a field is given twice", "give each field one value")
    data = run.connection.call(
        "config.set", {"config": fields, "keep": run.options.keep}, ACTION_TIMEOUT_S
    )
    text = render.config(_only(data, fields))
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


_REGISTERS = """\
examples:
  litegripctl register PMAX VMAX TMAX
  litegripctl register 21 0x15
"""


def register_options(parser: LateParser) -> None:
    """Take which."""
    parser.description, parser.epilog = "Read registers of the motor.", _REGISTERS
    parser.add_argument(
        "registers", nargs="+", metavar="NAME|NUMBER", help="PMAX, 21 or 0x15, for one"
    )


def register(run: Run) -> int:
    """Read registers."""
    rows = [
        run.connection.call("motor.read_register", {"register": name})
        for name in run.options.registers
    ]
    run.output.result({"registers": rows}, render.registers(rows))
    return OK


COMMANDS: Mapping[str, Command] = {"config": config, "register": register}
OPTIONS: Mapping[str, Fill] = {
    "config": config_options,
    "register": register_options,
}
