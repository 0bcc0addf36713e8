"""What gateway and portal read in a daemon's lines, which they pass on as they are."""

import re

_GENERATION = re.compile(rb'"(?:stop_)?generation":(\d{1,15})')


def generation_in(line: bytes) -> int | None:
    """Return the largest count of stops in a line of the daemon's, None without any."""
    found = [int(digits) for digits in _GENERATION.findall(line)]
    return max(found, default=None)


def is_sample(line: bytes) -> bool:
    """Return True for a sample of the state, which a newer one replaces."""
    return line.startswith(b'{"jsonrpc":"2.0","method":"state.')
