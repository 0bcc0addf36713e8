"""Plain UDP ends whose listening fails: that is told, and they are opened anew."""

import socket
import threading
from queue import SimpleQueue

import pytest

from litegripd.model.teleop import LinkOptions, LinkStatus, TeleopMode
from litegripd.teleop.ends import UdpFollower, UdpLeader
from litegripd.teleop.link import FRAME, STATUS, OpenLink, unpack_arrival, unpack_status
from litegripd.teleop.process import Station

DEADLINE_S = 30.0


class Daemon(socket.socket):
    """The daemon's end of a link process; it keeps what it is told."""

    def __init__(self) -> None:
        super().__init__(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._told: SimpleQueue[bytes] = SimpleQueue()

    def send(self, packet: bytes, _flags: int = 0) -> int:  # type: ignore[override]
        self._told.put(packet)
        return len(packet)

    def status(self) -> LinkStatus:
        """Wait for the next state of the link."""
        packet = self._told.get(timeout=DEADLINE_S)
        assert packet[:1] == STATUS
        return unpack_status(packet[1:])[1]

    def payload(self) -> bytes:
        """Wait for the next frame."""
        packet = self._told.get(timeout=DEADLINE_S)
        assert packet[:1] == FRAME
        return unpack_arrival(packet[1:])[1].payload


def socket_of(station: Station) -> socket.socket:
    """Return the socket at which a station listens."""
    end = station._endpoint
    if isinstance(end, UdpFollower):
        return end._socket
    assert isinstance(end, UdpLeader)
    (own,) = end._sockets.values()
    return own


@pytest.mark.parametrize("mode", ["master", "slave"])
def test_an_error_of_listening_is_told_and_the_port_opened_anew(mode: TeleopMode) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other, Daemon() as daemon:
        other.bind(("127.0.0.1", 0))
        port = int(other.getsockname()[1])
        if mode == "slave":
            other.close()  # the port is the follower's
        station = Station(daemon)
        threading.Thread(target=station.work, daemon=True).start()
        station.request(OpenLink(1, LinkOptions(mode, "udp", "127.0.0.1", port, reflects=True)))
        assert daemon.status().state == "open"
        socket_of(station).close()
        status = daemon.status()
        assert (status.state, status.error) == ("failed", "listening: Bad file descriptor")
        assert daemon.status().state == "open"
        listens_at = socket_of(station).getsockname()[1]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"frame", ("127.0.0.1", listens_at))
            assert daemon.payload() == b"frame"
        station.request(None)
