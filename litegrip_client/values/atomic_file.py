"""Write a file completely or not at all. The caller decides its content and handles errors."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path


def write(target: Path, content: bytes, *, makes_folder: bool = True) -> None:
    """Replace the file `target`, and create its directory if `makes_folder`; raises `OSError`."""
    new = target.with_name(f".{target.name}.{os.getpid()}.{threading.get_ident()}.new")
    if makes_folder:
        target.parent.mkdir(parents=True, exist_ok=True)
    try:
        with new.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):  # it may never have been made
            new.unlink()
        raise
