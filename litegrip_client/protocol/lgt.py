"""The trajectory file `.lgt` to the bit: a header of 66 bytes and 40 bytes a sample, little-endian.

What is stored is the openness, 0 (closed) to 1 (open), so that a trajectory taught on one gripper
replays on another.
"""

import math
import struct
from dataclasses import dataclass, fields
from typing import BinaryIO, Literal, TypeAlias

from litegrip_client.errors import TrajectoryFormatError

MAGIC = b"LGRTRJ01"
VERSION = 1
HEADER = struct.Struct("<8sHI5dI8s")
SAMPLE = struct.Struct("<5d")
MAX_SAMPLES = 360_000
"""30 minutes at 200 Hz, 14.4 MB."""

MAX_BYTES = HEADER.size + MAX_SAMPLES * SAMPLE.size

Mount: TypeAlias = Literal["normal", "reverse"]

_MOUNTS: dict[bytes, Mount | None] = {b"normal": "normal", b"reverse": "reverse", b"": None}
_MAX_CAN_ID = 2**32 - 1


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
        """Reject values that no reader accepts; raises `TrajectoryFormatError`."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not math.isfinite(value):
                text = f"{field.name} of the header is {value}, it must be a finite number"
                raise TrajectoryFormatError(text)
        if self.sample_hz <= 0.0:
            raise TrajectoryFormatError(f"sample_hz is {self.sample_hz}, it must be above 0")
        if self.rad_to_mm <= 0.0:
            raise TrajectoryFormatError(f"rad_to_mm is {self.rad_to_mm}, it must be above 0")
        if self.closed_rad == self.open_rad:
            raise TrajectoryFormatError("zero travel: the closed and the open limit are equal")
        check_count(self.samples)
        if not 0 <= self.can_id <= _MAX_CAN_ID:
            raise TrajectoryFormatError(f"can_id is {self.can_id}, it must fit into 32 bits")

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


def check_count(samples: int) -> None:
    """Raise `TrajectoryFormatError` for more samples than there may be."""
    if not 0 <= samples <= MAX_SAMPLES:
        raise TrajectoryFormatError(f"{samples} samples, at most {MAX_SAMPLES} are allowed")


def check_length(length: int, samples: int) -> None:
    """Raise `TrajectoryFormatError` for a file whose length is not that of its samples."""
    expected = HEADER.size + samples * SAMPLE.size
    if length != expected:
        raise TrajectoryFormatError(
            f"{length} bytes, but {samples} samples make {expected}: it is cut off or"
            " something was added"
        )


def read_header(content: memoryview) -> Header:
    """Read the header of a whole file; raises `TrajectoryFormatError` with the reason."""
    header = parse_header(content)
    check_length(len(content), header.samples)
    return header


def parse_header(content: memoryview) -> Header:
    """Return the header, ignoring what follows; raises `TrajectoryFormatError` with the reason."""
    if len(content) < HEADER.size:
        text = f"{len(content)} bytes are too few for a header, which has {HEADER.size}"
        raise TrajectoryFormatError(text)
    magic, version, samples, *figures, can_id, padded = HEADER.unpack_from(content)
    if magic != MAGIC:
        raise TrajectoryFormatError(
            f"it begins with {magic!r} and not with {MAGIC!r}: no .lgt file"
        )
    if version != VERSION:
        raise TrajectoryFormatError(f"version {version}, only version {VERSION} can be read")
    mount = padded.rstrip(b"\0")
    if mount not in _MOUNTS:
        raise TrajectoryFormatError(f"unknown mount {mount!r}; there are normal, reverse, and none")
    hz, created_s, closed_rad, open_rad, rad_to_mm = figures
    return Header(samples, hz, created_s, closed_rad, open_rad, rad_to_mm, can_id, _MOUNTS[mount])


def duration_s(file: BinaryIO, samples: int) -> float | None:
    """Return the last sample's time since the first; None where the two are no course of time.

    The file's length is that of all its samples.
    """
    if not samples:
        return 0.0
    file.seek(HEADER.size)
    first_s = SAMPLE.unpack(file.read(SAMPLE.size))[0]
    file.seek(HEADER.size + (samples - 1) * SAMPLE.size)
    lasts_s: float = SAMPLE.unpack(file.read(SAMPLE.size))[0] - first_s
    return lasts_s if 0.0 <= lasts_s < math.inf else None
