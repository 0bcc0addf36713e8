"""Completion in shells: what may stand where the cursor is, from the parsers of the command line.

The scripts of `scripts` ask this program itself, so that they know nothing of its commands.
"""

from __future__ import annotations

from collections.abc import Sequence

from litegrip_client.ctl.completion.reading import CommandLine
from litegrip_client.ctl.completion.words import FILES, words_of
from litegrip_client.ctl.parser import whole_parser

_NO_FILES = "-"


def complete(words: Sequence[str]) -> list[str]:
    """Return lines for a script; `words` stand behind the program's name, up to the cursor.

    The first line is `files` where paths may stand, too. Each other one is a word that may take the
    place of the last of `words`, and, behind a tab, what it means, if that is known.
    """
    *before, current = words or [""]
    line = CommandLine(whole_parser())
    for word in before:
        line.take(word)
    wanted = line.wanted(current)
    found = [*wanted.words, *words_of(wanted.sources, line.given)]
    rows = [(wanted.front + word, text) for word, text in found]
    lines = [f"{word}\t{text}" for word, text in rows if _fits(word, current)]
    return [FILES if FILES in wanted.sources else _NO_FILES, *lines]


def _fits(word: str, current: str) -> bool:
    """Return True if a word may take the place of `current`; file names may hold line ends."""
    return word.startswith(current) and word.isprintable()
