"""Runs `litegripd-web` as a process of its own, and speaks to it as browsers do, or must not."""

import contextlib
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from litegrip_web.bridge import TOKEN_WITHIN_S
from litegrip_web.proof import proof
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, line_of, written

CHANNEL = "can7"
START = """
import asyncio, contextlib, encodings.idna, os, sys
from litegrip_web import bridge, main
uid, token_within_s, *arguments = sys.argv[1:]
bridge.TOKEN_WITHIN_S = float(token_within_s)
@contextlib.asynccontextmanager
async def listening(settings, whole=main.listening):
    async with whole(settings) as address:
        if int(uid) != os.getuid():
            os.setgroups([]), os.setgid(int(uid)), os.setuid(int(uid))
        yield address
main.listening = listening
sys.exit(main.main(arguments))
"""
"""Becomes another user late: that one may not read what Python imports and the page's files."""


class Page:
    """A running `litegripd-web`; `uid` is the user it runs as, if not this one."""

    def __init__(
        self,
        *arguments: str,
        uid: int | None = None,
        channels: tuple[str, ...] = (CHANNEL,),
        token_within_s: float = TOKEN_WITHIN_S,
    ) -> None:
        own = (str(uid or os.getuid()), str(token_within_s))
        self.process = subprocess.Popen(
            [sys.executable, "-c", START, *own, *channels, "--port=0", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.told = line_of(self.process)
        self.url, _, self.token = self.told.partition("#")
        self.port = int(self.url.split(":")[2].partition("/")[0])

    def get(self, path: str = "/", **headers: str) -> http.client.HTTPResponse:
        """Ask as a browser would, but with these headers."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=DEADLINE_S)
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection.getresponse()

    @contextlib.contextmanager
    def connect(
        self, *, origin: str | None = "own", host: str | None = None, token: str | None = "own"
    ) -> Iterator[ClientConnection]:
        """Connect to the gripper: as the page itself does, if nothing else is said."""
        own = self.url.rstrip("/")
        with connect(
            f"ws://{host or f'127.0.0.1:{self.port}'}/ws/{CHANNEL}",
            sock=socket.create_connection(("127.0.0.1", self.port), timeout=DEADLINE_S),
            origin=None if origin is None else Origin(own if origin == "own" else origin),
            proxy=None,
        ) as browser:
            if token is not None:
                prove(
                    browser,
                    self.token if token == "own" else token,
                    host or f"127.0.0.1:{self.port}",
                )
            yield browser

    def close(self) -> str:
        """End it as an operator would; return what it said on standard error."""
        self.process.send_signal(signal.SIGTERM)
        _, errors = self.process.communicate(timeout=DEADLINE_S)
        assert self.process.returncode == 0, errors
        return errors


@contextlib.contextmanager
def page(*arguments: str, **more: Any) -> Iterator[Page]:
    """Run a page, made as `Page` says, that must still be well at the end."""
    running = Page(*arguments, **more)
    try:
        yield running
        assert "Traceback" not in running.close()
    finally:
        running.process.kill()
        running.process.communicate()


@contextlib.contextmanager
def mortal(
    folder: Path, name: str
) -> Iterator[tuple[Callable[[], DaemonProcess], DaemonProcess, Page]]:
    """Run a daemon that a test may kill, and a page for it; with what starts the next daemon."""
    arguments = (*written(folder), "--socket", str(folder / "rpc.sock"))
    with contextlib.ExitStack() as stack:

        def run() -> DaemonProcess:
            started = DaemonProcess(folder, f"{name}-{os.getpid()}", *arguments)
            stack.callback(started.kill)
            return started

        first = run()
        yield run, first, stack.enter_context(page("--socket", str(first.socket_path), "--operate"))


class StandIn:
    """What stands in for a daemon, and keeps the lines that reach it.

    It answers each with its method; `is_stuck` makes it answer none, but stops.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "rpc.sock"
        self.lines: list[dict[str, Any]] = []
        self.stops: list[dict[str, Any]] = []
        self.is_stuck = False
        self._came = threading.Condition()
        self._listeners = [
            self._listen(self.path, self._serve),
            self._listen(folder / "rpc.stop.sock", self._serve_stop),
        ]

    def until(self, condition: Callable[["StandIn"], bool]) -> None:
        """Wait until what has come meets a condition."""
        with self._came:
            assert self._came.wait_for(lambda: condition(self), DEADLINE_S), self.lines

    def forget(self) -> None:
        """Be as at the beginning."""
        with self._came:
            self.lines.clear()
            self.stops.clear()
        self.is_stuck = False

    def close(self) -> None:
        for listener in self._listeners:
            listener.shutdown(socket.SHUT_RDWR)
            listener.close()

    def _listen(self, path: Path, serve: Callable[[socket.socket], None]) -> socket.socket:
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(path))
        listener.listen()

        def accept() -> None:
            with contextlib.suppress(OSError):  # closed: the test has ended
                while True:
                    taken, _ = listener.accept()
                    threading.Thread(target=serve, args=(taken,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        return listener

    def _serve(self, taken: socket.socket) -> None:
        with taken, taken.makefile("rb") as file:
            for line in file:
                request = json.loads(line)
                if request.get("params", {}).get("client") == "litegripd-web":
                    file.read()  # the page's own, which no browser asked for: it gets nothing
                    return
                with self._came:
                    self.lines.append(request)
                    self._came.notify_all()
                if not self.is_stuck:
                    answer = {"jsonrpc": "2.0", "id": request["id"], "result": request["method"]}
                    taken.sendall(json.dumps(answer).encode() + b"\n")

    def _serve_stop(self, taken: socket.socket) -> None:
        with taken, taken.makefile("rb") as file:
            request = json.loads(file.readline())
            with self._came:
                self.stops.append(request)
                self._came.notify_all()
            result = {"level": request["params"]["level"], "generation": 1}
            answer = {"jsonrpc": "2.0", "id": request["id"], "result": result}
            taken.sendall(json.dumps(answer).encode() + b"\n")


@contextlib.contextmanager
def stand_in(folder: Path) -> Iterator[StandIn]:
    running = StandIn(folder)
    try:
        yield running
    finally:
        running.close()


NONCE = "n" * 43


def prove(browser: ClientConnection, token: str, host: str) -> None:
    """Prove that this browser knows a token; that the server has proved it is tried elsewhere."""
    browser.send(json.dumps({"nonce": NONCE}))
    told = json.loads(browser.recv(DEADLINE_S))
    browser.send(json.dumps({"proof": proof(token, "page", host, NONCE, told["nonce"])}))


def welcome(browser: ClientConnection) -> dict[str, Any]:
    """Return what a browser is told first."""
    told: dict[str, Any] = json.loads(browser.recv(DEADLINE_S))
    assert told["method"] == "web.welcome", told
    params: dict[str, Any] = told["params"]
    return params


def ask(browser: ClientConnection, text: str | bytes) -> dict[str, Any]:
    """Send a message; return the next answer."""
    browser.send(text)
    answer: dict[str, Any] = json.loads(browser.recv(DEADLINE_S))
    return answer


def request(method: str, **params: object) -> str:
    return json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})


def reason(answer: dict[str, Any]) -> str:
    """Return why something was refused."""
    assert "error" in answer, answer
    told: str = answer["error"]["data"]["reason"]
    return told
