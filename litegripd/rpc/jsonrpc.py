"""JSON-RPC 2.0 on one line: strict parsing of requests, and the making of answers.

`json` of the standard library accepts more than JSON (NaN, duplicate keys): rejected here. What
JSON allows but a field does not, for example 1e999, is rejected where the field is checked.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias, TypedDict, cast

from litegrip_client.protocol import strict_json
from litegripd.model.errors import Refusal

MAX_LINE_BYTES = 16_384
"""64 KiB take 4 ms to parse, more than a tick can spare."""

MAX_CONTAINERS = 512
"""Objects and arrays in one line. Each costs 0.4 µs, so that 16 KiB of `{}` took over 2 ms."""

MAX_ID_CHARACTERS = 128
_USUAL_ID = 2**53  # a shorter line is surely short enough

RequestId: TypeAlias = str | int | None

_MEMBERS = frozenset({"jsonrpc", "id", "method", "params"})

_encoder = json.JSONEncoder(allow_nan=False, separators=(",", ":"))


class ErrorData(TypedDict):
    """The reason that programs compare; the data of an error has more members for some reasons."""

    reason: str
    retryable: bool


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


def result_line(identity: RequestId, result: bytes) -> bytes:
    """Answer request `identity` with `result`, already JSON."""
    return b'{"jsonrpc":"2.0","id":%b,"result":%b}\n' % (_encoded_id(identity), result)


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
