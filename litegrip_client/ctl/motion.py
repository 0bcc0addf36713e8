"""Run a motion for a command: a live line on the way, cancelling at Ctrl-C, and words for its end.

It must not know what the motions do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from litegrip_client.blocking import BlockingWire, complete
from litegrip_client.core.motion import Motion
from litegrip_client.ctl.render import Data, figure, plain
from litegrip_client.ctl.run import ENDING, INTERRUPTED, NOT_OK, OK, Run
from litegrip_client.errors import CancelledError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


def start(run: Run, method: str, params: Mapping[str, Any]) -> int:
    """Start a motion and show its job, without waiting for its end."""
    call = run.connection.prepare_guarded(method, {**params, "detach": True, "wait": False})
    data = run.connection.run(call)
    run.output.result(data, f"{run.options.command}: job {data['job']} started")
    return OK


def finish(
    run: Run, method: str, params: Mapping[str, Any], tell: Callable[[dict[str, Any]], str]
) -> int:
    """Run a motion to its end and show the result as `tell` puts it.

    It outlives this program's death, but Ctrl-C cancels it. The exit code is that of the
    result's `ok`, where it has one.
    """

    def show(data: dict[str, Any]) -> None:
        if run.output.live:
            run.output.line(progress(data))

    motion = Motion(BlockingWire(run.connection), method, {**params, "detach": True}, show)
    try:
        data = complete(motion.run())
    except KeyboardInterrupt:
        run.output.erase_line()
        _report_cancelled(motion, run)
        return INTERRUPTED
    run.output.erase_line()
    run.output.result(data, tell(data))
    return OK if data.get("ok", True) else NOT_OK


def _report_cancelled(motion: Motion, run: Run) -> None:
    hint = ""
    if motion.cancel_error is not None:
        text = f"interrupted, but the motion could NOT be cancelled: {motion.cancel_error.message}"
        hint = "it may go on; stop it with: litegripctl stop"
    elif motion.cancelled is None:
        text = "interrupted: no motion was running, the jaws hold"
    elif motion.cancelled["state"] in ENDING:
        text = f"interrupted: job {motion.cancelled['job']} cancelled, the jaws hold"
    else:
        text = f"interrupted: job {motion.cancelled['job']} had ended, {motion.cancelled['state']}"
    run.output.error(CancelledError(text, reason="interrupted"), hint)


_BAR_WIDTH = 24


def progress(data: Data) -> str:
    """Show how far a motion is, in one line; with a bar where it is known how far it goes."""
    total = data.get("total_steps") or 0
    done = f"{bar(data.get('step', 0) / total)} " if total > 0 else ""
    opening = figure(data.get("opening_mm"), "6.2f", "mm")
    torque = figure(data.get("torque_nm"), "+.2f", "N·m")
    passes = f", pass {data['loops'] + 1}" if data.get("loops") else ""
    return f"{done}{opening}  {torque}  {words(data.get('phase'))}{passes}"


def bar(share: float) -> str:
    """Show a share, 0 to 1, as a bar."""
    filled = "#" * round(min(1.0, max(0.0, share)) * _BAR_WIDTH)
    return f"[{filled.ljust(_BAR_WIDTH, '.')}]"


def verdict(data: Data) -> str:
    """Show whether it went as it should, and how it ended."""
    return f"{'' if data.get('ok') else 'NOT ok: '}{words(data.get('outcome'))}"


def words(name: object) -> str:
    """Show a name of the protocol in words."""
    return plain(name).replace("_", " ")


def opening_of(data: Data) -> str:
    """Show where the jaws were at the end."""
    return figure(data.get("state", {}).get("opening_mm"), ".2f", "mm")
