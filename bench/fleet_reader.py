"""Reads the states of many grippers at once, and how old each is.

python -m bench.fleet_reader HZ SOCKET...

Says `subscribed` once every socket has answered; each line SECONDS on standard input then has it
count for so long, and print as JSON how many samples came, at what age (microseconds, from
the sample's `monotonic_s`), how many of their numbers were missing, and how many sessions ended.
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
UNTIL_ASKED_S = 1e6
_SAMPLE = re.compile(rb'"seq":(\d+),"dropped":\d+,"monotonic_s":([0-9.]+)')


class Reader:
    """One gripper's subscription."""

    def __init__(self, path: str, hz: float) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(WITHIN_S)
        self.socket.connect(path)
        request = {"jsonrpc": "2.0", "id": 1, "method": "state.subscribe", "params": {"hz": hz}}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        self.ages_s = array("d")
        self.missing = 0
        self._number: int | None = None
        self._rest = b""

    def subscribed(self) -> None:
        """Wait for the answer to the subscription; raises `RuntimeError` for a refusal."""
        while b"\n" not in self._rest:
            self._rest += self.socket.recv(READ_BYTES)
        line, _newline, self._rest = self._rest.partition(b"\n")
        if b'"result"' not in line:
            raise RuntimeError(line)

    def read(self) -> bool:
        """Take what is there; return False at the end."""
        received = self.socket.recv(READ_BYTES)
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


def count(readers: dict[int, Reader], poll: "select.epoll", seconds: float) -> dict[str, object]:
    """Read for so long, or without a limit until standard input has a line; return the figures."""
    ended = 0
    for reader in readers.values():
        reader.ages_s, reader.missing = array("d"), 0
    ends_s = time.monotonic() + seconds
    while (left_s := ends_s - time.monotonic()) > 0.0:
        for fd, _events in poll.poll(left_s):
            if fd == sys.stdin.fileno():
                ends_s = 0.0
            elif not readers[fd].read():
                poll.unregister(fd)
                ended += 1
    ages_s = sorted(age_s for reader in readers.values() for age_s in reader.ages_s)
    missing = sum(reader.missing for reader in readers.values())
    figures: dict[str, object] = {"samples": len(ages_s), "missing": missing, "ended": ended}
    if ages_s:
        shares = {"p50": 0.5, "p99": 0.99, "worst": 1.0}
        figures |= {
            name: ages_s[int(share * (len(ages_s) - 1))] * 1e6 for name, share in shares.items()
        }
    return figures


def main() -> None:
    hz, paths = float(sys.argv[1]), sys.argv[2:]
    opened = [Reader(path, hz) for path in paths]
    poll = select.epoll()
    for reader in opened:
        reader.subscribed()
        poll.register(reader.socket.fileno(), select.EPOLLIN)
    readers = {reader.socket.fileno(): reader for reader in opened}
    poll.register(sys.stdin.fileno(), select.EPOLLIN)
    print("subscribed", flush=True)
    while True:
        count(readers, poll, UNTIL_ASKED_S)
        if not (line := sys.stdin.readline()):
            return
        poll.unregister(sys.stdin.fileno())
        print(json.dumps(count(readers, poll, float(line))), flush=True)
        poll.register(sys.stdin.fileno(), select.EPOLLIN)


if __name__ == "__main__":
    main()
