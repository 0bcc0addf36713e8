"""The files that commands write. In a module of its own, since few commands write one."""

from __future__ import annotations

from pathlib import Path

from litegrip_client.values import atomic_file
from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.errors import CommandError


def refuse_existing(path: str, hint: str) -> None:
    """Raise `CommandError` for a file that exists already."""
    if Path(path).exists():
        raise CommandError(f"{path} exists already", reason="file_exists", data={"hint": hint})


def put_file(path: str, content: bytes) -> None:
    """Write a file, wholly or not at all; raises `CommandError`."""
    try:
        atomic_file.write(Path(path), content, makes_folder=False)
    except OSError as error:
        raise CommandError(
            f"cannot write {path}: {why_not_written(error, path)}",
            reason="file_not_written",
            data={"hint": "choose a directory that you may write to"},
        ) from error
