"""One user who floods: connections that always have requests waiting, and whose answers are read.

python -m bench.hostile.flood SOCKET CONNECTIONS [UID]

It says "on" once every connection has been answered, and goes on until its standard input ends.
With UID it becomes that user first, which only root can.
"""

import contextlib
import os
import select
import socket
import sys
from pathlib import Path

REQUEST = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'
AHEAD = 50  # requests of each connection that wait


class Flood:
    """The connections, and how many answers each still waits for."""

    def __init__(self, path: Path, connections: int) -> None:
        self._waiting: dict[socket.socket, int] = {}
        self._poll = select.epoll()
        self._by_fd: dict[int, socket.socket] = {}
        self.silent = connections
        for _ in range(connections):
            connected = socket.socket(socket.AF_UNIX)
            connected.connect(str(path))
            connected.setblocking(False)
            self._waiting[connected] = 0
            self._by_fd[connected.fileno()] = connected
            self._poll.register(connected.fileno(), select.EPOLLIN)
            self._ask(connected)

    def round(self) -> None:
        """Read what there is, and ask as much again."""
        for fd, _mask in self._poll.poll(0.1):
            connected = self._by_fd[fd]
            with contextlib.suppress(BlockingIOError):
                answers = connected.recv(1 << 20).count(b"\n")
                if self._waiting[connected] == AHEAD and answers:
                    self.silent -= 1
                self._waiting[connected] -= answers
            if self._waiting[connected] <= AHEAD // 2:
                self._ask(connected)

    def _ask(self, connected: socket.socket) -> None:
        count = AHEAD - self._waiting[connected]
        with contextlib.suppress(BlockingIOError):
            sent = connected.send(REQUEST * count)
            self._waiting[connected] += sent // len(REQUEST)


def main() -> None:
    path, connections, *uid = sys.argv[1:]
    for one in map(int, uid):
        os.setgroups([])
        os.setgid(one)
        os.setuid(one)
    flood = Flood(Path(path), int(connections))
    while flood.silent > 0:
        flood.round()
    print("on", flush=True)
    while not select.select([sys.stdin], [], [], 0.0)[0]:
        flood.round()


if __name__ == "__main__":
    main()
