"""What is attached to messages: it arrives as it was sent, and anything else is refused."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.wire.messages import (
    LONGEST_BYTES,
    Ask,
    BadMessageError,
    Push,
    Reply,
    packed,
    unpacked,
)
from tests.properties import examples

MESSAGES: list[Ask | Reply | Push] = [
    Ask("open", ttl_s=1.0, program="grasp.py"),
    Ask("line", 7, 3, at_s=12.5, generation=2),
    Ask("live", got=9, again=True),
    Reply(7, 9, 1234.5, 2),
    Reply(0, 0, 1.0, gone={"code": -32060, "message": "x", "data": {}}),
    Reply(0, 0, 1.0, about={"site": "lab"}),
    Push(3, more=True),
    Push(None, generation=4),
    Push(9, end=True),
]


@pytest.mark.parametrize("message", MESSAGES)
def test_a_message_arrives_as_it_was_sent(message: Ask | Reply | Push) -> None:
    assert unpacked(type(message), packed(message)) == message
    assert len(packed(message)) < 200


def test_what_a_newer_minor_version_says_besides_is_passed_over() -> None:
    attached = json.dumps({"v": 1, "op": "live", "mood": "good"}).encode()
    assert unpacked(Ask, attached) == Ask("live")


@pytest.mark.parametrize(
    "attached",
    [
        None,
        b"",
        b"\xff",
        b"[]",
        b"1",
        b"{}",
        b'{"v":2,"op":"live"}',
        b'{"v":1}',
        b'{"v":1,"op":"fly"}',
        b'{"v":1,"op":["live"]}',
        b'{"v":1,"op":"line","number":-1}',
        b'{"v":1,"op":"line","number":1.5}',
        b'{"v":1,"op":"line","number":true}',
        b'{"v":1,"op":"line","number":99999999999999999999}',
        b'{"v":1,"op":"line","at_s":"now"}',
        b'{"v":1,"op":"line","at_s":NaN}',
        b'{"v":1,"op":"line","at_s":1e300}',
        b'{"v":1,"op":"line","at_s":1' + b"0" * 400 + b"}",
        b'{"v":1,"op":"open","program":"a\\nb"}',
        b'{"v":1,"op":"open","program":"' + b"x" * 65 + b'"}',
        b'{"v":1,"op":"live","again":1}',
        b"[" * LONGEST_BYTES,
        b'{"v":1,"op":"live"' + b" " * LONGEST_BYTES + b"}",
    ],
)
def test_anything_else_is_refused(attached: bytes | None) -> None:
    with pytest.raises(BadMessageError):
        unpacked(Ask, attached)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=5,
)
NAMES = st.sampled_from(["v", "op", "number", "got", "again", "at_s", "generation", "ttl_s"])


@examples(100)
@given(st.binary() | st.dictionaries(NAMES, JSON).map(lambda value: json.dumps(value).encode()))
def test_no_bytes_do_anything_but_be_read_or_refused(attached: bytes) -> None:
    kinds: tuple[type[Ask] | type[Reply] | type[Push], ...] = (Ask, Reply, Push)
    for kind in kinds:
        try:
            message = unpacked(kind, attached)
        except BadMessageError:
            continue
        assert unpacked(kind, packed(message)) == message
