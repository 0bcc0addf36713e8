"""Who gets one of a gripper's sessions: nobody's keep out a user who has none, nor operators."""

from collections import Counter
from collections.abc import Collection

from litegrip_fleet.wire.keys import Caller

MOST_SESSIONS = 56
"""For each gripper; the daemon lets 64 connections of a user in."""

MOST_OF_A_USER = 28

MOST_FURTHER = 40
"""Sessions of users who have another one: there is room for the first ones of 16 users more."""

MOST_WATCHING = 20
"""Of the further ones, with the role observer: as many are left to operators and admins."""

_NAMED = 5


def why_full(sessions: Collection[Caller], new: Caller) -> str | None:
    """Return why there is no room for a new session, and who has it; None if there is.

    `sessions` has the new one, too.
    """
    own, watching = Counter[str](), Counter[str]()
    for one in sessions:
        own[one.user] += 1
        watching[one.user] += one.role == "observer"
    further = sum(own.values()) - len(own)
    further_watching = sum(watching[user] - (watching[user] == own[user]) for user in own)
    is_first = own[new.user] == 1
    if own[new.user] > MOST_OF_A_USER:
        text = f"{new.user} has {MOST_OF_A_USER} sessions, as many as a user may have"
    elif len(sessions) > MOST_SESSIONS:
        text = f"all {MOST_SESSIONS} sessions are taken"
    elif not is_first and further > MOST_FURTHER:
        text = f"what is left of {MOST_SESSIONS} sessions is for users who have none"
    elif not is_first and new.role == "observer" and further_watching > MOST_WATCHING:
        text = f"observers have {MOST_WATCHING} further sessions, the others are for operators"
    else:
        return None
    own[new.user] -= 1
    return f"{text}; {_holders(own)}; end a program, or close a page or a connection"


def _holders(own: "Counter[str]") -> str:
    most = [(user, count) for user, count in own.most_common(_NAMED) if count]
    named = ", ".join(f"{user} has {count}" for user, count in most)
    others = sum(own.values()) - sum(count for _user, count in most)
    return f"{named}, others have {others}" if others else named
