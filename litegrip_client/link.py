"""The connection of one `LiteGrip` object, for threads."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from litegrip_client.blocking import BlockingWire, pause
from litegrip_client.connection import Connection
from litegrip_client.core import link as core
from litegrip_client.core.link import ACTION_TIMEOUT_S
from litegrip_client.discovery import connect

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, TypeVar

    from litegrip_client.core.wire import Wire

    _Result = TypeVar("_Result")

__all__ = ["ACTION_TIMEOUT_S", "Link"]


class Link(core.Link):
    """A daemon, by channel, and the connection to it while there is one."""

    async def _connect(self) -> Wire:
        return BlockingWire(connect(self.channel, self.socket_path))

    async def reach(self, path: str, timeout_s: float) -> Wire:
        """Connect to another socket of the same daemon; raises `OSError`."""
        return BlockingWire(Connection(path, timeout_s))

    async def ask(self, method: str, params: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Make a call, even from a signal handler whose thread waits for an answer."""
        connection = self.connection
        if not connection.is_waiting_here:
            return connection.call(method, params)
        with Connection(connection.path) as another:
            return another.call(method, params)

    async def aside(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Return what `function` does."""
        return function(*arguments)

    async def pause(self, seconds: float) -> None:
        """Wait for a while."""
        await pause(seconds)

    @property
    def connection(self) -> Connection:
        """The connection; raises `ConnectError` when there is none."""
        wire = self.wire
        if not isinstance(wire, BlockingWire):
            raise TypeError(f"{wire!r} does not block")
        return wire.connection
