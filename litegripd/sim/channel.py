"""A simulated CAN bus inside one process: one gripper, any number of nodes.

It keeps the order and the duration of frames, as a bus at 1 Mbit/s would, and is the only place of
the simulator that locks between nodes. It does no physics and knows nothing of python-can's API
beyond `can.Message`. What can go wrong with the link is switched in `faults`.
"""

from __future__ import annotations

import copy
import math
import threading
import time
from collections import deque
from collections.abc import Callable

import can

from litegripd.model.frame import CanFrame
from litegripd.sim.faults import BusFaults, failure
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.wire import Arrival, MotorWire

# A frame of 8 bytes at 1 Mbit/s with its stuff bits (CAN specification: 0.11 to 0.13 ms).
FRAME_TIME_S = 0.13e-3
# Frames that a node keeps when nobody reads, about what a socket's buffer holds; then it loses
# the newest, like a socket.
QUEUE_FRAMES = 1000


class Node:
    """One attached bus object: its queue of frames, each with the time at which it has arrived.

    `error_code` is what receiving raises next; a node that `is_gone` has lost its adapter.
    """

    __slots__ = ("error_code", "is_gone", "lost", "queue", "receive_own")

    def __init__(self, *, receive_own: bool) -> None:
        self.receive_own = receive_own
        self.queue: deque[tuple[float, can.Message]] = deque()
        self.lost = 0
        self.error_code: int | None = None
        self.is_gone = False

    def put(self, due_s: float, message: can.Message) -> None:
        """Queue a frame that arrives at `due_s`."""
        if self.is_gone:
            return
        if len(self.queue) >= QUEUE_FRAMES:
            self.lost += 1
            return
        self.queue.append((due_s, message))


class Channel:
    """The nodes and the gripper on one named bus. Any thread may call `attach` to `receive`.

    The other methods and the attributes are for `faults`, which holds the lock, `arrival`.
    """

    def __init__(self, gripper: SimulatedGripper, monotonic_fn: Callable[[], float]) -> None:
        self.wire = MotorWire(gripper)
        self.arrival = threading.Condition(threading.Lock())
        self.nodes: list[Node] = []
        self.faults = BusFaults(self)
        self._monotonic_fn = monotonic_fn
        # Other tools read time stamps as seconds since 1970; a virtual clock has no such thing.
        real = monotonic_fn is time.monotonic
        self._epoch_s = time.time() - time.monotonic() if real else 0.0
        self._busy_until_s = -float("inf")

    @property
    def gripper(self) -> SimulatedGripper:
        """The gripper on this bus."""
        return self.wire.gripper

    def attach(self, node: Node) -> None:
        """Add a node; it sees the frames from now on. Raises `OSError` without an adapter."""
        with self.arrival:
            self.faults.check_present()
            self.faults.meet(node)
            self.nodes.append(node)

    def detach(self, node: Node) -> bool:
        """Remove a node and wake who waits for it; return whether any other is left."""
        with self.arrival:
            self.nodes.remove(node)
            self.arrival.notify_all()
            return bool(self.nodes)

    def send(self, sender: Node, message: can.Message) -> None:
        """Put a frame on the bus: the other nodes see it, and the motor may answer it.

        Raises `can.CanOperationError` as the faults of the link have it.
        """
        with self.arrival:
            faults = self.faults
            if (faults.is_whole and not sender.is_gone) or faults.admit(sender, message):
                self.transmit(sender, message)
                self.arrival.notify_all()

    def receive(self, node: Node, timeout_s: float | None) -> can.Message | None:
        """Return the next frame that has arrived, after at most `timeout_s` of real time.

        None waits for ever. When the clock is virtual, frames arrive as that clock says. Raises
        `can.CanOperationError` once for each time that the link was lost.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self.arrival:
            while True:
                self.let_late_arrive()
                if node.error_code is not None:
                    code, node.error_code = node.error_code, None
                    raise failure("Error receiving", code)
                now_s = self._monotonic_fn()
                due_s = node.queue[0][0] if node.queue else math.inf
                if due_s <= now_s:
                    return node.queue.popleft()[1]
                if node not in self.nodes:
                    return None
                wait_s = min(due_s, self.wire.next_s) - now_s
                if deadline_s is not None:
                    left_s = deadline_s - time.monotonic()
                    if left_s <= 0.0:
                        return None
                    wait_s = min(wait_s, left_s)
                self.arrival.wait(None if wait_s == math.inf else wait_s)

    def transmit(self, sender: Node | None, message: can.Message) -> None:
        """Put a frame on the bus at last; without a sender it comes from another node."""
        self.let_late_arrive()
        now_s = self._monotonic_fn()
        due_s = max(now_s, self._busy_until_s) + FRAME_TIME_S
        self._busy_until_s = due_s
        if self.faults.is_whole:
            for node in self.nodes:
                if node is not sender or node.receive_own:
                    node.put(due_s, self._copy(message, due_s, is_rx=node is not sender))
        if not (message.is_extended_id or message.is_remote_frame):
            frame = CanFrame(message.arbitration_id, bytes(message.data))
            way = self.wire.deliver if sender is None else self.wire.carry
            self._tell(way(now_s, due_s, frame))

    def let_late_arrive(self) -> None:
        """Let the late frames arrive whose time has come."""
        if self.wire.next_s < math.inf:
            self._tell(self.wire.late(self._monotonic_fn()))

    def forget_unarrived(self) -> None:
        """Lose what has not arrived yet, in both directions."""
        now_s = self._monotonic_fn()
        self.wire.lose_late()
        for node in self.nodes:
            node.queue = deque(item for item in node.queue if item[0] <= now_s)

    def report(self, message: can.Message) -> None:
        """Let every node receive what its adapter itself has to say."""
        now_s = self._monotonic_fn()
        message.timestamp = self._epoch_s + now_s
        for node in self.nodes:
            node.put(now_s, copy.copy(message))

    def _tell(self, answers: list[Arrival]) -> None:
        """Let every node receive the motor's answers, unless the link is broken by now."""
        if self.faults.is_whole:
            for at_s, answer in answers:
                for node in self.nodes:
                    node.put(at_s, self._message(answer, at_s))

    def _message(self, frame: CanFrame, due_s: float) -> can.Message:
        return can.Message(
            timestamp=self._epoch_s + due_s,
            arbitration_id=frame.can_id,
            is_extended_id=False,
            data=frame.data,
        )

    def _copy(self, message: can.Message, due_s: float, *, is_rx: bool) -> can.Message:
        return can.Message(
            timestamp=self._epoch_s + due_s,
            arbitration_id=message.arbitration_id,
            is_extended_id=message.is_extended_id,
            is_remote_frame=message.is_remote_frame,
            dlc=message.dlc,
            data=None if message.is_remote_frame else bytes(message.data),
            is_rx=is_rx,
        )
