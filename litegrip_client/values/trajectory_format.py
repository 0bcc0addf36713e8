"""The files of a trajectory to the bit: `.lgt` with its samples, and the taught grips beside it.

`NAME.lgt` has a header of 66 bytes and 40 bytes a sample, little-endian. What is stored is the
openness, 0 (closed) to 1 (open), so that a trajectory taught on one gripper replays on another.

`NAME.grip.json` lies beside `NAME.lgt`, which keeps the vendor's format. It names the SHA-256 of
that file: grips never go with another path.
"""

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, BinaryIO, Literal, TypeAlias

from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.strict_json import is_finite
from litegrip_client.values.text import json_of

MAGIC = b"LGRTRJ01"
ENDING = ".lgt"
LGT_VERSION = 1
HEADER = struct.Struct("<8sHI5dI8s")
SAMPLE = struct.Struct("<5d")
SAMPLE_FIELDS = ("t_s", "openness", "position_rad", "velocity_rad_s", "torque_nm")
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
            LGT_VERSION,
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


def check_finite(number: int, sample: Sequence[float]) -> None:
    """Raise `TrajectoryFormatError` that names a value of a sample which is not finite."""
    if all(map(math.isfinite, sample)):
        return
    named = zip(SAMPLE_FIELDS, sample, strict=True)
    name, value = next(one for one in named if not math.isfinite(one[1]))
    text = f"sample {number}: {name} is {value}, it must be a finite number"
    raise TrajectoryFormatError(text)


def check_length(length: int, samples: int) -> None:
    """Raise `TrajectoryFormatError` for a file whose length is not that of its samples."""
    expected = HEADER.size + samples * SAMPLE.size
    if length != expected:
        by_text = ", as by a copy in text mode: copy it in binary mode" if length > expected else ""
        raise TrajectoryFormatError(
            f"{length} bytes, but {samples} samples make {expected}: it is cut off or"
            f" something was added{by_text}"
        )


def read_header(content: memoryview) -> Header:
    """Read the header of a whole file; raises `TrajectoryFormatError` with the reason."""
    header = parse_header(content)
    check_length(len(content), header.samples)
    return header


def parse_header(content: memoryview) -> Header:
    """Return the header, ignoring what follows; raises `TrajectoryFormatError` with the reason."""
    if len(content) < HEADER.size:
        raise TrajectoryFormatError(
            f"{len(content)} bytes are too few for a header, which has {HEADER.size}: no .lgt file"
        )
    magic, version, samples, *figures, can_id, padded = HEADER.unpack_from(content)
    if magic != MAGIC:
        raise TrajectoryFormatError(
            f"it begins with {magic!r} and not with {MAGIC!r}: no .lgt file"
        )
    if version != LGT_VERSION:
        raise TrajectoryFormatError(f"version {version}, only version {LGT_VERSION} can be read")
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


GRIPS_FORMAT = "litegrip-grips"
GRIPS_VERSION = 1
GRIP_ENDING = ".grip.json"
MOST_GRIPS = 200
"""The most that fit into a packet between control thread and helper process: in 30 minutes one in
9 s."""

MAX_GRIP_BYTES = 131_072
MAX_SOURCE = 80
MOST_FORCE_N = 40.0
"""What the gripper's fingers are rated for together: no hold and no taught grip has more, with any
motor. The vendor recommends 20 N for continuous work."""

_KEYS = {"format", "version", "lgt_sha256", "grips"}


@dataclass(frozen=True, slots=True)
class TaughtGrip:
    """One grip; its times are the samples' own.

    From `closing_s` on the jaws closed on something. From `start_s` to `end_s` they held it with
    the set force `force_n`. `openness` and `width_mm` are those at the contact; `source` says who
    commanded it. Raises `TrajectoryFormatError` for impossible values.
    """

    closing_s: float
    start_s: float
    end_s: float
    openness: float
    width_mm: float
    force_n: float
    source: str

    def __post_init__(self) -> None:
        for field in fields(self)[:-1]:
            _check_figure(field.name, getattr(self, field.name))
        if not self.closing_s <= self.start_s <= self.end_s:
            text = f"closing_s {self.closing_s}, start_s {self.start_s}, end_s {self.end_s}"
            raise TrajectoryFormatError(f"{text} must come one after the other")
        if not 0.0 <= self.openness <= 1.0:
            raise TrajectoryFormatError(f"openness is {self.openness}, it must be 0 to 1")
        if self.width_mm < 0.0:
            raise TrajectoryFormatError(f"width_mm is {self.width_mm}, it must not be below 0")
        if not 0.0 < self.force_n <= MOST_FORCE_N:
            text = f"force_n is {self.force_n}, it must be above 0 and at most {MOST_FORCE_N:g}"
            raise TrajectoryFormatError(text)
        source: object = self.source
        if not isinstance(source, str) or not _is_plain(source):
            text = f"source must be 1 to {MAX_SOURCE} printable ASCII characters"
            raise TrajectoryFormatError(text)


def check_grips(grips: Sequence[TaughtGrip], first_s: float, last_s: float) -> None:
    """Refuse grips that overlap, or do not lie between the first and the last sample.

    Raises `TrajectoryFormatError` with the number of the wrong one.
    """
    if len(grips) > MOST_GRIPS:
        raise TrajectoryFormatError(f"{len(grips)} grips, at most {MOST_GRIPS} are allowed")
    before_s = first_s
    for number, grip in enumerate(grips):
        given: object = grip
        if not isinstance(given, TaughtGrip):
            raise TrajectoryFormatError(f"grip {number} is {given!r:.60}, no TaughtGrip")
        if grip.closing_s < before_s:
            text = f"closing_s is {grip.closing_s}, before {before_s}, where it can begin"
            raise TrajectoryFormatError(f"grip {number}: {text}")
        if grip.end_s > last_s:
            text = f"end_s is {grip.end_s}, after {last_s}, where the trajectory ends"
            raise TrajectoryFormatError(f"grip {number}: {text}")
        before_s = grip.end_s


def pack_grips(grips: Sequence[TaughtGrip], lgt_sha256: str) -> bytes:
    """Return the content of the file for the `.lgt` with this digest."""
    whole = {"format": GRIPS_FORMAT, "version": GRIPS_VERSION, "lgt_sha256": lgt_sha256}
    return (
        json.dumps({**whole, "grips": [asdict(grip) for grip in grips]}, indent=1) + "\n"
    ).encode()


def unpack_grips(content: bytes, lgt_sha256: str) -> tuple[TaughtGrip, ...]:
    """Return the grips of a file that belongs to this `.lgt`; raises `TrajectoryFormatError`."""
    plain = parse_grips(content)
    if not isinstance(plain, dict) or plain.keys() != _KEYS or plain["format"] != GRIPS_FORMAT:
        raise TrajectoryFormatError(
            f"it is no object with {', '.join(sorted(_KEYS))}: no file of grips"
        )
    if plain["version"] != GRIPS_VERSION or isinstance(plain["version"], bool):
        text = f"version {plain['version']!r:.40}, only version {GRIPS_VERSION} can be read"
        raise TrajectoryFormatError(text)
    grips = grips_of(plain["grips"])
    if plain["lgt_sha256"] != lgt_sha256:
        raise TrajectoryFormatError("it belongs to another .lgt file, which has been replaced")
    return grips


def grips_of(plain: object) -> tuple[TaughtGrip, ...]:
    """Return the grips in a list of objects; raises `TrajectoryFormatError`, which names one."""
    if not isinstance(plain, list) or len(plain) > MOST_GRIPS:
        raise TrajectoryFormatError(f"grips must be an array of at most {MOST_GRIPS}")
    return tuple(_grip_of(number, one) for number, one in enumerate(plain))


def parse_grips(content: bytes) -> Any:
    """Return the parsed JSON; raises `TrajectoryFormatError` if it is too long or no JSON."""
    if len(content) > MAX_GRIP_BYTES:
        raise TrajectoryFormatError(f"{len(content)} bytes, at most {MAX_GRIP_BYTES} are allowed")
    try:
        return json_of(content)
    except ValueError as error:
        raise TrajectoryFormatError(str(error)) from None


def _grip_of(number: int, plain: object) -> TaughtGrip:
    names = {field.name for field in fields(TaughtGrip)}
    if not isinstance(plain, dict) or plain.keys() != names:
        text = f"grip {number} is no object with {', '.join(sorted(names))}"
        raise TrajectoryFormatError(text)
    try:
        return TaughtGrip(**plain)
    except TrajectoryFormatError as error:
        raise TrajectoryFormatError(f"grip {number}: {error}") from None


def _check_figure(name: str, value: object) -> None:
    fine = isinstance(value, int | float) and is_finite(value)
    if not fine or isinstance(value, bool):
        raise TrajectoryFormatError(f"{name} is {value!r:.40}, it must be a finite number")


def _is_plain(source: str) -> bool:
    return 1 <= len(source) <= MAX_SOURCE and source.isascii() and source.isprintable()
