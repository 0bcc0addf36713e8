"""What the machine of a gripper says of it, read down to each member: it may say anything.

Whatever is wrong with it is said of that gripper alone.
"""

import json
import reprlib
from collections.abc import Callable, Mapping
from typing import Any

from litegrip_client.core.sockets import NOT_REACHED, STOP_LEVELS, is_reached
from litegrip_client.values.figures import plain

_LONGEST_TEXT = 200
_MOST_SILENT = 64
_TEXTS = ("version", "gateway", "verdict", "mode", "owner", "error")


def facts_in(payload: bytes) -> dict[str, Any]:
    """Return what a gateway's answer says of its gripper, see `facts_of`."""
    value = _object_in(payload)
    return {"error": _no_answer(payload)} if value is None else facts_of(value)


def facts_of(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return how a gripper is: what is known of the members below, each of its type.

    `version`, `gateway`, `verdict`, `mode`, `owner` and `error` are printable texts, `age_s` is in
    seconds, `silent` names users, `kept_out` counts how often somebody else had the gateway's id.
    An answer that has one of another type is an `error`.
    """
    facts: dict[str, Any] = {}
    for name in _TEXTS:
        if isinstance(text := value.get(name), str):
            facts[name] = _shown(text)
        elif text is not None:
            return _wrong(name, text)
    for name, (fits, default) in _OTHERS.items():
        if not fits(value.get(name, default)):
            return _wrong(name, value[name])
    if "error" not in facts:
        if not {"version", "verdict", "mode"} <= facts.keys():
            return {"error": "an answer without version, verdict and mode"}
        facts = {"owner": None, **facts, "age_s": value.get("age_s")}
    if "kept_out" in value:
        facts["kept_out"] = value["kept_out"]
    if "silent" in value:
        facts["silent"] = [_shown(user) for user in value["silent"][:_MOST_SILENT]]
    return facts


def _is_age(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return value is None or (is_number and abs(value) < 1e9)  # type: ignore[arg-type] # NaN is not


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < 1_000_000_000


def _are_names(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(one, str) for one in value)


_OTHERS: Mapping[str, tuple[Callable[[object], bool], object]] = {
    "age_s": (_is_age, None),
    "kept_out": (_is_count, 0),
    "silent": (_are_names, []),
}


def stop_problem(payload: bytes) -> str | None:
    """Return why a gripper did not stop; None if its answer says that it did."""
    answer = _object_in(payload)
    if answer is None:
        return _no_answer(payload)
    result, error = answer.get("result"), answer.get("error")
    if error is None and isinstance(result, dict) and result.get("level") in STOP_LEVELS:
        return None if is_reached(result) else f"latched, but {NOT_REACHED}"
    message = error.get("message") if isinstance(error, dict) else None
    return _shown(message) if isinstance(message, str) else _no_answer(payload)


def _object_in(payload: bytes) -> dict[str, Any] | None:
    try:
        value = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    return value if isinstance(value, dict) else None


def _shown(text: str) -> str:
    return plain(text[:_LONGEST_TEXT])


def _wrong(name: str, value: object) -> dict[str, Any]:
    return {"error": f"an answer with a wrong {name}: {plain(reprlib.repr(value))}"}


def _no_answer(payload: bytes) -> str:
    return f"an answer that is none: {payload[:60]!r}"
