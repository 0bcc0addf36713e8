"""JSON-RPC 2.0 lines: read and answered, and what each line may cost."""

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias, TypedDict, cast

from litegrip_client.values import strict_json
from litegripd.model.errors import Refusal
from litegripd.model.sentence import TermViews, terms_of
from litegripd.model.state import STOP_LEVELS, StopLevel

MAX_LINE_BYTES = 16_384
"""64 KiB take 4 ms to parse, more than a tick can spare."""

MAX_CONTAINERS = 512
"""Objects and arrays in one line. Each costs 0.4 µs, so that 16 KiB of `{}` took over 2 ms."""

MAX_ID_CHARACTERS = 128
_USUAL_ID = 2**53  # a shorter line is surely short enough

RequestId: TypeAlias = str | int | None

_MEMBERS = frozenset({"jsonrpc", "id", "method", "params"})

_encoder = json.JSONEncoder(allow_nan=False, separators=(",", ":"))


class _ErrorData(TypedDict):
    reason: str
    retryable: bool


class ErrorData(_ErrorData, total=False):
    """The reason that programs compare; the data of an error has more members for some reasons.

    `terms` are those of the message and of the texts here, for example of `hint`.
    """

    terms: TermViews


class ErrorObject(TypedDict):
    """Why a request was rejected, or a job failed."""

    code: int
    message: str
    data: ErrorData


class Request(NamedTuple):
    """One well-formed request; `identity` is None for a notification."""

    identity: RequestId
    method: str
    params: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class BadRequest:
    """A line that is no request, and the id to answer it with."""

    identity: RequestId
    refusal: Refusal


def parse(line: bytes) -> Request | BadRequest:
    """Read one line. Never raises, for any bytes."""
    if line.count(b"{") + line.count(b"[") > MAX_CONTAINERS:
        text = f"a request has at most {MAX_CONTAINERS} objects, arrays, or braces in its texts"
        return _bad(None, "invalid_request", text)
    try:
        value = strict_json.decode(line.decode("utf-8"))
    except UnicodeDecodeError as error:
        return _bad(None, "parse_error", f"the line is not UTF-8 (byte {error.start})")
    except RecursionError:
        return _bad(None, "parse_error", "the JSON is nested too deep")
    except ValueError as error:
        return _bad(None, "parse_error", f"not valid JSON: {error}")
    if isinstance(value, list):
        return _bad(None, "invalid_request", "batches are not supported: send one request a line")
    if not isinstance(value, dict):
        return _bad(None, "invalid_request", "a request is a JSON object")
    return _request(value)


def _request(value: dict[str, Any]) -> Request | BadRequest:
    identity = value.get("id")
    if not (type(identity) is int and abs(identity) < _USUAL_ID):
        problem = _problem_of_id(identity, is_given="id" in value)
        if problem is not None:
            return _bad(None, "invalid_request", problem)
    if value.get("jsonrpc") != "2.0":
        return _bad(identity, "invalid_request", '"jsonrpc" must be "2.0"')
    method = value.get("method")
    if not isinstance(method, str):
        return _bad(identity, "invalid_request", '"method" must be a string')
    params = value.get("params", {})
    if not isinstance(params, dict):
        return _bad(identity, "invalid_params", "parameters are given by name, in an object")
    if not value.keys() <= _MEMBERS:
        unknown = _names(value.keys() - _MEMBERS)
        return _bad(identity, "invalid_request", f"unknown members: {unknown}")
    return Request(identity, method, params)


def _problem_of_id(identity: object, *, is_given: bool) -> str | None:
    if isinstance(identity, bool) or not isinstance(identity, str | int | None):
        return '"id" must be a string or an integer'
    if len(str(identity)) > MAX_ID_CHARACTERS:
        return f'"id" is longer than {MAX_ID_CHARACTERS} characters'
    if is_given and identity is None:
        return '"id" must not be null'
    return None


def state_asked(line: bytes) -> bytes | None:
    """Return the number of a plain request for the state, as it is written; None for other lines.

    Clients send most of all what this matches; other spellings are read by `parse`.
    """
    asked = _STATE_GET.fullmatch(line)
    return None if asked is None else asked[1]


_STATE_GET = re.compile(rb'\{"jsonrpc":"2\.0","id":(0|[1-9]\d{0,14}),"method":"state\.get"\}')


def result_line(identity: RequestId, result: bytes) -> bytes:
    """Answer request `identity` with `result`, already JSON."""
    return numbered_line(_encoded_id(identity), result)


def numbered_line(identity: bytes, result: bytes) -> bytes:
    """Answer the request whose id is `identity` with `result`, both already JSON."""
    return b'{"jsonrpc":"2.0","id":%b,"result":%b}\n' % (identity, result)


def error_line(identity: RequestId, refusal: Refusal) -> bytes:
    """Answer request `identity` with a refusal."""
    return b'{"jsonrpc":"2.0","id":%b,"error":%b}\n' % (
        _encoded_id(identity),
        encode(error_object(refusal)),
    )


def notification_line(method: str, params: bytes) -> bytes:
    """Return a notification for a subscription; `params` is already JSON."""
    return b'{"jsonrpc":"2.0","method":"%b","params":%b}\n' % (method.encode(), params)


def error_object(refusal: Refusal) -> ErrorObject:
    """Return a refusal's form on the wire."""
    kind = refusal.kind
    data = {"reason": kind.reason, "retryable": kind.retryable, **refusal.data}
    terms = terms_of({"message": refusal.message, **data})
    if terms:
        data["terms"] = terms
    return {"code": kind.code, "message": refusal.message, "data": cast(ErrorData, data)}


def encode(value: object) -> bytes:
    """Return a value as compact JSON; a number that JSON cannot hold (NaN) becomes null."""
    try:
        return _encoder.encode(value).encode()
    except ValueError:
        return _encoder.encode(_without_nan(value)).encode()


def _encoded_id(identity: RequestId) -> bytes:
    # The encoder takes 2 µs for a number, and numbers are what clients use.
    return b"%d" % identity if isinstance(identity, int) else encode(identity)


def _without_nan(value: object) -> object:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _without_nan(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return value


def _bad(identity: RequestId, reason: str, message: str) -> BadRequest:
    return BadRequest(identity, Refusal(reason, message))


def _names(names: set[str]) -> str:
    return ", ".join(sorted(repr(name[:40]) for name in names)[:8])


# Stops --------------------------------------------------------------------------------------------

_LEVELS: Mapping[str, StopLevel] = {level: level for level in STOP_LEVELS}
_WHY_CHARACTERS = 80
_LAST_STOPS = 32
"""At most this many stops of a lost client are read; a client with more can use the stop socket."""


@dataclass(frozen=True, slots=True)
class StopLine:
    """What a line asks for, and the id to answer it with; gateways say on whose behalf."""

    level: StopLevel
    why: str | None = None
    identity: RequestId = None
    on_behalf: str | None = None


def stop_in(line: bytes) -> StopLine:
    """Read a line of the stop socket: a level's bare name, a request `stop`, else a `hold`.

    Never raises, for any bytes. A line that says something else is its own reason; a reason that
    cannot be shown is left out.
    """
    level = _LEVELS.get(line.strip().lower().decode(errors="replace"))
    if level is not None:
        return StopLine(level)
    request = parse(line)
    asked = asked_stop(line)
    if asked is None:
        return StopLine("hold", _shown(line.decode(errors="replace")), request.identity)
    return replace(asked, identity=request.identity)


def asked_stop(line: bytes) -> StopLine | None:
    """Return the stop that a line asks for by its `method`, well-formed or not; None for others.

    An unknown or unreadable level is a `hold`. Never raises.
    """
    if b"stop" not in line and b"\\" not in line:
        return None
    if line.count(b"{") + line.count(b"[") > MAX_CONTAINERS or len(line) > MAX_LINE_BYTES:
        return None  # it would take too long to read
    try:
        value = json.loads(line.decode(errors="replace"))
    except (ValueError, RecursionError):
        return None
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, dict) and one.get("method") == "stop":
            return _stop_of(one.get("params"))
    return None


def stops_in(text: bytes) -> list[bytes]:
    """Return the lines that ask for a stop among those of a lost client.

    Few are read; plainly spelt ones come before those that only may be stops.
    """
    if b"stop" not in text and b"\\" not in text:
        return []
    likely = [line for line in text.split(b"\n") if b'"stop"' in line or b"\\" in line]
    likely.sort(key=lambda line: b'"stop"' not in line)
    return [line for line in likely[:_LAST_STOPS] if asked_stop(line) is not None]


def _stop_of(params: Any) -> StopLine:
    named: Iterable[Any] = params if isinstance(params, list) else ()
    if isinstance(params, dict):
        named = (params.get("level"),)
    levels = [_LEVELS[one] for one in named if isinstance(one, str) and one in _LEVELS]
    level: StopLevel = levels[0] if levels else "hold"
    if not isinstance(params, dict):
        return StopLine(level)
    return StopLine(level, _text(params.get("why")), None, _text(params.get("on_behalf")))


def _text(value: object) -> str | None:
    return _shown(value) if isinstance(value, str) else None


def _shown(text: str) -> str | None:
    """Return a reason as one short line; None if nothing can be shown."""
    text = text.strip()
    return text[:_WHY_CHARACTERS] if text.isprintable() and text else None


# Set-points ---------------------------------------------------------------------------------------

_MARK = b'"stream.set"'
_MOST_BYTES = 512  # longer than a client has reason to write; it is matched in microseconds
_LOOKS = 8  # at most this many lines that only name the method are checked for the newest set-point

_BLANKS = b" \t\r"
_S = rb"[ \t\r]*"
_VALUE = rb'(?:-?\d+(?:\.\d+)?(?:[eE][+-]?\d{1,3})?|"[^"\\\x00-\x1f]*")'
_NAME = (
    rb'"(?:opening_mm|position_rad|openness|valid_s|speed_mm_s|torque_nm|lease|sent_s'
    rb'|stop_generation)"'
)
_MEMBER = _NAME + _S + rb":" + _S + _VALUE + _S
_PARAMS = rb"\{" + _S + rb"(?:" + _MEMBER + rb"(?:," + _S + _MEMBER + rb")*)?\}"
_JSONRPC = rb'"jsonrpc"' + _S + rb":" + _S + rb'"2\.0"'
_METHOD = rb'"method"' + _S + rb":" + _S + _MARK
_ITEM = rb"(?:" + rb"|".join((_JSONRPC, _METHOD, rb'"params"' + _S + rb":" + _S + _PARAMS)) + rb")"
_LINE = re.compile(
    # Three members, and each of the three names: in any order, none is there twice. Blanks around
    # it are stripped before: tried one by one, they would take the square of their number.
    rb"(?=[^\n]*" + _JSONRPC + rb")(?=[^\n]*" + _METHOD + rb')(?=[^\n]*"params")\{'
    + _S + _ITEM + _S + rb"(?:," + _S + _ITEM + _S + rb"){2}\}"
)  # fmt: skip


def is_set_point(line: bytes) -> bool:
    """Return True for a well-formed `stream.set` without an id.

    False for any long or unusually spelt line: such a line is only served one by one.
    """
    if len(line) > _MOST_BYTES or _MARK not in line:
        return False
    return _LINE.fullmatch(line.strip(_BLANKS)) is not None


def newest_set_point(text: bytes, begin: int) -> int:
    """Return where the last whole line from `begin` on starts that is a set-point, or -1."""
    at = text.rfind(_MARK, begin)
    for _ in range(_LOOKS):
        if at < 0:
            break
        start = text.rfind(b"\n", begin, at) + 1 or begin
        end = text.find(b"\n", at)
        if end >= 0 and is_set_point(text[start:end]):
            return start
        at = text.rfind(_MARK, begin, start)
    return -1
