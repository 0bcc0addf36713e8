"""The control thread's end of the helper process, where disk and every other slow thing lives.

Requests go out as JSON packets and come back as calls of `on_result`; nothing here waits. A
helper that dies is started again, and every request it left unanswered fails with that reason.
"""

import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from litegripd.io.child import MAX_PACKET_BYTES, Child, Start, start_here
from litegripd.model.errands import ErrandResult

_log = logging.getLogger(__name__)

_RESTART_AFTER_S = 0.5
END_WITHIN_S = 0.5
FINISH_WITHIN_S = 2.5
"""So long the end waits for a helper that has something to finish, the dump of a fault for one."""

_PACKETS_PER_EVENT = 8
_MOST_KEPT = 64
"""So many posts wait for a helper to be started: log lines, that of its own death among them."""

MODULE = "litegripd.io.helper_main"
LOG_STATE = b"l"
"""The kind of the packets, which answer no request, that report what becomes of the log."""

GOODBYE = "goodbye"
"""Tells the helper that the daemon ends as it should; one that just vanishes has crashed."""


@dataclass(frozen=True, slots=True)
class HelperResult(ErrandResult):
    """What became of one request; what came in pieces is in `pieces`."""

    pieces: tuple[bytes, ...] = ()


@dataclass(slots=True)
class _Request:
    on_result: Callable[[HelperResult], None]
    pieces: list[bytes] = field(default_factory=list)


class Helper:
    """Keeps one helper process running and passes requests to it.

    `watch(child)` and `unwatch(child)` register its descriptors with the event loop, which then
    calls `on_event`; `poll(now_s)`, once per tick, starts the helper where there is none. Every
    helper gets the shared memory `memory_fd`.
    """

    def __init__(
        self,
        watch: Callable[[Child], None],
        unwatch: Callable[[Child], None],
        module: str = MODULE,
        memory_fd: int | None = None,
        start: Start = start_here,
    ) -> None:
        self.deaths = 0
        self.refused = 0
        self.log_lines_lost = 0
        self.log_is_stuck = False
        self._watch = watch
        self._unwatch = unwatch
        self._module = module
        self._memory_fd = memory_fd
        self._start_child = start
        self._requests: dict[int, _Request] = {}
        self._next_id = 0
        self._restart_at_s = 0.0
        self._kept: list[bytes] = []
        self._child: Child | None = None
        self._lost_by_child = 0

    @property
    def is_running(self) -> bool:
        """Whether there is a helper now."""
        return self._child is not None

    @property
    def pid(self) -> int | None:
        """The helper's process id, None while there is none."""
        return None if self._child is None else self._child.pid

    @property
    def is_busy(self) -> bool:
        """Whether a request has not been answered yet."""
        return bool(self._requests)

    def request(
        self,
        operation: str,
        parameters: Mapping[str, object],
        on_result: Callable[[HelperResult], None],
        descriptors: Sequence[int] = (),
    ) -> None:
        """Ask for `operation`; `on_result` is called once, from the event loop.

        The operation gets copies of `descriptors`.
        """
        self._next_id += 1
        packet = json.dumps([self._next_id, operation, parameters]).encode()
        if self._child is None or not self._child.send(packet, descriptors):
            self.refused += 1
            on_result(HelperResult(error="the helper process is not running or overloaded"))
            return
        self._requests[self._next_id] = _Request(on_result)

    def post(self, operation: str, parameters: Mapping[str, object]) -> bool:
        """Send a request that wants no answer, now or to the next helper; tell whether it could."""
        packet = json.dumps([0, operation, parameters]).encode()
        if self._child is not None:
            return self._child.send(packet)
        if len(self._kept) >= _MOST_KEPT or len(packet) > MAX_PACKET_BYTES:
            return False
        self._kept.append(packet)
        return True

    def on_event(self, _mask: int) -> None:
        """Take the packets that have come, a bounded number at a time."""
        child = self._child
        if child is None:
            return
        for _ in range(_PACKETS_PER_EVENT):
            packet = child.receive()
            if packet is None:
                if child.has_ended:
                    self._bury(child)
                return
            self._take(packet)

    def poll(self, now_s: float) -> None:
        """Start the helper, or start it again once its time has come."""
        if self._child is None and now_s >= self._restart_at_s:
            self._start()

    def close(self) -> None:
        """End the helper process once it has done what it was sent, or after a while."""
        if self._child is not None:
            self.post(GOODBYE, {})
            self._unwatch(self._child)
            self._child.close(FINISH_WITHIN_S if self._requests else END_WITHIN_S)
            self._child = None

    def let_go(self) -> None:
        """Leave the helper process to do what it was sent, and to end by itself."""
        if self._child is not None:
            self.post(GOODBYE, {})
            self._unwatch(self._child)
            self._child.let_go()
            self._child = None

    def _start(self) -> None:
        try:
            self._child = self._start_child(self._module, (), self._memory_fd)
        except OSError as error:
            self._restart_at_s = time.monotonic() + _RESTART_AFTER_S
            _log.error("the helper process cannot be started: %s", error)
            return
        self._watch(self._child)
        kept, self._kept = self._kept, []
        for packet in kept:
            self._child.send(packet)

    def _take(self, packet: bytes) -> None:
        identity = int.from_bytes(packet[:4], "little")
        if packet[4:5] == LOG_STATE:
            self._note_log(*json.loads(packet[5:]))
            return
        request = self._requests.get(identity)
        if request is None:
            return
        kind = packet[4:5]
        if kind == b"p":
            request.pieces.append(packet[5:])
            return
        del self._requests[identity]
        value = json.loads(packet[5:])
        pieces = tuple(request.pieces)
        if kind == b"r":
            _tell(request, HelperResult(value, None, pieces))
        else:
            _tell(request, HelperResult(None, str(value), ()))

    def _note_log(self, lost: int, is_stuck: bool) -> None:
        self.log_lines_lost += lost - self._lost_by_child
        self._lost_by_child, self.log_is_stuck = lost, is_stuck

    def _bury(self, child: Child) -> None:
        while packet := child.receive():
            self._take(packet)  # what it still finished
        self.deaths += 1
        self._lost_by_child, self.log_is_stuck = 0, False
        pid, failure = child.pid, child.failure
        self._unwatch(child)
        child.close()
        self._child = None
        self._restart_at_s = time.monotonic() + _RESTART_AFTER_S
        if failure is None:
            _log.error("the helper process (pid %d) died; it will be started again", pid)
        else:
            _log.error("the helper process cannot be started: %s", failure)
        orphans, self._requests = list(self._requests.values()), {}
        for request in orphans:
            _tell(request, HelperResult(error="the helper process died while it worked on this"))


def _tell(request: _Request, result: HelperResult) -> None:
    """Hand a result over; a defect of who takes it must not leave the helper unserved."""
    try:
        request.on_result(result)
    except Exception:  # noqa: BLE001 - whatever it is
        _log.exception("a result of the helper process could not be used")
