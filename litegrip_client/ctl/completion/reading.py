"""Reads a command line that is not finished: what has been given, and what may come next.

Only the parsers are asked. A word that they do not know is passed over.
"""

from __future__ import annotations

from argparse import Action
from collections.abc import Mapping

from litegrip_client.ctl.parser import LateParser, Parser

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

Words: TypeAlias = "list[tuple[str, str]]"
"""What may be written, each with what it means."""


class Wanted:
    """What may come next: `words`, and what the `sources` know; with `front` before all of it."""

    __slots__ = ("front", "sources", "words")

    def __init__(
        self, words: Words | None = None, sources: tuple[str, ...] = (), front: str = ""
    ) -> None:
        self.words = words or []
        self.sources = sources
        self.front = front


class CommandLine:
    """Takes the words before the cursor one by one; `given` has values by their names."""

    def __init__(self, parser: Parser) -> None:
        self.given: dict[str, str] = {}
        self._seen: set[str] = set()
        self._only_plain = False
        self._enter(parser)

    def _enter(self, parser: Parser) -> None:
        """Continue with the parser of a command, or of its action."""
        if isinstance(parser, LateParser):
            parser.become()
        self._parser = parser
        actions = parser.arguments()
        self._options = {name: action for action in actions for name in action.option_strings}
        self._plain = [action for action in actions if not action.option_strings]
        self._open: Action | None = None

    def take(self, word: str) -> None:
        """Take the next word."""
        if self._open is not None:
            self.given[self._open.dest] = word
            self._open = None
        elif word == "--" and not self._only_plain:
            self._only_plain = True
        elif word.startswith("-") and not self._only_plain:
            self._take_option(*word.partition("="))
        elif self._plain:
            self._take_plain(self._plain[0], word)

    def _take_option(self, name: str, equals: str, value: str) -> None:
        action = self._options.get(name)
        if action is None:
            return
        self._seen.add(action.dest)
        if equals:
            self.given[action.dest] = value
        elif action.nargs is None:
            self._open = action

    def _take_plain(self, action: Action, word: str) -> None:
        self.given[action.dest] = word
        if isinstance(action.choices, Mapping):  # of parsers: commands, or actions of one
            self._plain, self._options = [], {}  # nothing goes with a command that is none
            if word in action.choices:
                self._enter(action.choices[word])
        elif action.nargs != "+":
            del self._plain[0]

    def wanted(self, word: str) -> Wanted:
        """Return what may stand in the place of `word`, which is not finished."""
        if self._open is not None:
            return self._values(self._open)
        if word.startswith("-") and not self._only_plain:
            name, equals, _ = word.partition("=")
            if equals:
                action = self._options.get(name)
                return Wanted() if action is None else self._values(action, f"{name}=")
            return Wanted(self._unused_options())
        if self._plain:
            return self._values(self._plain[0])
        return Wanted() if self._only_plain else Wanted(self._unused_options())

    def _values(self, action: Action, front: str = "") -> Wanted:
        if isinstance(action.choices, Mapping):
            # The only place where argparse keeps these texts.
            named = action._get_subactions()  # type: ignore[attr-defined]  # noqa: SLF001
            return Wanted([(one.dest, _text(one)) for one in named])
        sources = tuple(self._parser.words.get(action.dest, "").split())
        return Wanted([(str(choice), "") for choice in action.choices or ()], sources, front)

    def _unused_options(self) -> Words:
        return [
            (name, _text(action))
            for name, action in self._options.items()
            if name.startswith("--") and action.dest not in self._seen
        ]


def _text(action: Action) -> str:
    return (action.help or "").replace("%%", "%")
