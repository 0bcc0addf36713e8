"""Sentences for people that name methods and parameters: what is a name is known, not guessed.

A client that speaks Python, or a shell, puts its own names there. All else in a sentence stays as
it is, whatever it looks like: a user's reason, a path, a program.
"""

from collections.abc import Iterable, Mapping
from functools import cache
from string import Formatter
from typing import Any, NamedTuple, TypeAlias, TypedDict, TypeGuard, cast


class Term(NamedTuple):
    """A name in a sentence: its place, and what it names.

    That is a method; or a method to be called with a parameter; or, without a method, a parameter
    of the method that the sentence answers.
    """

    start: int
    end: int
    method: str | None
    parameter: str | None


class Sentence(str):
    """A text that knows its terms; made by `sentence`, and for everybody else a text."""

    __slots__ = ("terms",)
    terms: tuple[Term, ...]

    def __new__(cls, text: str, terms: Iterable[Term] = ()) -> "Sentence":
        """Make a text with its terms."""
        made = super().__new__(cls, text)
        made.terms = tuple(terms)
        return made


def sentence(template: str, /, **values: object) -> Sentence:
    """Return a sentence of a template, which is always written out where it is used.

    A gap is a term if it has a dot: `{motor.enable}`, `{calibration.zero with a mount}` (of which
    the last word is the parameter), `{.force_n}` (of the method that the sentence answers). Other
    gaps are for `values`, as with `str.format`. Nothing in a value is read as a gap; if one is a
    sentence itself, its terms stay.
    """
    parts: list[str] = []
    for literal, named, name, form, conversion in _gaps(template):
        parts.append(literal)
        if named is not None:
            parts.append(named)
        elif name is None:
            continue
        elif isinstance(value := values[name], str) and not (form or conversion):
            parts.append(value)
        else:
            parts.append(format(repr(value) if conversion else value, form))
    return joined("", parts)


def joined(between: str, texts: Iterable[str]) -> Sentence:
    """Return texts in a row, as `str.join`; their terms stay."""
    row, terms, at = list(texts), list[Term](), 0
    for text in row:
        if isinstance(text, Sentence):
            terms += [Term(at + start, at + end, *name) for start, end, *name in text.terms]
        at += len(text) + len(between)
    return Sentence(between.join(row), terms)


def method_name(name: str) -> Sentence:
    """Return the name of a method."""
    return Sentence(name, [Term(0, len(name), name, None)])


def parameter_name(name: str) -> Sentence:
    """Return the name of a parameter of the method that the sentence answers."""
    return Sentence(name, [Term(0, len(name), None, name)])


def with_plain_start(text: str) -> Sentence:
    """Return a text that begins with the method's own name, if it begins with that of a method.

    So it says what was called, to readers of all kinds; names further on say what to do.
    """
    terms = text.terms if isinstance(text, Sentence) else ()
    return Sentence(text, [term for term in terms if term.start or term.method is None])


@cache
def _gaps(template: str) -> tuple[tuple[str, Sentence | None, str | None, str, str | None], ...]:
    """Return the texts of a template, and behind each a term or what is to be filled in."""
    return tuple(
        (literal, _named(name) if name and "." in name else None, name, form or "", conversion)
        for literal, name, form, conversion in Formatter().parse(template)
    )


def _named(name: str) -> Sentence:
    if name.startswith("."):
        return parameter_name(name[1:])
    called, _, with_what = name.partition(" with ")
    last = with_what.rpartition(" ")[2] or None
    return Sentence(name, [Term(0, len(name), called, last)])


# On the wire --------------------------------------------------------------------------------------


class TermView(TypedDict):
    """A name in a text, from character `start` to before `end`.

    It names `method`; with `parameter`, a call with that parameter; with it alone, a parameter of
    the method that was asked.
    """

    start: int
    end: int
    method: str | None
    parameter: str | None


TermViews: TypeAlias = dict[str, list[TermView] | list[list[TermView]]]
"""By the name of a member beside it, which is a text or a list of texts: its terms."""


def with_terms(members: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object's members, and the terms of its texts if they have any."""
    terms = terms_of(members)
    return {**members, "terms": terms} if terms else dict(members)


def terms_of(members: Mapping[str, Any]) -> TermViews:
    """Return the terms of an object's texts."""
    terms: TermViews = {}
    for name, value in members.items():
        if _has_terms(value):
            terms[name] = _views(value)
        elif isinstance(value, list) and any(map(_has_terms, value)):
            terms[name] = [_views(text) if _has_terms(text) else [] for text in value]
    return terms


def _has_terms(text: object) -> TypeGuard[Sentence]:
    return isinstance(text, Sentence) and bool(text.terms)


def _views(text: Sentence) -> list[TermView]:
    return [cast(TermView, term._asdict()) for term in text.terms]


def read_sentence(text: str, terms: object) -> Sentence:
    """Return a sentence that came from another process of the daemon, with its terms if it has."""
    rows = terms if isinstance(terms, list) else []
    return Sentence(text, [Term(**row) for row in rows])
