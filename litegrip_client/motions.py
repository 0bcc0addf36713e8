"""Run a motion to its end, and cancel it when its caller is interrupted meanwhile.

This module must not know what a motion does.
"""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.blocking import BlockingWire, wait
from litegrip_client.calls import Progress
from litegrip_client.connection import Connection
from litegrip_client.core import motions as core

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.errors import LiteGripError


class Motion:
    """One motion, to be run once.

    After an interrupt, `cancelled` is the job from the daemon's answer to the cancelling,
    and `cancel_error` why cancelling failed; both None when nothing was left to cancel.
    """

    def __init__(
        self,
        connection: Connection,
        method: str,
        params: Mapping[str, Any],
        on_progress: Progress | None = None,
    ) -> None:
        self._motion = core.Motion(BlockingWire(connection), method, params, on_progress)

    @property
    def cancelled(self) -> dict[str, Any] | None:
        """The cancelled job."""
        return self._motion.cancelled

    @property
    def cancel_error(self) -> LiteGripError | None:
        """Why it could not be cancelled."""
        return self._motion.cancel_error

    def run(self) -> dict[str, Any]:
        """Wait for the motion's result, however long it takes.

        Whatever else ends the waiting (KeyboardInterrupt, an error of the progress callback)
        cancels the motion first, so that the jaws hold, and is then raised.
        """
        return wait(self._motion.run())
