"""What the transport counts of each client, and what it sends at the end, over real sockets."""

import json
import time
from types import SimpleNamespace

import pytest

from litegripd.io import connection as connection_module
from litegripd.io import server as server_module
from litegripd.model.errors import Refusal
from litegripd.rpc.sessions import Counters, Session
from tests.io.loop import Loop, line


def counters(loop: Loop, client: int = 0) -> Counters:
    return loop.service.sessions[client].counters


def test_bytes_are_counted_in_both_directions(loop: Loop) -> None:
    client, idle = loop.connect(), loop.connect()
    requests = line("echo", 1, text="ü") + b"\n \n" + line("big", 2, size=300_000)
    client.send(requests)
    answers = loop.read(client, 2)
    assert len(answers[1]["result"]) == 300_000
    assert counters(loop).bytes_in == len(requests)
    frame = b'{"jsonrpc":"2.0","id":1,"result":}\n'
    expected = 2 * len(frame) + len(b'{"text":"\\u00fc"}') + 300_002
    assert counters(loop).bytes_out == expected
    assert (counters(loop, 1).bytes_in, counters(loop, 1).bytes_out) == (0, 0)
    idle.close()


def test_what_a_client_has_not_taken_is_not_counted_as_sent(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("big", 1, size=400_000))
    loop.until(lambda: bool(loop.service.sessions) and loop.service.sessions[0].congested)
    assert 0 < counters(loop).bytes_out < 400_000
    loop.read(client, 1)
    assert counters(loop).bytes_out > 400_000


def test_the_latency_counts_from_the_end_of_the_line_until_it_is_answered(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = loop.connect()
    client.send(line("echo", 1)[:-1])
    loop.until(lambda: bool(loop.service.sessions) and counters(loop).bytes_in > 0)
    loop.run(3)
    assert counters(loop).worst_latency_s is None  # the line has no end yet
    passed_s = 0.0
    handle, began_s = loop.service.handle, time.monotonic()

    def slow(session: Session, text: bytes, now_s: float, received_s: float | None) -> None:
        nonlocal passed_s
        handle(session, text, now_s, received_s)
        passed_s = 5.0

    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + passed_s)
    monkeypatch.setattr(server_module, "time", clock)
    monkeypatch.setattr(loop.service, "handle", slow)
    client.send(b"\n")
    loop.until(lambda: bool(loop.service.lines))
    worst_s = counters(loop).worst_latency_s
    assert worst_s is not None
    assert 5.0 < worst_s < 5.0 + time.monotonic() - began_s


def test_every_line_of_one_packet_has_waited_since_the_packet_came(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = loop.connect()
    loop.until(lambda: bool(loop.service.sessions))
    noted: list[float] = []
    monkeypatch.setattr(Counters, "note_latency", lambda _self, latency_s: noted.append(latency_s))
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() - 100.0)
    with monkeypatch.context() as patch:
        patch.setattr(connection_module, "time", clock)
        client.send(b"".join(line("echo", number) for number in range(50)))
        loop.until(lambda: bool(noted))
    loop.read(client, 50)
    assert len(noted) == 50
    assert min(noted) > 100.0
    client.send(line("echo", 50))
    loop.read(client, 1)
    assert 0.0 < noted[-1] < 100.0


def test_a_request_that_waits_for_a_motion_has_no_latency(loop: Loop) -> None:
    client = loop.connect()
    client.send(line("later", 1))
    loop.until(lambda: bool(loop.service.waiting))
    loop.service.finish()
    loop.read(client, 1)
    assert counters(loop).worst_latency_s is None
    client.send(line("echo", 2))
    loop.read(client, 1)
    assert counters(loop).worst_latency_s is not None


def test_what_waits_at_the_end_of_the_daemon_is_sent(loop: Loop) -> None:
    client = loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    loop.service.samples += [loop.service.sessions[0]] * 3
    loop.server.flush()
    loop.server.close()
    client.setblocking(True)
    with client.makefile("rb") as file:
        assert len(file.readlines()) == 3


def test_the_last_line_at_the_end_of_the_daemon_is_why_for_each_client(loop: Loop) -> None:
    clients = [loop.connect(), loop.connect()]
    loop.until(lambda: loop.server.clients == 2)
    loop.service.samples += [loop.service.sessions[0]] * 3
    loop.server.flush()
    loop.server.close(Refusal("shutting_down", "it ends", {"motor_off": True}))
    for client, before in zip(clients, (3, 0), strict=True):
        client.setblocking(True)
        with client.makefile("rb") as file:
            lines = file.readlines()
        assert len(lines) == before + 1
        last = json.loads(lines[-1])
        assert last["id"] is None
        assert last["error"]["data"] == {
            "reason": "shutting_down",
            "retryable": True,
            "motor_off": True,
        }
