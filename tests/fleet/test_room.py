"""Which sessions a gateway lets in, whoever has the others."""

import pytest

from litegrip_fleet.far.room import (
    MOST_FURTHER,
    MOST_OF_A_USER,
    MOST_SESSIONS,
    MOST_WATCHING,
    why_full,
)
from litegrip_fleet.wire.keys import Caller


class Sessions:
    """Those that were let in."""

    def __init__(self) -> None:
        self.there: list[Caller] = []

    def begin(self, user: str, role: str = "operator") -> str | None:
        """Begin one; return why it is refused."""
        new = Caller(user, f"s-{len(self.there)}", role)
        why = why_full([*self.there, new], new)
        if why is None:
            self.there.append(new)
        return why

    def fill(self, user: str, role: str = "operator") -> str:
        """Begin as many as are let in; return why the next one is refused."""
        for _ in range(2 * MOST_SESSIONS):
            if (why := self.begin(user, role)) is not None:
                return why
        raise AssertionError("there is no end")


@pytest.mark.parametrize("role", ["observer", "operator", "admin"])
def test_two_users_who_take_all_they_can_leave_a_session_for_each_other_user(role: str) -> None:
    sessions = Sessions()
    sessions.fill("op1")
    sessions.fill("viewer", "observer")
    others = MOST_SESSIONS - MOST_FURTHER - 2
    assert [sessions.begin(f"user{number}", role) for number in range(others)] == [None] * others


def test_observers_leave_room_for_operators_further_sessions() -> None:
    sessions = Sessions()
    for user in ("viewer", "display", "recorder"):
        sessions.fill(user, "observer")
    assert len(sessions.there) == MOST_WATCHING + 3
    sessions.fill("op1")
    assert sum(one.user == "op1" for one in sessions.there) == MOST_FURTHER - MOST_WATCHING + 1


def test_an_operator_who_watches_counts_as_one_who_watches() -> None:
    sessions = Sessions()
    assert "observers have 20 further" in sessions.fill("op1", "observer")
    assert len(sessions.there) == MOST_WATCHING + 1
    assert sessions.begin("op1") is None
    assert len(sessions.there) == MOST_WATCHING + 2


def test_who_is_refused_is_told_why_and_who_has_them() -> None:
    sessions = Sessions()
    why = sessions.fill("op1")
    assert why.startswith(f"op1 has {MOST_OF_A_USER} sessions, as many as a user may have; op1 has")
    assert "observers have" not in sessions.fill("viewer", "observer")
    why = sessions.fill("op2")
    assert why.startswith(
        "what is left of 56 sessions is for users who have none; op1 has 28, view"
    )
    assert "op2 has 1" in why
    assert "end a program" in why
    for number in range(20):
        sessions.begin(f"user{number}")
    assert len(sessions.there) == MOST_SESSIONS
    why = sessions.fill("late")
    assert why.startswith(f"all {MOST_SESSIONS} sessions are taken; op1 has {MOST_OF_A_USER}, ")
    assert ", others have " in why
    assert "late" not in why


def test_a_session_that_ends_makes_room() -> None:
    sessions = Sessions()
    sessions.fill("op1")
    sessions.there.pop()
    assert sessions.begin("op1") is None
