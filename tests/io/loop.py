"""Drives the real reactor and server in the test's own thread, until something has happened."""

import contextlib
import json
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from litegripd.io.loop import Reactor
from litegripd.io.server import Server
from litegripd.io.sockets import listen
from litegripd.rpc.jsonrpc import Request, encode, error_line, notification_line, parse, result_line
from litegripd.rpc.sessions import Peer, Session

PERIOD_S = 0.005
DEADLINE_S = 20.0


class EchoService:
    """Answers `echo` with the request's parameters, `later` when `finish` is called.

    What has no id is not answered.

    `big` answers with as many bytes as asked for; `fail` raises, which no real service does.
    """

    def __init__(self) -> None:
        self.sessions: list[Session] = []
        self.lines: list[bytes] = []
        self.received_s: list[float] = []
        self.served: list[Session] = []
        self.ended: list[Session] = []
        self.orphans: list[Session] = []
        self.waiting: list[tuple[Session, Any]] = []
        self.samples: list[Session] = []
        self.idle = True

    def opened(self, peer: Peer, _now_s: float) -> Session:
        self.sessions.append(Session(len(self.sessions) + 1, peer))
        return self.sessions[-1]

    def handle(
        self, session: Session, line: bytes, now_s: float, received_s: float | None = None
    ) -> None:
        self.received_s.append(now_s if received_s is None else received_s)
        self.lines.append(line)
        self.served.append(session)
        request = parse(line)
        if not isinstance(request, Request):
            session.write(error_line(request.identity, request.refusal))
        elif request.method == "fail":
            raise ZeroDivisionError("a defect")
        elif request.method == "later":
            session.unanswered += 1
            self.waiting.append((session, request.identity))
        elif request.method == "big":
            session.write(result_line(request.identity, encode("x" * request.params["size"])))
        elif request.identity is not None:
            session.write(result_line(request.identity, encode(dict(request.params))))

    def finish(self) -> None:
        """Answer all that waits."""
        for session, identity in self.waiting:
            session.unanswered -= 1
            session.write(result_line(identity, b"true"))
        self.waiting.clear()

    @property
    def pending(self) -> bool:
        return bool(self.samples)

    def send_one(self) -> None:
        self.samples.pop(0).write(notification_line("sample", b"{}"))

    def closed(self, session: Session, _now_s: float) -> None:
        self.ended.append(session)

    def process_ended(self, session: Session, _now_s: float) -> None:
        self.orphans.append(session)

    def is_idle(self, session: Session) -> bool:
        return not session.unanswered and self.idle


class Loop:
    """A reactor and a server at a socket; time passes in `until`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.service = EchoService()
        self.ticks = 0
        self.at_tick: Callable[[float], None] = lambda _now_s: None
        self.reactor = Reactor(PERIOD_S, self._tick)
        self.server = Server(self.reactor, listen(path, None), self.service)
        self.reactor.backlog = self.server
        self._condition: Callable[[], bool] = lambda: True
        self._ends_s = 0.0
        self._clients: list[socket.socket] = []

    def _tick(self, now_s: float) -> None:
        self.ticks += 1
        if self._condition() or now_s >= self._ends_s:
            self.reactor.stop()
        self.at_tick(now_s)

    def until(self, condition: Callable[[], bool]) -> None:
        """Run the loop until a condition holds; fail when it does not."""
        self._condition = condition
        self._ends_s = time.monotonic() + DEADLINE_S
        self.reactor.run()
        assert condition(), "did not happen in time"

    def run(self, ticks: int) -> None:
        """Run the loop for a number of ticks."""
        end = self.ticks + ticks
        self.until(lambda: self.ticks >= end)

    def connect(self) -> socket.socket:
        """Connect a client; its socket does not block."""
        client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._clients.append(client)
        client.connect(str(self.path))
        client.setblocking(False)
        return client

    def read(self, client: socket.socket, lines: int) -> list[dict[str, Any]]:
        """Run the loop until a client has been sent so many lines; return them, parsed."""
        received = bytearray()

        def enough() -> bool:
            with contextlib.suppress(BlockingIOError):
                while chunk := client.recv(65536):
                    received.extend(chunk)
            return received.count(b"\n") >= lines

        self.until(enough)
        return [json.loads(line) for line in bytes(received).splitlines() if line]

    def read_to_end(self, client: socket.socket) -> list[dict[str, Any]]:
        """Run the loop until a client has been closed; return what it was sent before."""
        received = bytearray()

        def ended() -> bool:
            try:
                while chunk := client.recv(65536):
                    received.extend(chunk)
            except BlockingIOError:
                return False
            except ConnectionResetError:
                return True  # closed with requests of ours unread
            return True

        self.until(ended)
        return [json.loads(line) for line in bytes(received).splitlines()[-1:] if line]

    def close(self) -> None:
        """Close everything."""
        for client in self._clients:
            client.close()
        self.server.close()
        self.reactor.close()


@contextlib.contextmanager
def running(path: Path) -> Iterator[Loop]:
    """Make a loop, and leave no socket open."""
    loop = Loop(path)
    try:
        yield loop
    finally:
        loop.close()


def line(method: str, identity: int = 1, **params: object) -> bytes:
    """Make a request line with its newline."""
    value = {"jsonrpc": "2.0", "id": identity, "method": method, "params": params}
    return json.dumps(value).encode() + b"\n"
