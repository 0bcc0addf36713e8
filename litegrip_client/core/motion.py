"""Run a motion to its end, and cancel it when its caller is interrupted meanwhile.

This module must not know what a motion does.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from litegrip_client.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.exchange import FOREVER_S, Call, Progress
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.wire import Wire

_CANCEL_TIMEOUT_S = 2.0


class Motion:
    """One motion, to be run once.

    After an interrupt, `cancelled` is the job from the daemon's answer to the cancelling,
    and `cancel_error` why cancelling failed; both None when nothing was left to cancel.
    """

    def __init__(
        self,
        wire: Wire,
        method: str,
        params: Mapping[str, Any],
        on_progress: Progress | None = None,
    ) -> None:
        self.cancelled: dict[str, Any] | None = None
        self.cancel_error: LiteGripError | None = None
        self._wire = wire
        self._method = method
        # Always with progress, because that gives the number of the job.
        self._params = {**params, "progress": True}
        self._on_progress = on_progress

    async def run(self) -> dict[str, Any]:
        """Wait for the motion's result, however long it takes.

        Whatever else ends the waiting (KeyboardInterrupt, a cancelled task, an error of the
        progress callback) cancels the motion first, so that the jaws hold, and is then raised.
        """
        wire = self._wire
        call = wire.prepare_guarded(self._method, self._params, self._on_progress)
        call.keep = True
        try:
            return await wire.run(call, FOREVER_S)
        except GeneratorExit:  # the event loop is gone, and nothing can be awaited
            raise
        except BaseException:
            if not call.answered:
                await wire.finish(self._cancel(call))
            raise
        finally:
            wire.forget(call)

    async def _cancel(self, call: Call) -> None:
        if self._wire.closed:
            self.cancel_error = ConnectError("the daemon is gone", reason="connection_lost")
            return
        try:
            number = call.job if call.job is not None else await self._find_job(call)
            # By now this motion may have ended, and what runs may be another's.
            if number is not None and not call.answered:
                params = {"job": number}
                self.cancelled = await self._wire.call("job.cancel", params, _CANCEL_TIMEOUT_S)
        except LiteGripError as error:
            self.cancel_error = error
            warn(f"the interrupted {self._method} could not be cancelled: {error}")

    async def _find_job(self, call: Call) -> int | None:
        """Find the running job of this connection: no notification has named its number yet."""
        listed = (await self._wire.call("job.list", None, _CANCEL_TIMEOUT_S))["jobs"]
        running = [job for job in listed if job["state"] == "running"]
        for job in running:
            if self._is_own(job["owner"]):
                return int(job["job"])
        if running and not call.answered:
            numbers = ", ".join(str(job["job"]) for job in running)
            raise CommandError(
                f"job {numbers} runs, but not as a job of process {os.getpid()}",
                reason="unknown_job",
            )
        return None

    def _is_own(self, owner: Mapping[str, Any]) -> bool:
        """Return True if a job is of this connection, or, where unknown, of this process."""
        client = self._wire.client
        if client is not None and "client" in owner:
            return bool(owner["client"] == client)
        return bool(owner["pid"] == os.getpid())
