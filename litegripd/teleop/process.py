"""The link process: opens, keeps and closes the teleoperation link, where waiting is allowed.

The main thread reads the daemon's socket, publishes, and ends the process with the daemon. A worker
opens and closes; each listener to the network has a thread of its own. The process knows no
geometry and no motor: payloads in, payloads out.
"""

import errno
import os
import re
import socket
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

from litegripd.io.helper.child import inherited_socket, next_packet, use_all_cpus
from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus
from litegripd.teleop.ends import Endpoint, UdpFollower, UdpLeader
from litegripd.teleop.link import (
    CLOSE,
    FRAME,
    OPEN,
    READY,
    REPLY,
    OpenLink,
    pack_arrival,
    pack_status,
    unpack_open,
    unpack_reply,
)

if TYPE_CHECKING:
    from litegripd.teleop.ends import ZenohLeaders

_LOOK_EVERY_S = 0.1
_RETRY_AFTER_S = 1.0
_FASTEST_HZ = 1500.0
_PLACE = re.compile(r" at /\S+\.rs:\d+\.?")
"""The place in zenoh's sources where an error was made."""
_IN_USE = os.strerror(errno.EADDRINUSE)
_BURST = 24
"""No leader sends more, so more is not passed on: the daemon does not see a network's flood."""


@dataclass(slots=True)
class Flood:
    """Lets `_FASTEST_HZ` pass, and a burst, as after a short stop of the network."""

    dropped: int = 0
    _left: float = _BURST
    _at_s: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def passes(self, now_s: float) -> bool:
        """Return True if one more may pass now."""
        with self._lock:
            self._left = min(self._left + (now_s - self._at_s) * _FASTEST_HZ, _BURST)
            self._at_s = now_s
            if self._left < 1.0:
                self.dropped += 1
                return False
            self._left -= 1.0
            return True

    def refuse(self) -> None:
        """Count one that does not pass for another reason."""
        with self._lock:
            self.dropped += 1


class Station:
    """Keeps the one link that the daemon wants, and reports its status."""

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer
        self._requests: SimpleQueue[OpenLink | None] = SimpleQueue()
        self._endpoint: Endpoint | None = None
        self._error: str | None = None
        self._reported = LinkStatus()
        self._flood = Flood()
        self._leaders: ZenohLeaders | None = None

    def request(self, wanted: OpenLink | None) -> None:
        """Request a link in place of the present one, or none."""
        self._requests.put(wanted)

    def publish(self, payload: bytes) -> None:
        """Send a frame, if the link is open; the worker reports an error."""
        self._use(lambda endpoint: endpoint.publish(payload))

    def reply(self, payload: bytes, to: str) -> None:
        """Send a frame to a leader, if the link is open; the worker reports an error."""
        self._use(lambda endpoint: endpoint.reply(payload, to))

    def tell(self, payload: bytes) -> None:
        """Send whether this follower is ready, if the link is open; as `reply`."""
        self._use(lambda endpoint: endpoint.tell(payload))

    def _use(self, send: Callable[[Endpoint], None]) -> None:
        endpoint = self._endpoint
        if endpoint is None:
            return
        try:
            send(endpoint)
        except Exception as error:  # noqa: BLE001 - whatever a network raises, the link continues
            self._error = _worded(error)
        else:
            self._error = None

    def work(self) -> None:
        """Open and close as requested, for ever; a worker that fails ends the process.

        The daemon restarts it, and requests its link again.
        """
        wanted = self._requests.get()
        try:
            while True:
                wanted = self._serve(wanted) if wanted is not None else self._requests.get()
        except Exception:  # noqa: BLE001 - whatever it is, it is reported
            traceback.print_exc()
            os._exit(1)

    def _serve(self, wanted: OpenLink) -> OpenLink | None:
        """Keep one link open until the next request; return that request."""
        self._reported = LinkStatus()
        self._flood = Flood()
        endpoint = self._open(wanted)
        while True:
            try:
                following = self._requests.get(
                    timeout=_RETRY_AFTER_S if endpoint is None else _LOOK_EVERY_S
                )
            except Empty:
                endpoint = self._open(wanted) if endpoint is None else self._look(wanted, endpoint)
                continue
            self._endpoint = None
            if endpoint is not None:
                endpoint.close()
            return following

    def _open(self, wanted: OpenLink) -> Endpoint | None:
        self._error = None
        try:
            endpoint = self._make(wanted)
        except Exception as error:  # noqa: BLE001 - whatever it is: report and retry
            self._report(wanted, LinkStatus("failed", _not_opened(error, wanted.options)))
            return None
        self._endpoint = endpoint
        self._report(wanted, self._status_of(endpoint))
        return endpoint

    def _make(self, wanted: OpenLink) -> Endpoint:
        options, flood = wanted.options, self._flood

        def deliver(payload: bytes, source: str) -> None:
            now_s = time.monotonic()
            if not flood.passes(now_s):
                return
            if not self._send(pack_arrival(wanted.generation, Arrival(payload, now_s, source))):
                flood.refuse()  # the daemon stands still: frames get old, they are not kept

        if options.kind == "udp":
            return (
                UdpLeader(options, deliver, flood.refuse)
                if options.mode == "master"
                else UdpFollower(options, deliver, flood.refuse)
            )
        from litegripd.teleop.ends import (  # noqa: PLC0415 - large, and UDP needs none of it
            ZenohFollower,
            ZenohLeaders,
        )

        if options.mode == "slave":
            return ZenohFollower(options, wanted.zenoh_config, deliver)
        self._leaders = self._leaders or ZenohLeaders()
        return self._leaders.open(options, wanted.zenoh_config, deliver)

    def _look(self, wanted: OpenLink, endpoint: Endpoint) -> Endpoint | None:
        """Report changes; close an end that has stopped listening."""
        failure = endpoint.failure
        if failure is not None:
            self._endpoint = None
            endpoint.close()
            self._report(wanted, LinkStatus("failed", f"listening: {_worded(failure)}"))
            return None
        self._report(wanted, self._status_of(endpoint))
        return endpoint

    def _status_of(self, endpoint: Endpoint) -> LinkStatus:
        error = self._error
        return LinkStatus(
            "open" if error is None else "failed",
            error,
            matching=endpoint.matching,
            dropped=self._flood.dropped,
            is_protected=endpoint.is_protected,
            reach=endpoint.reach,
        )

    def _report(self, wanted: OpenLink, status: LinkStatus) -> None:
        """Report the link's status if it has changed; a report that did not leave is repeated."""
        if status != self._reported and self._send(pack_status(wanted.generation, status)):
            self._reported = status

    def _send(self, packet: bytes) -> bool:
        """Send a packet to the daemon; return True if its socket had room for it.

        Without a daemon, end the process from any thread.
        """
        try:
            self._peer.send(packet, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False
        except OSError:
            os._exit(0)
        return True


def _not_opened(error: Exception, options: LinkOptions) -> str:
    """Return why a link could not be opened, and what to do if that is known."""
    text = _worded(error)
    if _IN_USE not in text:
        return text
    return (
        f"port {options.port} is in use, by another program or by the daemon of another channel"
        " (one that has led keeps its port): give another --port at both ends, or restart that"
        " daemon"
    )


def _worded(error: Exception) -> str:
    """Return an error's text, without the places in zenoh's sources."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return _PLACE.sub("", text) or type(error).__name__


def main() -> None:
    """Serve the daemon until it is gone."""
    use_all_cpus()
    peer = inherited_socket()
    station = Station(peer)
    threading.Thread(target=station.work, daemon=True).start()
    while packet := next_packet(peer):
        kind, body = packet[:1], packet[1:]
        if kind == FRAME:
            station.publish(body)
        elif kind == REPLY:
            station.reply(*unpack_reply(body))
        elif kind == READY:
            station.tell(body)
        elif kind == OPEN:
            station.request(unpack_open(body))
        elif kind == CLOSE:
            station.request(None)
    os._exit(0)  # a session that is not closed, and a waiting worker, would keep it here


if __name__ == "__main__":
    main()
