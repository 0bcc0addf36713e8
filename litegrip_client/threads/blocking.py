"""Runs the core's coroutines without an event loop: they block instead of being suspended."""

from __future__ import annotations

import time
from collections.abc import Callable, Coroutine, Mapping

from litegrip_client.core.discovery import reach
from litegrip_client.core.session import DaemonSession, own_jobs
from litegrip_client.line.connection import Connection
from litegrip_client.line.exchange import DEFAULT_TIMEOUT_S
from litegrip_client.values.errors import LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeVar

    from litegrip_client.core.session import Wire
    from litegrip_client.line.exchange import Call
    from litegrip_client.values.figures import Here

    _Result = TypeVar("_Result")


def complete(coroutine: Coroutine[Any, Any, _Result]) -> _Result:
    """Run a coroutine to its end, here and now: nothing that it awaits ever suspends it."""
    try:
        coroutine.send(None)
    except StopIteration as end:
        result: _Result = end.value
        return result
    coroutine.close()
    raise RuntimeError(f"{coroutine!r} wants an event loop")


async def pause(seconds: float) -> None:
    """Let the thread wait for a while."""
    time.sleep(seconds)


class BlockingWire:
    """A connection whose coroutines block the thread until they are done."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection

    async def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a call, and return its result."""
        return self.connection.run(call, timeout_s)

    async def call(
        self, method: str, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call and run it."""
        return self.connection.call(method, params, timeout_s)

    async def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
        """Send a guarded request that gets no answer."""
        self.connection.notify_guarded(method, params)

    async def take_refusal(self) -> LiteGripError | None:
        """Return the daemon's refusal of such a request, or None."""
        return self.connection.take_refusal()

    async def finish(self, begin: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Await what `begin` returns; another interrupt ends that."""
        await begin()

    async def close(self) -> None:
        """End the connection; in a forked child only the child's copy of it."""
        self.connection.close()


def connect(
    channel: str,
    socket_path: str | None = None,
    timeout_s: float = DEFAULT_TIMEOUT_S,
    *,
    left_out: bool = False,
    here: Here = str,
) -> Connection:
    """Connect to the daemon of `channel`; raises `ConnectError` that lists the attempts."""

    async def attempt(candidate: str) -> Connection:
        return Connection(candidate, timeout_s)

    return complete(reach(channel, socket_path, attempt, left_out=left_out, here=here))


class BlockingSession(DaemonSession):
    """A daemon, by channel, and the connection to it while there is one."""

    async def _connect(self) -> Wire:
        left_out = self.channel_left_out
        at = self.chosen, self.socket_path
        return BlockingWire(connect(*at, left_out=left_out, here=self.here))

    async def reach(self, path: str, timeout_s: float) -> Wire:
        """Connect to another socket of the same daemon; raises `OSError`."""
        return BlockingWire(Connection(path, timeout_s))

    async def ask(
        self, method: str, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call, even from a signal handler whose thread waits for an answer."""
        connection = self.connection
        if not connection.is_waiting_here:
            return connection.call(method, params, timeout_s)
        with Connection(connection.socket_path) as another:
            another.voice = self.voice
            return another.call(method, params, timeout_s)

    async def cancel_own(self) -> bool:
        """Cancel what moves for this session's connection, also from a signal handler.

        If its thread waits for an answer there, the handler must not wait: then the thread sends
        the cancelling as soon as it goes on, and this is true.
        """
        connection = self.connection
        if not connection.is_waiting_here:
            return await super().cancel_own()
        self.cancels += 1

        def cancel(result: dict[str, Any]) -> None:
            for number in own_jobs(connection, result["jobs"]):
                connection.post("job.cancel", {"job": number})

        connection.post("job.list", {}, cancel)
        return True

    async def run_blocking(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Run a function; return its result."""
        return function(*arguments)

    async def pause(self, seconds: float) -> None:
        """Let the thread wait for a while."""
        await pause(seconds)

    @property
    def connection(self) -> Connection:
        """The connection; raises `ConnectError` when there is none."""
        wire = self.wire
        if not isinstance(wire, BlockingWire):
            raise TypeError(f"{wire!r} does not block")
        return wire.connection
