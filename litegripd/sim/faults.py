"""Faults of a simulated bus as a robot meets them: on the wire, and at the adapter.

`FrameFaults` loses, delays, repeats and damages the frames of the wire. `BusFaults` says what
python-can then raises and receives: the nodes of a channel are sockets on one adapter, so a link
that goes down or an adapter that is unplugged concerns them all; the motor is at the other end of
the wire. Types and numbers are those of python-can on SocketCAN. Frames are moved by `interface`.
"""

from __future__ import annotations

import contextlib
import copy
import errno
import math
import os
import random
import threading
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

import can

from litegripd.model.motor import CanFrame


class FrameFaults:
    """The faults of one direction, all off at first; they may be set at any time, by any thread.

    A frame may suffer several of them at once: it is lost, else changed, doubled and late.
    """

    def __init__(self, direction: str, seed: int = 0) -> None:
        self.is_used = False
        """True if any fault was ever set: until then nobody needs to ask `arrivals`."""
        self._direction = direction
        self._lock = threading.Lock()
        self._latest_s = -math.inf
        self._switch_off()
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Restart the sequence of chances."""
        with self._lock:
            self._random = random.Random(f"{self._direction} {seed}")  # noqa: S311 - no secret

    def clear(self) -> None:
        """Switch all off. Frames that are late already still arrive."""
        with self._lock:
            self._switch_off()

    def drop(self, probability: float) -> None:
        """Lose each frame with this probability, 0 to 1. Raises `ValueError` for another."""
        _check_probability(probability)
        with self._lock:
            self._drop = probability
            self.is_used = True

    def drop_next(self, count: int) -> None:
        """Lose the next `count` frames. Raises `ValueError` for a negative number."""
        if count < 0:
            raise ValueError(f"the number of frames to drop must not be negative, but is {count!r}")
        with self._lock:
            self._drop_next = count
            self.is_used = True

    def delay(self, seconds: float, *, in_order: bool = True) -> None:
        """Let frames arrive late by this time, from now on; 0 ends it.

        In order, none overtakes another, not even when the delay ends. Else each is late by a
        random share of the time, and overtakes. Raises `ValueError` for a negative time or one
        that is not finite.
        """
        if not math.isfinite(seconds) or seconds < 0:
            raise ValueError(f"the delay must be finite and not negative, but is {seconds!r} s")
        with self._lock:
            self._delay_s = seconds
            self._in_order = in_order
            self.is_used = True

    def double(self, probability: float) -> None:
        """Let each frame arrive twice with this probability, 0 to 1. Raises `ValueError`."""
        _check_probability(probability)
        with self._lock:
            self._double = probability
            self.is_used = True

    def corrupt(self, probability: float) -> None:
        """Change the data of each frame with this probability, 0 to 1. Raises `ValueError`.

        At least one byte is changed. The bus itself would notice that; adapters and gateways
        are known to do it.
        """
        _check_probability(probability)
        with self._lock:
            self._corrupt = probability
            self.is_used = True

    def arrivals(self, due_s: float, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        """Return what arrives, and when, of a frame that is due at `due_s`."""
        with self._lock:
            if self._drop_next > 0:
                self._drop_next -= 1
                return []
            if self._happens(self._drop):
                return []
            if self._happens(self._corrupt):
                frame = self._changed(frame)
            count = 2 if self._happens(self._double) else 1
            return [(self._arrives_at(due_s), frame) for _ in range(count)]

    def _switch_off(self) -> None:
        self._drop = self._double = self._corrupt = self._delay_s = 0.0
        self._drop_next = 0
        self._in_order = True

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability

    def _arrives_at(self, due_s: float) -> float:
        if not self._in_order:
            return due_s + self._delay_s * self._random.random()
        self._latest_s = max(self._latest_s, due_s + self._delay_s)
        return self._latest_s

    def _changed(self, frame: CanFrame) -> CanFrame:
        data = bytearray(frame.data)
        for place in self._random.sample(range(len(data)), self._random.randint(0, len(data))):
            data[place] ^= self._random.randrange(256)
        if data and data == frame.data:
            data[self._random.randrange(len(data))] ^= self._random.randrange(1, 256)
        return CanFrame(frame.can_id, bytes(data))


def _check_probability(probability: float) -> None:
    if not 0.0 <= probability <= 1.0:
        raise ValueError(f"a probability must be 0 to 1, not {probability!r}")


if TYPE_CHECKING:
    from litegripd.sim.interface import Channel, Node

TX_QUEUE_FRAMES = 10
"""Frames that an adapter queues while nobody acknowledges any (Linux: `txqueuelen` of CAN)."""
BUS_OFF_ID = 0x40
"""Id of the error frame that says bus-off (Linux: CAN_ERR_BUSOFF, masked to 11 bits)."""

_ID_MASK = 0x7FF


class BusFaults:
    """The faults of one channel, all off at first; any thread may switch them at any time.

    Each is a switch of its own. `to_motor` and `from_motor` are the faults of single frames.
    """

    def __init__(self, channel: Channel) -> None:
        self.to_motor = channel.wire.to_motor
        self.from_motor = channel.wire.from_motor
        self.is_whole = True
        """True if frames go out and come in, as they do without any fault of the link."""
        self._channel = channel
        self._is_down = self.is_unplugged = self._is_off = self._is_stalled = False
        self._queue: deque[tuple[Node, can.Message]] = deque()

    def seed(self, seed: int) -> None:
        """Restart the chances of both directions."""
        self._channel.wire.seed(seed)

    def inject(self, frame: CanFrame) -> None:
        """Let another node send a frame: all receive it, and the motor may answer it.

        The faults on the way to the motor spare it.
        """
        with self._channel.arrival:
            message = can.Message(
                arbitration_id=frame.can_id, is_extended_id=False, data=frame.data
            )
            self._channel.transmit(None, message)
            self._channel.arrival.notify_all()

    def inject_error(self, arbitration_id: int, data: bytes = bytes(8)) -> None:
        """Let the adapter report an error frame; its id is masked to 11 bits, as python-can does.

        0x08 | 0x10, a problem of the protocol and one of the controller, is 0x18.
        """
        with self._channel.arrival:
            self._report(arbitration_id, data)
            self._channel.arrival.notify_all()

    def link_down(self) -> None:
        """Take the interface down: receiving raises code 100 once, sending each time.

        What waits to be sent or is under way is lost.
        """
        with self._switching():
            if not self._is_down:
                self._is_down = True
                self._lose_under_way()
                for node in self._channel.nodes:
                    if not node.is_gone:
                        node.error_code = errno.ENETDOWN

    def link_up(self) -> None:
        """Bring the interface up: every bus object works again, and nothing is replayed."""
        with self._switching():
            self._is_down = False

    def unplug(self) -> None:
        """Take the adapter away: receiving raises code 19 once, sending code 6 each time.

        A bus object that was open stays dead, and no new one can be opened.
        """
        with self._switching():
            if not self.is_unplugged:
                self.is_unplugged = True
                self._lose_under_way()
                for node in self._channel.nodes:
                    if not node.is_gone:
                        node.is_gone = True
                        node.error_code = errno.ENODEV
                        node.queue.clear()

    def replug(self) -> None:
        """Put the adapter back: a new bus object works, those of before stay dead."""
        with self._switching():
            self.is_unplugged = False

    def bus_off(self) -> None:
        """Let the controller go bus-off: one error frame, and then what is sent vanishes."""
        with self._switching():
            if not self._is_off:
                self._is_off = True
                self._lose_under_way()
                self._report(BUS_OFF_ID, bytes(8))

    def recover(self) -> None:
        """Let the controller take part again, as `restart-ms` does, or the link set down and up."""
        with self._switching():
            self._is_off = False

    def stall(self) -> None:
        """Let nobody acknowledge: frames wait to be sent, and beyond ten sending raises code 105.

        As when the motor, the only other node, has no power or the cable is off.
        """
        with self._switching():
            if not self._is_stalled:
                self._is_stalled = True
                self._channel.forget_unarrived()

    def unstall(self) -> None:
        """Let frames be acknowledged again: what has waited is sent now, however old it is."""
        with self._switching():
            self._is_stalled = False
            self._note_wholeness()
            while self._queue:
                self._channel.transmit(*self._queue.popleft())

    def check_present(self) -> None:
        """Raise `OSError` 19, as opening a socket does, while the adapter is unplugged."""
        if self.is_unplugged:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))

    def meet(self, node: Node) -> None:
        """Let a new node find the link as it is; the caller holds the channel's lock."""
        if self._is_down:
            node.error_code = errno.ENETDOWN

    def admit(self, node: Node, message: can.Message) -> bool:
        """Return True if a node's frame goes out now; else it is lost, or waits.

        The caller holds the channel's lock. Raises `can.CanOperationError`.
        """
        if node.is_gone:
            raise failure("Failed to transmit", errno.ENXIO)
        if self._is_down:
            raise failure("Failed to transmit", errno.ENETDOWN)
        if self._is_off:
            return False
        if self._is_stalled:
            if len(self._queue) >= TX_QUEUE_FRAMES:
                raise failure("Failed to transmit", errno.ENOBUFS)
            self._queue.append((node, copy.copy(message)))
            return False
        return True

    @contextlib.contextmanager
    def _switching(self) -> Iterator[None]:
        """Hold the lock, let arrive what had its time, and wake who waits afterwards."""
        with self._channel.arrival:
            self._channel.let_late_arrive()
            yield
            self._note_wholeness()
            self._channel.arrival.notify_all()

    def _note_wholeness(self) -> None:
        broken = self._is_down or self.is_unplugged or self._is_off or self._is_stalled
        self.is_whole = not broken

    def _lose_under_way(self) -> None:
        self._queue.clear()
        self._channel.forget_unarrived()

    def _report(self, arbitration_id: int, data: bytes) -> None:
        message = can.Message(
            arbitration_id=arbitration_id & _ID_MASK,
            is_extended_id=False,
            is_error_frame=True,
            data=data,
        )
        self._channel.report(message)


def failure(what: str, code: int) -> can.CanOperationError:
    """Return what python-can's SocketCAN interface raises for a system error."""
    return can.CanOperationError(f"{what}: {os.strerror(code)}", error_code=code)
