"""Standard output and standard error of `litegripctl`, and what it does when they fail."""

from __future__ import annotations

import io
import os
import sys


class OutputLostError(Exception):
    """Standard output takes nothing more: a full disk, for one. The message says why."""


def write(text: str) -> None:
    """Write to standard output; raises `OutputLostError`, and `BrokenPipeError` as it is."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputLostError(error.strerror or str(error)) from error


def prepare() -> None:
    """Let the streams take any text, and open those that are closed."""
    # Those that are closed (`>&-`) become /dev/null; else a socket would get their number.
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - for good
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without "°" is no reason to fail


def abandon_output() -> None:
    """Drop what is not written yet."""
    # Else the interpreter, when it ends, complains that it cannot write what is left.
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
