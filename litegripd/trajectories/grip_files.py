"""The grips beside whole trajectories in the helper process: checked, and how they are stored.

A file of grips that cannot be used never makes its trajectory unusable: it is reported as a
problem. An upload with such grips is rejected.
"""

import hashlib
import os
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Any

from litegrip_client.errors import TrajectoryFormatError
from litegrip_client.protocol.grips import (
    ENDING,
    MAX_GRIP_BYTES,
    TaughtGrip,
    check_row,
    grips_of,
    pack,
    parse,
    read,
)
from litegrip_client.protocol.lgt import HEADER, SAMPLE
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import FileSystem
from litegripd.trajectories.content import ENDING as LGT_ENDING
from litegripd.trajectories.content import StoreError, open_file


@dataclass(frozen=True, slots=True)
class Grips:
    """The grips beside a trajectory; `problem` says why they cannot be used, or is None."""

    grips: tuple[TaughtGrip, ...] = ()
    whole: bytes = b""
    problem: str | None = None

    def facts(self) -> dict[str, Any]:
        """Return the number of grips, and the problem, if there is one."""
        return {"grips": len(self.grips), "grip_problem": self.problem}

    def rows(self, lgt: bytes) -> list[tuple[Any, ...]]:
        """Return what a replay needs of each grip, with times from the first sample of `lgt`.

        Without the sources the largest number of grips fits into a packet.
        """
        if not self.grips:
            return []
        first_s, _ = _span(lgt)
        moved = (
            replace(
                grip,
                closing_s=grip.closing_s - first_s,
                start_s=grip.start_s - first_s,
                end_s=grip.end_s - first_s,
                source="-",
            )
            for grip in self.grips
        )
        return [astuple(grip) for grip in moved]


def recorded(plain: bytes, lgt: bytes, sha256: str) -> Grips:
    """Return the file of the grips recorded with the trajectory `lgt`; raises `StoreError`."""
    try:
        grips = grips_of(parse(plain))
        return sent(pack(grips, sha256), lgt, sha256)
    except TrajectoryFormatError as error:
        raise _unusable(error) from None


def sent(whole: bytes, lgt: bytes, sha256: str) -> Grips:
    """Check a file that was uploaded with the trajectory `lgt`; raises `StoreError`."""
    try:
        grips = read(whole, sha256)
        if grips:
            check_row(grips, *_span(lgt))
    except TrajectoryFormatError as error:
        raise _unusable(error) from None
    return Grips(grips, whole) if grips else Grips()


def load(path: Path, lgt: bytes, sha256: str) -> Grips:
    """Return the grips beside the file of a checked trajectory."""
    beside = path_beside(path)
    try:
        with open_file(beside) as file:
            whole = file.read(MAX_GRIP_BYTES + 1)
        return sent(whole, lgt, sha256)
    except FileNotFoundError:
        return Grips()
    except OSError as error:
        return Grips(problem=f"{beside}: cannot be read: {error.strerror}")
    except StoreError as error:
        return Grips(problem=f"{beside}: {error}")


def facts_beside(path: Path) -> dict[str, Any]:
    """Return the facts about the grips beside a listed file; it is read only if it exists."""
    if not os.path.lexists(path_beside(path)):
        return Grips().facts()
    try:
        with open_file(path) as file:
            lgt = file.read()
    except (OSError, StoreError) as error:
        return Grips(problem=str(error)).facts()
    return load(path, lgt, hashlib.sha256(lgt).hexdigest()).facts()


def save(path: Path, grips: Grips, file_system: FileSystem) -> None:
    """Write the grips beside a trajectory's file, or remove their file; raises `OSError`."""
    if grips.grips:
        atomic_file.write(path_beside(path), grips.whole, file_system=file_system)
    else:
        remove(path, file_system)


def remove(path: Path, file_system: FileSystem) -> None:
    """Remove the grips beside a trajectory's file, if they exist; raises `OSError`."""
    beside = path_beside(path)
    if os.path.lexists(beside):
        file_system.remove(beside)
        file_system.sync_directory(beside.parent)


def path_beside(path: Path) -> Path:
    """Return the path of the grips of a trajectory's file."""
    return path.with_name(path.name.removesuffix(LGT_ENDING) + ENDING)


def _span(lgt: bytes) -> tuple[float, float]:
    """Return the times of the first and the last sample."""
    if len(lgt) < HEADER.size + SAMPLE.size:
        raise TrajectoryFormatError("a trajectory without samples has no grips")
    first_s, *_ = SAMPLE.unpack_from(lgt, HEADER.size)
    last_s, *_ = SAMPLE.unpack_from(lgt, len(lgt) - SAMPLE.size)
    return first_s, last_s


def _unusable(error: TrajectoryFormatError) -> StoreError:
    return StoreError("trajectory_unreadable", f"no usable grips: {error}")
