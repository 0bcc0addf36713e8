"""Run a motion to its end, and cancel it when its caller is interrupted meanwhile.

This module must not know what a motion does.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

from litegrip_client.calls import Call, Progress
from litegrip_client.connection import FOREVER_S, Connection
from litegrip_client.errors import CommandError, ConnectError, LiteGripError
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

_CANCEL_TIMEOUT_S = 2.0


class Motion:
    """One motion, to be run once.

    After an interrupt, `cancelled` is the job as the daemon's answer to the cancelling tells it,
    and `cancel_error` why cancelling failed; both None when nothing was left to cancel.
    """

    def __init__(
        self,
        connection: Connection,
        method: str,
        params: Mapping[str, Any],
        on_progress: Progress | None = None,
    ) -> None:
        self.cancelled: dict[str, Any] | None = None
        self.cancel_error: LiteGripError | None = None
        self._connection = connection
        self._method = method
        # Always with progress, because that tells the number of the job.
        self._params = {**params, "progress": True}
        self._on_progress = on_progress

    def run(self) -> dict[str, Any]:
        """Wait for the motion's result, however long it takes.

        Whatever else ends the waiting (KeyboardInterrupt, an error of the progress callback)
        cancels the motion first, so that the jaws hold, and is then raised.
        """
        connection = self._connection
        call = connection.prepare_guarded(self._method, self._params, self._on_progress)
        call.keep = True
        try:
            return connection.run(call, FOREVER_S)
        except BaseException:
            if not call.answered:
                self._cancel(call)
            raise
        finally:
            connection.forget(call)

    def _cancel(self, call: Call) -> None:
        if self._connection.closed:
            self.cancel_error = ConnectError("the daemon is gone", reason="connection_lost")
            return
        try:
            number = call.job if call.job is not None else self._find_job(call)
            # By now this motion may have ended, and what runs may be another's.
            if number is not None and not call.answered:
                params = {"job": number}
                self.cancelled = self._connection.call("job.cancel", params, _CANCEL_TIMEOUT_S)
        except LiteGripError as error:
            self.cancel_error = error
            warn(f"the interrupted {self._method} could not be cancelled: {error}")

    def _find_job(self, call: Call) -> int | None:
        """Find this process's running job: no notification has told its number yet."""
        listed = self._connection.call("job.list", None, _CANCEL_TIMEOUT_S)["jobs"]
        running = {
            job["owner"]["pid"]: int(job["job"]) for job in listed if job["state"] == "running"
        }
        if os.getpid() in running:
            return running[os.getpid()]
        if running and not call.answered:
            # In a container the daemon sees another pid than the process itself.
            raise CommandError(
                f"job {', '.join(map(str, running.values()))} runs, but not as a job of process "
                f"{os.getpid()}",
                reason="unknown_job",
            )
        return None
