"""Whoever asks for a stop gets one, however the request is spelt."""

import pytest

from litegripd.rpc.jsonrpc import asked_stop, stops_in
from tests.rpc.raw import Raw
from tests.world import World, reason_of

SPELLINGS: dict[bytes, str] = {
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":[]}': "hold",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":["disable"]}': "disable",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":null}': "hold",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"relax"},"more":1}': "relax",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"disable","more":1}}': "disable",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"gently"}}': "hold",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":["relax"]}}': "hold",
    b'{"id":1,"method":"stop"}': "hold",
    b'{"id":1,"method":"stop","params":{"level":"disable"}}': "disable",
    b'{"jsonrpc":"1.0","id":1,"method":"stop"}': "hold",
    b'{"jsonrpc":"2.0","method":"stop"}': "hold",
    b'{"jsonrpc":"2.0","id":null,"method":"stop"}': "hold",
    b'{"jsonrpc":"2.0","id":[1],"method":"stop"}': "hold",
    b'{"jsonrpc":"2.0","id":1,"id":1,"method":"stop"}': "hold",
    b'{"jsonrpc":"2.0","id":1,"method":"st\\u006fp","more":1}': "hold",
    b'[{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"relax"}}]': "relax",
    b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"relax","sent_s":NaN}}': "relax",
}


@pytest.mark.parametrize("line", SPELLINGS)
def test_a_stop_that_is_refused_stops_all_the_same(line: bytes) -> None:
    world = World()
    mover, raw = world.enabled(), Raw(world)
    motion = mover.send("motion.open")
    world.run(0.1)
    answer = raw.error(line)
    latched = world.controller.stop_latch.latched
    assert latched is not None
    assert latched.level == SPELLINGS[line]
    assert answer["error"]["message"].endswith(f"; stopped ({latched.level}) all the same")
    assert reason_of(mover.wait(motion)) == "stopped"


@pytest.mark.parametrize(
    "line",
    [
        b'{"jsonrpc":"2.0","id":1,"method":"stop.clear","params":[]}',
        b'{"jsonrpc":"2.0","id":1,"method":"state.get","params":["stop"]}',
        b'{"jsonrpc":"2.0","id":1,"method":"state.get","params":{"method":"stop"}}',
        b'{"jsonrpc":"2.0","id":1,"method":"stop"',
        b'{"jsonrpc":"2.0","id":1,"method":["stop"]}',
        b'"stop"',
        b"[" * 600 + b'"stop"',
        b"\xff stop",
    ],
)
def test_what_asks_for_something_else_stops_nothing(line: bytes) -> None:
    world = World()
    raw = Raw(world)
    raw.send(line)
    assert world.controller.stop_latch.latched is None
    assert asked_stop(line) is None
    assert stops_in(line + b"\n" + line) == []
