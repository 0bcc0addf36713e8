"""Clients that mean no good, each a process of its own, and what the daemon owes even to them.

python -m bench.hostile.clients KIND SOCKET [UID]

A client does rounds until its standard input ends. It says "on" after the first, its figures as
JSON at the end, and ends with an error where the daemon has not kept a promise of
docs/protocol.md. With UID it becomes that user first, which only root can.
"""

import contextlib
import json
import os
import random
import select
import socket
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from bench.hostile.lines import HostileLines
from bench.hostile.raw_connection import Connection, expect, reason_of
from litegripd.app.build import METHODS
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES, Request, parse

STATE_GET = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'
OTHERS_RIGHT = ("stop", "job.cancel", "lease.take", "config.set", "daemon.restart")
"""What any user of the same rights may do to whoever has the lease: the polite client beside could
then not expect that its motions succeed, and a restart, which begins only between its motions, ends
every connection. The fuzzer in virtual time does these as well."""


class Hostile:
    """One kind. `is_done`: the rounds are over, what is left is to wait for the end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.figures: Counter[str] = Counter()
        self.is_done = False

    def round(self) -> None:
        raise NotImplementedError

    def end(self) -> None:
        """Look at what is left from all rounds."""


class Fuzzer(Hostile):
    """Sends lines from nearly right to nonsense, in portions, and counts the answers of each."""

    PORTIONS, LINES = 10, 40

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        methods = [method for method in METHODS if method.name not in OTHERS_RIGHT]
        self._hostile = HostileLines(random.Random(1), methods)

    def round(self) -> None:
        with Connection(self.path) as connection:
            waiting = 0
            for number in range(self.PORTIONS):
                waiting = self._portion(connection, number, waiting)
            connection.send(b"x" * (MAX_LINE_BYTES + 1) + b"\n")
            last = connection.last_message()
            expect(reason_of(last) == "line_too_long" and last["id"] is None, last)
        self.figures["connections"] += 1

    def _portion(self, connection: Connection, number: int, waiting: int) -> int:
        """Send a portion, check what comes back; return how many requests wait for an answer."""
        lines = [line for _ in range(self.LINES) if (line := self._hostile.line()).strip()]
        large = [line for line in lines if b"rpc.discover" in line]
        lines = [line for line in lines if line not in large[1:]]  # four fill the backlog
        mark = f"mark {number}"
        asked = {"jsonrpc": "2.0", "id": mark, "method": "clients.list"}
        expect(connection.send(b"\n".join([*lines, json.dumps(asked).encode()]) + b"\n"), "closed")
        answers: list[dict[str, Any]] = []
        while (message := connection.message()).get("id") != mark:
            expect(bool(message), f"closed, {answers[-1:]} came last, after {lines}")
            answers += [message] * ("method" not in message)
        (me,) = [client for client in message["result"]["clients"] if client["is_me"]]
        silent = sum(b"stream.set" in line for line in lines)  # without an id, it has no answer
        more = len(answers) + me["waiting"] - waiting
        expect(len(lines) - silent <= more <= len(lines), (lines, answers, waiting, me))
        owed = {request.identity for line in lines if isinstance(request := parse(line), Request)}
        unanswered = owed - {None} - {answer["id"] for answer in answers}
        expect(len(unanswered) <= me["waiting"], (unanswered, lines, answers, me))
        self.figures["lines"] += len(lines)
        self.figures["refused"] += sum("error" in answer for answer in answers)
        waits: int = me["waiting"]
        return waits


class Flooder(Hostile):
    """Asks as fast as the daemon answers, a hundred at once."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._connection = Connection(path)

    def round(self) -> None:
        expect(self._connection.send(STATE_GET * 100), "a flooder that reads is closed")
        for _ in range(100):
            line = self._connection.line()
            expect(line.startswith(b'{"jsonrpc":"2.0","id":1,"result":{'), line)
        self.figures["requests"] += 100


class DeafFlooder(Hostile):
    """Asks and never reads, until it is closed; then it comes again."""

    def round(self) -> None:
        with Connection(self.path) as connection:
            while connection.send(STATE_GET * 100):
                pass
            expect(reason_of(connection.last_message()) == "backlog_full", "no reason")
        self.figures["closed"] += 1


class DeafSubscriber(Hostile):
    """Subscribes to all there is as often as may be, and never reads."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._deaf: list[Connection] = []

    def round(self) -> None:
        for _ in range(8):
            connection = Connection(self.path)
            for number in range(7):
                request = {"jsonrpc": "2.0", "id": number, "method": "state.subscribe"}
                connection.send(json.dumps({**request, "params": {"hz": 200}}).encode() + b"\n")
            connection.send(
                b'{"jsonrpc":"2.0","id":7,"method":"events.subscribe","params":{"kinds":'
                b'["job_started","job_ended","client_lost","lease","refused"]}}\n'
            )
            self._deaf.append(connection)
        self.is_done = True

    def end(self) -> None:
        for connection in self._deaf:
            with connection:
                connection.send(b'{"jsonrpc":"2.0","id":"last","method":"state.get"}\n')
                self._read(connection)

    def _read(self, connection: Connection) -> None:
        """Read all that was sent: up to the last answer, or to why the connection is closed."""
        message: dict[str, Any] = {}
        while message.get("id") != "last":
            line = connection.line()
            if not line:
                expect(reason_of(message) == "backlog_full", message)
                self.figures["closed"] += 1
                return
            with contextlib.suppress(ValueError):  # cut off; then comes the reason
                message = json.loads(line)
        expect("result" in message, message)
        self.figures["still there"] += 1


class Crowd(Hostile):
    """Takes every connection that it is given, and goes on knocking."""

    KNOCKS = 250

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._let_in: list[Connection] = []

    def round(self) -> None:
        while self._knock():
            pass
        for _ in range(self.KNOCKS - 1):
            self._knock()

    def end(self) -> None:
        for connection in self._let_in:
            with connection:
                expect(connection.send(STATE_GET), "one that was let in is closed")
                expect("result" in connection.message(), "one that was let in is not answered")

    def _knock(self) -> bool:
        """Connect and ask; tell whether we were let in."""
        connection = Connection(self.path)
        connection.send(STATE_GET)
        message = connection.message()
        if "result" in message:
            self._let_in.append(connection)
            self.figures["let in"] += 1
            return True
        with connection:
            expect(reason_of(message) == "too_many_connections", message)
            expect(connection.line() == b"", "a refused connection stays open")
        self.figures["turned away"] += 1
        return False


class HalfOpen(Hostile):
    """Leaves connections in every half-way state that a socket can have."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._silent = [Connection(path) for _ in range(8)]
        for connection in self._silent:
            connection.send(STATE_GET[:20])

    def round(self) -> None:
        self._ends_sending(b"", [])
        self._ends_sending(STATE_GET, [None])
        self._ends_sending(STATE_GET + STATE_GET[:20], [None, "parse_error"])
        self._ends_reading()
        for left in (STATE_GET * 100, STATE_GET[:20]):  # gone, and nothing was read
            with Connection(self.path) as connection:
                connection.send(left)
        self.figures["rounds"] += 1

    def end(self) -> None:
        for connection in self._silent:
            with connection:
                connection.send(STATE_GET[20:])
                expect("result" in connection.message(), "half a line was forgotten")

    def _ends_sending(self, sent: bytes, reasons: list[str | None]) -> None:
        with Connection(self.path) as connection:
            connection.send(sent)
            connection.socket.shutdown(socket.SHUT_WR)
            told = [reason_of(message) for message in iter(connection.message, {})]
            expect(told == reasons, (sent, told))

    def _ends_reading(self) -> None:
        with Connection(self.path) as connection:
            connection.socket.shutdown(socket.SHUT_RD)
            while connection.send(STATE_GET):  # until it is closed, for it takes no answer
                pass


KINDS: dict[str, type[Hostile]] = {
    "fuzzer": Fuzzer,
    "flooder": Flooder,
    "deaf flooder": DeafFlooder,
    "deaf subscriber": DeafSubscriber,
    "crowd": Crowd,
    "half open": HalfOpen,
}


def main() -> None:
    kind, path, *uid = sys.argv[1:]
    for one in map(int, uid):
        os.setgroups([])
        os.setgid(one)
        os.setuid(one)
    hostile = KINDS[kind](Path(path))
    hostile.round()
    print("on", flush=True)
    while not select.select([sys.stdin], [], [], None if hostile.is_done else 0.0)[0]:
        hostile.round()
    hostile.end()
    print(json.dumps(hostile.figures))


if __name__ == "__main__":
    main()
