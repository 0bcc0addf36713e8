"""What was written to the disk, as the helper process answers it and clients are given it."""

from typing import TypedDict


class Saved(TypedDict):
    """Where a file was written, where the one before is, and the new one's date (Unix time)."""

    path: str
    previous: str | None
    saved_s: float


class Dumped(TypedDict):
    """A file of the flight recorder's, and what is in it."""

    path: str
    ticks: int
    seconds: float
    bytes: int
