"""The file of taught grips beside a trajectory: written, read and checked without a disk.

`NAME.grip.json` lies beside `NAME.lgt`, which keeps the vendor's format. It names the SHA-256 of
that file: grips never go with another path.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from litegrip_client.errors import TrajectoryFormatError
from litegrip_client.protocol import strict_json

FORMAT = "litegrip-grips"
VERSION = 1
ENDING = ".grip.json"
MOST_GRIPS = 200
"""The most that fit into a packet between control thread and helper process: in 30 minutes one in
9 s."""

MAX_GRIP_BYTES = 131_072
MAX_SOURCE = 80
MOST_FORCE_N = 30.0
"""The limit of the file, for any motor: grips go from one gripper to another."""

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


def check_row(grips: Sequence[TaughtGrip], first_s: float, last_s: float) -> None:
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


def pack(grips: Sequence[TaughtGrip], lgt_sha256: str) -> bytes:
    """Return the content of the file for the `.lgt` with this digest."""
    whole = {"format": FORMAT, "version": VERSION, "lgt_sha256": lgt_sha256}
    return (
        json.dumps({**whole, "grips": [asdict(grip) for grip in grips]}, indent=1) + "\n"
    ).encode()


def read(content: bytes, lgt_sha256: str) -> tuple[TaughtGrip, ...]:
    """Return the grips of a file that belongs to this `.lgt`; raises `TrajectoryFormatError`."""
    plain = parse(content)
    if not isinstance(plain, dict) or plain.keys() != _KEYS or plain["format"] != FORMAT:
        raise TrajectoryFormatError(
            f"it is no object with {', '.join(sorted(_KEYS))}: no file of grips"
        )
    if plain["version"] != VERSION or isinstance(plain["version"], bool):
        text = f"version {plain['version']!r:.40}, only version {VERSION} can be read"
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


def parse(content: bytes) -> Any:
    """Return the parsed JSON; raises `TrajectoryFormatError` if it is too long or no JSON."""
    if len(content) > MAX_GRIP_BYTES:
        raise TrajectoryFormatError(f"{len(content)} bytes, at most {MAX_GRIP_BYTES} are allowed")
    try:
        return strict_json.decode(content.decode())
    except (ValueError, RecursionError) as error:
        raise TrajectoryFormatError(f"it is no JSON: {error}") from None


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
    try:
        fine = isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # an integer beyond all floats
        fine = False
    if not fine or isinstance(value, bool):
        raise TrajectoryFormatError(f"{name} is {value!r:.40}, it must be a finite number")


def _is_plain(source: str) -> bool:
    return 1 <= len(source) <= MAX_SOURCE and source.isascii() and source.isprintable()
