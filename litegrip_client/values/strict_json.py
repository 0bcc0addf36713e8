"""JSON by its standard: no NaN, no infinity, and no key twice, which readers treat differently."""

import json
import reprlib
from collections.abc import Iterator, Mapping
from json import scanner
from typing import Any, NoReturn, cast


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


# Files that people write --------------------------------------------------------------------------


class NoNumber(float):
    """What a file has in the place of a number: infinite, or none; shown as it is written."""

    def __new__(cls, text: str) -> "NoNumber":
        """Keep the text."""
        made = super().__new__(cls, text)
        made.text = text
        return made

    text: str

    def __repr__(self) -> str:
        """Return the text."""
        return self.text


def file_number(text: str) -> float:
    """Return a number of a file, for parsers of JSON and of TOML."""
    value = float(text)
    return value if is_finite(value) else NoNumber(text)


def _file_integer(text: str) -> float:
    return int(text) if len(text) <= _MOST_DIGITS else file_number(text)


_MOST_DIGITS = 308
"""Integers of more are, or may be, beyond every float."""
_file_decoder = json.JSONDecoder(
    parse_float=file_number,
    parse_int=_file_integer,
    parse_constant=NoNumber,
    object_pairs_hook=_unique,
)


def decode_file(text: str, allowed: Mapping[str, str] | None = None) -> Any:
    """Return a file's value; raises `ValueError` with a sentence for who wrote it.

    `allowed` says by their keys what numbers must be; a number that is not finite is refused so.
    """
    try:
        value = _file_decoder.decode(text)
        check_numbers(value, allowed)
    except json.JSONDecodeError as error:
        raise ValueError(f"not valid JSON: {error}") from None
    except RecursionError:
        raise ValueError("not valid JSON: it is nested too deep") from None
    return value


def check_numbers(value: Any, allowed: Mapping[str, str] | None = None) -> None:
    """Raise `ValueError` that names a number which is not finite, and what is allowed."""
    for where, number in _numbers(value, ""):
        if not is_finite(number):
            must = (allowed or {}).get(where, "a finite number")
            raise ValueError(f"{where or 'it'} is {reprlib.repr(number)}, it must be {must}")


def is_finite(number: float) -> bool:
    """Return whether a number is one that a float can be."""
    try:
        return number * 0.0 == 0.0
    except OverflowError:  # an integer beyond every float
        return False


def _numbers(value: Any, where: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, int | float):
        yield where, value
    elif isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(item, f"{where}.{key}" if where else str(key))
