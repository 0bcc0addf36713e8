"""Reads the states of many grippers at once, and how old each is.

python -m bench.fleet.reader HZ SOCKET...

Subscribes, to a few at once, and says `subscribed`. Each line SECONDS on standard input then has
it count for so long, and print as JSON how many samples came, at what age (microseconds, from the
sample's `monotonic_s`), how many of their numbers were missing, and how many sessions have ended
since the begin. It does not connect again.
"""

import json
import re
import select
import socket
import sys
import time
from array import array

READ_BYTES = 262_144
WITHIN_S = 60.0
AT_ONCE = 10
_SAMPLE = re.compile(rb'"seq":(\d+),"dropped":\d+,"monotonic_s":([0-9.]+)')


class Reader:
    """One gripper's subscription."""

    def __init__(self, path: str, hz: float) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.connect(path)
        request = {"jsonrpc": "2.0", "id": 1, "method": "state.subscribe", "params": {"hz": hz}}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        self.ages_s = array("d")
        self.missing = 0
        self._number: int | None = None
        self._rest = b""

    @property
    def is_subscribed(self) -> bool:
        """True once a sample has come."""
        return bool(self.ages_s)

    def read(self) -> bool:
        """Take what is there; return False at the end."""
        try:
            received = self.socket.recv(READ_BYTES)
        except ConnectionResetError:
            received = b""
        now_s = time.monotonic()
        *lines, self._rest = (self._rest + received).split(b"\n")
        for line in lines:
            found = _SAMPLE.search(line, 0, 200)
            if found is None:
                continue
            number = int(found[1])
            if self._number is not None:
                self.missing += number - self._number - 1
            self._number = number
            self.ages_s.append(now_s - float(found[2]))
        return bool(received)


class Readers:
    """All of them, at one `epoll`."""

    def __init__(self) -> None:
        self.ended = 0
        self._poll = select.epoll()
        self._readers: dict[int, Reader] = {}

    def subscribe(self, path: str, hz: float, at_once: int = AT_ONCE) -> None:
        """Add one, and wait until few have neither their first sample nor their end."""
        reader = Reader(path, hz)
        fd = reader.socket.fileno()
        self._readers[fd] = reader
        self._poll.register(fd, select.EPOLLIN)
        self.until_subscribed(at_once)

    def until_subscribed(self, most: int = 0) -> None:
        """Read until no more than these wait for their first sample."""
        ends_s = time.monotonic() + WITHIN_S
        while sum(not one.is_subscribed for one in self._readers.values()) > most:
            self.read(max(0.0, ends_s - time.monotonic()))

    def read(self, within_s: float) -> bool:
        """Read what is there; return True if standard input has something, too."""
        asked = False
        for fd, _events in self._poll.poll(within_s):
            if fd == sys.stdin.fileno():
                asked = True
            elif not self._readers[fd].read():
                self._poll.unregister(fd)
                del self._readers[fd]
                self.ended += 1
        return asked

    def until_asked(self) -> None:
        """Read until standard input has something."""
        self._poll.register(sys.stdin.fileno(), select.EPOLLIN)
        while not self.read(WITHIN_S):
            pass
        self._poll.unregister(sys.stdin.fileno())

    def count(self, seconds: float) -> dict[str, object]:
        """Read for so long; return the figures."""
        counted = list(self._readers.values())
        for reader in counted:
            reader.ages_s, reader.missing = array("d"), 0
        ends_s = time.monotonic() + seconds
        while (left_s := ends_s - time.monotonic()) > 0.0:
            self.read(left_s)
        ages_s = sorted(age_s for reader in counted for age_s in reader.ages_s)
        missing = sum(reader.missing for reader in counted)
        figures: dict[str, object] = {"samples": len(ages_s), "missing": missing}
        figures["ended"] = self.ended
        if ages_s:
            shares = {"p50": 0.5, "p99": 0.99, "worst": 1.0}
            figures |= {
                name: ages_s[int(share * (len(ages_s) - 1))] * 1e6 for name, share in shares.items()
            }
        return figures


def main() -> None:
    readers = Readers()
    for path in sys.argv[2:]:
        readers.subscribe(path, float(sys.argv[1]))
    readers.until_subscribed()
    print("subscribed", flush=True)
    while True:
        readers.until_asked()
        if not (line := sys.stdin.readline()):
            return
        print(json.dumps(readers.count(float(line))), flush=True)


if __name__ == "__main__":
    main()
