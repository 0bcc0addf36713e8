"""The state asked for as clients spell it: answered without the parser, and as with it."""

from collections.abc import Callable
from dataclasses import astuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.control.admission import ENDING
from litegripd.rpc.jsonrpc import Request, parse, state_asked
from litegripd.rpc.sessions import ROLES, Role, Session
from tests.properties import examples
from tests.rpc.raw import Raw
from tests.world import World, enabled_world

PLAIN = b'{"jsonrpc":"2.0","id":7,"method":"state.get"}'
SPELLED = PLAIN.replace(b",", b", ")
PIECES = st.sampled_from(
    (b'{"jsonrpc":"2.0"', b'"id":7', b'"method":"state.get"}', b'"method":"state.get"', b",", b"}")
)


@examples(300)
@given(st.from_regex(rb'(-|0|")?[0-9]{0,20}"?', fullmatch=True))
def test_what_is_matched_is_read_the_same_by_the_parser(number: bytes) -> None:
    line = PLAIN.replace(b"7", number)
    if (asked := state_asked(line)) is not None:
        assert parse(line) == Request(int(asked), "state.get", {})
        assert asked == number == b"%d" % int(asked)


@examples(300)
@given(st.lists(PIECES, max_size=7).map(b"".join), st.binary(max_size=2), st.integers(0, 60))
def test_nothing_else_is_matched(line: bytes, inserted: bytes, at: int) -> None:
    for other in (
        line,
        PLAIN[:at] + inserted + PLAIN[at:],
        PLAIN[:at] + inserted + PLAIN[at + 1 :],
    ):
        if state_asked(other) is not None:
            assert isinstance(request := parse(other), Request)
            assert (request.method, request.params) == ("state.get", {})


@pytest.mark.parametrize("number", [b"0", b"7", b"123456789012345"])
def test_every_usual_number_is_matched(number: bytes) -> None:
    assert state_asked(PLAIN.replace(b"7", number)) == number


def orphan(_world: World, session: Session) -> None:
    session.is_orphaned = True


def end(world: World, _session: Session) -> None:
    world.controller.ending = ENDING


def stop(world: World, session: Session) -> None:
    world.controller.stop("hold", session.owner, "a test", world.now_s)
    world.tick()


def nothing(_world: World, _session: Session) -> None:
    pass


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("before", [nothing, orphan, end, stop])
def test_both_spellings_get_the_same_answer_and_leave_the_same_behind(
    role: Role, before: Callable[[World, Session], None]
) -> None:
    left = []
    for line in (PLAIN, SPELLED):
        world, _ = enabled_world()
        raw = Raw(world)
        raw.client.session.role = role
        before(world, raw.client.session)
        answers, events = raw.send(line), world.service.take_events()
        left.append((answers, astuple(raw.client.session.counters), events))
    assert left[0] == left[1]
    assert left[0][0][0]["result"]["seq"] > 0


def test_a_plain_read_renews_its_senders_lease() -> None:
    world, holder = enabled_world()
    holder.result("lease.acquire", ttl_s=0.5)
    for _ in range(4):
        world.run(0.3)
        world.service.handle(holder.session, PLAIN, world.now_s)
    assert world.controller.lease.holder is not None
    world.run(0.6)
    assert world.controller.lease.holder is None


def test_a_request_between_two_ticks_is_seen_by_the_next_plain_read() -> None:
    raw = Raw(World().start())
    (before,) = raw.send(PLAIN)
    raw.send(b'{"jsonrpc":"2.0","id":1,"method":"stop"}')
    (after,) = raw.send(PLAIN)
    assert (before["result"]["stop"], after["result"]["stop"]["level"]) == (None, "hold")
