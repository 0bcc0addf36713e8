"""Requests to the helper process: what becomes of one, and which of those that wait is the next.

The daemon's own leave at once, in their order. Users' requests are bounded for each user, leave
one at a time and take turns by user, so that none of them, however busy, holds up the others.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from litegripd.model.errands import ErrandResult

MOST_PER_UID = 8
"""So many requests of a user may wait for their answers; one more is refused."""

MOST_AT_ONCE = 1
"""So many requests of users are at the helper: what the daemon needs itself waits for no more."""

MOST_OWN = 64


@dataclass(frozen=True, slots=True)
class HelperResult(ErrandResult):
    """What became of one request; what came in pieces is in `pieces`."""

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
        """Take note of a request that the helper has got."""
        self._sent[request.identity] = request

    def at_helper(self, identity: int) -> HelperRequest | None:
        """Return a request that the helper has got."""
        return self._sent.get(identity)

    def answered(self, request: HelperRequest) -> None:
        """Forget a request that has its answer."""
        del self._sent[request.identity]

    def take_sent(self) -> list[HelperRequest]:
        """Forget and return what a helper had got that is gone; the rest waits for the next one."""
        orphans, self._sent = list(self._sent.values()), {}
        return orphans
