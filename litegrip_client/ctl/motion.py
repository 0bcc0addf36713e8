"""Run a motion for a command: a live line on the way, and cancelling at Ctrl-C.

It must not know what the motions do, nor how their results are shown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from litegrip_client.blocking import BlockingWire, wait
from litegrip_client.core.motion import Motion
from litegrip_client.ctl.render_results import progress
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
        data = wait(motion.run())
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
