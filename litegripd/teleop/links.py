"""The control thread's end of teleoperation links; a process of their own keeps them.

Nothing here waits: the process opens, connects and resolves names. It is started with the first
link, kept for the daemon's life, and restarted when it dies.
"""

from collections.abc import Callable, Sequence

from litegripd.io.helper.child import Child, start_here
from litegripd.model.teleop import Arrival, LinkOptions, LinkStatus
from litegripd.teleop.link import (
    CLOSE,
    FRAME,
    READY,
    STATUS,
    InProcessLinks,
    Link,
    OpenLink,
    pack_open,
    pack_reply,
    unpack_arrival,
    unpack_status,
)

MODULE = "litegripd.teleop.process"
_PACKETS_PER_TICK = 32
_RESTART_FIRST_S = 0.5
_RESTART_AT_MOST_S = 5.0
_END_WITHIN_S = 0.5


class TeleopLinks:
    """Makes links; the present one is the one opened last.

    `zenoh_config` is a file of zenoh's own, for TLS and access lists.
    """

    def __init__(
        self,
        zenoh_config: str | None = None,
        start: Callable[[str, Sequence[str]], Child] = start_here,
    ) -> None:
        self.deaths = 0
        self._zenoh_config = zenoh_config
        self._start = start
        self._inside = InProcessLinks()
        self._child: Child | None = None
        self._link: ProcessLink | None = None
        self._led: ProcessLink | None = None  # the key of the last zenoh leader
        self._open_port: int | None = None  # of an unprotected leader's session, which is kept
        self._generation = 0
        self._restart_at_s = 0.0
        self._restart_after_s = _RESTART_FIRST_S

    @property
    def pid(self) -> int | None:
        """The process's id, None while there is none."""
        return None if self._child is None else self._child.pid

    @property
    def status(self) -> LinkStatus | None:
        """The status of the present link, None if none goes through the process."""
        return None if self._link is None else self._link.status

    @property
    def is_open_to_network(self) -> bool | None:
        """True if others than those named in the configuration can reach a link now.

        That includes the session of a leader, which stays open after its teleoperation. None while
        this is unknown.
        """
        if self._open_port is not None:
            return True
        is_protected = None if self.status is None else self.status.is_protected
        return None if is_protected is None else not is_protected

    def open(self, options: LinkOptions) -> Link:
        """Begin to open a link; the process starts with the next `poll`."""
        if options.kind == "none":
            return self._inside.open(options)
        self._generation += 1
        self._link = ProcessLink(self, OpenLink(self._generation, options, self._zenoh_config))
        if (options.kind, options.mode) == ("zenoh", "master"):
            self._led = self._link
        return self._link

    def warning(self, options: LinkOptions) -> str | None:
        """Return a warning that others may take part, or None."""
        leads, port = options.mode == "master", options.port
        if options.kind == "udp":
            who = (
                f"is between here and {options.host}:{port}"
                if leads
                else f"can send to port {port}"
            )
            whose = "the follower's" if leads else "these"
            return (
                f"anybody who {who} can move {whose} jaws: datagrams are not encrypted nor signed"
            )
        if options.kind == "none" or self._zenoh_config is not None:
            return None
        what = f"listens for anybody at port {port}" if leads else f"follows {options.host}:{port}"
        return (
            f"it {what}, without encryption and without an access list"
            " (zenoh_config of [teleop] in the daemon's configuration sets both up)"
        )

    def poll(self, now_s: float) -> None:
        """Start the process if it is needed; called once per tick, after everything else."""
        link, child = self._link, self._child
        if child is not None and child.has_ended:
            self._bury(child, now_s)
        elif child is None and link is not None and now_s >= self._restart_at_s:
            self._spawn(link, now_s)
        elif child is not None and link is None and self._led is not None:
            self.exchange(self._led)  # what was closed while it opened may be open now

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.close(_END_WITHIN_S)
            self._child = None
            self._open_port = None

    def let_go(self) -> None:
        """Leave the process, which ends by itself without its daemon."""
        if self._child is not None:
            self._child.let_go()
            self._child = None
            self._open_port = None

    # For the links

    def send(self, packet: bytes) -> bool:
        """Send a packet to the process; return True if it was taken."""
        return self._child is not None and self._child.send(packet)

    def exchange(self, link: "ProcessLink") -> None:
        """Give `link` the reports of the process."""
        for _ in range(_PACKETS_PER_TICK):
            packet = None if self._child is None else self._child.receive()
            if packet is None:
                return
            self._restart_after_s = _RESTART_FIRST_S
            link.take(packet)
            if self._led is not None and self._led is not link:
                self._led.take(packet)

    def forget(self, link: "ProcessLink") -> None:
        """Record that a link is closed."""
        if self._link is link:
            self._link = None

    def note(self, link: "ProcessLink", options: LinkOptions, status: LinkStatus) -> None:
        """Record which leader's session the process keeps (see `ZenohLeaders`)."""
        if link is not self._led:
            return
        if status.is_protected is not None:
            self._open_port = None if status.is_protected else options.port
        elif status.state == "failed" and options.port != self._open_port:
            self._open_port = None  # closed in favour of another port, which could not be opened

    def _spawn(self, link: "ProcessLink", now_s: float) -> None:
        try:
            self._child = self._start(MODULE, ())
        except OSError as error:
            link.status = _unstarted(str(error))
            self._restart_at_s = now_s + self._restart_after_s
            return
        link.is_requested = False

    def _bury(self, child: Child, now_s: float) -> None:
        failure = child.failure
        child.close()
        self._child = self._open_port = None
        self.deaths += 1
        died = LinkStatus("failed", "the link process died; it is started again")
        if self._link is not None:
            self._link.status = died if failure is None else _unstarted(failure)
        self._restart_at_s = now_s + self._restart_after_s
        self._restart_after_s = min(2 * self._restart_after_s, _RESTART_AT_MOST_S)


def _unstarted(why: str) -> LinkStatus:
    return LinkStatus("failed", f"the link process cannot be started: {why}")


class ProcessLink:
    """One link, which the process keeps."""

    def __init__(self, links: TeleopLinks, wanted: OpenLink) -> None:
        self.status = LinkStatus()
        self.is_requested = False
        self._is_closed = False
        self._links = links
        self._wanted = wanted
        self._arrived: list[Arrival] = []

    def publish(self, payload: bytes, _now_s: float) -> bool:
        """Send a frame to the process; while the link is not open, it may be lost.

        It is sent in any case: only sending shows that a network is back.
        """
        return self._links.send(FRAME + payload) and self.status.state == "open"

    def reply(self, payload: bytes, to: str, _now_s: float) -> bool:
        """Send a frame for the leader to the process; it may be lost like any other."""
        return self._links.send(pack_reply(payload, to)) and self.status.state == "open"

    def tell(self, payload: bytes, _now_s: float) -> bool:
        """Send whether this follower is ready to the process; never over UDP."""
        has_way = self._wanted.options.has_ready and self.status.state == "open"
        return has_way and self._links.send(READY + payload)

    def receive(self, _now_s: float) -> Sequence[Arrival]:
        """Return what the process has passed on; request the link once."""
        self._links.exchange(self)
        if not self.is_requested:
            self.is_requested = self._links.send(pack_open(self._wanted))
        arrived, self._arrived = self._arrived, []
        return arrived

    def close(self) -> None:
        """Request the close; later reports of this link are not for the next one."""
        self._is_closed = True
        self._links.send(CLOSE)
        self._links.forget(self)

    def take(self, packet: bytes) -> None:
        """Take a packet of the process, unless it is of an earlier link."""
        kind, body = packet[:1], packet[1:]
        if kind == FRAME:
            generation, arrival = unpack_arrival(body)
            if generation == self._wanted.generation and not self._is_closed:
                self._arrived.append(arrival)
        elif kind == STATUS:
            generation, status = unpack_status(body)
            if generation == self._wanted.generation:
                self.status = status
                self._links.note(self, self._wanted.options, status)
