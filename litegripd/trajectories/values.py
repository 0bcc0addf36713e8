"""The trajectory file `.lgt`, exact to the bit: written, read and checked without a disk.

A header of 66 bytes and 40 bytes per sample, little-endian. It stores the openness, so that a
trajectory taught on one gripper replays on another. Checking a long one takes far longer than a
tick: the control thread must never do it. `Path` reads checked bytes sample by sample: fast enough
for a tick, for any length.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, fields

from litegripd.model.geometry import Mount

MAGIC = b"LGRTRJ01"
VERSION = 1
HEADER = struct.Struct("<8sHI5dI8s")
SAMPLE = struct.Struct("<5d")
MAX_SAMPLES = 360_000
"""30 minutes at 200 Hz, 14.4 MB."""

MAX_BYTES = HEADER.size + MAX_SAMPLES * SAMPLE.size
MAX_NAME = 64
MAX_NAME_BYTES = 200
"""With its suffixes, also that of a temporary file, a name fits into a file system's 255 bytes."""

CSV_HEAD = "t_s,openness,position_rad,velocity_rad_s,torque_nm\n"

_MOUNTS: dict[bytes, Mount | None] = {b"normal": "normal", b"reverse": "reverse", b"": None}
_MAX_CAN_ID = 2**32 - 1


class TrajectoryError(ValueError):
    """A trajectory that cannot be used, and why."""


@dataclass(frozen=True, slots=True)
class Header:
    """A file's facts about the gripper that it was taught on; `created_s` is Unix time."""

    samples: int
    sample_hz: float
    created_s: float
    closed_rad: float
    open_rad: float
    rad_to_mm: float
    can_id: int
    mount: Mount | None

    def __post_init__(self) -> None:
        """Reject values that no reader accepts; raises `TrajectoryError`."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise TrajectoryError(f"{field.name} of the header is {value}")
        if self.sample_hz <= 0.0:
            raise TrajectoryError(f"sample_hz is {self.sample_hz}, it must be above 0")
        if self.rad_to_mm <= 0.0:
            raise TrajectoryError(f"rad_to_mm is {self.rad_to_mm}, it must be above 0")
        if self.closed_rad == self.open_rad:
            raise TrajectoryError("zero travel: the closed and the open limit are equal")
        if not 0 <= self.samples <= MAX_SAMPLES:
            raise TrajectoryError(f"{self.samples} samples, at most {MAX_SAMPLES} are allowed")
        if not 0 <= self.can_id <= _MAX_CAN_ID:
            raise TrajectoryError(f"can_id is {self.can_id}, it must fit into 32 bits")

    def pack(self) -> bytes:
        """Return the 66 bytes."""
        mount = b"" if self.mount is None else self.mount.encode()
        return HEADER.pack(
            MAGIC,
            VERSION,
            self.samples,
            self.sample_hz,
            self.created_s,
            self.closed_rad,
            self.open_rad,
            self.rad_to_mm,
            self.can_id,
            mount,
        )


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample: what was measured at `t_s`; the torque is for diagnosis and never replayed."""

    t_s: float
    openness: float
    position_rad: float
    velocity_rad_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class Summary:
    """The result of checking the samples.

    `max_rate_s` is the fastest change of the openness per second: infinite for a jump. Without
    samples all values are 0.
    """

    duration_s: float = 0.0
    max_rate_s: float = 0.0


def read_header(content: memoryview) -> Header:
    """Return the header of a whole file; raises `TrajectoryError` with the reason."""
    header = parse_header(content)
    expected = HEADER.size + header.samples * SAMPLE.size
    if len(content) != expected:
        raise TrajectoryError(
            f"{len(content)} bytes, but {header.samples} samples make {expected}: it is cut off or"
            " something was added"
        )
    return header


def parse_header(content: memoryview) -> Header:
    """Return the header, ignoring what follows; raises `TrajectoryError` with the reason."""
    if len(content) < HEADER.size:
        text = f"{len(content)} bytes are too few for a header, which has {HEADER.size}"
        raise TrajectoryError(text)
    magic, version, samples, *figures, can_id, padded = HEADER.unpack_from(content)
    if magic != MAGIC:
        raise TrajectoryError(f"it begins with {magic!r} and not with {MAGIC!r}: no .lgt file")
    if version != VERSION:
        raise TrajectoryError(f"version {version}, only version {VERSION} can be read")
    mount = padded.rstrip(b"\0")
    if mount not in _MOUNTS:
        raise TrajectoryError(f"unknown mount {mount!r}; there are normal, reverse, and none")
    hz, created_s, closed_rad, open_rad, rad_to_mm = figures
    return Header(samples, hz, created_s, closed_rad, open_rad, rad_to_mm, can_id, _MOUNTS[mount])


def read(content: memoryview) -> tuple[Header, Summary]:
    """Check a whole file; raises `TrajectoryError` with the reason.

    The longest file takes about half a second.
    """
    header = read_header(content)
    return header, summarize(content[HEADER.size :])


def summarize(samples: memoryview) -> Summary:
    """Check the samples; raises `TrajectoryError` with the number of the wrong one."""
    first_s = last_s = last = fastest = 0.0
    for number, values in enumerate(SAMPLE.iter_unpack(samples)):
        t_s, openness = values[:2]
        if not all(map(math.isfinite, values)):
            raise TrajectoryError(f"sample {number} has a value that is not finite")
        if not 0.0 <= openness <= 1.0:
            raise TrajectoryError(f"sample {number}: openness is {openness}, it must be 0 to 1")
        if number == 0:
            first_s = t_s
        elif t_s < last_s:
            raise TrajectoryError(f"sample {number}: time runs backwards, {last_s} to {t_s} s")
        elif openness != last:
            rate_s = math.inf if t_s == last_s else abs(openness - last) / (t_s - last_s)
            fastest = max(fastest, rate_s)
        last_s, last = t_s, openness
    return Summary(last_s - first_s, fastest)


def csv_line(values: tuple[float, ...]) -> str:
    """Return a sample as a line of CSV; each number reads back exactly."""
    return ",".join(map(repr, values)) + "\n"


def name_problem(name: str) -> str | None:
    """Return why a trajectory cannot have this name, or None."""
    if not name or len(name) > MAX_NAME:
        return f"it must have 1 to {MAX_NAME} characters"
    if "/" in name or "\\" in name:
        return "it must have no / and no \\: it is a name, not a path"
    if name.startswith("."):
        return "it must not begin with a dot"
    if name != name.strip() or not name.isprintable():
        return "it must be printable, and not begin or end with a space"
    if len(name.encode()) > MAX_NAME_BYTES:
        return f"it must have at most {MAX_NAME_BYTES} bytes in UTF-8"
    return None


PIECE_SAMPLES = 800
PIECE_BYTES = PIECE_SAMPLES * SAMPLE.size
"""32,000 bytes: as base64 it fits into one packet between control thread and helper process."""


class Path:
    """The openness over the time since the first sample, linear between the samples.

    `pieces` have `PIECE_SAMPLES` samples each, the last one the remainder; `samples` is above 0.
    """

    def __init__(self, pieces: Sequence[bytes], samples: int) -> None:
        self.samples = samples
        self._pieces = pieces
        self._first_s = self._sample(0)[0]
        self.duration_s = self._sample(samples - 1)[0] - self._first_s

    def openness_at(self, elapsed_s: float) -> float:
        """Return the openness; before the start and after the end, that of the nearest sample.

        If several samples have the same time, the last one counts.
        """
        after = self._first_after(elapsed_s)
        if after == 0:
            return self._sample(0)[1]
        before_s, before = self._sample(after - 1)
        if after == self.samples:
            return before
        next_s, following = self._sample(after)
        share = (elapsed_s - (before_s - self._first_s)) / (next_s - before_s)
        return before + (following - before) * min(max(share, 0.0), 1.0)

    def _first_after(self, elapsed_s: float) -> int:
        """Return the number of the first later sample, by bisection."""
        low, high = 0, self.samples
        while low < high:
            middle = (low + high) // 2
            if self._sample(middle)[0] - self._first_s > elapsed_s:
                high = middle
            else:
                low = middle + 1
        return low

    def _sample(self, number: int) -> tuple[float, float]:
        """Return time and openness of a sample."""
        piece, index = divmod(number, PIECE_SAMPLES)
        t_s, openness, *_ = SAMPLE.unpack_from(self._pieces[piece], index * SAMPLE.size)
        return t_s, openness
