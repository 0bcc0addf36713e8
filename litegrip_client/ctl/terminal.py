"""Ask the person at the terminal.

Questions go to standard error, so that standard output keeps results only.
"""

from __future__ import annotations

import sys


def may_ask() -> bool:
    """Return True if somebody is there to read a question and to answer it."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()


def say(text: str) -> None:
    """Show a message before the result."""
    print(text, file=sys.stderr, flush=True)


def ask(question: str) -> str | None:
    """Return the answer in lower case, without the spaces around it; None at the end of input."""
    try:
        sys.stderr.write(f"{question} ")
        sys.stderr.flush()
        line = sys.stdin.readline()
    except KeyboardInterrupt:
        say("")
        raise
    if not line:
        say("")
        return None
    return line.strip().lower()


def confirm(question: str) -> bool:
    """Return True if the answer is yes; everything else is no."""
    return ask(f"{question} [y/N]") in ("y", "yes")
