"""JSON by its standard: no NaN, no infinity, and no key twice, which readers treat differently."""

import json
from json import scanner
from typing import Any, NoReturn, cast

from litegrip_client.values.text import cause, text_of


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"an object has the same key twice: {twice!r:.80}")
    return value


_decoder = json.JSONDecoder(parse_constant=_no_constant, object_pairs_hook=_unique)
_scan = scanner.make_scanner(cast(Any, _decoder))


def decode(text: str) -> Any:
    """Return the value; raises `ValueError`, or `RecursionError` for too deep nesting."""
    try:
        value, end = _scan(text, 0)
    except StopIteration:
        return _decoder.decode(text)  # blanks before it, or nothing at all
    except ValueError as error:
        if "digits" in str(error):  # CPython's text is advice for programmers
            raise ValueError("a number has more digits than any number needs") from None
        raise
    return value if end == len(text) else _decoder.decode(text)


def of_file(content: bytes, is_none: str) -> Any:
    """Return the value in a file that a person may have edited.

    Raises `ValueError` with what is wrong, which begins with `is_none` for what is no JSON.
    """
    text = text_of(content)
    try:
        return decode(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{is_none}: {error}{cause(text)}") from error
