"""Which log lines are written when the same ones come again and again.

A loose plug says the same in words of 240 characters, thousands of times a day. The first line is
written at once and in full. Lines that differ from it in figures only are its repeats: they are
counted, and reported by a short line with their number, at intervals that grow.
"""

import logging
import re
import sys
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

REPEATS = "repeats"
"""A log record's attribute, `extra={REPEATS: ...}`: True for a line that a flapping part can
repeat, False for one of which each is written. Without it warnings and errors are repeats."""

EACH = {REPEATS: False}

AFTER_COUNTS = {"after_counts": True}
"""`extra` of the line that begins an end: what was counted is written before it. Below it a count
of earlier lines would read as if they had come since."""

INTERVALS_S = (10.0, 60.0, 600.0, 3600.0)
"""From one line about a repeat to the next: within a minute it is clear that it continues, and
after that an hour's line says as much as a minute's."""
AWAY_S = 3600.0
"""What has stayed away for so long is new when it comes again."""
SETTLED_SHARE = 6.0
"""What has stayed away for the interval's sixth part, `SETTLED_FIRST_S` at least, has settled: what
was counted is reported then, so that the journal's end is no older than ten minutes."""
SETTLED_FIRST_S = 10.0

_LOOK_EVERY_S = 1.0
_MOST_KINDS = 256
_SHORT = 120
_FIGURES = re.compile(r"\d+")


@dataclass(slots=True)
class _Repeat:
    """One line that was written: its repeats since the last line about it."""

    record: logging.LogRecord
    reported_s: float
    last_s: float
    step: int = 0
    count: int = 0

    @property
    def due_s(self) -> float:
        """When the repeats are reported if none comes meanwhile."""
        interval_s = INTERVALS_S[self.step]
        settled_s = self.last_s + max(interval_s / SETTLED_SHARE, SETTLED_FIRST_S)
        return min(self.reported_s + interval_s, settled_s)

    def report(self, now_s: float) -> logging.LogRecord:
        """Return the short line about the repeats, and begin the next interval."""
        times = "once" if self.count == 1 else f"{self.count} times"
        ago_s = now_s - self.last_s
        last = "" if ago_s < 1.0 else f", the last {_span(ago_s)} ago"
        text = f"{_shortened(self.record.getMessage())} (again: {times} in"
        text += f" {_span(now_s - self.reported_s)}{last})"
        line = logging.makeLogRecord(vars(self.record) | {"msg": text, "args": None})
        line.exc_info = line.exc_text = line.stack_info = None
        line.created += ago_s  # it is written now, behind lines that came since
        line.msecs = line.created % 1.0 * 1e3
        self.reported_s, self.count = now_s, 0
        self.step = min(self.step + 1, len(INTERVALS_S) - 1)
        return line


class Repeats:
    """Passes on what is to be written; `due` is called often, and costs nothing until it is due.

    It knows no clock.
    """

    def __init__(self) -> None:
        self._kinds: OrderedDict[tuple[str, int, str], _Repeat] = OrderedDict()  # by `last_s`
        self._due_s = float("inf")

    def take(self, record: logging.LogRecord, now_s: float) -> list[logging.LogRecord]:
        """Return the lines to write now that `record` has come: itself, none, or others before."""
        if getattr(record, "after_counts", False):
            return [*self.rest(now_s), record]
        if not getattr(record, REPEATS, record.levelno >= logging.WARNING):
            return [record]
        key = (record.name, record.levelno, _FIGURES.sub("#", record.getMessage()))
        known = self._kinds.get(key)
        if known is None or now_s - known.last_s >= AWAY_S:
            before = [] if known is None or not known.count else [known.report(now_s)]
            self._kinds[key] = _Repeat(record, reported_s=now_s, last_s=now_s)
            self._kinds.move_to_end(key)
            return [*before, *self._made_room(now_s), record]
        is_over = now_s >= known.reported_s + INTERVALS_S[known.step]
        known.record, known.last_s, known.count = record, now_s, known.count + 1
        self._kinds.move_to_end(key)
        if is_over:
            return [known.report(now_s)]
        self._due_s = min(self._due_s, known.due_s)
        return []

    def due(self, now_s: float) -> list[logging.LogRecord]:
        """Return the lines about repeats whose interval has ended, or which have settled."""
        if now_s < self._due_s:
            return []
        counted = [known for known in self._kinds.values() if known.count]
        lines = [known.report(now_s) for known in counted if now_s >= known.due_s]
        self._due_s = min((known.due_s for known in counted if known.count), default=float("inf"))
        return lines

    def rest(self, now_s: float) -> list[logging.LogRecord]:
        """Return the lines about all repeats that were not reported yet, before the end."""
        return [known.report(now_s) for known in self._kinds.values() if known.count]

    def _made_room(self, now_s: float) -> list[logging.LogRecord]:
        """Forget what has stayed away for longest if there is too much; return what it counted."""
        excess = max(len(self._kinds) - _MOST_KINDS, 0)
        gone = [self._kinds.popitem(last=False)[1] for _ in range(excess)]
        return [known.report(now_s) for known in gone if known.count]


def to_standard_error(_record: logging.LogRecord, text: str) -> bool:
    """Write a line to standard error."""
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()
    return True


class RepeatsHandler(logging.Handler):
    """Hands a sink what `Repeats` says is to be written; it returns True if it took the line.

    Any thread may log. Call `poll` often, so that it can say how often lines came. A line that
    cannot be made, or that the sink does not take, is counted as `dropped`.
    """

    def __init__(
        self,
        sink: Callable[[logging.LogRecord, str], bool] = to_standard_error,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self.dropped = 0
        self._sink = sink
        self._clock = clock
        self._repeats = Repeats()

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line, or count it."""
        try:
            lines = self._repeats.take(record, self._clock())
        except Exception:  # noqa: BLE001 - a badly written log call must not end a tick
            self.dropped += 1
            return
        self._send(lines)

    def poll(self) -> None:
        """Write how often lines have repeated, where that is due."""
        self.acquire()
        try:
            self._send(self._repeats.due(self._clock()))
        finally:
            self.release()

    def close(self) -> None:
        """Write how often lines have repeated since that was written last."""
        self.acquire()
        try:
            self._send(self._repeats.rest(self._clock()))
        finally:
            self.release()
        super().close()

    def _send(self, lines: list[logging.LogRecord]) -> None:
        for line in lines:
            try:
                taken = self._sink(line, self.format(line))
            except Exception:  # noqa: BLE001 - as above
                taken = False
            self.dropped += not taken


async def poll_handlers() -> None:
    """Poll the handlers of the whole log until cancelled."""
    import asyncio  # noqa: PLC0415 - the daemon has none

    while True:
        for handler in logging.getLogger().handlers:
            if isinstance(handler, RepeatsHandler):
                handler.poll()
        await asyncio.sleep(_LOOK_EVERY_S)


def _shortened(text: str) -> str:
    """Return a text's beginning: its remedy was written with the first line."""
    if len(text) <= _SHORT:
        return text
    return text[:_SHORT].rpartition(" ")[0].rstrip(" ,;:(") + " ..."


def _span(duration_s: float) -> str:
    """Return a duration as people say it."""
    for unit_s, unit in ((3600.0, "h"), (60.0, "min")):
        if duration_s >= 0.995 * unit_s:
            return f"{round(duration_s / unit_s, 1):g} {unit}"
    return f"{max(duration_s, 1.0):.0f} s"
