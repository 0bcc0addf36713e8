"""Files on this side: calibrations, sent and received as contents, and copies of dumps.

What a content must hold is the daemon's to say.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from collections.abc import Mapping
    from typing import Any


def read(path: str) -> dict[str, Any]:
    """Read a calibration file; raises `CommandError` when it is no JSON object."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise _unreadable(path, getattr(error, "strerror", None) or str(error)) from error
    try:
        content = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
        raise _unreadable(path, f"not valid JSON: {error}") from error
    if not isinstance(content, dict):
        raise _unreadable(path, "not a JSON object")
    return content


def write(path: str, content: Mapping[str, Any], *, overwrite: bool) -> None:
    """Write a calibration file, wholly or not at all; raises `CommandError`."""
    if not overwrite:
        refuse_existing(path, "take another name, or replace it with: --overwrite")
    put(path, (json.dumps(content, indent=2) + "\n").encode())


def refuse_existing(path: str, hint: str) -> None:
    """Raise `CommandError` for a file that exists already."""
    if Path(path).exists():
        raise CommandError(f"{path} exists already", reason="file_exists", data={"hint": hint})


def put(path: str, content: bytes) -> None:
    """Write a file, wholly or not at all; raises `CommandError`."""
    beside = Path(f"{path}.{os.getpid()}.new")
    try:
        try:
            beside.write_bytes(content)
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise CommandError(
            f"cannot write {path}: {error.strerror}",
            reason="file_not_written",
            data={"hint": "choose a directory that you may write to"},
        ) from error


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _unreadable(path: str, why: str) -> CommandError:
    return CommandError(
        f"cannot load {path}: {why}",
        reason="calibration_unreadable",
        data={"hint": "give a calibration file, or a template: normal, reverse"},
    )
