"""Log lines of gateway, portal and router; what repeats is counted, and reported seldom."""

import asyncio
import logging
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from litegrip_client.values.repeats import Repeats

if TYPE_CHECKING:
    _StreamHandler = logging.StreamHandler[TextIO]
else:  # in Python 3.10 it takes no type
    _StreamHandler = logging.StreamHandler

_LOOK_EVERY_S = 1.0


class RepeatsHandler(_StreamHandler):
    """Writes to standard error what `Repeats` says is to be written; from any thread."""

    def __init__(
        self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(sys.stderr if stream is None else stream)
        self._clock = clock
        self._repeats = Repeats()

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, or count it."""
        try:
            lines = self._repeats.take(record, self._clock())
        except Exception:  # noqa: BLE001 - as logging's own handlers do
            self.handleError(record)
            return
        self._write(lines)

    def poll(self) -> None:
        """Write how often lines have repeated, where that is due; call it often."""
        self.acquire()
        try:
            self._write(self._repeats.due(self._clock()))
        finally:
            self.release()

    def close(self) -> None:
        """Write how often lines have repeated since that was written last."""
        self.acquire()
        try:
            self._write(self._repeats.rest(self._clock()))
        finally:
            self.release()
        super().close()

    def _write(self, lines: list[logging.LogRecord]) -> None:
        for line in lines:
            super().emit(line)


async def poll_handlers() -> None:
    """Poll the log's handlers until cancelled."""
    while True:
        for handler in logging.getLogger().handlers:
            if isinstance(handler, RepeatsHandler):
                handler.poll()
        await asyncio.sleep(_LOOK_EVERY_S)
