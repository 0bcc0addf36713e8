"""The commands that switch the motor and read its registers."""

from __future__ import annotations

from collections.abc import Iterable

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.parser import LateParser, count
from litegrip_client.ctl.render import Data, plain
from litegrip_client.ctl.run import NOT_OK, OK, Commands, Run

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


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
    run.output.result({"registers": rows}, _registers_text(rows))
    return OK


def _registers_text(rows: Iterable[Data]) -> str:
    """Show registers, one in a line."""
    return "\n".join(
        f"{plain(row.get('number')):>3}  {plain(row.get('name')):<9}  {plain(row.get('value'))}"
        for row in rows
    )


COMMANDS: Commands = {
    "enable": (enable, enable_options),
    "disable": (disable, None),
    "clear-fault": (clear_fault, None),
    "register": (register, register_options),
}
