"""What leader and follower share: their links, what crosses them, and their status.

Nothing here waits: opening, connecting and resolving names happen elsewhere. The first letter of a
packet is its kind. To the process: `o`, open this link in place of the present one; `c`, close it;
`f`, a frame to publish; `r`, a frame for the leader of those that came; `y`, a follower's byte that
says whether it is ready. From it: `f`, a frame that has come; `s`, the link's status.
"""

import json
import struct
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from typing import Protocol, TypeAlias

from litegripd.control.motions.base import PlainAction, Step
from litegripd.model.motor import Feedback, MotorView, Status, status_name
from litegripd.model.state import Event, TeleopResult
from litegripd.model.teleop import (
    FORCE_FRAME_BYTES,
    FRAME_BYTES,
    Arrival,
    LinkOptions,
    LinkStatus,
    Reach,
    TeleopMode,
    TeleopStatus,
)
from litegripd.rpc.jsonrpc import encode, notification_line
from litegripd.rpc.sessions import Session

_QUEUED_AT_MOST = 32


class Link(Protocol):
    """One end of a link while it is used."""

    @property
    def status(self) -> LinkStatus:
        """The present status."""

    def publish(self, payload: bytes, now_s: float) -> bool:
        """Send to all listeners, without waiting; return True if it was sent."""

    def reply(self, payload: bytes, to: str, now_s: float) -> bool:
        """Send from a follower to its leader, the `source` of the frames; as `publish`."""

    def tell(self, payload: bytes, now_s: float) -> bool:
        """Send from a follower to all leaders whether it is ready; as `publish`."""

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return what has arrived since the last call, the oldest first."""

    def close(self) -> None:
        """Stop sending and receiving."""


class Links(Protocol):
    """Makes links."""

    def open(self, options: LinkOptions) -> Link:
        """Begin to open a link; return it at once, it becomes usable by itself."""

    def warning(self, options: LinkOptions) -> str | None:
        """Return what a person should know before such a link is used, or None."""


class InProcessLinks:
    """A bus inside the process: links leaders and followers of a topic, without a network."""

    NOT_CARRIED = ("_ends",)

    def __init__(self) -> None:
        self._ends: list[InProcessLink] = []

    def open(self, options: LinkOptions) -> "InProcessLink":
        """Open an end; the kind of link does not matter here."""
        end = InProcessLink(self, options)
        self._ends.append(end)
        return end

    def warning(self, _link_options: LinkOptions) -> str | None:
        """Return None: nobody else can listen or send."""
        return None

    def forget(self, end: "InProcessLink") -> None:
        """Remove an end from the bus."""
        self._ends = [other for other in self._ends if other is not end]

    def listeners(self, options: LinkOptions) -> "list[InProcessLink]":
        """Return the followers of a leader."""
        return self._others("slave", options)

    def leaders(self, options: LinkOptions) -> "list[InProcessLink]":
        """Return a follower's leaders."""
        return self._others("master", options)

    def _others(self, mode: TeleopMode, options: LinkOptions) -> "list[InProcessLink]":
        return [
            end
            for end in self._ends
            if end.options.mode == mode and end.options.topic == options.topic
        ]


class InProcessLink:
    """One end of the bus inside the process."""

    def __init__(self, links: InProcessLinks, options: LinkOptions) -> None:
        self.options = options
        self._links = links
        self._arrived: deque[Arrival] = deque(maxlen=_QUEUED_AT_MOST)

    @property
    def status(self) -> LinkStatus:
        """It is open from the start."""
        leads = self.options.mode == "master"
        return LinkStatus(
            "open",
            matching=bool(self._links.listeners(self.options)) if leads else None,
            is_protected=True,
        )

    def publish(self, payload: bytes, now_s: float) -> bool:
        """Put a payload into each follower's queue."""
        for listener in self._links.listeners(self.options):
            listener.deliver(Arrival(payload, now_s))
        return True

    def reply(self, payload: bytes, _to: str, now_s: float) -> bool:
        """Put a payload into the queue of each leader that listens to forces."""
        return self._deliver(payload, now_s, lambda options: options.reflects)

    def tell(self, payload: bytes, now_s: float) -> bool:
        """Put a payload into the queue of each leader that listens to it."""
        has_way = self.options.has_ready
        return has_way and self._deliver(payload, now_s, lambda options: options.has_ready)

    def _deliver(
        self, payload: bytes, now_s: float, listens: Callable[[LinkOptions], bool]
    ) -> bool:
        for leader in self._links.leaders(self.options):
            if listens(leader.options):
                leader.deliver(Arrival(payload, now_s))
        return True

    def deliver(self, arrival: Arrival) -> None:
        """Take what another end sends."""
        self._arrived.append(arrival)

    def receive(self, _now_s: float) -> Sequence[Arrival]:
        """Empty the queue."""
        arrived = tuple(self._arrived)
        self._arrived.clear()
        return arrived

    def close(self) -> None:
        """Leave the bus."""
        self._links.forget(self)


class ClientLink:
    """A link of the client that has begun teleoperation: it carries the bytes to and fro.

    The newest frames count, a client that does not read gets none. It may bring anything.
    """

    def __init__(self, session: Session, options: LinkOptions) -> None:
        self.session = session
        self._options = options
        self._listens_to = options.ready_topic if options.mode == "master" else options.topic
        self._arrived: deque[Arrival] = deque(maxlen=_QUEUED_AT_MOST)
        self._dropped = 0

    @property
    def status(self) -> LinkStatus:
        """It is open from the start; what is behind it is only known to the client."""
        return LinkStatus("open", dropped=self._dropped)

    def publish(self, payload: bytes, _now_s: float) -> bool:
        """Have the client send a frame, if it reads."""
        return self._send(self._options.topic, payload)

    def reply(self, _payload: bytes, _to: str, _now_s: float) -> bool:
        """Do nothing: forces are not carried."""
        return False

    def tell(self, payload: bytes, _now_s: float) -> bool:
        """Have the client send whether this follower is ready, if it reads."""
        return self._send(self._options.ready_topic, payload)

    def take(self, topic: str, payload: bytes, at_s: float) -> None:
        """Take what the client has brought; of another topic, or too much, it is dropped."""
        self._dropped += topic != self._listens_to or len(self._arrived) == _QUEUED_AT_MOST
        if topic == self._listens_to:
            self._arrived.append(Arrival(payload[:MAX_PAYLOAD_BYTES], at_s))

    def receive(self, _now_s: float) -> Sequence[Arrival]:
        """Empty the queue."""
        arrived = tuple(self._arrived)
        self._arrived.clear()
        return arrived

    def close(self) -> None:
        """Do nothing: the connection is the client's."""

    def _send(self, topic: str, payload: bytes) -> bool:
        if self.session.congested or self.session.is_orphaned:
            return False
        self.session.write(
            notification_line("teleop.send", encode({"topic": topic, "payload": payload.hex()}))
        )
        return True


OPEN, CLOSE, FRAME, REPLY, READY, STATUS = b"o", b"c", b"f", b"r", b"y", b"s"
_ARRIVED = struct.Struct("<IdB")  # generation, when it came, bytes of the source's name
MAX_PAYLOAD_BYTES = max(FRAME_BYTES, FORCE_FRAME_BYTES) + 1
"""Anything longer is no frame; one more byte is enough to know that."""
_MAX_SOURCE_BYTES = 64
_LONGEST_ERROR = 500


@dataclass(frozen=True, slots=True)
class OpenLink:
    """The link to open; `generation` distinguishes its reports from those of the one before."""

    generation: int
    options: LinkOptions
    zenoh_config: str | None = None


def pack_open(wanted: OpenLink) -> bytes:
    """Return the packet that opens a link."""
    return (
        OPEN + json.dumps([wanted.generation, asdict(wanted.options), wanted.zenoh_config]).encode()
    )


def unpack_open(body: bytes) -> OpenLink:
    """Return the content of `pack_open`'s packet, without its letter."""
    generation, options, zenoh_config = json.loads(body)
    return OpenLink(generation, LinkOptions(**options), zenoh_config)


def pack_reply(payload: bytes, to: str) -> bytes:
    """Return the packet that replies `payload` to the sender of frames whose name is `to`."""
    name = to.encode()[:_MAX_SOURCE_BYTES]
    return REPLY + bytes([len(name)]) + name + payload


def unpack_reply(body: bytes) -> tuple[bytes, str]:
    """Return the content of `pack_reply`'s packet, without its letter."""
    payload_at = 1 + body[0]
    return body[payload_at:], body[1:payload_at].decode(errors="replace")


def pack_arrival(generation: int, arrival: Arrival) -> bytes:
    """Return the packet for a payload that has come; a long one is cut, and still is no frame."""
    source = arrival.source.encode()[:_MAX_SOURCE_BYTES]
    head = _ARRIVED.pack(generation, arrival.at_s, len(source))
    return FRAME + head + source + arrival.payload[:MAX_PAYLOAD_BYTES]


def unpack_arrival(body: bytes) -> tuple[int, Arrival]:
    """Return the content of `pack_arrival`'s packet, without its letter."""
    generation, at_s, length = _ARRIVED.unpack_from(body)
    payload_at = _ARRIVED.size + length
    source = body[_ARRIVED.size : payload_at].decode(errors="replace")
    return generation, Arrival(body[payload_at:], at_s, source)


def pack_status(generation: int, status: LinkStatus) -> bytes:
    """Return the packet that reports a link's status."""
    error = None if status.error is None else status.error[:_LONGEST_ERROR]
    reach = None if status.reach is None else astuple(status.reach)
    values = [generation, status.state, error, status.matching, status.dropped, status.is_protected]
    return STATUS + json.dumps([*values, reach]).encode()


def unpack_status(body: bytes) -> tuple[int, LinkStatus]:
    """Return the content of `pack_status`'s packet, without its letter."""
    generation, *values, reach = json.loads(body)
    status = LinkStatus(*values)
    return generation, status if reach is None else replace(status, reach=Reach(*reach))


_WINDOW_S = 1.0


class LoopRate:
    """Counts the ticks of whole windows; before the first window ends, the ticks so far."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._ticks = 0
        self._last_hz: float | None = None
        self._latest_s = 0.0

    def tick(self, now_s: float) -> None:
        """Count one tick."""
        self._latest_s = now_s
        if self._began_s is None:
            self._began_s = now_s
            return
        self._ticks += 1
        elapsed_s = now_s - self._began_s
        if elapsed_s >= _WINDOW_S:
            self._last_hz = self._ticks / elapsed_s
            self._began_s, self._ticks = now_s, 0

    @property
    def hz(self) -> float:
        """The rate; 0 before the second tick."""
        if self._last_hz is not None:
            return self._last_hz
        elapsed_s = 0.0 if self._began_s is None else self._latest_s - self._began_s
        return self._ticks / elapsed_s if elapsed_s > 0.0 else 0.0


ReportEvent: TypeAlias = Callable[[Event], None]
"""Receives events for the log and the subscribers."""

_OPEN: Mapping[TeleopMode, str] = {
    "master": (
        "everyone who reaches the link can take part: zenoh_config asks neither for certificates of"
        " both ends nor for an access list or passwords"
    ),
    "slave": (
        "anybody who answers at the leader's address can move these jaws: zenoh_config names no"
        " authority for the leader's certificate"
    ),
}


class TeleopAction(PlainAction, ABC):
    """One end of a teleoperation, while it lasts; only `finish` or a fault ends it."""

    def __init__(self, link: Link, options: LinkOptions, report: ReportEvent) -> None:
        self.options = options
        self.link = link
        self.loop = LoopRate()
        self.send_failed = 0
        self.is_warned = False
        """True after the warning that the link is open to others was logged."""
        self.is_finished = False
        self.feedback: Feedback | None = None
        self._report_event = report
        self._reported = LinkStatus()
        self._unreached: set[str] = set()  # the reasons that were told since it was reached

    def finish(self) -> TeleopResult:
        """End it on its owner's request; return the result."""
        self.is_finished = True
        return self.result()

    def close(self) -> None:
        """Release the link; a leader's session stays open for the next teleoperation."""
        self.link.close()

    @abstractmethod
    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`."""

    @abstractmethod
    def result(self) -> TeleopResult:
        """Return the result so far."""

    @abstractmethod
    def status(self, now_s: float) -> TeleopStatus:
        """Return the status."""

    def complaint(self) -> str | None:
        """Return what the daemon's health should report, including the link, or None."""
        reach = self.link.status.reach
        if reach is None or reach.why is None:
            return None
        return f"teleoperation: {self._other} is not reached: {reach.why}"

    def report(self, text: str, *, warning: bool = False, **data: object) -> None:
        """Report an event."""
        self._report_event(Event("teleop", f"teleop: {text}", {**data, "warning": warning}))

    def note_link(self) -> None:
        """Report a change of the link's state, once."""
        status, reported = self.link.status, self._reported
        if (status.state, status.error) != (reported.state, reported.error):
            self._reported = status
            why = "" if status.error is None else f": {status.error}"
            failed = status.state == "failed"
            self.report(f"the link is {status.state}{why}", warning=failed, link=status.state)
            if status.is_protected is False and not self.is_warned:
                self.is_warned = True
                self.report(_OPEN[self.options.mode], warning=True)
        self._note_reach(status)

    def _note_reach(self, status: LinkStatus) -> None:
        """Report each reason why the other end is not reached once, until it is."""
        reach = status.reach
        if reach is None:
            return
        if reach.why is None:
            if reach.state in ("connected", "sending", "frames"):
                self._unreached.clear()
        elif reach.why not in self._unreached:
            self._unreached.add(reach.why)
            text = f"{self._other} is not reached: {reach.why}"
            self.report(text, warning=True, link=status.state)

    @property
    def _other(self) -> str:
        return "a follower" if self.options.mode == "master" else "the leader"

    def base_status(self) -> TeleopStatus:
        """Return the part of the status that is the same for both ends."""
        link, feedback = self.link.status, self.feedback
        is_faultless = feedback is None or feedback.status == Status.ENABLED
        return TeleopStatus(
            active=True,
            mode=self.options.mode,
            topic=self.options.topic,
            link=self.options.kind,
            host=self.options.host,
            port=self.options.port if self.options.kind in ("zenoh", "udp") else None,
            link_state=link.state,
            link_error=link.error,
            link_protected=link.is_protected,
            reflects=self.options.reflects,
            matching=link.matching if self.options.mode == "master" else None,
            dropped=link.dropped,
            send_failed=self.send_failed,
            loop_hz=round(self.loop.hz, 1),
            torque_nm=0.0 if feedback is None else feedback.torque_nm,
            fault="" if feedback is None or is_faultless else status_name(feedback.status),
        )


def ended(status: TeleopStatus, why: str | None) -> TeleopStatus:
    """Return the last status of a teleoperation that has ended."""
    return replace(
        status,
        active=False,
        fault=why or status.fault,
        link_state=None,  # the action has released it
        link_reach=None,
        link_unreached=None,
        link_protected=None,
        matching=None,
        dq_cmd=0.0,
        loop_hz=0.0,
        reflected_n=None,
        followers=None,
        round_trip_ms=None,
    )
