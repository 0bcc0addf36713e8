"""The control thread's end of the helper process, which does all that is slow, as disk access.

Requests go out as JSON packets and come back as calls of `on_result`; nothing here waits. A
helper that dies is started again, and every request it left unanswered fails with that reason.
The daemon's own requests leave at once, in order. Users' requests are bounded for each user, leave
one at a time and take turns by user, so that no user, however busy, delays the others.
"""

import json
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from litegripd.io.helper.child import MAX_PACKET_BYTES, Child, Start, start_here
from litegripd.model.state import TaskResult

MOST_PER_UID = 8
"""So many requests of a user may wait for their answers; one more is refused."""

MOST_AT_ONCE = 1
"""So many requests of users are at the helper: what the daemon needs itself waits for no more."""

MOST_OWN = 64


@dataclass(frozen=True, slots=True)
class HelperResult(TaskResult):
    """The outcome of one request; a value that came in pieces is in `pieces`."""

    pieces: tuple[bytes, ...] = ()


@dataclass(slots=True)
class HelperRequest:
    """One request: the daemon's own without `uid`, else that user's."""

    identity: int
    packet: bytes
    on_result: Callable[[HelperResult], None]
    uid: int | None = None
    pieces: list[bytes] = field(default_factory=list)


class HelperRequests:
    """The requests that have no answer yet: those at the helper, and those that wait for it."""

    def __init__(self) -> None:
        self._sent: dict[int, HelperRequest] = {}
        self._own: deque[HelperRequest] = deque()
        self._of_users: dict[int, deque[HelperRequest]] = {}  # the user whose turn it is first

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._sent) + self.waiting

    @property
    def waiting(self) -> int:
        """How many have not been sent yet."""
        return len(self._own) + sum(map(len, self._of_users.values()))

    def refusal(self, uid: int | None) -> str | None:
        """Return why no more is taken, or None."""
        if uid is None:
            is_full = len(self._own) >= MOST_OWN
            return "the helper process is overloaded: try again" if is_full else None
        at_helper = sum(request.uid == uid for request in self._sent.values())
        if len(self._of_users.get(uid, ())) + at_helper < MOST_PER_UID:
            return None
        return (
            f"{MOST_PER_UID} requests of uid {uid} that read or write files have no answer yet:"
            " wait for one before the next"
        )

    def add(self, request: HelperRequest) -> None:
        """Let a request wait for its turn."""
        if request.uid is None:
            self._own.append(request)
        else:
            self._of_users.setdefault(request.uid, deque()).append(request)

    def send(self, send: Callable[[bytes], bool]) -> None:
        """Send what may leave now, as long as `send` takes it."""
        while self._own and send(self._own[0].packet):
            self.note_sent(self._own.popleft())
        while self._of_users and not self._own:
            of_users = sum(request.uid is not None for request in self._sent.values())
            uid, waiting = next(iter(self._of_users.items()))
            if of_users >= MOST_AT_ONCE or not send(waiting[0].packet):
                return
            self.note_sent(waiting.popleft())
            del self._of_users[uid]
            if waiting:
                self._of_users[uid] = waiting  # behind the others

    def note_sent(self, request: HelperRequest) -> None:
        """Note a request that the helper has got."""
        self._sent[request.identity] = request

    def at_helper(self, identity: int) -> HelperRequest | None:
        """Return a request that the helper has got."""
        return self._sent.get(identity)

    def answered(self, request: HelperRequest) -> None:
        """Forget a request that has its answer."""
        del self._sent[request.identity]

    def take_sent(self) -> list[HelperRequest]:
        """Forget and return the requests at a helper that is gone; others wait for the next one."""
        orphans, self._sent = list(self._sent.values()), {}
        return orphans


_log = logging.getLogger(__name__)

_RESTART_FIRST_S = 0.5
_RESTART_AT_MOST_S = 5.0
_SETTLED_S = 10.0
"""A helper that has lived so long is restarted at once again. One that dies at each start, as after
an upgrade under a running daemon, has a traceback in the journal each time."""
END_WITHIN_S = 0.5
FINISH_WITHIN_S = 2.5
"""So long the end waits for a helper that has something to finish, the dump of a fault for one."""

REFUSED_LATELY_S = 10.0

_PACKETS_PER_EVENT = 8
_MOST_KEPT = 64
"""So many posts wait for a helper to be started: log lines, that of its own death among them."""

MODULE = "litegripd.app.helper_main"
LOG_STATE = b"l"
"""The kind of the packets, which answer no request, that report what becomes of the log."""

LOG = "log"
GOODBYE = "goodbye"
"""Sent to the helper at the daemon's regular end; without it, the daemon has crashed."""


class Helper:
    """Keeps one helper process running and passes requests to it.

    `watch(child)` and `unwatch(child)` register its descriptors with the event loop, which then
    calls `on_event`; `poll(now_s)`, once per tick, starts the helper where there is none. Every
    helper gets the shared memory `memory_fd` and the `arguments`.

    Users' requests take turns by user and leave a few at a time; the daemon's own leave at once.
    """

    def __init__(
        self,
        watch: Callable[[Child], None],
        unwatch: Callable[[Child], None],
        module: str = MODULE,
        memory_fd: int | None = None,
        start: Start = start_here,
        *,
        arguments: Sequence[str] = (),
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
        self._arguments = arguments
        self._requests = HelperRequests()
        self._refused_uid: int | None = None
        self._refused_s = float("-inf")
        self._next_id = 0
        self._restart_at_s = 0.0
        self._restart_after_s = _RESTART_FIRST_S
        self._started_s = 0.0
        self._kept: list[bytes] = []
        self._child: Child | None = None
        self._lost_by_child = 0

    @property
    def is_running(self) -> bool:
        """True if there is a helper now."""
        return self._child is not None

    @property
    def pid(self) -> int | None:
        """The helper's process id, None while there is none."""
        return None if self._child is None else self._child.pid

    @property
    def is_busy(self) -> bool:
        """True if a request has not been answered yet."""
        return len(self._requests) > 0

    @property
    def waiting(self) -> int:
        """How many requests have not been sent to the helper yet."""
        return self._requests.waiting

    def lately_refused(self, now_s: float) -> int | None:
        """Return the user who was refused for too many requests in the last while, or None."""
        return self._refused_uid if now_s - self._refused_s < REFUSED_LATELY_S else None

    def request(
        self,
        operation: str,
        parameters: Mapping[str, object],
        on_result: Callable[[HelperResult], None],
        descriptors: Sequence[int] = (),
        uid: int | None = None,
    ) -> None:
        """Ask for `operation`; `on_result` is called once, from the event loop.

        The operation gets copies of `descriptors`. With `uid` it is the request of that user,
        bounded and in turn; without, the daemon's own.
        """
        self._next_id += 1
        packet = json.dumps([self._next_id, operation, parameters]).encode()
        request = HelperRequest(self._next_id, packet, on_result, uid)
        if len(packet) > MAX_PACKET_BYTES:
            self._refuse(request, f"the request has {len(packet)} bytes, too many for one packet")
        elif self._child is None:
            text = "the helper process is not running; it is being started again: try again"
            self._refuse(request, text, "helper_busy")
        elif descriptors:
            if self._child.send(packet, descriptors):
                self._requests.note_sent(request)
            else:
                self._refuse(request, "the helper process is overloaded: try again", "helper_busy")
        elif (refusal := self._requests.refusal(uid)) is not None:
            self._refused_uid, self._refused_s = uid, time.monotonic()
            self._refuse(request, refusal, "helper_busy")
        else:
            self._requests.add(request)
            self._send_waiting()

    def post(self, operation: str, parameters: Mapping[str, object]) -> bool:
        """Send a request without an answer, now or to the next helper; return False if lost."""
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
        """Start the helper, or start it again once its time has come; send what waits."""
        if self._child is None and now_s >= self._restart_at_s:
            self._start()
        elif self._requests.waiting:
            self._send_waiting()

    def close(self) -> None:
        """End the helper process once it has done what it was sent, or after a while."""
        if self._child is not None:
            self.post(GOODBYE, {})
            self._unwatch(self._child)
            self._child.close(FINISH_WITHIN_S if self.is_busy else END_WITHIN_S)
            self._child = None

    def let_go(self) -> None:
        """Leave the helper process to do what it was sent, and to end by itself."""
        if self._child is not None:
            self.post(GOODBYE, {})
            self._unwatch(self._child)
            self._child.let_go()
            self._child = None

    def _start(self) -> None:
        self._started_s = time.monotonic()
        try:
            self._child = self._start_child(self._module, self._arguments, self._memory_fd)
        except OSError as error:
            self._restart_later()
            _log.error("the helper process cannot be started: %s", error)
            return
        self._watch(self._child)
        kept, self._kept = self._kept, []
        for packet in kept:
            self._child.send(packet)
        self._send_waiting()

    def _refuse(self, request: HelperRequest, error: str, reason: str | None = None) -> None:
        self.refused += 1
        request.on_result(HelperResult(error=error, reason=reason))

    def _send_waiting(self) -> None:
        if self._child is not None:
            self._requests.send(self._child.send)

    def _take(self, packet: bytes) -> None:
        identity = int.from_bytes(packet[:4], "little")
        if packet[4:5] == LOG_STATE:
            lost, self.log_is_stuck = json.loads(packet[5:])
            self.log_lines_lost += lost - self._lost_by_child
            self._lost_by_child = lost
            return
        request = self._requests.at_helper(identity)
        if request is None:
            return
        kind = packet[4:5]
        if kind == b"p":
            request.pieces.append(packet[5:])
            return
        self._requests.answered(request)
        self._send_waiting()
        value = json.loads(packet[5:])
        pieces = tuple(request.pieces)
        if kind == b"r":
            _answer(request, HelperResult(value, pieces=pieces))
        else:
            _answer(request, HelperResult(error=str(value)))

    def _restart_later(self) -> None:
        now_s = time.monotonic()
        if now_s - self._started_s >= _SETTLED_S:
            self._restart_after_s = _RESTART_FIRST_S
        self._restart_at_s = now_s + self._restart_after_s
        self._restart_after_s = min(2 * self._restart_after_s, _RESTART_AT_MOST_S)

    def _bury(self, child: Child) -> None:
        while packet := child.receive():
            self._take(packet)  # what it still finished
        self.deaths += 1
        self._lost_by_child, self.log_is_stuck = 0, False
        pid, failure = child.pid, child.failure
        self._unwatch(child)
        child.close()
        self._child = None
        self._restart_later()
        if failure is None:
            _log.error("the helper process (pid %d) died; it will be started again", pid)
        else:
            _log.error("the helper process cannot be started: %s", failure)
        for request in self._requests.take_sent():
            _answer(request, HelperResult(error="the helper process died while it worked on this"))


def _answer(request: HelperRequest, result: HelperResult) -> None:
    """Pass a result on; a defect of its receiver must not leave the helper unserved."""
    try:
        request.on_result(result)
    except Exception:  # noqa: BLE001 - whatever it is
        _log.exception("a result of the helper process could not be used")
