"""The grips of a trajectory, and the file of them that lies beside its `.lgt`, to the last field.

That file names the SHA-256 of the `.lgt`, so that no grip goes with another path than its own.
This module must not know the daemon, nor where files lie: `trajectory_files`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields

from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, NoReturn

FORMAT = "litegrip-grips"
VERSION = 1
MOST_GRIPS = 200
MAX_GRIP_BYTES = 131_072
MAX_SOURCE = 80
MOST_FORCE_N = 30.0
_KEYS = {"format", "version", "lgt_sha256", "grips"}


@dataclass(frozen=True, slots=True)
class TaughtGrip:
    """One grip; its times are those of the samples.

    From `closing_s` on the jaws closed on something, from `start_s` to `end_s` they held it by
    `force_n` (at most 30), the force that was set. `openness` and `width_mm` are those at the
    contact; `source` says who commanded it. Raises `CommandError` for what cannot be.
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
            raise _unusable(f"{text} must come one after the other")
        if not 0.0 <= self.openness <= 1.0:
            raise _unusable(f"openness is {self.openness}, it must be 0 to 1")
        if self.width_mm < 0.0:
            raise _unusable(f"width_mm is {self.width_mm}, it must not be below 0")
        if not 0.0 < self.force_n <= MOST_FORCE_N:
            text = f"force_n is {self.force_n}, it must be above 0 and at most {MOST_FORCE_N:g}"
            raise _unusable(text)
        source: object = self.source
        if not isinstance(source, str) or not _is_plain(source):
            raise _unusable(f"source must be 1 to {MAX_SOURCE} printable ASCII characters")


def checked(grips: Sequence[TaughtGrip], first_s: float, last_s: float) -> tuple[TaughtGrip, ...]:
    """Return grips that follow each other between two times, those of the first and last sample.

    Raises `CommandError` with the number of the wrong one.
    """
    row = tuple(grips)
    if len(row) > MOST_GRIPS:
        raise _unusable(f"{len(row)} grips, at most {MOST_GRIPS} are allowed")
    before_s = first_s
    for number, grip in enumerate(row):
        given: object = grip
        if not isinstance(given, TaughtGrip):
            raise _unusable(f"grip {number} is {given!r:.60}, no TaughtGrip")
        if grip.closing_s < before_s:
            text = f"closing_s is {grip.closing_s}, before {before_s}, where it can begin"
            raise _unusable(f"grip {number}: {text}")
        if grip.end_s > last_s:
            text = f"end_s is {grip.end_s}, after {last_s}, where the trajectory ends"
            raise _unusable(f"grip {number}: {text}")
        before_s = grip.end_s
    return row


def pack(grips: Sequence[TaughtGrip], lgt_sha256: str) -> bytes:
    """Return the content of the file that goes with the `.lgt` of this digest."""
    head = {"format": FORMAT, "version": VERSION, "lgt_sha256": lgt_sha256}
    whole = {**head, "grips": [asdict(grip) for grip in grips]}
    return (json.dumps(whole, indent=1) + "\n").encode()


def read(content: bytes, lgt_sha256: str) -> tuple[TaughtGrip, ...]:
    """Judge a whole file, and that it goes with this `.lgt`; raises `CommandError`."""
    plain = _parsed(content)
    if not isinstance(plain, dict) or plain.keys() != _KEYS or plain["format"] != FORMAT:
        raise _unusable(f"it is no object with {', '.join(sorted(_KEYS))}: no file of grips")
    if plain["version"] != VERSION or isinstance(plain["version"], bool):
        raise _unusable(f"version {plain['version']!r:.40}, only version {VERSION} can be read")
    rows = plain["grips"]
    if not isinstance(rows, list) or len(rows) > MOST_GRIPS:
        raise _unusable(f"grips must be an array of at most {MOST_GRIPS}")
    grips = tuple(_grip_of(number, one) for number, one in enumerate(rows))
    if plain["lgt_sha256"] != lgt_sha256:
        raise _unusable("it belongs to another .lgt file, which has been replaced")
    return grips


def _parsed(content: bytes) -> Any:
    if len(content) > MAX_GRIP_BYTES:
        raise _unusable(f"{len(content)} bytes, at most {MAX_GRIP_BYTES} are allowed")
    try:
        return _decoder.decode(content.decode())
    except (ValueError, RecursionError) as error:
        raise _unusable(f"it is no JSON: {error}") from None


def _grip_of(number: int, plain: object) -> TaughtGrip:
    names = {field.name for field in fields(TaughtGrip)}
    if not isinstance(plain, dict) or plain.keys() != names:
        raise _unusable(f"grip {number} is no object with {', '.join(sorted(names))}")
    try:
        return TaughtGrip(**plain)
    except CommandError as error:
        raise _unusable(f"grip {number}: {error.message}") from None


def _check_figure(name: str, value: object) -> None:
    try:
        fine = isinstance(value, int | float) and math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        fine = False
    if not fine or isinstance(value, bool):
        raise _unusable(f"{name} is {value!r:.40}, it must be a finite number")


def _is_plain(source: str) -> bool:
    return 1 <= len(source) <= MAX_SOURCE and source.isascii() and source.isprintable()


def _unusable(text: str) -> CommandError:
    return CommandError(text, reason="trajectory_unreadable")


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        raise ValueError("an object has the same key twice")
    return value


_decoder = json.JSONDecoder(parse_constant=_no_constant, object_pairs_hook=_unique)
