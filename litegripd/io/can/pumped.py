"""A bus whose adapter can block (SLCAN and most USB adapters), driven by a process of its own.

That process is not the helper: a pump that waits for ever in a send must not hold up the disk,
and a file that is being parsed must not hold up the frames.
"""

import json
import socket
import struct
from collections.abc import Callable, Sequence

from litegripd.io.can.bus import MAX_FRAMES_PER_TICK, BusCounters
from litegripd.io.helper.child import Child, start_here
from litegripd.io.meters import RECENT_S, RecentLateness
from litegripd.model.motor import NOT_OPENED, UP, BusCondition, BusSettings, CanFrame

MODULE = "litegripd.io.can.pump_main"
_RESTART_FIRST_S = 0.5
_RESTART_AT_MOST_S = 5.0
_END_WITHIN_S = 0.5
_STALLED_AFTER_S = 1.0
"""A pump that drops frames for so long, and brings none, has a blocked adapter; one that drops
none for so long takes them again."""
_FRAME = struct.Struct("<IB3x8s")  # as the kernel's struct can_frame
_SECONDS = struct.Struct("<d")
FRAME_LIFETIME_PERIODS = 2.0
_BELOW_CONTROL = 2
"""The pump's real-time priority: so far below the control thread's, and above ordinary processes,
which kept frames waiting for longer than they live (python -m bench.timing.pump)."""
_TOO_LATE = (
    "frames waited up to {ms:.0f} ms for the process that drives the adapter, and were dropped:"
    " this machine is too busy{rights}"
)
_NO_RIGHTS = ", and that process has no real-time rights (litegripctl doctor)"


def pack_frames(frames: Sequence[CanFrame]) -> bytes:
    """Return the frames one after another, 16 bytes each."""
    return b"".join(_FRAME.pack(frame.can_id, len(frame.data), frame.data) for frame in frames)


def unpack_frames(packed: bytes) -> list[CanFrame]:
    """Return the frames in `pack_frames`'s bytes."""
    return [CanFrame(can_id, data[:length]) for can_id, length, data in _FRAME.iter_unpack(packed)]


def pack_send_request(frames: Sequence[CanFrame], deadline_s: float) -> bytes:
    """Return the packet that makes the pump send `frames`, but not after `deadline_s`."""
    return _SECONDS.pack(deadline_s) + pack_frames(frames)


def unpack_send_request(packet: bytes) -> tuple[list[CanFrame], float]:
    """Return the content of `pack_send_request`'s packet."""
    (deadline_s,) = _SECONDS.unpack_from(packet)
    return unpack_frames(packet[_SECONDS.size :]), deadline_s


def pack_lateness(late_s: float) -> bytes:
    """Return the packet that reports how long a frame has waited for the pump at most."""
    return b"l" + _SECONDS.pack(late_s)


class PumpedBus:
    """Exchanges frames with the pump process; starts it again when it dies.

    `period_s` is the control period: a frame that could not be sent within
    `FRAME_LIFETIME_PERIODS` of it is dropped by the pump, so that nothing stale is replayed.
    """

    def __init__(
        self,
        settings: BusSettings,
        period_s: float,
        start: Callable[[str, Sequence[str]], Child] = start_here,
        priority: int = 0,
    ) -> None:
        """`priority` is the control thread's (SCHED_FIFO), 0 for an ordinary one."""
        self.lateness = RecentLateness(RECENT_S)
        """How long frames have waited for the pump while the adapter was free."""
        self.counters = BusCounters()
        self.condition = NOT_OPENED
        self._settings = settings
        self._lifetime_s = FRAME_LIFETIME_PERIODS * period_s
        self._priority = max(priority - _BELOW_CONTROL, 1) if priority > 0 else 0
        self._has_rights = True
        self._late_until_s = 0.0
        self._start = start
        self._child: Child | None = None
        self._is_open = False
        self._doubt: str | None = None
        self._was_open = False
        self._dropping_since_s: float | None = None
        self._dropped_at_s = 0.0
        self._restart_at_s = 0.0
        self._restart_after_s = _RESTART_FIRST_S

    @property
    def pid(self) -> int | None:
        """The pump's process id, None while there is none."""
        return None if self._child is None else self._child.pid

    def receive(self, now_s: float) -> list[CanFrame]:
        """Return the frames that the pump has passed on since the last call."""
        child = self._child or self._spawn(now_s)
        frames: list[CanFrame] = []
        if child is None:
            return frames
        for _ in range(MAX_FRAMES_PER_TICK):
            packet = child.receive()
            if packet is None:
                if child.is_cut and child.has_ended:  # the latter asks the kernel
                    self._bury(child, frames, now_s)
                break
            self._take(packet, frames, now_s)
        self._judge_drops(now_s)
        if self.condition.state == "up":  # then a doubt may be why the motor is not reached
            doubt = self._doubt
            if now_s < self._late_until_s:
                rights = "" if self._has_rights else _NO_RIGHTS
                doubt = _TOO_LATE.format(ms=1e3 * self.lateness.worst_s(), rights=rights)
            if doubt != self.condition.error:
                self.condition = UP if doubt is None else BusCondition("up", doubt)
        return frames

    def send(self, frames: Sequence[CanFrame], now_s: float) -> None:
        """Pass `frames` to the pump, which drops them while the adapter is not open.

        Before it was open for the first time, that is no loss to be counted.
        """
        if not frames:
            return
        deadline_s = now_s + self._lifetime_s
        if self._is_open and self._child is not None:
            if self._child.send(pack_send_request(frames, deadline_s)):
                self.counters.sent += len(frames)
                for frame in frames:
                    self.counters.count(frame)
                return
            self.counters.errors += 1
        if self._was_open:
            self.counters.send_failures += len(frames)

    def close(self) -> None:
        """End the pump."""
        if self._child is not None:
            self._child.close(_END_WITHIN_S)
            self._child = None

    def stand_by(self, _now_s: float) -> None:
        """Do nothing: the adapter can be opened only once, so its pump is taken over."""

    def hand_over(self) -> tuple[tuple[int, ...], int]:
        """Return the socket to the pump, its pidfd, and its pid."""
        child = self._child
        if child is None or child.pid is None or child.pidfd is None:
            return (), 0
        return (child.socket.fileno(), child.pidfd), child.pid

    def take_over(self, descriptors: Sequence[int], pid: int) -> None:
        """Continue with the predecessor's pump, which has the adapter open."""
        connected, pidfd = descriptors
        self._child = Child(socket.socket(fileno=connected), pid, pidfd)
        self._was_open = True
        self._works()

    def leave(self) -> None:
        """Leave the pump to a successor."""
        if self._child is not None:
            self._child.let_go()
            self._child = None

    def _take(self, packet: bytes, frames: list[CanFrame], now_s: float) -> None:
        kind, body = packet[:1], packet[1:]
        if kind == b"f":
            new = unpack_frames(body)
            self.counters.received += len(new)
            for frame in new:
                self.counters.count(frame)
            frames.extend(new)
            self._works()
        elif kind == b"i":
            self.counters.ignored += int(body)
        elif kind == b"d":
            self.counters.send_failures += int(body)
            self._dropped_at_s = now_s
            if self._dropping_since_s is None:
                self._dropping_since_s = now_s
        elif kind == b"o":
            self.counters.reopened += self._was_open
            self._was_open = True
            self._doubt = None
            self._works()
            self._restart_after_s = _RESTART_FIRST_S
        elif kind == b"x":
            state, text = json.loads(body)
            self._is_open = False
            self.condition = BusCondition(state, text)
        else:
            self._take_report(kind, body, now_s)

    def _take_report(self, kind: bytes, body: bytes, now_s: float) -> None:
        """Take what the pump reports of itself, and of what is doubtful about its adapter."""
        if kind == b"l":
            (late_s,) = _SECONDS.unpack(body)
            self.lateness.add(now_s, late_s)
        elif kind == b"w":
            self.counters.send_failures += int(body)
            self._late_until_s = now_s + RECENT_S
        elif kind == b"r":
            self._has_rights = False
        elif kind == b"?":
            self._doubt = body.decode() or None

    def _judge_drops(self, now_s: float) -> None:
        """Report a blocked adapter once drops have lasted; end that when they end.

        A blocked one shows at every request. A motor that does not answer is asked all the time.
        """
        since_s = self._dropping_since_s
        if not self._is_open or since_s is None:
            return
        if now_s - self._dropped_at_s >= _STALLED_AFTER_S:
            self._works()
        elif now_s - since_s >= _STALLED_AFTER_S:
            text = "the adapter takes no frame: it is blocked, or nobody on the bus acknowledges"
            self.condition = BusCondition("bus_stalled", text)

    def _works(self) -> None:
        self._is_open = True
        self._dropping_since_s = None
        self.condition = UP

    def _spawn(self, now_s: float) -> Child | None:
        if now_s < self._restart_at_s:
            return None
        settings = self._settings
        described = json.dumps(
            [
                settings.interface,
                settings.channel,
                settings.bitrate,
                dict(settings.options),
                self._lifetime_s,
                self._priority,
            ],
            default=str,  # a date, say, which TOML has: python-can then says that it is none of its
        )
        try:
            self._child = self._start(MODULE, (described,))
        except OSError as error:
            self.condition = _unstarted(str(error))
            self._restart_later(now_s)
        return self._child

    def _bury(self, child: Child, frames: list[CanFrame], now_s: float) -> None:
        while packet := child.receive():  # its last words came between the last look and its end
            self._take(packet, frames, now_s)
        failure = child.failure
        child.close()
        self._child = None
        if failure is not None:
            self.condition = _unstarted(failure)
        elif self._is_open:
            self.condition = BusCondition("down", "the pump process died")
        self._is_open = False
        self._dropping_since_s = None
        self._restart_later(now_s)

    def _restart_later(self, now_s: float) -> None:
        """Wait before the next attempt, ever longer until one opens the adapter."""
        self._restart_at_s = now_s + self._restart_after_s
        self._restart_after_s = min(2 * self._restart_after_s, _RESTART_AT_MOST_S)


def _unstarted(why: str) -> BusCondition:
    return BusCondition("down", f"the pump process cannot be started: {why}")
