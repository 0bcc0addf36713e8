"""Trajectories: what was recorded of a gripper's motion, and the file format `.lgt` to the bit.

What is stored is the openness, 0 (closed) to 1 (open), so that a trajectory taught on one gripper
replays on another. This module must not know the daemon, nor where files lie: `trajectory_files`.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from litegrip_client import taught_grips
from litegrip_client.errors import CommandError
from litegrip_client.taught_grips import TaughtGrip
from litegrip_client.warn import warn

MAGIC = b"LGRTRJ01"
VERSION = 1
HEADER = struct.Struct("<8sHI5dI8s")
SAMPLE = struct.Struct("<5d")
MAX_SAMPLES = 360_000
"""As many as a daemon takes: 30 minutes at 200 Hz, 14.4 MB."""

_FIGURES = ("sample_hz", "created", "pos_closed_rad", "pos_open_rad", "rad_to_mm")
"""The header's, in its order."""

_MOUNTS: dict[bytes, str | None] = {b"normal": "normal", b"reverse": "reverse", b"": None}


class TrajectorySample(NamedTuple):
    """What was measured `t` seconds after the recording's begin; a tuple, for there are many.

    The torque is for diagnosis: it is never replayed.
    """

    t: float
    openness: float
    position_rad: float
    velocity_rad_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A motion of the jaws, and the gripper that it was recorded on.

    `sample_hz` is how often it was sampled, `created` when, as unix time; `mount` is "normal",
    "reverse" or None; `grips` are those that are known, in their order. Raises `CommandError`, with
    the reason in its message, for what no daemon would take: a sample that is not finite, an
    openness outside 0 to 1, time that runs backwards, a travel or scale of nothing, more than
    360 000 samples, a grip outside their time.
    """

    samples: Sequence[TrajectorySample]
    sample_hz: float
    created: float
    pos_closed_rad: float
    pos_open_rad: float
    rad_to_mm: float
    can_id: int = 0x08
    mount: str | None = None
    grips: Sequence[TaughtGrip] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "samples", _checked(self.samples))
        for name in _FIGURES:
            object.__setattr__(self, name, _finite(name, getattr(self, name)))
        for name in ("sample_hz", "rad_to_mm"):
            if getattr(self, name) <= 0.0:
                raise unusable(f"{name} is {getattr(self, name)}, it must be above 0")
        if self.pos_closed_rad == self.pos_open_rad:
            raise unusable("zero travel: the closed and the open limit are equal")
        if self.mount not in _MOUNTS.values():
            raise unusable(f"unknown mount {self.mount!r:.40}; there are normal, reverse, and none")
        if not isinstance(self.can_id, int) or not 0 <= self.can_id < 2**32:
            raise unusable(f"can_id is {self.can_id!r:.40}, it must fit into 32 bits")
        span_s = (self.samples[0].t, self.samples[-1].t) if self.samples else (0.0, -math.inf)
        object.__setattr__(self, "grips", taught_grips.checked(self.grips, *span_s))

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
        from litegrip_client import trajectory_files  # noqa: PLC0415 - which imports this module

        return trajectory_files.write(name, self.to_bytes(), self.grip_bytes())

    @classmethod
    def load(cls, name: str | os.PathLike[str]) -> Trajectory:
        """Read what `save` wrote under this name; raises `CommandError` that says what is wrong.

        Grips beside it that cannot be used, or belong to another file, are none, with a warning.
        """
        from litegrip_client import trajectory_files  # noqa: PLC0415 - which imports this module

        content = trajectory_files.read(name)
        try:
            trajectory = cls.from_bytes(content)
        except CommandError as error:
            raise unusable(f"{trajectory_files.path_of(name)}: {error.message}") from error
        try:
            return trajectory.with_grips(content, trajectory_files.read_grips(name))
        except CommandError as error:
            beside = trajectory_files.path_beside(name)
            warn(f"the grips in {beside} are left out: {error.message}")
            return trajectory

    def with_grips(self, content: bytes, beside: bytes) -> Trajectory:
        """Return it with the grips of the file beside its own `content`, none if that is empty.

        Raises `CommandError` for a file of grips that cannot be used, or belongs to another one.
        """
        if not beside:
            return self
        return replace(self, grips=taught_grips.read(beside, _digest(content)))

    def grip_bytes(self) -> bytes:
        """Return the content of the file of its grips, nothing without any."""
        return taught_grips.pack(self.grips, _digest(self.to_bytes())) if self.grips else b""

    def to_bytes(self) -> bytes:
        """Return the file's content, which knows of no grips."""
        mount = (self.mount or "").encode()
        figures = [getattr(self, name) for name in _FIGURES]
        head = HEADER.pack(MAGIC, VERSION, len(self), *figures, self.can_id, mount)
        return head + b"".join([SAMPLE.pack(*sample) for sample in self.samples])

    @classmethod
    def from_bytes(cls, content: bytes) -> Trajectory:
        """Read a file's content; raises `CommandError` with the reason."""
        header = read_header(content)
        count = header.pop("count")
        check_length(len(content), count)
        samples = map(TrajectorySample._make, SAMPLE.iter_unpack(content[HEADER.size :]))
        return cls(tuple(samples), **header)


def grips_counted(grips: int) -> str:
    """Count grips in words."""
    return f"{grips} grip" if grips == 1 else f"{grips} grips"


def read_header(content: bytes) -> dict[str, Any]:
    """Read what the header says, whatever follows it: `count`, and fields of `Trajectory`.

    Raises `CommandError` for what is no header; what its figures may be is checked by `Trajectory`.
    """
    if len(content) < HEADER.size:
        text = f"{len(content)} bytes are too few for a header, which has {HEADER.size}"
        raise unusable(text)
    magic, version, count, *figures, can_id, padded = HEADER.unpack_from(content)
    if magic != MAGIC:
        raise unusable(f"it begins with {magic!r} and not with {MAGIC!r}: no .lgt file")
    if version != VERSION:
        raise unusable(f"version {version}, only version {VERSION} can be read")
    mount = padded.rstrip(b"\0")
    if mount not in _MOUNTS:
        raise unusable(f"unknown mount {mount!r}; there are normal, reverse, and none")
    named = dict(zip(_FIGURES, figures, strict=True))
    return {"count": count, **named, "can_id": can_id, "mount": _MOUNTS[mount]}


def check_length(length: int, count: int) -> None:
    """Raise `CommandError` for a file whose length does not match its sample count."""
    _check_count(count)
    expected = HEADER.size + count * SAMPLE.size
    if length != expected:
        raise unusable(
            f"{length} bytes, but {count} samples make {expected}: it is cut off or something"
            " was added"
        )


def unusable(text: str) -> CommandError:
    """Return the error for a trajectory that cannot be used."""
    return CommandError(text, reason="trajectory_unreadable")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _check_count(count: int) -> None:
    if count > MAX_SAMPLES:
        raise unusable(f"{count} samples, at most {MAX_SAMPLES} are allowed")


def _checked(samples: Any) -> tuple[TrajectorySample, ...]:
    try:
        _check_count(len(samples))
        checked = tuple(TrajectorySample._make(map(float, sample)) for sample in samples)
    except (TypeError, ValueError, OverflowError) as error:
        text = f"samples are t, openness, position_rad, velocity_rad_s, torque_nm: {error}"
        raise unusable(text) from error
    last_s = -math.inf
    for number, sample in enumerate(checked):
        if not all(map(math.isfinite, sample)):
            raise unusable(f"sample {number} has a value that is not finite")
        if not 0.0 <= sample.openness <= 1.0:
            raise unusable(f"sample {number}: openness is {sample.openness}, it must be 0 to 1")
        if sample.t < last_s:
            text = f"sample {number}: time runs backwards, {last_s} to {sample.t} s"
            raise unusable(text)
        last_s = sample.t
    return checked


def _finite(name: str, value: Any) -> float:
    try:
        figure = float(value)
    except (TypeError, ValueError, OverflowError):
        figure = math.nan
    if not math.isfinite(figure):
        raise unusable(f"{name} is {value!r:.40}, it must be a finite number")
    return figure
