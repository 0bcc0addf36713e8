"""Trajectories: what was recorded of a gripper's motion, and the file format `.lgt` to the bit.

What is stored is the openness, 0 (closed) to 1 (open), so that a trajectory taught on one gripper
replays on another. This module must not know the daemon, nor where files lie: `trajectory_files`.
"""

from __future__ import annotations

import bisect
import hashlib
import itertools
import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from litegrip_client.calibration import NOMINAL_CLOSED_RAD, NOMINAL_OPEN_RAD, NOMINAL_RAD_TO_MM
from litegrip_client.checks import number
from litegrip_client.errors import CommandError, ParameterError, TrajectoryFormatError
from litegrip_client.protocol import grips as grip_file
from litegrip_client.protocol.grips import TaughtGrip
from litegrip_client.protocol.lgt import HEADER, SAMPLE, Header, Mount, check_count, read_header
from litegrip_client.warn import warn

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
        grip_file.check_row(self.grips, *span_s)

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
        after = bisect.bisect_right(rows, at_s, key=lambda row: row.t)
        if after in (0, len(rows)):
            return rows[0 if after == 0 else -1].openness
        low, high = rows[after - 1], rows[after]
        share = (at_s - low.t) / (high.t - low.t)
        return low.openness + share * (high.openness - low.openness)

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
            raise TrajectoryFormatError(
                f"{trajectory_files.path_of(name)}: {error.message}"
            ) from error
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
        return replace(self, grips=grip_file.read(beside, _digest(content)))

    def grip_bytes(self) -> bytes:
        """Return the content of the file of its grips, nothing without any."""
        return grip_file.pack(self.grips, _digest(self.to_bytes())) if self.grips else b""

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


def grips_counted(grips: int) -> str:
    """Count grips in words."""
    return f"{grips} grip" if grips == 1 else f"{grips} grips"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _checked(samples: Any) -> list[TrajectorySample]:
    try:
        check_count(len(samples))
        checked = [TrajectorySample._make(map(float, sample)) for sample in samples]
    except (TypeError, ValueError, OverflowError) as error:
        text = f"samples are t, openness, position_rad, velocity_rad_s, torque_nm: {error}"
        raise TrajectoryFormatError(text) from error
    last_s = -math.inf
    for place, sample in enumerate(checked):
        if not all(map(math.isfinite, sample)):
            raise TrajectoryFormatError(f"sample {place} has a value that is not finite")
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
