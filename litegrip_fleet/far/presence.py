"""Who has to be present, and when a gripper is to be stopped because somebody is not.

It knows no clock. A silence begins when a user's last sign of life is older than his session's time
to live, and each silence stops each gripper once, however late it is noticed. A stop that is
cleared meanwhile is due again; one that is not cleared stays when the user is back.
"""

from collections.abc import Sequence


class Presence:
    """Until when each of `users` counts as present, and how many silences there have been.

    Nobody is present at first: that is a silence of each.
    """

    def __init__(self, users: Sequence[str]) -> None:
        self._until_s = dict.fromkeys(users, float("-inf"))
        self._ended = 0
        self._latest = tuple(users)

    def shown(self, user: str, at_s: float | None, ttl_s: float, now_s: float) -> None:
        """Take a sign of life that was sent at `at_s` by a session that lives `ttl_s` without one.

        One without a time proves nothing: it may have waited anywhere. None is from the future.
        """
        until_s = self._until_s.get(user)
        if until_s is None or at_s is None:
            return
        shown_until_s = min(at_s, now_s) + ttl_s
        if shown_until_s < now_s or shown_until_s <= until_s:
            return
        if now_s > until_s:  # he was silent, whether anybody has looked then or not
            self._ended += 1
            self._latest = (user,)
        self._until_s[user] = shown_until_s

    def silent(self, now_s: float) -> tuple[str, ...]:
        """Return who is silent, in the order of the configuration."""
        return tuple(user for user, until_s in self._until_s.items() if now_s > until_s)

    def silences(self, now_s: float) -> int:
        """Return how many silences have begun; it never falls."""
        return self._ended + len(self.silent(now_s))

    def why(self, now_s: float) -> str:
        """Return why there is a stop; the daemon shows 80 characters of it."""
        silent = self.silent(now_s)
        if not silent:
            return f"{self._latest[0]} was silent, and has to be present"
        verbs = ("is", "has") if len(silent) == 1 else ("are", "have")
        return f"{' and '.join(silent)} {verbs[0]} silent, and {verbs[1]} to be present"


class DeadMan:
    """What one gripper gets of it: when a stop is due, until the daemon has confirmed one."""

    def __init__(self, presence: Presence) -> None:
        self._presence = presence
        self._answered = 0
        self._answering = 0
        self._is_lifted = False

    def lifted(self) -> None:
        """Take note that a stop may be in force no more: cleared, or the daemon is a new one."""
        self._is_lifted = True

    def is_due(self, now_s: float) -> bool:
        """Return True while the gripper is to be stopped."""
        if self._presence.silences(now_s) > self._answered:
            return True
        return self._is_lifted and bool(self._presence.silent(now_s))

    def begin(self, now_s: float) -> None:
        """Take note that a stop is being sent: what is cleared from now on is cleared after it."""
        self._answering = self._presence.silences(now_s)
        self._is_lifted = False

    def done(self, *, confirmed: bool) -> None:
        """Take note of what became of it."""
        if confirmed:
            self._answered = self._answering
        else:
            self._is_lifted = True
