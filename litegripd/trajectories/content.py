"""Whole trajectories and their grips in the helper process: checked contents, and their files.

An expected refusal is a `StoreError`, with a reason of the error table. A file of grips that cannot
be used never makes its trajectory unusable: it is reported as a problem. An upload with such grips
is rejected.
"""

import base64
import binascii
import errno
import hashlib
import os
import stat
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, BinaryIO

from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.trajectory_format import (
    ENDING,
    GRIP_ENDING,
    HEADER,
    MAX_BYTES,
    MAX_GRIP_BYTES,
    SAMPLE,
    Header,
    TaughtGrip,
    check_grips,
    check_length,
    duration_s,
    grips_of,
    pack_grips,
    parse_grips,
    parse_header,
    unpack_grips,
)
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import FileSystem
from litegripd.model.sentence import sentence
from litegripd.trajectories.values import CSV_HEAD, Summary, csv_line, read


class StoreError(ValueError):
    """Why an operation is not possible: a reason of the error table, a sentence, and figures."""

    def __init__(self, reason: str, message: str, data: Mapping[str, object] | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.reason = reason
        self.data = data or {}


@dataclass(frozen=True, slots=True)
class Content:
    """A whole trajectory that passed all checks, and the facts about it."""

    whole: bytes
    sha256: str
    header: Header
    summary: Summary

    @classmethod
    def of(cls, whole: bytes) -> "Content":
        """Return a trajectory that passes all checks; raises `StoreError` with the reason."""
        try:
            header, summary = read(memoryview(whole))
        except TrajectoryFormatError as error:
            raise StoreError("trajectory_unreadable", f"no usable trajectory: {error}") from None
        return cls(whole, hashlib.sha256(whole).hexdigest(), header, summary)

    def facts(self) -> dict[str, Any]:
        """Return the facts about it, without the samples."""
        known = {"sha256": self.sha256, "total": len(self.whole)}
        return {**known, **asdict(self.header), **asdict(self.summary)}

    def as_csv(self) -> bytes:
        """Return the samples as CSV, below a line of names."""
        samples = SAMPLE.iter_unpack(memoryview(self.whole)[HEADER.size :])
        return (CSV_HEAD + "".join(map(csv_line, samples))).encode()


def open_file(path: Path) -> BinaryIO:
    """Open a trajectory's file for reading: a regular file of a possible size, and no link.

    Raises `OSError`, or `StoreError` for a file that cannot be one.
    """
    # A link could lead anywhere; and opening a pipe must not wait for its other end.
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise StoreError("trajectory_unreadable", f"{path}: it is no regular file")
        if status.st_size > MAX_BYTES:
            text = f"{path}: {status.st_size} bytes, more than the {MAX_BYTES} of the longest one"
            raise StoreError("trajectory_unreadable", text)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def content_of(path: Path, whole: bytes) -> Content:
    """Return the checked content of a file; raises `StoreError` with its path and the reason."""
    try:
        return Content.of(whole)
    except StoreError as error:
        raise StoreError(error.reason, f"{path}: {error}") from None


def entry_of(name: str, path: Path) -> dict[str, Any]:
    """Return a file's header, size and length, or what is wrong; samples are not checked."""
    try:
        with open_file(path) as file:
            size = os.fstat(file.fileno()).st_size
            header = parse_header(memoryview(file.read(HEADER.size)))
            check_length(size, header.samples)
            lasts_s = duration_s(file, header.samples)
    except OSError as error:
        return {"name": name, "error": error.strerror}
    except (StoreError, TrajectoryFormatError) as error:
        return {"name": name, "error": str(error)}
    described = {"samples", "sample_hz", "created_s", "mount"}
    known = {key: value for key, value in asdict(header).items() if key in described}
    return {"name": name, "error": None, "bytes": size, **known, "duration_s": lasts_s}


def unknown(name: str, folder: Path) -> StoreError:
    """Return the error for a name that no trajectory in a folder has."""
    names = [path.name.removesuffix(ENDING) for path in folder.glob(f"*{ENDING}")]
    close = get_close_matches(name, names, 1)
    meant = f"did you mean {close[0]!r}? " if close else ""
    text = sentence(
        "there is no trajectory {name!r}; {meant}{trajectory.list} lists them",
        name=name,
        meant=meant,
    )
    return StoreError("unknown_trajectory", text)


def unopened(name: str, path: Path, error: OSError) -> StoreError:
    """Return the error for a file that cannot be read, or does not exist."""
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return unknown(name, path.parent)
    return StoreError("trajectory_unreadable", f"{path}: cannot be read: {error.strerror}")


def encoded(data: bytes) -> str:
    """Return bytes as base64, for JSON."""
    return base64.b64encode(data).decode("ascii")


def decoded(data: str) -> bytes:
    """Return the bytes of base64; raises `StoreError` for anything else."""
    try:
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError):
        raise StoreError("out_of_limits", "data is no base64") from None


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


def recorded_grips(plain: bytes, lgt: bytes, sha256: str) -> Grips:
    """Return the file of the grips recorded with the trajectory `lgt`; raises `StoreError`."""
    try:
        grips = grips_of(parse_grips(plain))
        return sent_grips(pack_grips(grips, sha256), lgt, sha256)
    except TrajectoryFormatError as error:
        raise _unusable(error) from None


def sent_grips(whole: bytes, lgt: bytes, sha256: str) -> Grips:
    """Check a file that was uploaded with the trajectory `lgt`; raises `StoreError`."""
    try:
        grips = unpack_grips(whole, sha256)
        if grips:
            check_grips(grips, *_span(lgt))
    except TrajectoryFormatError as error:
        raise _unusable(error) from None
    return Grips(grips, whole) if grips else Grips()


def load_grips(path: Path, lgt: bytes, sha256: str) -> Grips:
    """Return the grips beside the file of a checked trajectory."""
    beside = grips_beside(path)
    try:
        with open_file(beside) as file:
            whole = file.read(MAX_GRIP_BYTES + 1)
        return sent_grips(whole, lgt, sha256)
    except FileNotFoundError:
        return Grips()
    except OSError as error:
        return Grips(problem=f"{beside}: cannot be read: {error.strerror}")
    except StoreError as error:
        return Grips(problem=f"{beside}: {error}")


def facts_beside(path: Path) -> dict[str, Any]:
    """Return the facts about the grips beside a listed file; it is read only if it exists."""
    if not os.path.lexists(grips_beside(path)):
        return Grips().facts()
    try:
        with open_file(path) as file:
            lgt = file.read()
    except (OSError, StoreError) as error:
        return Grips(problem=str(error)).facts()
    return load_grips(path, lgt, hashlib.sha256(lgt).hexdigest()).facts()


def save_grips(path: Path, grips: Grips, file_system: FileSystem) -> None:
    """Write the grips beside a trajectory's file, or remove their file; raises `OSError`."""
    if grips.grips:
        atomic_file.write(grips_beside(path), grips.whole, file_system=file_system)
    else:
        remove_grips(path, file_system)


def remove_grips(path: Path, file_system: FileSystem) -> None:
    """Remove the grips beside a trajectory's file, if they exist; raises `OSError`."""
    beside = grips_beside(path)
    if os.path.lexists(beside):
        file_system.remove(beside)
        file_system.sync_directory(beside.parent)


def grips_beside(path: Path) -> Path:
    """Return the path of the grips of a trajectory's file."""
    return path.with_name(path.name.removesuffix(ENDING) + GRIP_ENDING)


def _span(lgt: bytes) -> tuple[float, float]:
    """Return the times of the first and the last sample."""
    if len(lgt) < HEADER.size + SAMPLE.size:
        raise TrajectoryFormatError("a trajectory without samples has no grips")
    first_s, *_ = SAMPLE.unpack_from(lgt, HEADER.size)
    last_s, *_ = SAMPLE.unpack_from(lgt, len(lgt) - SAMPLE.size)
    return first_s, last_s


def _unusable(error: TrajectoryFormatError) -> StoreError:
    return StoreError("trajectory_unreadable", f"no usable grips: {error}")
