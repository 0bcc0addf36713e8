"""A simulated CAN bus inside one process: one gripper, any number of nodes.

It keeps the order and the duration of frames, as a bus at 1 Mbit/s would, and is the only place of
the simulator that locks between nodes. It does no physics and knows nothing of python-can's API
beyond `can.Message`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

import can

from litegripd.model.frame import CanFrame
from litegripd.sim.gripper import SimulatedGripper

# A frame of 8 bytes at 1 Mbit/s with its stuff bits (CAN specification: 0.11 to 0.13 ms).
FRAME_TIME_S = 0.13e-3
# Frames that a node keeps when nobody reads, about what a socket's buffer holds; then it loses
# the newest, like a socket.
QUEUE_FRAMES = 1000


class Node:
    """One attached bus object: its queue of frames, each with the time at which it has arrived."""

    __slots__ = ("lost", "queue", "receive_own")

    def __init__(self, *, receive_own: bool) -> None:
        self.receive_own = receive_own
        self.queue: deque[tuple[float, can.Message]] = deque()
        self.lost = 0

    def put(self, due_s: float, message: can.Message) -> None:
        """Queue a frame that arrives at `due_s`."""
        if len(self.queue) >= QUEUE_FRAMES:
            self.lost += 1
            return
        self.queue.append((due_s, message))


class Channel:
    """The nodes and the gripper on one named bus. Every method may be called from any thread."""

    def __init__(self, gripper: SimulatedGripper, monotonic_fn: Callable[[], float]) -> None:
        self.gripper = gripper
        self._monotonic_fn = monotonic_fn
        # Other tools read time stamps as seconds since 1970; a virtual clock has no such thing.
        real = monotonic_fn is time.monotonic
        self._epoch_s = time.time() - time.monotonic() if real else 0.0
        self._arrival = threading.Condition(threading.Lock())
        self._nodes: list[Node] = []
        self._busy_until_s = -float("inf")

    def attach(self, node: Node) -> None:
        """Add a node; it sees the frames from now on."""
        with self._arrival:
            self._nodes.append(node)

    def detach(self, node: Node) -> bool:
        """Remove a node and wake who waits for it; return whether any other is left."""
        with self._arrival:
            self._nodes.remove(node)
            self._arrival.notify_all()
            return bool(self._nodes)

    def send(self, sender: Node, message: can.Message) -> None:
        """Put a frame on the bus: the other nodes see it, and the motor may answer it."""
        with self._arrival:
            now_s = self._monotonic_fn()
            due_s = max(now_s, self._busy_until_s) + FRAME_TIME_S
            answers: list[CanFrame] = []
            if not (message.is_extended_id or message.is_remote_frame):
                frame = CanFrame(message.arbitration_id, bytes(message.data))
                answers = self.gripper.receive(now_s, frame)
            for node in self._nodes:
                if node is not sender or node.receive_own:
                    node.put(due_s, self._copy(message, due_s, is_rx=node is not sender))
            for answer in answers:
                for node in self._nodes:
                    node.put(due_s, self._message(answer, due_s))
            self._busy_until_s = due_s
            if len(self._nodes) > 1 or answers:
                self._arrival.notify_all()

    def receive(self, node: Node, timeout_s: float | None) -> can.Message | None:
        """Return the next frame that has arrived, after at most `timeout_s` of real time.

        None waits for ever. When the clock is virtual, frames arrive as that clock says.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._arrival:
            while True:
                wait_s: float | None = None
                if node.queue:
                    due_s, message = node.queue[0]
                    wait_s = due_s - self._monotonic_fn()
                    if wait_s <= 0.0:
                        node.queue.popleft()
                        return message
                if node not in self._nodes:
                    return None
                if deadline_s is not None:
                    left_s = deadline_s - time.monotonic()
                    if left_s <= 0.0:
                        return None
                    wait_s = left_s if wait_s is None else min(wait_s, left_s)
                self._arrival.wait(wait_s)

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
