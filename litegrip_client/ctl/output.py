"""Where `litegripctl` writes and asks: results as text or JSON, a live line, and questions.

Questions go to standard error, so that standard output keeps results only. It must not decide
what is said.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping

from litegrip_client.errors import LiteGripError
from litegrip_client.voices import is_said

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


class OutputLostError(Exception):
    """Standard output takes nothing more: a full disk, for one. The message says why."""


class Output:
    """Standard output and standard error, for a person or (`as_json`) for a program.

    What a person reads goes through `for_gripper`, since no text knows which gripper it is about.
    """

    def __init__(self, *, as_json: bool, for_gripper: Callable[[str], str] = str) -> None:
        self.as_json = as_json
        self.for_gripper = for_gripper
        self.live = sys.stdout.isatty() and not as_json
        """True if a line can be written over."""
        self._open_line = False

    def result(self, data: Mapping[str, Any], text: str) -> None:
        """Print a result: as it came, or as `text`."""
        self.end_line()
        told = json.dumps(data, ensure_ascii=False) if self.as_json else self.for_gripper(text)
        _write(f"{told}\n")

    def line(self, text: str) -> None:
        """Write `text` over the line before, if that was written by this, too."""
        _write(f"\r{text}\x1b[K")
        self._open_line = True

    def erase_line(self) -> None:
        """Take away the line that `line` wrote."""
        if self._open_line:
            _write("\r\x1b[K")
            self._open_line = False

    def end_line(self) -> None:
        """Keep the line that `line` wrote, and continue below it."""
        if self._open_line:
            _write("\n")
            self._open_line = False

    def error(self, error: LiteGripError, hint: str) -> None:
        """Say what went wrong in one line, and what to do in another."""
        self.end_line()
        if self.as_json:
            data = {"reason": error.reason, **error.data}
            if hint:
                data.setdefault("hint", hint)
            told = {"code": error.code, "message": error.message, "data": data}
            _write(f"{json.dumps({'error': told}, ensure_ascii=False)}\n")
        else:
            self.note(error.message)
            if hint and not is_said(error.message, hint):  # many a message has its remedy
                print(f"  {one_line(self.for_gripper(hint))}", file=sys.stderr)

    def note(self, text: str) -> None:
        """Show a person something that is not a result."""
        print(f"litegripctl: {one_line(self.for_gripper(text))}", file=sys.stderr)


def _write(text: str) -> None:
    """Write to standard output; raises `OutputLostError`, and `BrokenPipeError` as it is."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputLostError(error.strerror or str(error)) from error


def one_line(text: str) -> str:
    """Make one printable line of a text that may come from the daemon."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


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
