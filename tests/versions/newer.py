"""A daemon of a later version, made of this one: what it sends has more than this client knows."""

from collections.abc import Iterable, Iterator
from typing import Any

WORD = "newer"


def with_more(message: dict[str, Any]) -> Iterable[dict[str, Any]]:
    """Add members to every object, kinds of events and of notifications, and values."""
    yield {"jsonrpc": "2.0", "method": "weather", "params": {"subscription": 1, "sun": True}}
    more = _grown(message)
    yield more
    if message.get("method") == "event":
        yield {**more, "params": _unknown_event(more["params"])}


def with_unknown_error(message: dict[str, Any]) -> Iterable[dict[str, Any]]:
    """Let every error be one that this client has never heard of."""
    if "error" in message:
        error = message["error"]
        error = {**error, "code": -32999, "data": {**error["data"], "reason": WORD}}
        message = {**message, "error": error}
    yield message


def _grown(value: Any, name: str = "") -> Any:
    if isinstance(value, list):
        items = [_grown(item) for item in value]
        return list(_with_unknown_events(items)) if name == "events" else items
    if isinstance(value, dict):
        members = {key: _grown(item, key) for key, item in value.items()}
        if isinstance(value.get("seq"), int) and "kind" in value:  # an event: room for another
            members["seq"] *= 2
        kinds = {type(item) for item in value.values()}
        is_table = len(value) > 1 and len(kinds) == 1  # of figures, say: it gets one more of them
        newer = next(iter(members.values())) if is_table else {"inside": [1, None, "text"]}
        return {**members, f"{WORD}_member": newer}
    return f"{WORD}_{value}" if name in ("outcome", "phase") and value is not None else value


def _with_unknown_events(events: list[Any]) -> Iterator[Any]:
    for event in events:
        yield event
        yield _unknown_event(event)


def _unknown_event(event: dict[str, Any]) -> dict[str, Any]:
    return {**event, "seq": event["seq"] + 1, "kind": WORD, "message": "never heard of"}
