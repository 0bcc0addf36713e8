"""The python-can interface `litegrip_sim`: a bus with one simulated gripper on it.

Any program that opens its bus with python-can can use it: `can.Bus(interface="litegrip_sim",
channel="sim0", ignore_config=True)`. Buses of one process that name the same channel are nodes of
the same bus; it ends with the last of them. `Channel` keeps the order and the duration of frames,
as a bus at 1 Mbit/s would, and is the only place of the simulator that locks between nodes; the
link's faults are switched in `faults`.

`MotorWire` is the way between bus and motor, with what may happen to frames on it in each
direction: every frame to the motor goes through `carry`, every answer comes out of it, or later out
of `late`. It knows no bus and no clock. It is not thread-safe, except for setting the faults; its
owner serialises calls.
"""

from __future__ import annotations

import copy
import heapq
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import can

from litegripd.model.motor import CanFrame
from litegripd.sim.faults import BusFaults, FrameFaults, failure
from litegripd.sim.gripper import SimulatedGripper, build_gripper, check_bitrate, options_of

Arrival = tuple[float, CanFrame]
"""A frame, behind the time in seconds at which it arrives."""


class MotorWire:
    """A gripper behind its wire. Without faults it is the gripper's own `receive`."""

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        self.to_motor = FrameFaults("to the motor")
        self.from_motor = FrameFaults("from the motor")
        self._late: list[tuple[float, int, bool, CanFrame]] = []
        self._number = 0  # keeps the order of frames that arrive at the same time

    def seed(self, seed: int) -> None:
        """Restart the chances of both directions."""
        self.to_motor.seed(seed)
        self.from_motor.seed(seed)

    @property
    def next_s(self) -> float:
        """When the next frame comes that is late or that nobody asked for; infinite if none."""
        late_s = self._late[0][0] if self._late else math.inf
        return min(late_s, self.gripper.next_unasked_s)

    def carry(self, now_s: float, due_s: float, frame: CanFrame) -> list[Arrival]:
        """Send a frame to the motor; return the answers that are due at `due_s`, and no later."""
        if not self.to_motor.is_used:
            return self.deliver(now_s, due_s, frame)
        answers: list[Arrival] = []
        for at_s, arriving in self.to_motor.arrivals(due_s, frame):
            if at_s > due_s:
                self._keep(at_s, True, arriving)
            else:
                answers += self.deliver(now_s, due_s, arriving)
        return answers

    def deliver(self, now_s: float, due_s: float, frame: CanFrame) -> list[Arrival]:
        """Hand a frame to the motor whatever the faults on the way to it; return as `carry`."""
        return self._bring(due_s, self.gripper.receive(now_s, frame))

    def late(self, now_s: float) -> list[Arrival]:
        """Let what is due by `now_s` arrive; return what comes from the motor, in its order."""
        answers: list[Arrival] = []
        if self.gripper.next_unasked_s <= now_s:
            for at_s, frame in self.gripper.take_unasked(now_s):
                answers += self._bring(at_s, [frame])
        while self._late and self._late[0][0] <= now_s:
            at_s, _, is_to_motor, frame = heapq.heappop(self._late)
            answers += self.deliver(at_s, at_s, frame) if is_to_motor else [(at_s, frame)]
        return answers

    def lose_late(self) -> None:
        """Lose what is still under way."""
        self._late.clear()

    def _bring(self, due_s: float, frames: list[CanFrame]) -> list[Arrival]:
        """Return what comes at `due_s` of the motor's frames; keep what is late."""
        if not self.from_motor.is_used:
            return [(due_s, frame) for frame in frames]
        found: list[Arrival] = []
        for frame in frames:
            for at_s, arriving in self.from_motor.arrivals(due_s, frame):
                if at_s > due_s:
                    self._keep(at_s, False, arriving)
                else:
                    found.append((at_s, arriving))
        return found

    def _keep(self, at_s: float, is_to_motor: bool, frame: CanFrame) -> None:
        self._number += 1
        heapq.heappush(self._late, (at_s, self._number, is_to_motor, frame))


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
        """Remove a node and wake its waiters; return True if another one is left."""
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


@dataclass(frozen=True, slots=True)
class _OpenChannel:
    channel: Channel
    options: dict[str, Any]
    monotonic_fn: Callable[[], float]


_channels: dict[str, _OpenChannel] = {}
_channels_lock = threading.Lock()


class SimulatedBus(can.BusABC):
    """One node of a simulated bus.

    Options, by keyword:

    - those of `OPTIONS`; a second bus of a channel gives the same, or none
    - `gripper`: a ready-made `SimulatedGripper` instead of the options above
    - `monotonic_fn`: the clock, `time.monotonic` unless given; seconds, never backwards
    - `receive_own_messages`: also receive what this node sends
    - `bitrate`: 1 000 000 or left out, because the motor knows no other

    Raises `ValueError` for an unknown option, for a value out of range, and when the channel is
    open already with other options; `OSError` 19 while its adapter is unplugged by `faults`.
    """

    def __init__(
        self,
        channel: object = "sim0",
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        gripper: SimulatedGripper | None = None,
        monotonic_fn: Callable[[], float] | None = None,
        receive_own_messages: bool = False,
        bitrate: object = None,
        **given: object,
    ) -> None:
        if not isinstance(channel, str) or not channel:
            raise ValueError(f"channel must be a name like 'sim0', not {channel!r}")
        check_bitrate(bitrate)
        options = options_of(given, from_text=True)
        self._node = Node(receive_own=bool(receive_own_messages))
        self._name = channel
        self._channel = _join(channel, self._node, options, gripper, monotonic_fn)
        self.channel_info = f"litegrip_sim: {channel}"
        super().__init__(channel, can_filters)

    @property
    def gripper(self) -> SimulatedGripper:
        """The gripper on this bus."""
        return self._channel.gripper

    @property
    def faults(self) -> BusFaults:
        """The faults that can be let happen to the whole channel."""
        return self._channel.faults

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Send one classic frame; it never waits.

        Raises `can.CanOperationError` after `shutdown`, for an FD or an error frame, and as
        `faults` has it.
        """
        if self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info} is shut down")
        if msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError(f"{self.channel_info} carries classic data frames only")
        self._channel.send(self._node, msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._channel.receive(self._node, timeout)
        if message is None and self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info} is shut down")
        # Error frames pass by the filters for ids: the kernel has a filter of their own for them.
        return message, message is not None and message.is_error_frame

    def shutdown(self) -> None:
        """Leave the bus. The last node that leaves ends it, and the gripper with it.

        While its adapter is unplugged, the bus outlasts its nodes.
        """
        if not self._is_shutdown:
            super().shutdown()
            _leave(self._name, self._node)


def _join(
    name: str,
    node: Node,
    options: dict[str, Any],
    gripper: SimulatedGripper | None,
    monotonic_fn: Callable[[], float] | None,
) -> Channel:
    """Attach a node to the channel of this name, which the first node creates."""
    if gripper is not None and options:
        raise ValueError(f"give either gripper or {', '.join(options)}, not both")
    with _channels_lock:
        opened = _channels.get(name)
        if opened is None:
            clock = monotonic_fn or time.monotonic
            built = build_gripper(**options) if gripper is None else gripper
            opened = _channels[name] = _OpenChannel(Channel(built, clock), options, clock)
        elif (
            options not in ({}, opened.options)
            or gripper not in (None, opened.channel.gripper)
            or monotonic_fn not in (None, opened.monotonic_fn)
        ):
            raise ValueError(
                f"channel {name!r} is open already with other options; use the same options, "
                f"none, or another channel"
            )
        opened.channel.attach(node)
        return opened.channel


def gripper_on(channel: str) -> SimulatedGripper | None:
    """Return the gripper of a channel of this process; None while nobody has it open."""
    with _channels_lock:
        opened = _channels.get(channel)
        return None if opened is None else opened.channel.gripper


def _leave(name: str, node: Node) -> None:
    with _channels_lock:
        channel = _channels[name].channel
        if not channel.detach(node) and not channel.faults.is_unplugged:
            del _channels[name]
