"""Trajectories: what was recorded of a gripper's motion, the file format `.lgt`, and its files.

What is stored is the openness, 0 (closed) to 1 (open), so that a trajectory taught on one gripper
replays on another. Files lie in a directory of the user's; the daemon's own store is another one.
"""

from __future__ import annotations

import bisect
import errno
import hashlib
import itertools
import math
import os
import stat
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

from litegrip_client.values import atomic_file
from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.calibration import (
    NOMINAL_CLOSED_RAD,
    NOMINAL_OPEN_RAD,
    NOMINAL_RAD_TO_MM,
)
from litegrip_client.values.checks import number
from litegrip_client.values.errors import (
    CommandError,
    ParameterError,
    TrajectoryFormatError,
    TrajectoryNotFoundError,
)
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.trajectory_format import (
    ENDING,
    GRIP_ENDING,
    HEADER,
    MAX_BYTES,
    MAX_GRIP_BYTES,
    MAX_SAMPLES,
    SAMPLE,
    Header,
    Mount,
    TaughtGrip,
    check_count,
    check_finite,
    check_grips,
    check_length,
    duration_s,
    pack_grips,
    parse_header,
    read_header,
    unpack_grips,
)
from litegrip_client.values.warn import warn

_FIGURES = ("sample_hz", "created", "pos_closed_rad", "pos_open_rad", "rad_to_mm")


class TrajectorySample(NamedTuple):
    """What was measured `t` seconds after the recording's begin; a tuple, for there are many.

    The torque is for diagnosis: it is never replayed.
    """

    t: float
    openness: float
    position_rad: float
    velocity_rad_s: float
    torque_nm: float


@shortened
@dataclass(slots=True)
class Trajectory:
    """A motion of the jaws, and the gripper that it was recorded on.

    `sample_hz` is how often it was sampled, `created` when, as unix time; `mount` is "normal",
    "reverse" or None; `grips` are those that are known, in their order. Raises `CommandError`, with
    the reason in its message, for what no daemon would take: a sample that is not finite, an
    openness outside 0 to 1, time that runs backwards, a travel or scale of nothing, more than
    360 000 samples, a grip outside their time.

    `samples` may be changed afterwards; they are checked again before they are saved or replayed.
    Without arguments it has none, and the geometry of the template of a normal mount.
    """

    samples: Sequence[TrajectorySample] = ()
    sample_hz: float = 100.0
    created: float = field(default_factory=time.time)
    pos_closed_rad: float = NOMINAL_CLOSED_RAD
    pos_open_rad: float = NOMINAL_OPEN_RAD
    rad_to_mm: float = NOMINAL_RAD_TO_MM
    can_id: int = 0x08
    mount: Mount | None = None
    grips: Sequence[TaughtGrip] = ()

    def __post_init__(self) -> None:
        self.samples = _checked(self.samples)
        for name in _FIGURES:
            setattr(self, name, _finite(name, getattr(self, name)))
        for name in ("sample_hz", "rad_to_mm"):
            if getattr(self, name) <= 0.0:
                raise TrajectoryFormatError(f"{name} is {getattr(self, name)}, it must be above 0")
        if self.pos_closed_rad == self.pos_open_rad:
            raise TrajectoryFormatError("zero travel: the closed and the open limit are equal")
        if self.mount not in ("normal", "reverse", None):
            raise TrajectoryFormatError(
                f"unknown mount {self.mount!r:.40}; there are normal, reverse, and none"
            )
        if not isinstance(self.can_id, int) or not 0 <= self.can_id < 2**32:
            raise TrajectoryFormatError(f"can_id is {self.can_id!r:.40}, it must fit into 32 bits")
        span_s = (self.samples[0].t, self.samples[-1].t) if self.samples else (0.0, -math.inf)
        self.grips = tuple(self.grips)
        check_grips(self.grips, *span_s)

    def __len__(self) -> int:
        return len(self.samples)

    def __bool__(self) -> bool:
        return True  # also without samples: it is there

    def __repr__(self) -> str:
        mount = f", mount {self.mount}" if self.mount else ""
        grips = f", {grips_counted(len(self.grips))}" if self.grips else ""
        return f"<Trajectory: {len(self)} samples, {self.duration_s:.2f} s{mount}{grips}>"

    @property
    def duration_s(self) -> float:
        """The time from the first to the last sample: replay starts at the first one's."""
        return self.samples[-1].t - self.samples[0].t if self.samples else 0.0

    @property
    def duration(self) -> float:
        """`duration_s`, by the vendor SDK's name."""
        return self.duration_s

    def openness_at(self, t: float) -> float:
        """Return the openness `t` seconds after the recording's begin, as in `samples`.

        Between two samples it lies on the line between them; before the first and after the last
        it is theirs. Raises `ParameterError` without samples, and for what is no finite number.
        """
        at_s, rows = number("t", t), self.samples
        if not rows:
            raise ParameterError("a trajectory without samples has no openness")
        return openness_between(rows, at_s)

    @property
    def longest_gap_s(self) -> float:
        """The longest time between two samples: more than 1/`sample_hz` where some are missing."""
        return max((b.t - a.t for a, b in itertools.pairwise(self.samples)), default=0.0)

    @property
    def travel_mm(self) -> float:
        """The travel of the gripper that it was recorded on; openness times it is the opening."""
        return abs(self.pos_closed_rad - self.pos_open_rad) * self.rad_to_mm

    def save(self, name: str | os.PathLike[str]) -> str:
        """Write it to `~/.litegrip/trajectories/NAME.lgt`, at once or not at all; return the path.

        LITEGRIP_TRAJ_DIR names another directory; a name with a path separator in it is used as
        written. Grips go into NAME.grip.json beside it. Files that are there are replaced. Raises
        `CommandError`.
        """
        return write_file(name, self.to_bytes(), self.grip_bytes())

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Trajectory:
        """Read what `save` wrote under this name; raises `CommandError` that says what is wrong.

        Grips beside it that cannot be used, or belong to another file, are left out with a warning.
        """
        content = read_file(name)
        try:
            trajectory = cls.from_bytes(content)
        except CommandError as error:
            raise TrajectoryFormatError(f"{path_of(name)}: {error.message}") from None
        try:
            return trajectory.with_grips(content, read_grips(name))
        except CommandError as error:
            beside = path_beside(name)
            warn(f"the grips in {beside} are left out: {error.message}")
            return trajectory

    def with_grips(self, content: bytes, beside: bytes) -> Trajectory:
        """Return it with the grips of the file beside its own `content`, none if that is empty.

        Raises `CommandError` for a file of grips that cannot be used, or belongs to another one.
        """
        if not beside:
            return self
        return replace(self, grips=unpack_grips(beside, _digest(content)))

    def grip_bytes(self) -> bytes:
        """Return the content of the file of its grips, nothing without any."""
        return pack_grips(self.grips, _digest(self.to_bytes())) if self.grips else b""

    def to_bytes(self) -> bytes:
        """Return the file's content, which knows of no grips; raises as the constructor does."""
        samples = _checked(self.samples)
        header = Header(
            samples=len(samples),
            sample_hz=self.sample_hz,
            created_s=self.created,
            closed_rad=self.pos_closed_rad,
            open_rad=self.pos_open_rad,
            rad_to_mm=self.rad_to_mm,
            can_id=self.can_id,
            mount=self.mount,
        )
        return header.pack() + b"".join([SAMPLE.pack(*sample) for sample in samples])

    @classmethod
    def from_bytes(cls, content: bytes) -> Trajectory:
        """Read a file's content; raises `CommandError` with the reason."""
        header = read_header(memoryview(content))
        samples = map(TrajectorySample._make, SAMPLE.iter_unpack(content[HEADER.size :]))
        return cls(
            tuple(samples),
            sample_hz=header.sample_hz,
            created=header.created_s,
            pos_closed_rad=header.closed_rad,
            pos_open_rad=header.open_rad,
            rad_to_mm=header.rad_to_mm,
            can_id=header.can_id,
            mount=header.mount,
        )


class _Row(Protocol):
    """A moment of a motion: `t` in seconds, and the openness then."""

    @property
    def t(self) -> float: ...

    @property
    def openness(self) -> float: ...


def openness_between(rows: Sequence[_Row], t: float) -> float:
    """Return the openness at a time, on the line between two rows; outside them, the end's."""
    after = bisect.bisect_right(rows, t, key=lambda row: row.t)
    if after in (0, len(rows)):
        return rows[0 if after == 0 else -1].openness
    low, high = rows[after - 1], rows[after]
    share = (t - low.t) / (high.t - low.t)
    return low.openness + share * (high.openness - low.openness)


def grips_counted(grips: int) -> str:
    """Return the number of grips in words."""
    return f"{grips} grip" if grips == 1 else f"{grips} grips"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checked(samples: Any) -> list[TrajectorySample]:
    each = "samples are t, openness, position_rad, velocity_rad_s, torque_nm"
    if isinstance(samples, str) or not isinstance(samples, Collection):
        text = f"{each}, not {samples!r:.40}; what was saved is read by Trajectory.load(name)"
        raise TrajectoryFormatError(text)
    check_count(len(samples))
    checked: list[TrajectorySample] = []
    try:
        for sample in samples:
            checked.append(TrajectorySample._make(map(float, sample)))
    except (TypeError, ValueError, OverflowError):
        text = f"{each}; sample {len(checked)} is {sample!r:.80}"
        raise TrajectoryFormatError(text) from None
    last_s = -math.inf
    for place, sample in enumerate(checked):
        check_finite(place, sample)
        if not 0.0 <= sample.openness <= 1.0:
            raise TrajectoryFormatError(
                f"sample {place}: openness is {sample.openness}, it must be 0 to 1"
            )
        if sample.t < last_s:
            text = f"sample {place}: time runs backwards, {last_s} to {sample.t} s"
            raise TrajectoryFormatError(text)
        last_s = sample.t
    return checked


def _finite(name: str, value: Any) -> float:
    try:
        figure = float(value)
    except (TypeError, ValueError, OverflowError):
        figure = math.nan
    if not math.isfinite(figure):
        raise TrajectoryFormatError(f"{name} is {value!r:.40}, it must be a finite number")
    return figure


DIRECTORY_VARIABLE = "LITEGRIP_TRAJ_DIR"

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


def read_file(name: str | os.PathLike[str]) -> bytes:
    """Return a file's content; raises `CommandError`, also for one that is far too long."""
    path = path_of(name)
    try:
        with _open(path) as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _unopened(path, error) from None
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


def write_file(name: str | os.PathLike[str], content: bytes, grips: bytes = b"") -> str:
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
            f"the trajectory cannot be written to {path}: {why_not_written(error, path)}",
            reason="not_saved",
            data={"path": str(path)},
        ) from None
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
        content = read_file(path)
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
        from litegrip_client.values.voices import did_you_mean  # noqa: PLC0415 - an error

        names = [other.name.removesuffix(ENDING) for other in path.parent.glob(f"*{ENDING}")]
        meant = did_you_mean(path.name.removesuffix(ENDING), names)
        text = f"there is no trajectory {path}{meant}"
        return TrajectoryNotFoundError(text, reason="unknown_trajectory")
    return TrajectoryFormatError(f"{path} cannot be read: {error.strerror or error}")
