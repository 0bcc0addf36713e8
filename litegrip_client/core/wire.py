"""What the core needs of a connection to the daemon: for the type checker alone."""

from __future__ import annotations

from collections.abc import Coroutine, Mapping
from typing import Any, Protocol

from litegrip_client.errors import LiteGripError
from litegrip_client.exchange import Call, Progress, Undo


class Wire(Protocol):
    """A connection: what of it does not wait is described by `Exchange`."""

    @property
    def path(self) -> str:
        """The daemon's socket."""

    @property
    def client(self) -> int | None:
        """The daemon's number for the connection."""

    @property
    def stop_socket(self) -> str | None:
        """The daemon's priority socket for stops; None until the daemon reports it."""

    @property
    def daemon_pid(self) -> int:
        """The process id of the other end, 0 if unknown."""

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""

    @property
    def is_own(self) -> bool:
        """True if this process made the connection, not the parent process before a fork."""

    def prepare(self, method: str, params: Mapping[str, Any] | None = None) -> Call:
        """Make a call."""

    def prepare_guarded(
        self, method: str, params: Mapping[str, Any], on_progress: Progress | None = None
    ) -> Call:
        """Make a call that never acts after a stop that its sender did not know."""

    def accept(self, hello: Mapping[str, Any]) -> None:
        """Note what the daemon says of itself."""

    def note_stops(self, result: Mapping[str, Any]) -> None:
        """Store the stop generation of a result from any source."""

    def forget(self, call: Call) -> None:
        """Drop what still comes for a call."""

    def abandon(self, call: Call, undo: Undo) -> None:
        """Take back what a call begins, now or when its answer comes."""

    async def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a call, and return its result."""

    async def call(
        self, method: str, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call and run it."""

    async def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
        """Send a guarded request that gets no answer."""

    async def take_refusal(self) -> LiteGripError | None:
        """Return why the daemon refused such a request, once it has said so."""

    async def finish(self, coroutine: Coroutine[Any, Any, None]) -> None:
        """Await something to its end, even when the awaiting task is cancelled again."""

    async def close(self) -> None:
        """End the connection; in a forked child only the child's copy of it."""
