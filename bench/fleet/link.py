"""A TCP connection that takes time, and that can be cut: a relay in a process of its own.

python -m bench.fleet.link PORT TO_PORT ONE_WAY_MS

What comes is sent on ONE_WAY_MS later, in each direction, in order; nothing waits for what was sent
before it, so throughput is not limited by the delay. To connect itself is not delayed. SIGUSR1 cuts
all connections. (The kernel's own netem needs a module that not every machine has.)
"""

import contextlib
import queue
import signal
import socket
import sys
import threading
import time

HOST = "127.0.0.1"
READ_BYTES = 65_536


class Link:
    """Both directions of one connection, each with a thread that reads and one that sends."""

    def __init__(self, near: socket.socket, far: socket.socket, one_way_s: float) -> None:
        self._sockets = (near, far)
        for one in self._sockets:
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for source, sink in ((near, far), (far, near)):
            waiting: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
            for work in (self._read, self._send):
                arguments = (source if work == self._read else sink, waiting, one_way_s)
                threading.Thread(target=work, args=arguments, daemon=True).start()

    def cut(self) -> None:
        """End both connections."""
        for one in self._sockets:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def _read(
        self,
        source: socket.socket,
        waiting: "queue.SimpleQueue[tuple[float, bytes]]",
        one_way_s: float,
    ) -> None:
        received = b"-"
        while received:
            try:
                received = source.recv(READ_BYTES)
            except OSError:
                received = b""
            waiting.put((time.monotonic() + one_way_s, received))

    def _send(
        self,
        sink: socket.socket,
        waiting: "queue.SimpleQueue[tuple[float, bytes]]",
        _one_way_s: float,
    ) -> None:
        with contextlib.suppress(OSError):
            while (item := waiting.get())[1]:
                time.sleep(max(0.0, item[0] - time.monotonic()))
                sink.sendall(item[1])
        self.cut()


def main() -> None:
    port, to_port, one_way_s = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]) / 1e3
    links: list[Link] = []

    def cut(*_received: object) -> None:
        while links:
            links.pop().cut()

    signal.signal(signal.SIGUSR1, cut)
    with socket.create_server((HOST, port)) as listener:
        print("listening", flush=True)
        while True:
            near, _address = listener.accept()
            try:
                far = socket.create_connection((HOST, to_port))
            except OSError:
                near.close()
                continue
            links.append(Link(near, far, one_way_s))


if __name__ == "__main__":
    main()
