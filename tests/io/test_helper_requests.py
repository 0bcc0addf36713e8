"""Whose request to the helper is the next one, and whose is refused."""

from collections.abc import Iterator

import pytest

from litegripd.io.helper.helper import (
    MOST_AT_ONCE,
    MOST_OWN,
    MOST_PER_UID,
    REFUSED_LATELY_S,
    Helper,
    HelperRequest,
    HelperRequests,
    HelperResult,
)
from tests.io.test_helper import Rig


class Sent:
    """Takes packets while it has room."""

    def __init__(self, room: int = 1000) -> None:
        self.packets: list[bytes] = []
        self.room = room

    def __call__(self, packet: bytes) -> bool:
        if len(self.packets) >= self.room:
            return False
        self.packets.append(packet)
        return True


def request(identity: int, uid: int | None = None) -> HelperRequest:
    return HelperRequest(identity, b"%d" % identity, lambda _result: None, uid)


def test_users_take_turns_and_few_are_at_the_helper() -> None:
    requests, sent = HelperRequests(), Sent()
    for identity, uid in enumerate([1, 1, 1, 1, 2, 3]):
        requests.add(request(identity, uid))
    requests.send(sent)
    assert sent.packets == [b"0"]
    assert (len(requests), requests.waiting) == (6, 5)
    for done in (0, 4, 5, 1, 2):
        answered = requests.at_helper(done)
        assert answered is not None
        requests.answered(answered)
        requests.send(sent)
    assert sent.packets == [b"0", b"4", b"5", b"1", b"2", b"3"]


def test_the_daemons_own_pass_all_users() -> None:
    requests, sent = HelperRequests(), Sent()
    for identity in range(6):
        requests.add(request(identity, 1))
    requests.send(sent)
    for identity in range(10, 14):
        requests.add(request(identity))
    requests.send(sent)
    assert sent.packets == [b"0", b"10", b"11", b"12", b"13"]


def test_what_the_helper_does_not_take_now_keeps_its_place() -> None:
    requests, sent = HelperRequests(), Sent(room=1)
    for identity, uid in ((1, None), (2, None), (3, 7)):
        requests.add(request(identity, uid))
    requests.send(sent)
    sent.room = 10
    requests.send(sent)
    assert sent.packets == [b"1", b"2", b"3"]


def test_each_user_is_bounded_alone_and_so_is_the_daemon() -> None:
    requests = HelperRequests()
    for identity in range(MOST_PER_UID):
        assert requests.refusal(1) is None
        requests.add(request(identity, 1))
    requests.send(Sent())
    assert "8 requests of uid 1" in (requests.refusal(1) or "")
    assert requests.refusal(2) is None
    for identity in range(MOST_OWN):
        assert requests.refusal(None) is None
        requests.add(request(100 + identity))
    assert "overloaded" in (requests.refusal(None) or "")


def test_what_waits_outlives_a_helper() -> None:
    requests, sent = HelperRequests(), Sent()
    for identity in range(4):
        requests.add(request(identity, 1))
    requests.send(sent)
    assert [orphan.identity for orphan in requests.take_sent()] == [0]
    requests.send(sent)
    assert sent.packets == [b"0", b"1"]


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    yield made
    made.helper.close()


def flood(helper: Helper, uid: int, results: list[HelperResult]) -> None:
    for _ in range(MOST_PER_UID):
        helper.request("double", {"x": 1}, results.append, uid=uid)


def test_a_user_who_asks_too_much_is_refused_and_named_for_a_while(rig: Rig) -> None:
    results: list[HelperResult] = []
    assert rig.helper.lately_refused(0.0) is None
    flood(rig.helper, 7, results)
    refused: list[HelperResult] = []
    rig.helper.request("double", {"x": 1}, refused.append, uid=7)
    assert refused[0].reason == "helper_busy"
    assert "uid 7" in (refused[0].error or "")
    assert rig.helper.refused == 1
    assert rig.helper.waiting >= MOST_PER_UID - MOST_AT_ONCE
    assert rig.helper.lately_refused(rig.helper._refused_s) == 7
    assert rig.helper.lately_refused(rig.helper._refused_s + REFUSED_LATELY_S) is None
    other: list[HelperResult] = []
    rig.helper.request("double", {"x": 2}, other.append, uid=8)
    rig.until(lambda: bool(other))
    assert other[0].value == {"twice": [2, 2]}
    rig.until(lambda: len(results) == MOST_PER_UID)
    assert all(result.error is None for result in results)
    assert not rig.helper.is_busy
