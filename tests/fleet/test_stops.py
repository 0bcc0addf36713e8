"""A gateway's stop for a remote user: what was asked, in any form."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.far.gateway import in_the_name_of
from litegripd.io.stop_socket import MAX_STOP_LINE_BYTES
from litegripd.rpc.jsonrpc import stop_in

OP1 = "op1@lab"
LONGEST_NAME = f"{'u' * 32}@{'s' * 32}"


def request(**params: Any) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": 7, "method": "stop", "params": params}


def line_of(value: object) -> bytes:
    return json.dumps(value).encode()


LINES = [
    b"relax\n",
    b" DISABLE\r\n",
    b"",
    b"stop!\n",
    b"\xff\n",
    b"[" * 5000,
    line_of(request(level="relax")),
    line_of(request(level="disable", why="smoke")),
    line_of(request(level="disable", why="smoke", on_behalf="op2@lab")),
    line_of(request(level="disable", why="\ud800")),
    line_of(request(level=["disable"], why=3)),
    line_of({"id": 5, "method": "stop"}),
    line_of({"id": "a", "method": "stop", "params": ["disable"]}),
    line_of([request(level="relax", why="smoke")]),
    line_of([request(level="relax", on_behalf="op2@lab")]),
    line_of({"jsonrpc": "2.0", "id": "a", "method": "state.get"}),
]


def agrees(line: bytes) -> None:
    """Check that a daemon does by the gateway's line what it would have done by the client's."""
    written = in_the_name_of(OP1, line)
    stop, direct = stop_in(written), stop_in(line)
    assert len(written) <= MAX_STOP_LINE_BYTES
    assert (stop.level, stop.on_behalf) == (direct.level, OP1)
    assert direct.why in (None, stop.why)


@pytest.mark.parametrize("line", LINES)
def test_a_stop_in_any_form_is_of_who_sent_it(line: bytes) -> None:
    agrees(line)


@given(
    st.binary(max_size=200)
    | st.builds(
        lambda level, why, one: line_of(request(**{level: one, "why": why})),
        st.sampled_from(("level", "levels", "on_behalf")),
        st.text(max_size=2000),
        st.sampled_from(("hold", "relax", "disable", "HOLD", "")),
    )
)
def test_whatever_is_sent_a_daemon_does_what_it_says(line: bytes) -> None:
    agrees(line)


@pytest.mark.parametrize("why", ["x" * 5000, "手が挟まった" * 50, "\U0001f6d1" * 500, "\x01" * 500])
def test_a_long_reason_makes_no_stop_weaker(why: str) -> None:
    asked = {**request(level="disable", why=why), "id": 2**31}
    written = in_the_name_of(LONGEST_NAME, line_of(asked))
    assert len(written) <= MAX_STOP_LINE_BYTES
    stop = stop_in(written)
    assert (stop.level, stop.identity, stop.on_behalf) == ("disable", 2**31, LONGEST_NAME)
    assert stop.why == (why[:80] if why.isprintable() else None)


@pytest.mark.parametrize(
    "character", ["x", '"', "\\", "\x01", "\u2028", "\ud800", "手", "\U0001f6d1"]
)
def test_no_reason_and_id_together_make_a_stop_weaker(character: str) -> None:
    asked = {**request(level="disable", why=character * 80), "id": character * 64}
    written = in_the_name_of(LONGEST_NAME, line_of(asked))
    assert len(written) <= MAX_STOP_LINE_BYTES
    stop = stop_in(written)
    assert (stop.level, stop.on_behalf) == ("disable", LONGEST_NAME)
    is_shown = character.isprintable()
    assert stop.identity == (character * 64 if is_shown else None)
    assert stop.why == (character * 80 if is_shown else None)


@pytest.mark.parametrize("identity", ["i" * 2000, 10**2000, ["i" * 2000], {"i": 2000 * "d"}, 1.5])
def test_a_long_id_is_not_answered_with(identity: object) -> None:
    asked = {**request(level="disable"), "id": identity}
    written = in_the_name_of(OP1, line_of(asked))
    assert len(written) <= MAX_STOP_LINE_BYTES
    stop = stop_in(written)
    assert (stop.level, stop.identity) == ("disable", None)
