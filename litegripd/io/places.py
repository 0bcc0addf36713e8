"""The three sockets by which a daemon has its place in the system; a successor gets the same ones.

They are the claim on the channel, the stop socket and the socket of all other requests. Since they
are never closed in between, no attempt to connect fails while one process takes another's place.
"""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from litegripd.io.listener import LISTEN_BACKLOG, ChannelClaim, listen_on_all


@dataclass(frozen=True, slots=True)
class Places:
    """The sockets, and the paths of those that have one."""

    claim: ChannelClaim
    stops: socket.socket
    requests: socket.socket
    stop_path: Path
    path: Path

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What a successor gets."""
        return (self.claim.fileno(), self.stops.fileno(), self.requests.fileno())

    def name_owner(self) -> None:
        """Let the kernel name this process to whoever asks who listens."""
        self.claim.name_owner()
        for listener in (self.stops, self.requests):
            listener.listen(LISTEN_BACKLOG)

    def remove(self) -> None:
        """Remove the files; the sockets are closed by those who serve them."""
        for path in (self.path, self.stop_path):
            path.unlink(missing_ok=True)


def occupy(interface: str, channel: str, path: Path, group: str | None) -> Places:
    """Take the places; raises `InUseError` where one belongs to another process."""
    claim = ChannelClaim(interface, channel)
    stop_path = stop_socket_path(path)
    # In this order, so that whoever has reached the one can stop by the other.
    stops, requests = listen_on_all((stop_path, path), group)
    return Places(claim, stops, requests, stop_path, path)


def take_over(interface: str, channel: str, path: Path, descriptors: Sequence[int]) -> Places:
    """Make the places of what a predecessor has handed over."""
    claim, stops, requests = (socket.socket(fileno=descriptor) for descriptor in descriptors)
    return Places(
        ChannelClaim(interface, channel, claim), stops, requests, stop_socket_path(path), path
    )


def stop_socket_path(path: Path) -> Path:
    """Return where stops are taken: `can0.stop.sock` beside `can0.sock`."""
    return path.parent / f"{path.name.removesuffix('.sock')}.stop.sock"
