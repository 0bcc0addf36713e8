"""Where trajectories lie on this side: a directory of the user's, names in it, and its listing.

What is in the files is `trajectory`'s. The daemon's own store is another one.
"""

from __future__ import annotations

import errno
import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from litegrip_client import atomic_file
from litegrip_client.errors import (
    CommandError,
    ParameterError,
    TrajectoryFormatError,
    TrajectoryNotFoundError,
)
from litegrip_client.protocol.grips import MAX_GRIP_BYTES
from litegrip_client.protocol.lgt import (
    HEADER,
    MAX_BYTES,
    MAX_SAMPLES,
    check_length,
    duration_s,
    parse_header,
)
from litegrip_client.trajectory import Trajectory, grips_counted

DIRECTORY_VARIABLE = "LITEGRIP_TRAJ_DIR"
ENDING = ".lgt"
GRIP_ENDING = ".grip.json"

DEFAULT_RATE_HZ = 100.0
"""Samples a second of a recording, by the SDK's name."""


@dataclass(frozen=True, slots=True)
class TrajectoryFile:
    """A file of the directory, from its header; as a string it is one line.

    `error` says why it cannot be used, if so; then the figures are 0. The samples themselves are
    not looked at before `Trajectory.load`. `grips` counts those that are kept beside it;
    `grip_problem` says why these cannot be used, if so. `duration_s` is the time from the first to
    the last sample, None where the two are no course of time.
    """

    name: str
    path: str
    samples: int = 0
    sample_hz: float = 0.0
    created: float = 0.0
    mount: str | None = None
    error: str | None = None
    grips: int = 0
    grip_problem: str | None = None
    duration_s: float | None = None

    def __str__(self) -> str:
        if self.error is not None:
            return f"{self.name}: {self.error}"
        seconds = "-" if self.duration_s is None else f"{self.duration_s:.2f}"
        mount = f", mount {self.mount}" if self.mount else ""
        grips = f", {grips_counted(self.grips)}" if self.grips else ""
        return f"{self.name}: {seconds} s, {self.samples} samples{mount}{grips}"


def directory() -> Path:
    """Return where trajectories are kept: LITEGRIP_TRAJ_DIR, else ~/.litegrip/trajectories."""
    named = os.environ.get(DIRECTORY_VARIABLE) or "~/.litegrip/trajectories"
    return _real(named)


def trajectory_dir() -> str:
    """Return the directory of this user's trajectories: `directory` by the SDK's name."""
    return str(directory())


def resolve_path(name: str | os.PathLike[str]) -> str:
    """Return the file that a trajectory's name means: `path_of` by the SDK's name."""
    return str(path_of(name))


def path_of(name: str | os.PathLike[str]) -> Path:
    """Return the file that `name` means; raises `CommandError` for what cannot be a name.

    With a path separator in it, it is used as written.
    """
    text = os.fspath(name) if isinstance(name, str | os.PathLike) else ""
    if not isinstance(text, str) or not text or "\0" in text:
        raise _not_a_name(name, "it must be text, and not empty")
    if os.sep in text:
        return _real(text)
    if text.startswith("."):
        raise _not_a_name(name, "it must not begin with a dot, or be a path")
    return _real(directory() / f"{text.removesuffix(ENDING)}{ENDING}")


def read(name: str | os.PathLike[str]) -> bytes:
    """Return a file's content; raises `CommandError`, also for one that is far too long."""
    path = path_of(name)
    try:
        with _open(path) as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _unopened(path, error) from error
    if len(content) > MAX_BYTES:
        raise TrajectoryFormatError(
            f"{path}: it is larger than {MAX_SAMPLES} samples, {MAX_BYTES} bytes"
        )
    return content


def read_grips(name: str | os.PathLike[str]) -> bytes:
    """Return the content of the file of grips, nothing where there is none."""
    path = path_beside(name)
    try:
        with _open(path) as file:
            return file.read(MAX_GRIP_BYTES + 1)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise TrajectoryFormatError(f"it cannot be read: {error.strerror or error}") from error


def path_beside(name: str | os.PathLike[str]) -> Path:
    """Return the file of grips that goes with what `name` means."""
    path = path_of(name)
    return path.with_name(path.name.removesuffix(ENDING) + GRIP_ENDING)


def write(name: str | os.PathLike[str], content: bytes, grips: bytes = b"") -> str:
    """Write a file at once or not at all, with its directory; return its path.

    Then what is beside it is written, or removed without `grips`. Between the two no grips go with
    the new file, by its digest.
    """
    path = path_of(name)
    try:
        atomic_file.write(path, content)
        if grips:
            atomic_file.write(path_beside(name), grips)
        else:
            path_beside(name).unlink(missing_ok=True)
    except OSError as error:
        raise CommandError(
            f"the trajectory cannot be written to {path}: {error.strerror or error}",
            reason="not_saved",
            data={"path": str(path)},
        ) from error
    return str(path)


def list_trajectories() -> list[TrajectoryFile]:
    """List the files of the directory by name; raises `CommandError` when it cannot be read."""
    found = directory()
    try:
        names = sorted(entry.name for entry in found.iterdir())
    except FileNotFoundError:
        return []
    except OSError as error:
        text = f"the directory {found} cannot be read: {error.strerror or error}"
        raise CommandError(text, reason="trajectory_unreadable") from error
    usable = [name for name in names if name.endswith(ENDING) and not name.startswith(".")]
    return [_entry(found / name) for name in usable]


def _entry(path: Path) -> TrajectoryFile:
    name = path.name.removesuffix(ENDING)
    try:
        with _open(path) as file:
            header = parse_header(memoryview(file.read(HEADER.size)))
            check_length(os.fstat(file.fileno()).st_size, header.samples)
            lasts_s = duration_s(file, header.samples)
    except OSError as error:
        return TrajectoryFile(name, str(path), error=error.strerror or str(error))
    except CommandError as error:
        return TrajectoryFile(name, str(path), error=error.message)
    grips, problem = _grips_beside(path)
    return TrajectoryFile(
        name,
        str(path),
        samples=header.samples,
        sample_hz=header.sample_hz,
        created=header.created_s,
        mount=header.mount,
        grips=grips,
        grip_problem=problem,
        duration_s=lasts_s,
    )


def _grips_beside(path: Path) -> tuple[int, str | None]:
    """Return how many grips go with a file, and why they cannot be used, if so."""
    try:
        beside = read_grips(path)
        if not beside:
            return 0, None
        content = read(path)
        return len(Trajectory.from_bytes(content).with_grips(content, beside).grips), None
    except CommandError as error:
        return 0, error.message


def _open(path: Path) -> BinaryIO:
    """Open a regular file, without waiting for a pipe's other end; raises `OSError`."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no regular file")
    return os.fdopen(descriptor, "rb")


def _real(path: str | Path) -> Path:
    try:
        # Links are resolved, so that a link still points to the new file.
        return Path(path).expanduser().resolve()
    except (OSError, RuntimeError) as error:  # RuntimeError: no home, a loop of links
        raise _not_a_name(path, str(error)) from error


def _not_a_name(name: object, why: str) -> CommandError:
    text = f"{name!r:.80} cannot be a trajectory's name: {why}"
    return ParameterError(text, reason="invalid_params")


def _unopened(path: Path, error: OSError) -> CommandError:
    if isinstance(error, FileNotFoundError):
        text = f"there is no trajectory {path}"
        return TrajectoryNotFoundError(text, reason="unknown_trajectory")
    return TrajectoryFormatError(f"{path} cannot be read: {error.strerror or error}")
