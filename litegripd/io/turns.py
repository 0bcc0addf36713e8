"""Whose line is served next: users take turns by the time that they have used, not connections.

A user's connections then take turns among themselves, so that somebody with 64 of them is served
as much as somebody with one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from litegripd.io.connection import Connection

LIGHT_SHARE = 0.1
"""Of a period: a user who used less of late is light, and is served although a flood has used up
the time for requests."""

_FADES = 0.5  # what was used counts half after each period
_FORGOTTEN = 1e-3  # of a period


@dataclass(slots=True, eq=False)
class _User:
    """One user's connections that wait, the next one first, and the seconds used of late."""

    used_s: float = 0.0
    waiting: "dict[Connection, None]" = field(default_factory=dict)


class Turns:
    """The connections that have something to be read or served.

    `charge` whatever time a user costs; `next_period` lets the past fade.
    """

    def __init__(self, period_s: float) -> None:
        self._light_s = LIGHT_SHARE * period_s
        self._forgotten_s = _FORGOTTEN * period_s
        self._users: dict[int, _User] = {}
        self._waiting: dict[int, _User] = {}

    def __bool__(self) -> bool:
        """Return whether any connection waits."""
        return bool(self._waiting)

    @property
    def has_light(self) -> bool:
        """Whether a connection of a light user waits."""
        return any(user.used_s < self._light_s for user in self._waiting.values())

    def __contains__(self, connection: "Connection") -> bool:
        """Return whether a connection waits."""
        user = self._users.get(connection.session.peer.uid)
        return user is not None and connection in user.waiting

    def add(self, connection: "Connection") -> None:
        """Let a connection wait, once."""
        uid = connection.session.peer.uid
        user = self._users.setdefault(uid, _User())
        user.waiting.setdefault(connection)
        self._waiting[uid] = user

    def remove(self, connection: "Connection") -> None:
        """Let a connection wait no longer, if it does."""
        uid = connection.session.peer.uid
        user = self._waiting.get(uid)
        if user is not None:
            user.waiting.pop(connection, None)
            if not user.waiting:
                del self._waiting[uid]

    def postpone(self, connection: "Connection") -> None:
        """Let a connection's turn come after those of the same user's others."""
        waiting = self._waiting[connection.session.peer.uid].waiting
        del waiting[connection]
        waiting[connection] = None

    def heads(self, *, light_only: bool) -> "Iterator[Connection]":
        """Yield each user's next connection, whose user has used the least first."""
        users = list(self._waiting.values())
        if light_only:
            users = [user for user in users if user.used_s < self._light_s]
        if len(users) > 1:
            users.sort(key=lambda user: user.used_s)
        for user in users:
            yield next(iter(user.waiting))

    def charge(self, uid: int, used_s: float) -> None:
        """Note that a user has cost some time."""
        self._users.setdefault(uid, _User()).used_s += used_s

    def next_period(self, periods: int) -> None:
        """Let what was used fade, once for each period that has begun."""
        fades = _FADES**periods
        for uid, user in list(self._users.items()):
            user.used_s *= fades
            if user.used_s < self._forgotten_s and not user.waiting:
                del self._users[uid]
