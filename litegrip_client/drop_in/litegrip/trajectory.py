"""Trajectories: a motion of the jaws, its file `.lgt`, and where such files lie."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from litegrip_client.values import atomic_file, errors
from litegrip_client.values import trajectory as ours
from litegrip_client.values.trajectory_format import ENDING, HEADER, LGT_VERSION, MAGIC, SAMPLE

from ._refused import Refused
from .exceptions import LiteGripError

__all__ = [
    "DEFAULT_RATE_HZ",
    "Trajectory",
    "TrajectoryBusyError",
    "TrajectoryEmptyError",
    "TrajectoryError",
    "TrajectoryFormatError",
    "TrajectoryNotActiveError",
    "TrajectoryPlayer",
    "TrajectoryRecorder",
    "TrajectoryRecordingError",
    "TrajectorySample",
    "trajectory_dir",
]

DEFAULT_RATE_HZ = 100.0

_DIRECTORY_VARIABLE = "LITEGRIP_TRAJ_DIR"
_MOUNT_BYTES = 8


class TrajectoryError(LiteGripError):
    """A trajectory cannot be recorded, replayed, read or written."""


class TrajectoryBusyError(TrajectoryError):
    """Another session runs on this gripper."""


class TrajectoryNotActiveError(TrajectoryError):
    """Nothing is being recorded."""


class TrajectoryEmptyError(TrajectoryError):
    """A trajectory has no samples."""


class TrajectoryRecordingError(TrajectoryError):
    """A recording broke off, or did not fill."""


class TrajectoryFormatError(TrajectoryError):
    """A file is no trajectory that can be used."""


@dataclass(frozen=True)
class TrajectorySample:
    """What was measured `t` seconds after the begin: openness 0 to 1, rad, rad/s, N·m."""

    t: float
    openness: float
    position_rad: float
    velocity_rad_s: float = 0.0
    torque_nm: float = 0.0


@dataclass
class Trajectory:
    """A motion of the jaws, and the gripper on which it was recorded; `created` is Unix time."""

    samples: list[TrajectorySample] = field(default_factory=list)
    sample_hz: float = DEFAULT_RATE_HZ
    created: float = field(default_factory=time.time)
    can_id: int = 0x08
    pos_closed_rad: float = 0.0
    pos_open_rad: float = 0.0
    rad_to_mm: float = 0.0
    mount: str | None = None

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def duration(self) -> float:
        """The time from the first to the last sample, s; 0.0 for fewer than two."""
        return self.samples[-1].t - self.samples[0].t if len(self.samples) > 1 else 0.0

    def openness_at(self, t: float) -> float:
        """Return the openness at a time, on the line between two samples, or the end's.

        Raises `TrajectoryEmptyError` without samples.
        """
        rows = self.samples
        if not rows:
            raise TrajectoryEmptyError("a trajectory without samples has no openness")
        return ours.openness_between(rows, t)

    def to_bytes(self) -> bytes:
        """Return a file's content; raises `TrajectoryError` for a mount that does not fit."""
        mount = (self.mount or "").encode()
        if len(mount) > _MOUNT_BYTES:
            raise TrajectoryError(f"mount is {self.mount!r}: more than {_MOUNT_BYTES} bytes")
        header = HEADER.pack(
            MAGIC,
            LGT_VERSION,
            len(self.samples),
            self.sample_hz,
            self.created,
            self.pos_closed_rad,
            self.pos_open_rad,
            self.rad_to_mm,
            self.can_id,
            mount,
        )
        rows = [
            SAMPLE.pack(row.t, row.openness, row.position_rad, row.velocity_rad_s, row.torque_nm)
            for row in self.samples
        ]
        return header + b"".join(rows)

    @classmethod
    def from_bytes(cls, blob: bytes) -> Trajectory:
        """Read a file's content; raises `TrajectoryFormatError` with the reason."""
        try:
            return cls._of(ours.Trajectory.from_bytes(blob))
        except errors.CommandError as error:
            raise TrajectoryFormatError(error.message) from None

    @classmethod
    def _of(cls, known: ours.Trajectory) -> Trajectory:
        """Return what `litegrip_client` has, without its taught grips."""
        return cls(
            [TrajectorySample(*row) for row in known.samples],
            sample_hz=known.sample_hz,
            created=known.created,
            can_id=known.can_id,
            pos_closed_rad=known.pos_closed_rad,
            pos_open_rad=known.pos_open_rad,
            rad_to_mm=known.rad_to_mm,
            mount=known.mount,
        )

    def save(self, path: str | os.PathLike[str]) -> str:
        """Write a file, at once or not at all; return its path. See `resolve_path`."""
        target = resolve_path(path)
        atomic_file.write(Path(target), self.to_bytes())
        return target

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Read a file (`resolve_path`); raises `FileNotFoundError`, `TrajectoryFormatError`."""
        found = resolve_path(path)
        with open(found, "rb") as file:
            return cls.from_bytes(file.read())


def trajectory_dir() -> str:
    """Return the directory of this user's trajectories."""
    return os.environ.get(_DIRECTORY_VARIABLE) or os.path.expanduser("~/.litegrip/trajectories")


def resolve_path(path: str | os.PathLike[str]) -> str:
    """Return the file that a name means; with a separator in it, it is a path as written."""
    text = os.fspath(path)
    if os.sep in text:
        return text
    return os.path.join(trajectory_dir(), text if text.endswith(ENDING) else text + ENDING)


class TrajectoryRecorder(Refused):
    """The SDK's recording loop, which is the daemon's."""

    _INSTEAD: ClassVar[Mapping[str, str]] = {
        "start": "LiteGrip.record_start()",
        "stop": "LiteGrip.record_stop()",
        "wait_for": "LiteGrip.record(duration_s)",
        "result": "LiteGrip.record_stop()",
        "status": "LiteGrip.trajectory_status()",
        "is_recording": "LiteGrip.session",
        "sample_count": "LiteGrip.trajectory_status()",
    }

    def __init__(self, gripper: Any, *_more: Any, **_keywords: Any) -> None:
        super().__init__()
        self.gripper = gripper


class TrajectoryPlayer(Refused):
    """The SDK's replay loop, which is the daemon's."""

    _INSTEAD: ClassVar[Mapping[str, str]] = {
        "start": "LiteGrip.play_start(trajectory)",
        "stop": "LiteGrip.play_stop()",
        "wait": "LiteGrip.play(trajectory)",
        "status": "LiteGrip.trajectory_status()",
        "is_playing": "LiteGrip.session",
        "is_finished": "LiteGrip.trajectory_status()",
    }

    def __init__(self, gripper: Any, trajectory: Any, *_more: Any, **_keywords: Any) -> None:
        super().__init__()
        self.gripper, self.trajectory = gripper, trajectory
