"""The daemon's messages, told with the names of another language, a `Voice`.

The daemon says beside a message where it names a method or a parameter: its `terms`. Only there the
voice speaks. All else stays as it came, whatever it looks like: users' reasons, paths, programs. So
does the whole message of an older daemon, which says nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeAlias

Voice: TypeAlias = "Callable[[str | None, str | None, str | None], str | None]"
"""Names what a message names, for its reader; None leaves the daemon's name, not Python's.

Its arguments are a method, a parameter, and the method that was asked. It returns the call that
does the method, with the parameter if one is given; or, for a parameter without a method, the
argument of the call that was asked.
"""


class Called(str):
    """A daemon's method that several calls use, as one of these: its name, and what it calls what.

    Python's voice names both so, where the daemon's message names the method or a parameter.
    """

    __slots__ = ("arguments", "call")

    call: str
    arguments: Mapping[str, str]

    def __new__(cls, method: str, call: str, **arguments: str) -> Called:
        """By a parameter of the method: the argument of the call."""
        made = super().__new__(cls, method)
        made.call, made.arguments = call, arguments
        return made


def told(data: Mapping[str, Any], name: str, voice: Voice, asked: str | None = None) -> str:
    """Return the text `name` of an object that the daemon sent, in the words of a voice.

    `asked` is the method that it answers. At the beginning that is left out: who has typed the call
    knows which one it was.
    """
    return _composed(str(data[name]), terms_of(data, name), voice, asked)


def told_all(data: Mapping[str, Any], name: str, voice: Voice) -> list[str]:
    """Return a list of texts in the words of a voice; empty if there is none."""
    texts = list(map(str, data.get(name, ())))
    terms = terms_of(data, name)
    if len(terms) != len(texts):
        return texts
    return [_composed(text, its, voice, None) for text, its in zip(texts, terms, strict=True)]


def terms_of(data: Mapping[str, Any], name: str) -> list[Any]:
    """Return where the text `name` has names; for a list of texts, that of each."""
    terms = data.get("terms")
    found = terms.get(name) if isinstance(terms, dict) else None
    return found if isinstance(found, list) else []


def methods_in(data: Mapping[str, Any], name: str) -> frozenset[str]:
    """Return the methods that the text `name` names."""
    rows = (term for term in terms_of(data, name) if isinstance(term, dict))
    return frozenset(str(term["method"]) for term in rows if term.get("method"))


def _composed(text: str, terms: object, voice: Voice, asked: str | None) -> str:
    parts, at = [], 0
    try:
        for term in terms if isinstance(terms, list) else ():
            start, end, method = term["start"], term["end"], term["method"]
            if not at <= start < end <= len(text):
                return text
            parts.append(text[at:start])
            if (
                start == 0
                and method is not None
                and method == asked
                and text[end : end + 2] == ": "
            ):
                at = end + 2
                continue
            parts.append(voice(method, term["parameter"], asked) or text[start:end])
            at = end
    except (KeyError, TypeError):  # of a daemon that means something else by it
        return text
    return "".join((*parts, text[at:]))
