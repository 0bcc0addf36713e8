"""Write a file completely or not at all. The caller decides its content and handles errors."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path


def write(target: Path, content: bytes) -> None:
    """Replace the file `target`; create its directory if needed. Raises `OSError`."""
    new = target.with_name(f".{target.name}.{os.getpid()}.{threading.get_ident()}.new")
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
