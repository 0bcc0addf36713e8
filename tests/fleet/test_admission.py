"""What a gateway lets through: with its age and its limits, as the daemon reads it, or not."""

import json
from typing import Any

import pytest

from litegrip_fleet.far.admission import MAX_CONTAINERS, RefusedError, asked_lease, passed
from litegrip_fleet.wire.answers import error_object
from litegrip_fleet.wire.daemon_lines import MAX_ID_CHARACTERS, MAX_LINE_BYTES
from litegripd.model.errors import ERRORS
from litegripd.rpc import jsonrpc
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES as DAEMONS_MAX_LINE_BYTES
from litegripd.rpc.jsonrpc import BadRequest, is_set_point, parse

NOW_S = 1000.0
VOIDED = frozenset({"motion.open", "stream.set", "teleop.receive"})


def through(
    line: bytes,
    age_s: float | None = 0.01,
    generation: int | None = 3,
    ttl_s: float = 1.0,
    process: str = "p1",
) -> bytes:
    at_s = None if age_s is None else NOW_S - age_s
    return passed(
        line,
        NOW_S,
        at_s=at_s,
        generation=generation,
        ttl_s=ttl_s,
        voided=VOIDED,
        process=process,
    )


def request(method: str, identity: int | None = 1, **params: Any) -> bytes:
    value: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "params": params}
    if identity is not None:
        value["id"] = identity
    return json.dumps(value).encode() + b"\n"


def params_of(line: bytes) -> dict[str, Any]:
    params: dict[str, Any] = json.loads(line)["params"]
    return params


def refused(line: bytes, age_s: float | None = 0.01) -> bytes:
    with pytest.raises(RefusedError) as caught:
        through(line, age_s)
    return caught.value.answer


def test_a_motion_says_when_it_was_sent_and_of_which_stops_it_knew() -> None:
    params = params_of(through(request("motion.open", speed_mm_s=20)))
    assert params == {"speed_mm_s": 20, "sent_s": NOW_S - 0.01, "stop_generation": 3}


def test_the_clients_own_count_of_stops_stays_and_its_clock_does_not() -> None:
    params = params_of(through(request("motion.open", stop_generation=2, sent_s=5.0)))
    assert params == {"sent_s": NOW_S - 0.01, "stop_generation": 2}


def test_a_portal_that_knows_of_no_stops_says_nothing_about_them() -> None:
    params = params_of(through(request("motion.open"), generation=None))
    assert params == {"sent_s": NOW_S - 0.01}


def test_the_name_of_a_motion_is_that_of_a_process_as_on_one_machine() -> None:
    line = request("motion.open", key="grip")
    first, second = params_of(through(line, process="p1")), params_of(through(line, process="p2"))
    assert first["key"] != second["key"]
    assert first == params_of(through(line, process="p1"))
    assert params_of(through(request("motion.open", key=7)))["key"] == 7  # the daemon's to refuse


def test_what_moves_nothing_passes_as_it_is() -> None:
    for line in (request("state.get"), request("state.get", sent_s=1.0), b'{"id":1}\n', b"x\n"):
        assert through(line, age_s=60.0) == line


@pytest.mark.parametrize(
    ("method", "age_s", "counts"),
    [
        ("motion.open", 0.49, True),
        ("motion.open", 0.51, False),
        ("motion.open", -0.4, True),
        ("motion.open", -0.6, False),
        ("motion.open", None, False),
        ("stream.set", 0.19, True),
        ("stream.set", 0.21, False),
    ],
)
def test_late_is_void(method: str, age_s: float | None, counts: bool) -> None:
    if counts:
        assert params_of(through(request(method), age_s))["sent_s"] <= NOW_S
    else:
        answer = json.loads(refused(request(method), age_s))
        assert (answer["id"], answer["error"]["data"]["reason"]) == (1, "too_late")
        assert "too late" in answer["error"]["message"]
        is_unknown = age_s is None or age_s < 0.0
        assert ("its age is unknown" in answer["error"]["message"]) == is_unknown


def test_a_late_set_point_without_an_id_is_told_as_the_daemon_does() -> None:
    for line, name in (
        (request("stream.set", None, opening_mm=10), "stream.refused"),
        (request("teleop.receive", None, topic="a", payload="00"), "teleop.refused"),
    ):
        told = json.loads(refused(line, 0.3))
        assert told["method"] == name
        assert told["params"]["data"]["reason"] == "too_late"
    assert refused(request("motion.open", None), 5.0) == b""


def test_a_number_that_is_too_large_is_refused_as_the_daemon_would() -> None:
    line = b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"speed_mm_s":1e999}}\n'
    assert json.loads(refused(line))["error"]["data"]["reason"] == "invalid_params"


def test_a_set_point_stays_one_that_the_daemon_reads_quickly() -> None:
    line = through(b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":10}}\n')
    assert is_set_point(line.rstrip(b"\n"))


@pytest.mark.parametrize("method", ["lease.acquire", "lease.take"])
def test_a_lease_has_a_time_to_live(method: str) -> None:
    assert params_of(through(request(method)))["ttl_s"] == 1.0
    assert params_of(through(request(method, ttl_s=0.3)))["ttl_s"] == 0.3
    for ttl_s in (0.29, 5.1, 86_400):
        error = json.loads(refused(request(method, ttl_s=ttl_s)))["error"]
        assert error["data"] == {
            "reason": "invalid_params",
            "retryable": False,
            "parameter": "ttl_s",
        }
        assert "0.3 to 5" in error["message"]


@pytest.mark.parametrize(
    "line",
    [
        b'{"jsonrpc":"2.0","id":1,"method":"state.get","method":"motion.open"}\n',
        b'[{"jsonrpc":"2.0","id":1,"method":"motion.open"}]\n',
        b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":[]}\n',
        b'{"jsonrpc":"2.0","id":1,"method":"motion.open"} x\n',
        b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"speed_mm_s":NaN}}\n',
        b'\xff{"method":"motion.open"}\n',
        b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"x":[%s{}]}}\n' % (b"{}," * 600),
    ],
)
def test_what_passes_unread_is_no_request_for_the_daemon_either(line: bytes) -> None:
    assert through(line, age_s=60.0) == line
    assert isinstance(parse(line.rstrip(b"\n")), BadRequest)


@pytest.mark.parametrize("code", [-32602, -32060, -32061, -32003, -32001, -32000])
def test_errors_are_those_of_the_daemons_table(code: int) -> None:
    error = error_object(code, "x")
    kind = ERRORS[error["data"]["reason"]]
    assert (kind.code, kind.retryable) == (code, error["data"]["retryable"])


def test_lines_may_be_as_long_as_the_daemons_and_hold_as_much() -> None:
    assert MAX_LINE_BYTES == DAEMONS_MAX_LINE_BYTES
    assert (MAX_CONTAINERS, MAX_ID_CHARACTERS) == (
        jsonrpc.MAX_CONTAINERS,
        jsonrpc.MAX_ID_CHARACTERS,
    )


def test_a_line_of_the_longest_length_passes_and_none_becomes_longer() -> None:
    frame = len(request("state.get", text=""))
    longest = request("state.get", text="x" * (MAX_LINE_BYTES + 1 - frame))
    assert through(longest) == longest
    too_long = json.loads(refused(request("state.get", text="x" * (MAX_LINE_BYTES + 2 - frame))))
    assert (too_long["id"], too_long["error"]["data"]["reason"]) == (None, "line_too_long")
    frame = len(request("motion.open", text=""))
    grown = json.loads(refused(request("motion.open", text="x" * (MAX_LINE_BYTES + 1 - frame))))
    assert (grown["id"], grown["error"]["data"]["reason"]) == (1, "line_too_long")


@pytest.mark.parametrize("blank", [b" ", b"\t", b"\r", b"\x0b", b"\x0c", b" \x0c\x0b"])
def test_blanks_that_a_daemon_skips_hide_no_motion(blank: bytes) -> None:
    answer = json.loads(refused(blank + request("motion.open"), age_s=60.0))
    assert (answer["id"], answer["error"]["data"]["reason"]) == (1, "too_late")
    assert params_of(through(blank + request("lease.acquire")))["ttl_s"] == 1.0


def test_a_message_of_two_lines_is_refused_and_a_half_one_is_not_completed_by_the_next() -> None:
    late = request("motion.open")
    for lines in (late + late, b"\n" + late, b"x\n" + late, late + b"\n"):
        answer = json.loads(refused(lines))
        assert (answer["id"], answer["error"]["data"]["reason"]) == (None, "invalid_params")
    half = late[: len(late) // 2]
    assert through(half, age_s=60.0) == half + b"\n"


def test_an_escaped_method_is_that_method() -> None:
    line = request("lease.acquire", ttl_s=2.0).replace(b"lease.", b"\\u006cease.")
    assert params_of(through(line))["ttl_s"] == 2.0
    assert asked_lease(line) == (b'{"jsonrpc":"2.0","id":1,', True)


def test_a_time_to_live_that_no_float_can_hold_is_refused() -> None:
    line = request("lease.acquire", ttl_s=10**400)
    assert json.loads(refused(line))["error"]["data"]["reason"] == "invalid_params"


@pytest.mark.parametrize(
    ("identity", "answered"),
    [
        ("7", 7),
        ('"a"', "a"),
        ('"%s"' % ("x" * 128), "x" * 128),
        ('"%s"' % ("x" * 129), None),
        ("1e999", None),
        ("1.5", None),
        ("true", None),
        ("null", None),
        ("9" * 200, None),
        ('{"stop_generation":9}', None),
    ],
)
def test_a_refusal_has_the_id_that_the_daemon_would_answer_with(
    identity: str, answered: object
) -> None:
    line = b'{"jsonrpc":"2.0","id":%b,"method":"motion.open"}\n' % identity.encode()
    asked = parse(line.rstrip(b"\n"))
    assert asked.identity == answered
    assert json.loads(refused(line, age_s=60.0), parse_constant=pytest.fail)["id"] == answered
