"""JSON as its standard has it: no NaN, no infinity; and no key twice, on which readers differ."""

import json
from typing import Any, NoReturn


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        raise ValueError("an object has the same key twice")
    return value


_decoder = json.JSONDecoder(parse_constant=_no_constant, object_pairs_hook=_unique)


def decode(text: str) -> Any:
    """Return the value; raises `ValueError`, or `RecursionError` for what is nested too deeply."""
    return _decoder.decode(text)
