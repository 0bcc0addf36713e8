"""The Unix socket: lines, bounds, fairness and the ends of connections, over real sockets."""

import contextlib
import json
import logging
import os
import socket
import time
from collections import Counter
from pathlib import Path

import pytest

from litegripd.io import server as server_module
from litegripd.io.connection import MAX_UNSENT_BYTES
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES
from litegripd.rpc.sessions import Session
from tests.io.loop import DEADLINE_S, Loop, line


def padded(length: int) -> bytes:
    """Make a request of exactly `length` bytes, without its newline."""
    request = line("echo", 5)[:-1]
    return request + b" " * (length - len(request) - 1) + b" "


def test_a_request_is_answered(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("echo", 7, x=1))
    (answer,) = loop.read(client, 1)
    assert answer == {"jsonrpc": "2.0", "id": 7, "result": {"x": 1}}
    peer = loop.service.sessions[0].peer
    assert (peer.pid, peer.uid, peer.gid) == (os.getpid(), os.getuid(), os.getgid())
    comm = Path("/proc/self/comm").read_text(encoding="utf-8").strip()
    assert peer.program == comm


def test_many_lines_in_one_packet_are_all_answered_in_order(loop: Loop) -> None:
    client = loop.connect()
    client.send(b"".join(line("echo", n) for n in range(150)))
    assert [answer["id"] for answer in loop.read(client, 150)] == list(range(150))


def test_all_that_clients_have_sent_before_an_end_is_served(loop: Loop) -> None:
    clients = [loop.connect() for _ in range(40)]
    loop.until(lambda: loop.server.clients == len(clients))
    for client in clients:
        client.send(line("echo", 1))
    loop.server.drain(time.monotonic() + DEADLINE_S)
    assert len(loop.service.lines) == len(clients)


def test_a_line_may_come_in_pieces_and_half_a_line_disturbs_nobody(loop: Loop) -> None:
    slow, other = loop.connect(), loop.connect()
    whole = line("echo", 3, text="ü")
    for byte in whole[:-1]:
        slow.send(bytes([byte]))
        loop.run(1) if byte == 0xC3 else None
    other.send(line("echo", 4))
    assert loop.read(other, 1)[0]["id"] == 4
    assert [session.identity for session in loop.service.served] == [2]
    slow.send(whole[-1:])
    assert loop.read(slow, 1)[0]["result"] == {"text": "ü"}


def test_blank_lines_are_no_requests(loop: Loop) -> None:
    client = loop.connect()
    client.send(b"\n \r\n\t\n" * 4000 + line("echo", 1) + b"\r\n\n")
    loop.read(client, 1)
    assert loop.service.lines == [line("echo", 1)[:-1]]


def test_a_line_of_exactly_the_limit_is_served(loop: Loop) -> None:
    client = loop.connect()
    client.send(padded(MAX_LINE_BYTES) + b"\n")
    assert loop.read(client, 1)[0]["id"] == 5


@pytest.mark.parametrize("ending", [b"\n", b""])
def test_a_longer_line_is_refused_and_the_connection_closed(loop: Loop, ending: bytes) -> None:
    client, other = loop.connect(), loop.connect()
    client.send(line("echo", 1) + b"x" * (MAX_LINE_BYTES + 1) + ending)
    (last,) = loop.read_to_end(client)
    assert last["id"] is None
    assert last["error"]["data"] == {
        "reason": "line_too_long",
        "retryable": False,
        "limit": MAX_LINE_BYTES,
    }
    assert loop.service.lines == [line("echo", 1)[:-1]]
    assert loop.server.clients == 1
    other.send(line("echo", 9))
    assert loop.read(other, 1)[0]["id"] == 9


def test_what_came_before_a_too_long_line_is_answered(loop: Loop) -> None:
    client = loop.connect()
    client.send(b"".join(line("echo", n) for n in range(3)) + b"x" * (MAX_LINE_BYTES + 1))
    messages = loop.read(client, 4)
    assert [message["id"] for message in messages] == [0, 1, 2, None]


def test_a_flooder_takes_no_more_turns_than_a_polite_client(loop: Loop) -> None:
    polite = [loop.connect() for _ in range(3)]
    flooder = loop.connect()
    loop.until(lambda: loop.server.clients == 4)
    flood = line("echo", 0) * 200
    flooder.send(flood)
    for client in polite:
        client.send(b"".join(line("echo", n) for n in range(20)))
    loop.until(lambda: len(loop.service.served) >= 80)
    turns = Counter(session.identity for session in loop.service.served[:80])
    assert max(turns.values()) - min(turns.values()) <= 2


def test_who_comes_while_a_flood_is_served_waits_for_a_few_of_its_lines_only(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    flooder, newcomer = loop.connect(), loop.connect()
    loop.until(lambda: loop.server.clients == 2)
    served, handle = loop.service.served, loop.service.handle

    def handle_and_be_asked(
        session: Session, text: bytes, now_s: float, received_s: float | None
    ) -> None:
        if len(served) == 10:
            newcomer.send(line("echo", 2))
        handle(session, text, now_s, received_s)

    monkeypatch.setattr(loop.service, "handle", handle_and_be_asked)
    flooder.send(line("echo", 1) * 150)
    loop.read(newcomer, 1)
    loop.read(flooder, 150)
    assert served.index(loop.service.sessions[1]) < 10 + 20


def test_a_client_that_does_not_read_is_closed_with_the_reason_and_others_are_served(
    loop: Loop,
) -> None:
    deaf, other = loop.connect(), loop.connect()
    loop.until(lambda: loop.server.clients == 2)
    size = MAX_UNSENT_BYTES // 4
    deaf.send(b"".join(line("big", n, size=size) for n in range(12)))
    other.send(line("echo", 1))
    loop.until(lambda: loop.server.clients == 1)
    (last,) = loop.read_to_end(deaf)
    assert last["error"]["data"]["reason"] == "backlog_full"
    assert last["error"]["data"]["limit"] == MAX_UNSENT_BYTES
    assert loop.service.ended == [loop.service.sessions[0]]
    assert loop.read(other, 1)[0]["id"] == 1


def test_what_a_client_that_is_closed_was_sent_are_whole_lines(loop: Loop) -> None:
    deaf = loop.connect()
    size = MAX_UNSENT_BYTES // 4
    deaf.send(b"".join(line("big", n, size=size) for n in range(12)))
    loop.until(lambda: loop.server.clients == 0 and bool(loop.service.ended))
    received = bytearray()
    with contextlib.suppress(ConnectionResetError):
        while chunk := deaf.recv(1 << 20):
            received += chunk
    *answers, last = [json.loads(text) for text in received.splitlines()]
    assert [answer["id"] for answer in answers] == list(range(len(answers)))
    assert {len(answer["result"]) for answer in answers} == {size}
    assert last["error"]["data"]["reason"] == "backlog_full"


def test_a_slow_reader_is_congested_until_it_has_read(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("big", 1, size=300_000))
    loop.until(lambda: bool(loop.service.sessions) and loop.service.sessions[0].congested)
    (answer,) = loop.read(client, 1)
    assert len(answer["result"]) == 300_000
    assert not loop.service.sessions[0].congested


def test_a_half_closed_client_still_gets_its_answers(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("later", 1) + line("echo", 2))
    client.shutdown(socket.SHUT_WR)
    assert loop.read(client, 1)[0]["id"] == 2
    assert loop.server.clients == 1
    loop.service.finish()
    (last,) = loop.read_to_end(client)
    assert last["id"] == 1
    assert loop.server.clients == 0


def test_a_last_line_without_a_newline_is_served(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("echo", 6)[:-1])
    client.shutdown(socket.SHUT_WR)
    (last,) = loop.read_to_end(client)
    assert last["id"] == 6


def test_a_half_closed_subscriber_stays(loop: Loop) -> None:
    loop.service.idle = False
    client = loop.connect()
    client.send(line("echo", 1))
    client.shutdown(socket.SHUT_WR)
    loop.read(client, 1)
    loop.run(3)
    assert loop.server.clients == 1
    loop.service.samples.append(loop.service.sessions[0])
    assert loop.read(client, 1)[0]["method"] == "sample"
    client.close()
    loop.until(lambda: loop.server.clients == 0)


def test_a_stop_after_the_server_has_closed_is_no_error(loop: Loop) -> None:
    """A daemon that retires still takes stops, for its successor."""
    loop.connect().send(line("echo", 1))
    loop.server.close()
    loop.server.note_stop(1.0)


@pytest.mark.parametrize("idle", [True, False], ids=["idle", "subscribed"])
def test_an_heir_of_a_half_closed_connection_costs_no_time(loop: Loop, idle: bool) -> None:
    """The process that had opened it is gone; a child of it keeps the descriptor."""
    loop.service.idle = idle
    client = loop.connect()
    client.send(line("echo", 1))
    loop.read(client, 1)
    loop.run(1)
    client.shutdown(socket.SHUT_WR)
    connection = next(iter(loop.server._connections.values()))
    connection.forget_unread()  # as when the end of the process is noticed first
    assert loop.server.clients == (0 if idle else 1)
    polls = 0
    on_event = connection.on_event

    def counted(mask: int) -> None:
        nonlocal polls
        polls += 1
        on_event(mask)

    connection.on_event = counted  # type: ignore[method-assign]
    loop.run(3)
    assert polls == 0
    client.close()
    loop.until(lambda: loop.server.clients == 0)


def test_a_stop_that_was_sent_just_before_the_end_of_a_client_is_served(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("stop", 1))
    client.close()
    loop.until(lambda: bool(loop.service.ended))
    assert loop.service.lines == [line("stop", 1)[:-1]]
    assert loop.server.clients == 0


def test_a_client_that_is_gone_cannot_keep_its_place_by_requests_that_it_left(loop: Loop) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    client.send(line("echo", 1) * 1000)
    client.close()
    loop.until(lambda: loop.server.clients == 0)
    assert len(loop.service.lines) < 1000


def test_a_client_that_waits_for_a_motion_is_lost_when_it_ends(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("later", 1))
    loop.until(lambda: bool(loop.service.waiting))
    client.close()
    loop.until(lambda: bool(loop.service.ended))


def test_samples_and_requests_take_turns(loop: Loop) -> None:
    watcher, asker = loop.connect(), loop.connect()
    loop.until(lambda: loop.server.clients == 2)
    sessions = loop.service.sessions
    loop.service.samples += [sessions[0]] * 200
    asker.send(line("echo", 1) * 200)
    loop.until(lambda: len(loop.service.served) >= 20)
    assert len(loop.service.samples) < 200
    loop.read(watcher, 200)
    loop.read(asker, 150)


def test_a_defect_of_the_service_ends_neither_the_loop_nor_other_clients(
    loop: Loop, caplog: pytest.LogCaptureFixture
) -> None:
    client, other = loop.connect(), loop.connect()
    client.send(line("fail", 1) + line("fail", 2))
    other.send(line("echo", 3))
    assert loop.read(other, 1)[0]["id"] == 3
    loop.until(lambda: loop.reactor.backlog_errors == 2)
    assert len([record for record in caplog.records if record.levelname == "ERROR"]) == 1
    client.send(line("echo", 4))
    assert loop.read(client, 1)[0]["id"] == 4


def test_closing_the_server_closes_its_clients(tmp_path: Path) -> None:
    loop = Loop(tmp_path / "a.sock")
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    loop.close()
    assert loop.service.ended == loop.service.sessions
    assert client.fileno() == -1


def test_a_long_line_is_served_at_every_rate(
    loop: Loop, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR)
    monkeypatch.setattr(server_module, "_COST_PER_BYTE_S", 1e-3)  # 16 s for the longest line
    client = loop.connect()
    client.send(json.dumps({"jsonrpc": "2.0", "id": 1, "method": "x" * 16000}).encode() + b"\n")
    assert loop.read(client, 1)[0]["id"] == 1
