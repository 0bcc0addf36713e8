"""The calibration by hand: the person moves the slack jaws, this program asks and records.

The daemon ends it when this program dies; the calibration in use changes at the very end only.
"""

from __future__ import annotations

from litegrip_client.ctl import render_results as render
from litegrip_client.ctl import terminal
from litegrip_client.ctl.output import one_line
from litegrip_client.ctl.render import figure
from litegrip_client.ctl.run import INTERRUPTED, NOT_OK, OK, Run
from litegrip_client.errors import CancelledError, CommandError, LiteGripError
from litegrip_client.link import ACTION_TIMEOUT_S

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_AS_BEFORE = "the calibration is as it was"
_SAVE = "use it and store it (y), use it without storing it (n), or cancel (c)?"


class _NotWantedError(Exception):
    """The person says so, or has gone."""


def manual(run: Run) -> int:
    """Record both stops, show the travel, and have it used as the person says."""
    if not terminal.may_ask():
        return run.refuse(
            "a calibration by hand needs a terminal to ask at",
            "without hands: litegripctl zero --yes",
        )
    _step(run, "begin")
    try:
        data = _lead(run)
    except (KeyboardInterrupt, _NotWantedError) as reason:
        interrupted = isinstance(reason, KeyboardInterrupt)
        _report(run, "interrupted" if interrupted else "cancelled")
        return INTERRUPTED if interrupted else NOT_OK
    except BaseException:
        _cancel(run)  # if that fails, too, the end of the connection does it
        raise
    run.output.result(data, render.measured("manual", data))
    return OK if data["ok"] else NOT_OK


def _lead(run: Run) -> dict[str, Any]:
    """Record until what was recorded is taken."""
    terminal.say("The jaws are slack now. Ctrl-C cancels.")
    while True:
        _record(run)
        answer = _ask(_SAVE)
        while answer not in ("y", "yes", "n", "no", "c", "cancel"):
            answer = _ask(f"please answer y, n or c: {_SAVE}")
        if answer.startswith("c"):
            raise _NotWantedError
        try:
            return _step(run, "finish", save=answer.startswith("y"))
        except CommandError as error:
            if error.reason != "out_of_limits":
                raise
            terminal.say(f"  {one_line(error.message)}")


def _record(run: Run) -> None:
    for step, request in (
        ("closed", "push the jaws closed, to the stop, then press Enter:"),
        ("open", "pull the jaws open, to the stop, then press Enter:"),
    ):
        _ask(request)
        marks = _step(run, step)
        terminal.say(f"  {step} at {figure(marks[f'{step}_rad'], '+.4f', 'rad')}")
    terminal.say(f"  {render.travel(marks)}")


def _ask(question: str) -> str:
    answer = terminal.ask(question)
    if answer is None:
        raise _NotWantedError
    return answer


def _step(run: Run, step: str, **params: object) -> dict[str, Any]:
    call = run.connection.prepare_guarded("calibration.manual", {"step": step, **params})
    return run.connection.run(call, ACTION_TIMEOUT_S)


def _report(run: Run, how: str) -> None:
    error = _cancel(run)
    if error is None:
        run.output.error(CancelledError(f"{how}: {_AS_BEFORE}, the jaws hold", reason=how), "")
        return
    text = f"{how}, but the daemon did not confirm that {_AS_BEFORE}: {error.message}"
    run.output.error(CancelledError(text, reason=how), "see: litegripctl calibration")


def _cancel(run: Run) -> LiteGripError | None:
    """End it; gives the error of that: the end of this connection then ends it."""
    try:
        run.connection.call("calibration.manual", {"step": "cancel"})
    except LiteGripError as error:
        return error
    return None
