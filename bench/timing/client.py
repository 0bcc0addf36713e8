"""A client that reads the state as fast as it can, or that never reads its answers.

python -m bench.timing.client SOCKET SECONDS FILE [--never-read]; latencies go to FILE as doubles.
"""

import array
import contextlib
import socket
import sys
import time
from pathlib import Path

REQUEST = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'


def read_states(connected: socket.socket, seconds: float) -> "array.array[float]":
    """Ask and wait, again and again; return how long each answer took."""
    latencies = array.array("d")
    ends_s = time.perf_counter() + seconds
    while True:
        asked_s = time.perf_counter()
        if asked_s >= ends_s:
            return latencies
        connected.sendall(REQUEST)
        received = b""
        while not received.endswith(b"\n"):
            received = connected.recv(65536)
            if not received:
                raise ConnectionError("the server is gone")
        latencies.append(time.perf_counter() - asked_s)


def never_read(connected: socket.socket, seconds: float) -> None:
    """Ask without reading, until the daemon closes the connection or the time is over."""
    connected.settimeout(seconds)
    with contextlib.suppress(OSError):
        while True:
            connected.sendall(REQUEST * 100)


def main() -> None:
    path, seconds, output = sys.argv[1], float(sys.argv[2]), Path(sys.argv[3])
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected:
        connected.connect(path)
        if sys.argv[4:] == ["--never-read"]:
            never_read(connected, seconds)
            return
        output.write_bytes(read_states(connected, seconds).tobytes())


if __name__ == "__main__":
    main()
