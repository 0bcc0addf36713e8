"""What counts of what clients have left unread: stops, and the newest set-point."""

import json
import math
import socket
import time
from itertools import pairwise

import pytest

from litegripd.io.connection import Connection
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES, is_set_point, newest_set_point, stops_in
from litegripd.rpc.sessions import Session
from tests.io.loop import Loop, line

STOP = line("stop", 2, level="relax")


def point(number: float, **more: object) -> bytes:
    """Make a set-point without an id."""
    params = {"opening_mm": number, **more}
    return json.dumps({"jsonrpc": "2.0", "method": "stream.set", "params": params}).encode() + b"\n"


def served(loop: Loop) -> list[bytes]:
    return [text + b"\n" for text in loop.service.lines]


def fill(client: socket.socket, texts: list[bytes]) -> list[bytes]:
    """Send whole lines, a hundred at once, until the kernel takes no more; return what was sent."""
    sent: list[bytes] = []
    for begin in range(0, len(texts), 100):
        some = texts[begin : begin + 100]
        try:
            assert client.send(b"".join(some)) == len(b"".join(some))
        except BlockingIOError:
            break
        sent += some
    return sent


def connection_of(loop: Loop) -> Connection:
    (connection,) = loop.server._connections.values()
    return connection


@pytest.mark.parametrize("leaves_answers", [False, True], ids=["closed", "reset"])
@pytest.mark.parametrize("beyond", [0, 1000], ids=["little", "more than is read at once"])
def test_of_what_a_client_that_is_gone_has_left_only_stops_are_served(
    loop: Loop, leaves_answers: bool, beyond: int
) -> None:
    client = loop.connect()
    if leaves_answers:
        client.send(line("echo", 1))
        loop.until(lambda: bool(loop.service.lines))
        loop.run(1)
        loop.service.lines.clear()
    left = [line("motion.open", 1), point(1), *[line("echo", 3)] * beyond, STOP, line("echo", 4)]
    assert fill(client, left) == left
    client.close()
    loop.until(lambda: bool(loop.service.ended))
    assert served(loop) == [STOP]
    assert loop.server.clients == 0


def test_half_a_stop_of_a_client_that_is_gone_is_none(loop: Loop) -> None:
    client = loop.connect()
    client.send(STOP[:20])
    client.close()
    loop.until(lambda: bool(loop.service.ended))
    assert served(loop) == []


def test_a_stop_without_its_newline_is_served_though_its_client_is_gone(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("echo", 1) + STOP[:-1])
    client.close()
    loop.until(lambda: bool(loop.service.ended))
    assert served(loop) == [STOP]


def test_stops_without_end_that_a_client_has_left_hold_up_nobody(loop: Loop) -> None:
    client = loop.connect()
    fill(client, [STOP] * 10_000)
    client.close()
    loop.until(lambda: bool(loop.service.ended))
    assert 0 < len(loop.service.lines) <= 32


def test_a_stop_that_a_client_has_left_is_found_behind_many_lines_that_only_may_be_stops() -> None:
    maybe = line("trajectory.put", 1, content="a\nb")
    assert stops_in(maybe * 100 + STOP + maybe * 100) == [STOP[:-1]]


def test_who_has_only_ended_its_sending_side_is_served(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("echo", 1) * 3 + point(1))
    client.shutdown(socket.SHUT_WR)
    loop.read(client, 3)
    loop.until(lambda: len(loop.service.lines) == 4)


def test_of_many_set_points_the_newest_is_served_and_all_else_in_its_order(loop: Loop) -> None:
    client = loop.connect()
    first, second = line("echo", 1), line("lease.renew", 2)
    stream = [point(number) for number in range(50)]
    client.send(b"".join([*stream[:20], first, *stream[20:], second, STOP]))
    loop.read(client, 3)
    assert served(loop) == [first, stream[-1], second, STOP]


@pytest.mark.parametrize("text", [line("stream.set", 7, opening_mm=1.0), b'{"jsonrpc":"2.0"}\n'])
def test_what_is_owed_an_answer_gets_it_behind_a_newer_set_point_too(
    loop: Loop, text: bytes
) -> None:
    client = loop.connect()
    client.send(text * 3 + point(2))
    assert len(loop.read(client, 3)) == 3
    loop.until(lambda: len(loop.service.lines) == 4)


def test_the_newest_set_point_overtakes_all_that_lay_in_the_kernel(loop: Loop) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    sent = fill(client, [point(number) for number in range(10_000)])
    assert sum(map(len, sent)) > 3 * MAX_LINE_BYTES
    loop.until(lambda: sent[-1] in served(loop))
    assert served(loop) == [sent[-1]]
    client.send(STOP)
    loop.read(client, 1)
    assert served(loop) == [sent[-1], STOP]


def test_what_follows_a_set_point_without_end_is_not_read_without_end(loop: Loop) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    fill(client, [point(1), *[b"x" * 100] * 10_000])
    (last,) = loop.read_to_end(client)
    assert last["error"]["data"]["reason"] == "line_too_long"
    assert served(loop) == [point(1)]


def test_lines_that_only_look_like_set_points_are_served_one_by_one(loop: Loop) -> None:
    client = loop.connect()
    odd = b'{"jsonrpc":"2.0","id":1,"method":"echo","params":{"a":"stream.set"}}\n'
    client.send(odd * 20 + point(1) + odd)
    loop.read(client, 21)
    assert served(loop) == [odd] * 20 + [point(1), odd]


def test_what_lay_in_the_kernel_counts_as_received_when_it_was_first_seen_there(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    sent = fill(client, [line("echo", number) for number in range(500)])
    assert sum(map(len, sent)) > MAX_LINE_BYTES
    ends: list[float] = []
    handle = loop.service.handle

    def handle_and_note(
        session: Session, text: bytes, now_s: float, received_s: float | None
    ) -> None:
        handle(session, text, now_s, received_s)
        ends.append(time.monotonic())

    monkeypatch.setattr(loop.service, "handle", handle_and_note)
    loop.read(client, len(sent))
    times = loop.service.received_s
    assert all(earlier <= later for earlier, later in pairwise(times))
    assert max(times) < ends[0]
    client.send(line("echo", 1))
    loop.read(client, 1)
    assert loop.service.received_s[-1] > ends[-2]


def test_what_lies_unread_when_a_stop_comes_was_received_before_it(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("echo", 1))
    loop.read(client, 1)
    client.send(line("echo", 2) * 3)
    stopped_s = time.monotonic()
    loop.server.note_stop(stopped_s)
    client.send(line("echo", 3))
    loop.read(client, 4)
    assert [received_s < stopped_s for received_s in loop.service.received_s] == [
        *[True] * 4,
        False,
    ]


def test_what_comes_behind_what_is_known_to_be_unread_was_received_before_a_stop_too(
    loop: Loop,
) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    client.send(line("echo", 2))
    loop.server.note_stop(10.0)
    client.send(line("echo", 3))
    loop.server.note_stop(20.0)
    client.send(line("echo", 4))
    loop.read(client, 3)
    first_s, second_s, third_s = loop.service.received_s
    assert first_s == math.nextafter(10.0, 0.0)
    assert second_s < 20.0 < third_s


def test_what_a_client_sent_that_was_not_let_in_yet_was_received_before_a_stop(
    loop: Loop,
) -> None:
    first, second = loop.connect(), loop.connect()
    first.send(line("echo", 1))
    second.send(line("echo", 2))
    stopped_s = time.monotonic()
    loop.server.note_stop(stopped_s)
    loop.read(first, 1)
    loop.read(second, 1)
    assert all(received_s < stopped_s for received_s in loop.service.received_s)
    later = loop.connect()
    later.send(line("echo", 3))
    loop.read(later, 1)
    first.send(line("echo", 4))
    loop.read(first, 1)
    assert all(received_s > stopped_s for received_s in loop.service.received_s[2:])


def test_a_second_stop_makes_nothing_newer(loop: Loop) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    client.send(line("echo", 2))
    loop.server.note_stop(10.0)
    loop.server.note_stop(20.0)
    loop.read(client, 1)
    assert loop.service.received_s == [math.nextafter(10.0, 0.0)]


@pytest.mark.parametrize(
    "text",
    [
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":1}}',
        b' { "params" : { "openness" : 2e-1 } , "method" : "stream.set" , "jsonrpc" : "2.0" } \r',
        point(-1.5, lease="0:1", sent_s=12.5, stop_generation=3, torque_nm=1)[:-1],
    ],
)
def test_a_set_point_is_recognized(text: bytes) -> None:
    assert is_set_point(text)
    assert newest_set_point(b"x\n" + text + b"\ny", 0) == 2
    assert newest_set_point(b"x\n" + text, 0) == -1  # it is not whole
    assert newest_set_point(text + b"\n", 5) == -1


def test_blanks_before_what_is_no_set_point_take_no_time() -> None:
    """A whole read of them; matched one by one they would take seconds."""
    request = b'{"jsonrpc":"2.0","method":"stream.set","params":1}\n'
    began_s = time.process_time()
    assert newest_set_point(b" " * MAX_LINE_BYTES + request, 0) == -1
    assert not is_set_point(b" " * MAX_LINE_BYTES + request[:-1])
    assert time.process_time() - began_s < 0.1


def test_a_long_line_counts_as_no_set_point() -> None:
    assert is_set_point(point(1, lease="x" * 300)[:-1])
    assert not is_set_point(point(1, lease="x" * 600)[:-1])


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b'"stream.set"',
        b'{"jsonrpc":"2.0","id":1,"method":"stream.set","params":{"opening_mm":1}}',
        b'{"jsonrpc":"2.0","method":"stream.set"}',
        b'{"jsonrpc":"1.0","method":"stream.set","params":{"opening_mm":1}}',
        b'{"jsonrpc":"2.0","method":"stream.set","method":"stop"}',
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":1},"params":{}}',
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":NaN}}',
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":1,"more":1}}',
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":[1]}}',
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":1}}}',
        b'{"jsonrpc":"2.0","method":"stop","params":{"lease":"stream.set"}}',
    ],
)
def test_what_is_owed_an_answer_is_no_set_point(text: bytes) -> None:
    assert not is_set_point(text)
    assert newest_set_point(text + b"\n", 0) == -1
