"""Somebody who knocks at a port and says nothing: knocker.py HOST PORT RATE_HZ KEPT_S [COUNT].

It opens so many connections a second, keeps each for so long, and prints at its end (after COUNT,
or by SIGTERM) how many it has tried and how many came about. It needs Python alone.
"""

import json
import resource
import selectors
import signal
import socket
import sys
import time
from dataclasses import dataclass, field

GIVE_UP_S = 3.0
"""So long a connection may take to come about."""
MOST_OPEN = 8192


@dataclass
class Knocker:
    """Connections to one address, and what became of them."""

    where: tuple[socket.AddressFamily, tuple[object, ...]]
    kept_s: float
    tried: int = 0
    connected: int = 0
    _selector: selectors.BaseSelector = field(default_factory=selectors.DefaultSelector)
    _until_s: dict[socket.socket, float] = field(default_factory=dict)

    def open_one(self) -> None:
        """Begin another connection."""
        family, address = self.where
        knock = socket.socket(family, socket.SOCK_STREAM)
        knock.setblocking(False)
        knock.connect_ex(address)
        self.tried += 1
        self._until_s[knock] = time.monotonic() + GIVE_UP_S
        self._selector.register(knock, selectors.EVENT_WRITE)

    def look(self, wait_s: float) -> None:
        """See which have come about; close those whose time is over."""
        for key, _events in self._selector.select(wait_s):
            knock = key.fileobj
            assert isinstance(knock, socket.socket)
            self._selector.unregister(knock)
            is_there = knock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) == 0
            self.connected += is_there
            self._until_s[knock] = time.monotonic() + (self.kept_s if is_there else 0.0)
        now_s = time.monotonic()
        for knock in [knock for knock, until_s in self._until_s.items() if until_s <= now_s]:
            if knock in self._selector.get_map():
                self._selector.unregister(knock)
            del self._until_s[knock]
            knock.close()

    @property
    def is_idle(self) -> bool:
        """True if no connection is open or under way."""
        return not self._until_s


def main() -> int:
    """Knock until the count is reached or a signal comes; return 0."""
    host, port, rate_hz, kept_s, *counts = sys.argv[1:]
    count = int(counts[0]) if counts else sys.maxsize
    resource.setrlimit(resource.RLIMIT_NOFILE, (MOST_OPEN, MOST_OPEN))
    family, _, _, _, address = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)[0]
    knocker = Knocker((family, address), float(kept_s))
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: ended.append(number))
    period_s, due_s = 1.0 / float(rate_hz), time.monotonic()
    print("knocking", flush=True)
    while not ended and not (knocker.tried >= count and knocker.is_idle):
        if knocker.tried < count and time.monotonic() >= due_s:
            knocker.open_one()
            due_s += period_s
        knocker.look(min(0.05, max(0.0, due_s - time.monotonic())))
    print(json.dumps({"tried": knocker.tried, "connected": knocker.connected}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
