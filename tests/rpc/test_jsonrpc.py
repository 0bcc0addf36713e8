"""Strict parsing: every bad line gets one clear error, with its id where it has one."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.app.build import METHODS
from litegripd.model.errors import ERRORS, Refusal
from litegripd.rpc import jsonrpc
from tests.properties import examples
from tests.rpc.raw import Raw, request
from tests.world import World

HEAD = b'"jsonrpc":"2.0","id":7'
BAD_LINES: dict[str, tuple[bytes, object, str]] = {
    "not JSON": (b"open!", None, "parse_error"),
    "cut off": (b"{" + HEAD + b',"method":"state.get"', None, "parse_error"),
    "two texts": (b"{" + HEAD + b',"method":"hello"} {}', None, "parse_error"),
    "duplicate key": (b'{"id":1,"id":2,"jsonrpc":"2.0","method":"hello"}', None, "parse_error"),
    "duplicate parameter": (
        b"{" + HEAD + b',"method":"motion.open","params":{"speed_mm_s":5,"speed_mm_s":50}}',
        None,
        "parse_error",
    ),
    "NaN": (b"{" + HEAD + b',"method":"stop","params":{"sent_s":NaN}}', None, "parse_error"),
    "Infinity": (b"{" + HEAD + b',"method":"stop","params":{"sent_s":-Infinity}}', None, "parse_"),
    "not UTF-8": (b"{" + HEAD + b',"method":"\xff"}', None, "parse_error"),
    "a batch": (b"[{" + HEAD + b',"method":"state.get"}]', None, "invalid_request"),
    "an empty batch": (b"[]", None, "invalid_request"),
    "a number": (b"17", None, "invalid_request"),
    "a nesting bomb": (b"[" * 16384, None, "invalid_request"),
    "a closed nesting bomb": (b"[" * 8192 + b"]" * 8192, None, "invalid_request"),
    "nested objects": (b'{"a":' * 3000 + b"1" + b"}" * 1384, None, "invalid_request"),
    "many objects": (b"[" + b"{}," * 5000 + b"{}]", None, "invalid_request"),
    "no version": (b'{"id":7,"method":"state.get"}', 7, "invalid_request"),
    "a wrong version": (b'{"jsonrpc":"1.0","id":7,"method":"state.get"}', 7, "invalid_request"),
    "id is null": (b'{"jsonrpc":"2.0","id":null,"method":"stop"}', None, "invalid_request"),
    "id is true": (b'{"jsonrpc":"2.0","id":true,"method":"stop"}', None, "invalid_request"),
    "id is a float": (b'{"jsonrpc":"2.0","id":1.0,"method":"stop"}', None, "invalid_request"),
    "id is an object": (b'{"jsonrpc":"2.0","id":{},"method":"stop"}', None, "invalid_request"),
    "id too long": (request("stop", "x" * 129), None, "invalid_request"),
    "id too large": (request("stop", 10**130), None, "invalid_request"),
    "no method": (b"{" + HEAD + b"}", 7, "invalid_request"),
    "method is null": (b"{" + HEAD + b',"method":null}', 7, "invalid_request"),
    "unknown member": (b"{" + HEAD + b',"method":"stop","extra":1}', 7, "invalid_request"),
    "unknown method": (request("motion.fly", 7), 7, "unknown_method"),
    "positional parameters": (b"{" + HEAD + b',"method":"stop","params":[1]}', 7, "invalid_params"),
    "params is null": (b"{" + HEAD + b',"method":"stop","params":null}', 7, "invalid_params"),
    "unknown parameter": (request("stop", 7, speed=1), 7, "invalid_params"),
    "missing parameter": (request("job.get", 7), 7, "invalid_params"),
    "1e999": (b"{" + HEAD + b',"method":"stop","params":{"sent_s":1e999}}', 7, "invalid_params"),
    "400 digits": (request("motion.open", 7, speed_mm_s=10**400), 7, "invalid_params"),
    "a notification": (b'{"jsonrpc":"2.0","method":"motion.open"}', None, "invalid_request"),
}


STOPS_ALL_THE_SAME = {
    "NaN", "Infinity", "id is null", "id is true", "id is a float", "id is an object",
    "id too long", "id too large", "unknown member", "positional parameters", "params is null",
    "unknown parameter", "1e999",
}  # fmt: skip
"""Requests for a stop that are spelt wrongly: nobody may have to spell to stop the jaws."""


@pytest.mark.parametrize("name", BAD_LINES)
def test_a_bad_line_gets_one_clear_error_and_the_session_goes_on(name: str) -> None:
    line, identity, reason = BAD_LINES[name]
    raw = Raw(World().start())
    answer = raw.error(line)
    assert answer["id"] == identity
    error = answer["error"]
    assert error["data"]["reason"].startswith(reason), error
    assert error["code"] == ERRORS[error["data"]["reason"]].code
    assert len(error["message"]) > 10
    assert raw.is_alive()
    assert (raw.world.state.stop is not None) == (name in STOPS_ALL_THE_SAME)


def test_a_notification_moves_nothing() -> None:
    world = World()
    world.enabled()
    raw = Raw(world)
    raw.error(b'{"jsonrpc":"2.0","method":"motion.open"}')
    world.run(0.1)
    assert world.state.mode == "holding"


WRONG_TYPES: tuple[tuple[str, str, object], ...] = (
    ("motion.open", "speed_mm_s", "50"),
    ("motion.open", "speed_mm_s", True),
    ("motion.open", "speed_mm_s", None),
    ("motion.open", "speed_mm_s", [50]),
    ("motion.open", "speed_mm_s", 0.05),
    ("motion.open", "speed_mm_s", -50),
    ("motion.open", "wait", 1),
    ("motion.open", "detach", "yes"),
    ("motor.enable", "retries", 2.0),
    ("motor.enable", "retries", 0),
    ("motor.enable", "retries", 21),
    ("lease.acquire", "on_lost", "explode"),
    ("lease.acquire", "on_lost", ["hold"]),
    ("stop", "level", "Hold"),
    ("stop", "why", "x" * 257),
    ("stop", "why", "a\nforged log line"),
    ("stop", "why", "\ud800"),
    ("hello", "client", "\x1b[2Jcleared"),
    ("state.subscribe", "hz", 0),
    ("state.subscribe", "hz", 201),
    ("state.subscribe", "fields", "position_rad"),
    ("state.subscribe", "fields", ["position_rad", 1]),
    ("state.subscribe", "fields", ["no_such_field"]),
    ("job.get", "job", 0),
    ("job.get", "job", 2**60),
    ("state.get", "stop_generation", -1),
)


@pytest.mark.parametrize(("method", "parameter", "value"), WRONG_TYPES)
def test_a_wrong_value_is_refused_with_its_parameter(
    method: str, parameter: str, value: object
) -> None:
    raw = Raw(World().start())
    error = raw.error(request(method, 3, **{parameter: value}))["error"]
    assert error["data"]["reason"] == "invalid_params"
    assert error["data"]["parameter"] == parameter
    assert parameter in error["message"]
    assert (raw.world.state.stop is not None) == (method == "stop")


@pytest.mark.parametrize("depth", [100, 400, 490])
def test_a_deeply_nested_value_is_refused_without_being_shown(depth: int) -> None:
    raw = Raw(World().start())
    line = b"{" + HEAD + b',"method":"hello","params":{"client":' + b"[" * depth + b"]" * depth
    error = raw.error(line + b"}}")["error"]
    assert error["data"]["reason"] == "invalid_params"
    assert len(error["message"]) < 200


def test_a_refusal_never_breaks_a_line_of_the_log() -> None:
    raw = Raw(World().start())
    for line in (
        b"{" + HEAD + b',"method":"stop","x\\ny":1}',
        request("no\nsuch"),
        request("stop", 1, **{"x\ny": 1}),
        request("hello", 1, client="a\nb"),
    ):
        raw.error(line)
    events = raw.world.service.take_events() + raw.world.service.take_events()
    refused = [event.message for event in events if event.kind == "refused"]
    assert len(refused) == 4
    assert all(message.isprintable() for message in refused)


@pytest.mark.parametrize("identity", [0, -5, 2**70, "", "a-b", "ü\n\u2028"])
def test_the_id_comes_back_as_it_was(identity: object) -> None:
    raw = Raw(World().start())
    (answer,) = raw.send(request("state.get", identity))
    assert answer["id"] == identity


@pytest.mark.parametrize("line", [b'{"jsonrpc":"2.0","id":1,"method":"hello"}\r', b"  %b \t"])
def test_blanks_around_a_request_are_allowed(line: bytes) -> None:
    raw = Raw(World().start())
    (answer,) = raw.send(line.replace(b"%b", request("hello")))
    assert "result" in answer


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=12,
)
NAMES = st.sampled_from([method.name for method in METHODS])
PARAMS = st.dictionaries(
    st.sampled_from(sorted({name for method in METHODS for name in method.declared}))
    | st.text(max_size=5),
    JSON_VALUES | st.integers(-2, 70) | st.sampled_from(["hold", "relax", "disable"]),
    max_size=4,
)
REQUESTS = st.fixed_dictionaries(
    {"jsonrpc": st.just("2.0"), "method": NAMES | st.text(max_size=9)},
    optional={"id": st.integers() | st.text(max_size=5) | JSON_VALUES, "params": PARAMS},
).map(lambda value: json.dumps(value).encode())
LINES = st.binary(min_size=1, max_size=300) | JSON_VALUES.map(lambda v: json.dumps(v).encode())


@examples(150)
@given(LINES)
def test_any_bytes_are_answered_once_and_never_raise(line: bytes) -> None:
    raw = Raw(World())
    line = line.replace(b"\n", b" ")
    (answer,) = raw.send(line)
    assert answer["id"] is None or isinstance(answer["id"], int | str)
    assert ("result" in answer) != ("error" in answer)
    assert answer.get("error", {}).get("code") != -32603


@examples(50)
@given(st.lists(REQUESTS, min_size=1, max_size=6))
def test_any_requests_are_each_answered_once(lines: list[bytes]) -> None:
    world = World().start()
    raw = Raw(world)
    answers: list[dict[str, Any]] = []
    for line in lines:
        answers += raw.send(line)
    world.run_until(lambda: not raw.client.session.unanswered)
    answers = [message for message in answers + raw.take() if "method" not in message]
    requests = [json.loads(line) for line in lines]
    silent = {method.name for method in METHODS if method.may_notify}
    wanted = [one for one in requests if "id" in one or one["method"] not in silent]
    assert len(wanted) <= len(answers) <= len(lines)  # what is no JSON has no readable id
    assert all(answer.get("error", {}).get("code") != -32603 for answer in answers)


def test_what_json_cannot_hold_becomes_null() -> None:
    value = {"a": math.nan, "b": [1.0, math.inf], "c": {"d": (-math.inf, "x", None, True)}}
    assert json.loads(jsonrpc.encode(value)) == {
        "a": None,
        "b": [1.0, None],
        "c": {"d": [None, "x", None, True]},
    }


def test_an_error_object_carries_the_row_of_the_table() -> None:
    error = jsonrpc.error_object(Refusal("busy", "somebody moves", {"job": 3}))
    assert error == {
        "code": -32020,
        "message": "somebody moves",
        "data": {"reason": "busy", "retryable": True, "job": 3},
    }
