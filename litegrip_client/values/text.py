"""Text of a file that a person may have edited, perhaps on another system: what nobody sees in it.

Editors show neither an encoding nor a non-breaking space, and parsers name only the place where
they stop. A UTF-8 mark at the beginning, and CR LF at the ends of lines, mean what they look like,
and are accepted. Everything else that cannot be seen is named, with its place.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from litegrip_client.values.strict_json import decode_file, file_number

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

_INVISIBLE = {
    "\u00a0": "a non-breaking space",
    "\u00ad": "a soft hyphen",
    "\u200b": "a space without width",
    "\u200c": "a joiner without width",
    "\u200d": "a joiner without width",
    "\u200e": "a mark of direction",
    "\u200f": "a mark of direction",
    "\u2007": "a non-breaking space",
    "\u2028": "a separator of lines that is no line end",
    "\u2029": "a separator of lines that is no line end",
    "\u202f": "a non-breaking space",
    "\u2060": "a joiner without width",
    "\u3000": "a wide space",
    "\ufeff": "a mark of the encoding, which belongs at the beginning of a file only",
}
_LOOKALIKES = {
    "\u2018": "a typographic quote",
    "\u2019": "a typographic quote",
    "\u201c": "a typographic quote",
    "\u201d": "a typographic quote",
    "\u201e": "a typographic quote",
    "\u2212": "a typographic minus",
    "\u2013": "a dash",
    "\u2014": "a dash",
}
"""They are seen, but look like what a parser wants in their place."""
_CONTROLS = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


def text_of(content: bytes) -> str:
    """Return the text of a file in UTF-8, without the mark that some editors put first.

    Raises `ValueError` with the encoding that it seems to have, and what to do.
    """
    even, odd = content[:4:2], content[1:4:2]
    is_utf16 = b"\0\0" in (even, odd) and b"\0" not in (even if odd == b"\0\0" else odd)
    if is_utf16 or content.startswith(_UTF16):
        raise ValueError("it is in UTF-16, as editors of another system write it: save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(
            f"byte 0x{content[error.start]:02X} in line {line} is not UTF-8, perhaps an umlaut or"
            " accent in another encoding: save the file as UTF-8"
        ) from error


def toml_of(content: bytes, loads: Callable[..., dict[str, Any]]) -> dict[str, Any]:
    """Return what `tomllib.loads` makes of a file; raises `ValueError` for who wrote it."""
    text = text_of(content)
    try:
        value = loads(text, parse_float=file_number)
    except (ValueError, RecursionError) as error:  # not only by the parser's own class
        long = re.search(r"\d{309,}", text)
        if long is not None and "digits" in str(error):  # CPython's text is for programmers
            line = text.count("\n", 0, long.start()) + 1
            raise ValueError(
                f"line {line} has a number of {len(long[0])} digits: no key takes it"
            ) from error
        raise ValueError(f"not valid TOML: {error}{cause(text)}") from error
    if (sign := hidden(value)) is not None:
        raise ValueError(sign)
    return value


def cause(text: str) -> str:
    """Return a sentence that names what nobody sees in a text that could not be parsed, or "".

    It begins with "; ", and is meant to follow the parser's message.
    """
    if text and not text.strip("\0"):
        return "; it holds nothing but zeros, as after a power failure: restore it"
    for number, line in enumerate(re.split("\r\n|\n", text), 1):
        for sign in line:
            name = _INVISIBLE.get(sign) or _LOOKALIKES.get(sign)
            if name is not None:
                return f"; line {number} has {name} (U+{ord(sign):04X}): write a plain one"
        if (found := _CONTROLS.search(line)) is not None:
            return f"; line {number} has a control character (0x{ord(found[0]):02X}): remove it"
        if "\r" in line:
            return f"; line {number} has a CR without LF: save the file with LF at line ends"
    return ""


def hidden(value: Any, name: str = "") -> str | None:
    """Return which key or text of a parsed value has a sign that cannot be seen, or None."""
    for where, text in _texts(value, name):
        for sign in text:
            if sign in _INVISIBLE:
                shown = text.replace(sign, f"<U+{ord(sign):04X}>")
                return f"{where}: {shown[:60]!r} has {_INVISIBLE[sign]}: write a plain one, or none"
    return None


def _texts(value: Any, name: str) -> Iterator[tuple[str, str]]:
    if isinstance(value, str):
        yield name, value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield name or "key", str(key)
            yield from _texts(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item, name)


def json_of(content: bytes, allowed: Mapping[str, str] | None = None) -> Any:
    """Return the value in a JSON file that a person may have edited.

    Raises `ValueError` as `strict_json.decode_file`, with what nobody sees in the text.
    """
    text = text_of(content)
    try:
        return decode_file(text, allowed)
    except ValueError as error:
        raise ValueError(f"{error}{cause(text)}") from error
