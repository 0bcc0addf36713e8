"""Write a file wholly or not at all. What is in it, and what its errors mean, is the caller's."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path


def write(target: Path, content: bytes) -> None:
    """Write `target`, with its directory, in place of what is there; raises `OSError`."""
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
