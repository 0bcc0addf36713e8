import json
import math
import pickle
import socket
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.line.connection import Connection
from litegrip_client.values.errors import (
    CANTimeoutError,
    CommandError,
    ConnectError,
    HardwareError,
    ProtocolError,
    StoppedError,
)
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.rig import Kind


def test_a_request_is_one_compact_line_with_parameters_by_name(
    daemon: FakeDaemon, connection: Connection
) -> None:
    daemon.handlers["job.get"] = lambda request: {"job": 1}
    assert connection.call("job.get", {"job": 1}) == {"job": 1}
    assert connection.call("state.get") == STATE
    first, second = daemon.requests
    assert first.raw == {"jsonrpc": "2.0", "id": 1, "method": "job.get", "params": {"job": 1}}
    assert second.raw == {"jsonrpc": "2.0", "id": 2, "method": "state.get"}


def test_answers_that_come_in_pieces_and_together(
    daemon: FakeDaemon, connection: Connection
) -> None:
    def answer(request: Request) -> None:
        text = "x" * 99_999
        message = {"jsonrpc": "2.0", "id": request.identity, "result": {"text": text}}
        one = json.dumps(message).encode() + b"\n"
        request.send_bytes(b'{"jsonrpc":"2.0","id":999,"result":{}}\n' + one[:10])
        request.send_bytes(one[10:])

    daemon.handlers["pieces"] = answer
    assert connection.call("pieces") == {"text": "x" * 99_999}
    assert connection.call("state.get") == STATE


def test_no_answer_in_time_is_an_error_and_the_late_answer_is_dropped(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with pytest.raises(ConnectError, match=r"did not answer slow within 0\.01 s") as caught:
        connection.call("slow", timeout_s=0.01)
    assert caught.value.reason == "no_answer"
    assert caught.value.retryable
    daemon.wait_for("slow")[0].reply({"late": True})
    assert connection.call("state.get") == STATE


def test_a_late_answer_that_comes_alone_is_not_taken_for_the_next_one(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with pytest.raises(ConnectError):
        connection.call("slow", timeout_s=0.01)
    (slow,) = daemon.wait_for("slow")
    daemon.handlers["state.get"] = lambda request: slow.reply({"late": True})
    daemon.handlers["clients.list"] = lambda request: {"clients": []}
    with pytest.raises(ConnectError):
        connection.call("state.get", timeout_s=0.01)
    assert connection.call("clients.list") == {"clients": []}


def test_what_the_daemon_said_before_it_closed_is_the_reason(
    daemon: FakeDaemon, connection: Connection
) -> None:
    def close(request: Request) -> None:
        error = {
            "code": -32004,
            "message": "the daemon ends",
            "data": {"reason": "shutting_down", "retryable": True},
        }
        request.send({"jsonrpc": "2.0", "id": None, "error": error})
        request.hang_up()

    daemon.handlers["state.get"] = close
    with pytest.raises(ConnectError, match="the daemon ends") as caught:
        connection.call("state.get")
    assert (caught.value.reason, caught.value.code) == ("shutting_down", -32004)
    assert caught.value.retryable


def test_the_reason_is_also_read_when_the_daemon_closes_before_the_request(
    daemon: FakeDaemon, connection: Connection
) -> None:
    def close(request: Request) -> None:
        error = {"code": -32003, "message": "read faster", "data": {"reason": "backlog_full"}}
        request.reply({})
        request.send({"jsonrpc": "2.0", "id": None, "error": error})
        request.hang_up()

    daemon.handlers["first"] = close
    connection.call("first")
    with pytest.raises(ConnectError, match="read faster") as caught:
        connection.call("state.get")
    assert caught.value.reason == "backlog_full"


@pytest.mark.parametrize("line", [b"nonsense\n", b"[]\n", b"{}\n", b"\xff\n", b'{"id":"x"}\n"\n'])
def test_what_is_not_the_protocol_ends_the_connection(
    daemon: FakeDaemon, connection: Connection, line: bytes
) -> None:
    daemon.handlers["state.get"] = lambda request: request.send_bytes(line)
    with pytest.raises(ConnectError, match="not the protocol"):
        connection.call("state.get")


def test_a_result_that_is_no_object_is_a_protocol_error(
    daemon: FakeDaemon, connection: Connection
) -> None:
    daemon.handlers["state.get"] = lambda request: [1]
    with pytest.raises(ProtocolError, match=r"state\.get with no object"):
        connection.call("state.get")


def test_unknown_notifications_are_ignored(daemon: FakeDaemon, connection: Connection) -> None:
    def answer(request: Request) -> Any:
        request.notify("event.of_tomorrow", {"a": 1})
        request.notify("state.sample", {"subscription": 99, "seq": 1, "state": {}})
        return STATE

    daemon.handlers["state.get"] = answer
    assert connection.call("state.get") == STATE


def test_a_request_that_cannot_be_sent_is_refused_here(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with pytest.raises(CommandError, match="not JSON"):
        connection.call("stop", {"why": math.nan})
    with pytest.raises(CommandError, match="16384 at most"):
        connection.call("stop", {"why": "x" * 16_384})
    assert connection.call("state.get") == STATE
    assert daemon.methods() == ["state.get"]


def test_a_daemon_that_does_not_read_is_an_error(tmp_path: Path, kind: Kind) -> None:
    path = str(tmp_path / "deaf.sock")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(path)
        listener.listen()
        connection = kind.connect(path, 0.02)
        messages = set()
        while "the daemon does not read its requests within 0.02 s" not in messages:
            with pytest.raises(ConnectError) as caught:
                connection.call("stop", {"why": "x" * 16_000}, timeout_s=0.0)
            messages.add(caught.value.message)
            assert caught.value.reason == "no_answer"
        connection.close()


def test_the_stop_generation_is_learned_from_every_answer_that_has_it(
    daemon: FakeDaemon, connection: Connection
) -> None:
    daemon.handlers["stop"] = lambda request: {"level": "hold", "generation": 4, "state": {}}
    daemon.handlers["motion.open"] = lambda request: {"state": {"stop_generation": 9}}
    known = [connection.stop_generation]
    connection.accept(connection.call("hello"))
    known.append(connection.stop_generation)
    connection.call("stop")
    known.append(connection.stop_generation)
    connection.call("state.get")  # says 3: an answer made before, read later
    known.append(connection.stop_generation)
    connection.call("motion.open")
    known.append(connection.stop_generation)
    assert known == [None, 3, 4, 4, 9]


def test_who_is_told_of_a_stop_may_send_what_comes_after_it(
    daemon: FakeDaemon, connection: Connection
) -> None:
    connection.accept(connection.call("hello"))
    daemon.handlers["motion.open"] = lambda request: request.fail("sent_before_stop", -32022)
    with pytest.raises(StoppedError):
        connection.run(connection.prepare_guarded("motion.open", {}))
    call = connection.prepare_guarded("motion.open", {})
    assert call.params is not None
    assert call.params.keys() == {"sent_s"}
    daemon.handlers["motion.open"] = lambda request: request.fail(
        "stopped", -32021, stop_generation=8
    )
    with pytest.raises(StoppedError):
        connection.run(call)
    assert connection.stop_generation == 8


def test_another_protocol_is_refused(daemon: FakeDaemon, connection: Connection) -> None:
    daemon.handlers["hello"] = lambda request: {"protocol": 2}
    with pytest.raises(ProtocolError, match="protocol 2, this client 1"):
        connection.accept(connection.call("hello"))


def test_the_daemons_errors_keep_all_they_say(daemon: FakeDaemon, connection: Connection) -> None:
    owner = {"pid": 12, "program": "other.py"}
    daemon.handlers["motor.enable"] = lambda request: request.fail(
        "motor_silent", -32032, "nothing comes", retryable=True, hint="power?", owner=owner
    )
    with pytest.raises(HardwareError) as caught:
        connection.call("motor.enable")
    error = caught.value
    assert str(error) == "nothing comes\npower?"
    assert (error.message, error.code, error.retryable) == ("nothing comes", -32032, True)
    assert (error.hint, error.owner) == ("power?", owner)
    copy = pickle.loads(pickle.dumps(error))
    assert (type(copy), copy.reason, copy.data) == (CANTimeoutError, error.reason, error.data)


# Calls beside each other, of threads or of tasks


def test_answers_in_the_other_order_reach_who_asked(
    daemon: FakeDaemon, kind: Kind, connection: Connection
) -> None:
    first = kind.begin(connection, "call", "first")
    (one,) = kind.arrived(daemon, "first")
    second = kind.begin(connection, "call", "second")
    (two,) = kind.arrived(daemon, "second")
    two.reply({"n": 2})
    assert second() == {"n": 2}
    one.reply({"n": 1})
    assert first() == {"n": 1}


def test_many_at_once_each_get_their_own_answers(
    daemon: FakeDaemon, kind: Kind, connection: Connection
) -> None:
    daemon.handlers["echo"] = lambda request: request.params
    for turn in range(8):
        asked = [{"number": number, "turn": turn} for number in range(50)]
        calls = [kind.begin(connection, "call", "echo", params) for params in asked]
        assert [call() for call in calls] == asked


def test_all_who_wait_are_served_whoever_reads_first(
    daemon: FakeDaemon, kind: Kind, connection: Connection
) -> None:
    calls = [kind.begin(connection, "call", "wait", timeout_s=math.inf) for _ in range(8)]
    requests = kind.arrived(daemon, "wait", 8)
    for request in requests:
        request.reply({"id": request.identity})
    assert {call()["id"] for call in calls} == {request.identity for request in requests}


def test_closing_says_so_to_who_waits_and_to_who_comes_later(
    daemon: FakeDaemon, kind: Kind, connection: Connection
) -> None:
    waiting = kind.begin(connection, "call", "wait", timeout_s=math.inf)
    kind.arrived(daemon, "wait")
    connection.close()
    for call in (waiting, partial(connection.call, "state.get")):
        with pytest.raises(ConnectError, match="was closed"):
            call()
    connection.close()


def test_a_daemon_that_ends_is_told_to_all_who_wait_and_to_who_comes_later(
    daemon: FakeDaemon, kind: Kind, connection: Connection
) -> None:
    calls = [kind.begin(connection, "call", "wait") for _ in range(5)]
    requests = kind.arrived(daemon, "wait", 5)
    was_closed, told = connection.closed, set()
    requests[0].hang_up()
    calls.append(partial(connection.call, "state.get"))
    for call in calls:
        with pytest.raises(ConnectError, match="ended the connection") as caught:
            call()
        assert isinstance(caught.value, ConnectionError)
        told.add(id(caught.value))
    assert (was_closed, connection.closed) == (False, True)
    assert len(told) == 6
