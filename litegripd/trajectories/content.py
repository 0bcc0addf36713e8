"""Whole trajectories in the helper process: checked contents, and how their files are opened.

An expected refusal is a `StoreError`, with a reason of the error table.
"""

import base64
import binascii
import errno
import hashlib
import os
import stat
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO

from litegrip_client.errors import TrajectoryFormatError
from litegrip_client.protocol.lgt import (
    HEADER,
    MAX_BYTES,
    SAMPLE,
    Header,
    check_length,
    duration_s,
    parse_header,
)
from litegripd.trajectories.values import CSV_HEAD, Summary, csv_line, read

ENDING = ".lgt"


class StoreError(ValueError):
    """Why an operation is not possible: a reason of the error table, a sentence, and figures."""

    def __init__(self, reason: str, message: str, data: Mapping[str, object] | None = None) -> None:
        super().__init__(message)
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
        _check_file(path, os.fstat(descriptor))
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


def unknown(name: str) -> StoreError:
    """Return the error for a name that no trajectory has."""
    text = f"there is no trajectory {name!r}; trajectory.list lists them"
    return StoreError("unknown_trajectory", text)


def unopened(name: str, path: Path, error: OSError) -> StoreError:
    """Return the error for a file that cannot be read, or does not exist."""
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return unknown(name)
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


def _check_file(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise StoreError("trajectory_unreadable", f"{path}: it is no regular file")
    if status.st_size > MAX_BYTES:
        text = f"{path}: {status.st_size} bytes, more than the {MAX_BYTES} of the longest one"
        raise StoreError("trajectory_unreadable", text)
