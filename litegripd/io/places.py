"""The three sockets by which a daemon has its place in the system; a successor gets the same ones.

They are the claim on the channel, the stop socket and the socket of all other requests. Since they
are never closed in between, no attempt to connect fails while one process takes another's place.
"""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from litegripd.io.listener import LISTEN_BACKLOG, ChannelClaim, InUseError, listen_on_all

_SOCKETS = 3
STOP_ENDING = ".stop.sock"


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
        sockets = (self.claim.fileno(), self.stops.fileno(), self.requests.fileno())
        return (*sockets, *self.claim.descriptors)

    def name_owner(self) -> None:
        """Let the kernel name this process to whoever asks who listens."""
        self.claim.name_owner()
        for listener in (self.stops, self.requests):
            listener.listen(LISTEN_BACKLOG)

    def remove(self) -> None:
        """Remove the files; the sockets are closed by those who serve them."""
        for path in (self.path, self.stop_path):
            path.unlink(missing_ok=True)
        self.claim.remove()


def occupy(interface: str, channel: str, path: Path, group: str | None) -> Places:
    """Take the places; raises `InUseError` where one belongs to another process."""
    if path.name.endswith(STOP_ENDING):
        raise InUseError(f"{path}: names that end in {STOP_ENDING} are kept for stop sockets")
    claim = ChannelClaim(interface, channel)
    stop_path = stop_socket_path(path)
    # In this order, so that whoever has reached the one can stop by the other.
    try:
        stops, requests = listen_on_all((stop_path, path), group)
    except InUseError:
        claim.remove()
        claim.close()
        raise
    return Places(claim, stops, requests, stop_path, path)


def take_over(interface: str, channel: str, path: Path, descriptors: Sequence[int]) -> Places:
    """Make the places of what a predecessor has handed over."""
    *sockets, lock = (*descriptors, None) if len(descriptors) == _SOCKETS else descriptors
    claim, stops, requests = (socket.socket(fileno=descriptor) for descriptor in sockets)
    claimed = ChannelClaim(interface, channel, claim, lock)
    return Places(claimed, stops, requests, stop_socket_path(path), path)


def stop_socket_path(path: Path) -> Path:
    """Return where stops are taken: `can0.stop.sock` beside `can0.sock`."""
    return path.parent / f"{path.name.removesuffix('.sock')}{STOP_ENDING}"
