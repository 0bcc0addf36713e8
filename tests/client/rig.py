"""The client, for threads or on asyncio, at the real daemon's core in virtual time.

A test is one text for both kinds: `Asyncio` lends the asyncio client the manners of the other one.
What a daemon never says is put in its mouth by `Heard.instead`.
"""

import asyncio
import gc
import json
import selectors
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, TypeAlias, TypeVar, cast

import pytest

from litegrip_client import LiteGrip, aio
from litegrip_client.aio.gripper import Connection as AsyncConnection
from litegrip_client.core.sockets import SYSTEM_DIRECTORY
from litegrip_client.ctl.main import main
from litegrip_client.line.connection import Connection
from litegripd.app.machine import Ending
from litegripd.model.sentence import terms_of
from litegripd.rpc.jsonrpc import error_line
from tests.client.fake_daemon import DEADLINE_S, FakeDaemon, Request
from tests.client.helpers import in_thread
from tests.drop_in import Daemon, Site, VirtualStream, a_site

_Result = TypeVar("_Result")

GUARDS = ("sent_s", "stop_generation")
"""What tells a motion's request from one that was sent before a stop."""

Ctl: TypeAlias = Callable[..., tuple[int, str, str]]
"""Runs litegripctl: its arguments in, its exit code and its two outputs out."""


@dataclass(frozen=True, slots=True)
class Asked:
    """One request as the daemon got it."""

    identity: int | None
    method: str
    params: dict[str, Any]

    @property
    def plain(self) -> dict[str, Any]:
        """The parameters without what guards a motion."""
        return {name: value for name, value in self.params.items() if name not in GUARDS}


class Refuse:
    """An error in place of the daemon's answer; its message may be a `Sentence`."""

    def __init__(self, reason: str, code: int, message: str = "no", **data: Any) -> None:
        detail = {"reason": reason, "retryable": False, **data}
        if terms := terms_of({"message": message, **data}):
            detail["terms"] = terms
        self.error = {"code": code, "message": message, "data": detail}


SILENT = object()
"""No answer."""


class Heard(Daemon):
    """A daemon that keeps what it is asked; `instead` of its answer to a method it gives another.

    That is a result, a `Refuse`, `SILENT`, or a function that returns one of these for a request;
    None is the daemon's own answer. A method that is `late` reaches it after so many seconds.
    """

    def __init__(self, *arguments: Any, **settings: Any) -> None:
        super().__init__(*arguments, **settings)
        self.requests: list[Asked] = []
        self.instead: dict[str, Any] = {}
        self.late: dict[str, float] = {}
        self._is_frozen = False
        self._unread: list[Callable[[], None]] = []
        self.streams: list[Line] = []

    def methods(self) -> list[str]:
        return [request.method for request in self.requests]

    def asked(self, method: str) -> list[dict[str, Any]]:
        """Return with which parameters a method was called, its guards left out."""
        return [request.plain for request in self.requests if request.method == method]

    @property
    def wire_state(self) -> dict[str, Any]:
        """The state as it is sent."""
        state: dict[str, Any] = self.client().result("state.get")
        return state

    def freeze(self) -> None:
        """Neither read nor write any more, as a process that is stopped; its connections stay."""
        self._is_frozen = True

    def thaw(self) -> None:
        """Go on, with what was sent meanwhile."""
        self._is_frozen = False
        unread, self._unread = self._unread, []
        for read in unread:
            read()

    @property
    def is_frozen(self) -> bool:
        """True from `freeze` to `thaw`."""
        return self._is_frozen

    def read(self, reading: Callable[[], None]) -> None:
        """Take a request, now or when it goes on."""
        if self._is_frozen:
            self._unread.append(reading)
        else:
            reading()

    def end(self) -> None:
        """End in order, and say so to every client."""
        ending = Ending(self.machine)
        ending.begin(self.now_s)
        self.run_until(lambda: ending.is_over(self.now_s), 5.0)
        parting = ending.parting()
        assert parting is not None
        for stream in self.streams:
            stream.hear(error_line(None, parting))
        self.hang_up()

    def hang_up(self) -> None:
        """End as a daemon ends that is killed: all connections are gone."""
        for stream in self.streams:
            stream.close()


class Line(VirtualStream):
    """A connection of which the daemon keeps what it hears."""

    peer_pid = 0

    def __init__(self, site: "Bench", daemon: Heard) -> None:
        super().__init__(site, daemon)
        self._heard = daemon
        daemon.streams.append(self)

    def send(self, line: bytes, _timeout_s: float) -> None:
        for one in line.splitlines():
            data = json.loads(one)
            request = Asked(data.get("id"), data["method"], data.get("params", {}))
            self._heard.requests.append(request)
            delay_s = self._heard.late.get(request.method)
            if delay_s is None:
                self._heard.read(partial(self._answer, request, one))
            else:
                self._site.after(delay_s, partial(self._answer, request, one))

    def _answer(self, request: Asked, line: bytes) -> None:
        answer = self._heard.instead.get(request.method)
        if callable(answer):
            answer = answer(request)
        if answer is None:
            super().send(line, 0.0)
        elif answer is not SILENT:
            result = {"error": answer.error} if isinstance(answer, Refuse) else {"result": answer}
            message = {"jsonrpc": "2.0", "id": request.identity, **result}
            self._session.outgoing.append(json.dumps(message).encode() + b"\n")

    def say(self, method: str, params: Mapping[str, Any]) -> None:
        """Put a notification in the daemon's mouth."""
        message = {"jsonrpc": "2.0", "method": method, "params": params}
        self.hear(json.dumps(message).encode() + b"\n")

    def hear(self, line: bytes) -> None:
        """Have a line come from the daemon."""
        self._session.outgoing.append(line)

    def _take(self) -> bool:
        return not self._heard.is_frozen and super()._take()

    @property
    def has_more(self) -> bool:
        is_heard = bool(self._session.outgoing) and not self._heard.is_frozen
        return is_heard or self.hung_up

    def take(self) -> bytes:
        received = b"".join(self._session.outgoing)
        self._session.outgoing.clear()
        return received


class Bench(Site):
    """A machine whose daemons keep what they hear."""

    def heard(self, path: str) -> Heard:
        """Return the daemon whose socket would be at `path`."""
        at = Path(path)
        daemon = self._daemons.get(at.stem) if str(at.parent) == SYSTEM_DIRECTORY else None
        if daemon is None:
            raise FileNotFoundError(2, "No such file or directory", path)
        return cast("Heard", daemon)

    def channels(self) -> list[str]:
        """Return the channels that have a daemon."""
        return sorted(self._daemons)

    def open_stream(self, path: str, _timeout_s: float) -> Line:
        return Line(self, self.heard(path))


class AsyncLine:
    """Stands in for the asyncio client's `LineStream`, whose methods these are."""

    peer_pid = 0
    is_full = False

    def __init__(
        self, site: Bench, on_lines: Callable[[list[bytes]], None], on_change: Callable[[], None]
    ) -> None:
        self.ended = False
        self._site = site
        self._on_lines = on_lines
        self._on_change = on_change
        self._line: Line | None = None

    async def connect(self, path: str, timeout_s: float) -> None:
        self._line = self._site.open_stream(path, timeout_s)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, Loop)
        loop.lines.append(self)

    def send(self, line: bytes) -> None:
        if self._line is not None and not self._line.hung_up:
            self._line.send(line, 0.0)

    def deliver(self) -> bool:
        """Have what has come taken soon; return False if there is nothing."""
        if self._line is None or not self._line.has_more:
            return False
        asyncio.get_running_loop().call_soon(self._taken, self._line.take(), self._line.hung_up)
        if self._line.hung_up:
            self._line = None
        return True

    def _taken(self, received: bytes, ends: bool) -> None:
        if received:
            self._on_lines(received.splitlines())
        if ends:
            self.ended = True
            self._on_change()

    def abort(self) -> None:
        if self._line is not None:
            self._line.close()

    def close_here(self) -> None:
        if self._line is not None:
            self._line.close(shared=True)


_SLICE_S, _TURNS = 0.5, 20


class _Selector(selectors.SelectSelector):
    """Lets virtual time pass where an event loop would wait."""

    loop: "Loop"

    def select(self, timeout: float | None = None) -> list[Any]:
        events = super().select(0.0)
        site, loop = self.loop.site, self.loop
        ends_s = site.now_s + (_SLICE_S if timeout is None else min(timeout, _SLICE_S))
        loop.is_woken = bool(events)
        loop.turns = loop.turns + 1 if timeout == 0.0 else 0
        if loop.turns > _TURNS:  # tasks that only give way take their time as well
            loop.turns = 0
            site.tick()
        while sum(line.deliver() for line in loop.lines) == 0:
            if loop.is_woken or site.now_s >= ends_s:
                break
            site.tick()
        return events


class _Here(ThreadPoolExecutor):
    """Does what would be a thread's at once: no test depends on how fast threads are."""

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments, **named))
        except BaseException as error:  # noqa: BLE001 - raised where it is awaited
            future.set_exception(error)
        return future


class Loop(asyncio.SelectorEventLoop):
    """An event loop in the time of a site."""

    def __init__(self, site: Bench) -> None:
        self.site = site
        self.lines: list[AsyncLine] = []
        self.is_woken = False
        self.turns = 0
        selector = _Selector()
        selector.loop = self
        super().__init__(selector)
        self.set_default_executor(_Here())

    def time(self) -> float:
        return self.site.now_s

    def call_soon(  # type: ignore[override]
        self, callback: Any, *arguments: Any, context: Any = None
    ) -> asyncio.Handle:
        self.is_woken = True
        return super().call_soon(callback, *arguments, context=context)


class Lent:
    """Something of the asyncio client, used as one for threads is."""

    def __init__(self, kind: "Asyncio", real: Any) -> None:
        self.__dict__.update(_kind=kind, _real=real)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._real, name)
        if name in _ASKING:  # properties of the other client
            value = value()
        elif callable(value):
            return lambda *arguments, **named: self._kind.lend(value(*arguments, **named))
        return self._kind.lend(value)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self._real, name, value)

    def __enter__(self) -> Any:
        return self._kind.lend(self._real.__aenter__())

    def __exit__(self, *details: Any) -> Any:
        return self._kind.lend(self._real.__aexit__(*details))

    def __iter__(self) -> "Lent":
        self._real.__aiter__()
        return self

    def __next__(self) -> Any:
        try:
            return self._kind.lend(self._real.__anext__())
        except StopAsyncIteration:
            raise StopIteration from None


_ASKING = ("config", "mount")


class Threads:
    """A program with the client for threads; `awaits` stands before a call that is named."""

    awaits = ""

    interrupted: type[BaseException] = KeyboardInterrupt

    def __init__(self, site: Bench | None = None) -> None:
        """Without a `site` time is the real one, and so are sockets."""
        self._site = site

    @property
    def site(self) -> Bench:
        assert self._site is not None
        return self._site

    def gripper(self, channel: str | None = "can0", *arguments: Any, **settings: Any) -> LiteGrip:
        return LiteGrip(channel, *arguments, **settings)

    def interrupt(self, within_s: float = 0.0) -> None:
        """Interrupt the call that waits by then: the next period at the soonest."""

        def interrupt() -> None:
            raise KeyboardInterrupt

        self.site.after(within_s, interrupt)

    def pause(self, seconds: float) -> None:
        """Let the program do nothing for a while."""
        self.site.run(seconds)

    def ask(self, gripper: LiteGrip, method: str, **params: Any) -> dict[str, Any]:
        """Call a raw method over a gripper's connection."""
        return gripper._session.connection.call(method, params)

    def connect(self, path: str, timeout_s: float) -> Connection:
        """Return a raw connection."""
        return Connection(path, timeout_s)

    def begin(self, owner: Any, name: str, *arguments: Any, **named: Any) -> Callable[[], Any]:
        """Begin a call beside others; what this returns waits for its result."""
        return in_thread(partial(getattr(owner, name), *arguments, **named))

    def arrived(self, daemon: FakeDaemon, method: str, count: int = 1) -> list[Request]:
        """Wait until requests have come to a scripted daemon."""
        return daemon.wait_for(method, count)

    def close(self) -> None:
        """There is nothing to end."""


class Asyncio:
    """A program with the client for asyncio, each of whose calls is a task of its own."""

    awaits = "await "

    interrupted: type[BaseException] = asyncio.CancelledError

    def __init__(self, site: Bench | None = None) -> None:
        """Without a `site` time is the real one, and so are sockets."""
        self.loop = asyncio.new_event_loop() if site is None else Loop(site)
        self.loop.set_debug(site is None)
        self.loop.slow_callback_duration = DEADLINE_S  # a tick is not slow, but the machine is busy
        self._site = site
        self._task: asyncio.Task[Any] | None = None
        self._complaints: list[dict[str, Any]] = []
        self.loop.set_exception_handler(lambda _loop, context: self._complaints.append(context))

    def gripper(self, channel: str | None = "can0", *arguments: Any, **settings: Any) -> LiteGrip:
        return cast("LiteGrip", Lent(self, aio.LiteGrip(channel, *arguments, **settings)))

    def lend(self, value: Any) -> Any:
        """Return a value, or what a coroutine returns, with the other client's manners."""
        if asyncio.iscoroutine(value):
            value = self._completed(value)
        is_lent = hasattr(value, "__aenter__") or hasattr(value, "__anext__")
        return Lent(self, value) if is_lent or isinstance(value, AsyncConnection) else value

    def _completed(self, coroutine: Any) -> Any:
        self._task = task = self.loop.create_task(coroutine)
        return self.loop.run_until_complete(task)

    def interrupt(self, within_s: float = 0.0) -> None:
        """Cancel the task that waits by then: the next period at the soonest."""

        def cancel() -> None:
            assert self._task is not None
            self._task.cancel()

        assert self._site is not None
        self._site.after(within_s, cancel)

    def pause(self, seconds: float) -> None:
        """Let the program do nothing for a while."""
        self.run(asyncio.sleep(seconds))

    def ask(self, gripper: LiteGrip, method: str, **params: Any) -> dict[str, Any]:
        """Call a raw method over a gripper's connection."""
        connection = cast("aio.LiteGrip", gripper)._session.connection
        return self.run(connection.call(method, params))

    def connect(self, path: str, timeout_s: float) -> Connection:
        """Return a raw connection."""
        return cast("Connection", self.lend(AsyncConnection.open(path, timeout_s)))

    def begin(self, owner: Any, name: str, *arguments: Any, **named: Any) -> Callable[[], Any]:
        """Begin a call beside others; what this returns waits for its result."""
        task = self.loop.create_task(getattr(owner._real, name)(*arguments, **named))
        return lambda: self.loop.run_until_complete(task)

    def arrived(self, daemon: FakeDaemon, method: str, count: int = 1) -> list[Request]:
        """Wait until requests have come to a scripted daemon; the event loop goes on meanwhile."""
        return self.run(asyncio.to_thread(daemon.wait_for, method, count))

    def run(self, coroutine: Coroutine[Any, Any, _Result]) -> _Result:
        """Run a coroutine to its end."""
        return self.loop.run_until_complete(coroutine)

    def use(self, scene: Callable[[aio.LiteGrip], Coroutine[Any, Any, None]]) -> None:
        """Play a scene with a connected gripper, which is enabled."""

        async def main() -> None:
            async with aio.LiteGrip() as gripper:
                assert await gripper.enable()
                await scene(gripper)

        self.run(main())

    def close(self) -> None:
        """End the event loop; fail for tasks that are left, and for errors of callbacks."""
        left = asyncio.all_tasks(self.loop)
        self.loop.close()
        gc.collect(1)  # what warns of being left behind does so now, which is an error
        assert not left
        assert not self._complaints


def cancelling(task: "asyncio.Task[Any]") -> Callable[[object], None]:
    """Return what cancels a task as soon as an answer is read, before the task has its turn."""

    def cancel(_result: object) -> None:
        task.cancel()

    return cancel


Kind: TypeAlias = "Threads | Asyncio"


@contextmanager
def a_bench(home: Path) -> Iterator[Bench]:
    """Give a machine of its own to the client of both kinds, and to litegripctl."""
    site = Bench()
    with a_site(home, site=site), pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "litegrip_client.aio.gripper.LineStream",
            lambda on_lines, on_change: AsyncLine(site, on_lines, on_change),
        )
        clock = SimpleNamespace(monotonic=lambda: site.now_s, sleep=site.run)
        patch.setattr("litegrip_client.ctl.commands.teleop.time", clock)
        # What really runs on this machine is nobody's to find, and least of all to stop.
        patch.setattr("litegrip_client.ctl.commands.state.stop_at", _no_stop_socket)
        for module in ("run", "render"):
            for name in ("channels_with_socket", "running_channels"):
                patch.setattr(f"litegrip_client.ctl.{module}.{name}", site.channels)
        yield site


def _no_stop_socket(path: str, *_arguments: object) -> NoReturn:
    raise FileNotFoundError(2, "No such file or directory", path)


def run_ctl(capsys: pytest.CaptureFixture[str]) -> Ctl:
    """Return what runs litegripctl."""

    def run(*arguments: str) -> tuple[int, str, str]:
        code = main(list(arguments))
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run
