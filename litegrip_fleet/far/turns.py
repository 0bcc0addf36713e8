"""Whose message is taken next: users have turns, and each user's programs among themselves."""

from collections import deque
from typing import Generic, TypeVar

MOST_WAITING = 1024
"""So many of a user's messages wait to be taken; more are dropped, and the portal asks again."""

MOST_OF_A_PROGRAM = 512
"""Of them: another program of this user still finds room."""

_Message = TypeVar("_Message")


class Turns(Generic[_Message]):
    """The messages that wait, by user and by program, each in the order in which they came."""

    def __init__(self) -> None:
        self._waiting: dict[str, dict[str, deque[_Message]]] = {}
        """The next user, and his next program, first."""

    def __bool__(self) -> bool:
        """Return True while a message waits."""
        return bool(self._waiting)

    def add(self, user: str, program: str, message: _Message) -> bool:
        """Let a message wait; False if there is no room for it."""
        programs = self._waiting.get(user, {})
        queue = programs.get(program, deque())
        if len(queue) >= MOST_OF_A_PROGRAM or sum(map(len, programs.values())) >= MOST_WAITING:
            return False
        queue.append(message)
        programs[program] = queue
        self._waiting[user] = programs
        return True

    def take(self) -> _Message:
        """Return the message whose turn it is; there has to be one."""
        user, programs = next(iter(self._waiting.items()))
        program, queue = next(iter(programs.items()))
        message = queue.popleft()
        del self._waiting[user], programs[program]
        if queue:
            programs[program] = queue  # behind the user's others
        if programs:
            self._waiting[user] = programs  # behind the other users
        return message
