"""What gateway and portal know of a daemon's lines, which they pass on: limits, and a few words."""

import re
from typing import TypeGuard

from litegrip_fleet.wire.answers import LINE_TOO_LONG, error_object

MAX_LINE_BYTES = 16_384
"""As the daemon's; without the newline."""

MAX_ANSWER_BYTES = 16 * 1024 * 1024
"""Of a line of the daemon's, whatever it answers."""

MAX_ID_CHARACTERS = 128
"""As the daemon's."""

TOO_LONG = error_object(
    LINE_TOO_LONG,
    f"a line is longer than {MAX_LINE_BYTES} bytes: send large contents in pieces",
    limit=MAX_LINE_BYTES,
)

_GENERATION = re.compile(rb'"(?:stop_)?generation":(\d{1,15})')
_LAST = b'"stop_generation":'


def generation_in(line: bytes) -> int | None:
    """Return the largest count of stops in a line of the daemon's, None without any."""
    # A whole state, as most lines have, ends in its count, which no other of its counts exceeds.
    at = line.rfind(_LAST) if is_single_sample(line) else -1
    found = _GENERATION.findall(line, max(at, 0))
    return max(map(int, found), default=None)


def is_clearing(line: bytes) -> bool:
    """Return True for the event that a stop was cleared."""
    return (
        line.startswith(b'{"jsonrpc":"2.0","method":"event"') and b'"kind":"stop_cleared"' in line
    )


def is_sample(line: bytes) -> bool:
    """Return True for a sample of the state, which a newer one replaces."""
    return line.startswith(b'{"jsonrpc":"2.0","method":"state.')


def is_single_sample(line: bytes) -> bool:
    """Return True for a sample of one moment, and not a batch of rows."""
    return line.startswith(b'{"jsonrpc":"2.0","method":"state.sample",')


def is_id(value: object) -> TypeGuard[str | int]:
    """Return True for what a daemon takes as a request's id."""
    is_one = isinstance(value, str | int) and not isinstance(value, bool)
    return is_one and len(str(value)) <= MAX_ID_CHARACTERS
