"""The old daemon's side of a restart that holds: starts a successor and hands the state over.

At each moment one process owns the bus. The state is sent in one packet: before it the successor
commands nothing, after it this process commands nothing. This process takes the bus back only
once the successor is dead, by itself or killed by this process. It gives the bus up for good when
the successor reports that its first command is sent.

Packets are JSON with descriptors beside them. A large value travels as a file in memory, by its
descriptor. Of the line between the two, only `wait` waits.
"""

import json
import logging
import math
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from litegripd.control.controller import Controller
from litegripd.handover.state import (
    Machine,
    OnRestarted,
    export,
    export_history,
    why_not_restartable,
)
from litegripd.io.helper.child import CHILD_FD, MAX_PACKET_BYTES, receive_descriptors
from litegripd.io.helper.helper import Helper, HelperResult
from litegripd.io.loop import Urgent
from litegripd.io.server import Server
from litegripd.io.sockets import Places
from litegripd.io.stop_socket import StopListener
from litegripd.model.errors import Refusal
from litegripd.model.motor import IN_PROCESS_INTERFACES
from litegripd.model.plain import PlainError, plain_of
from litegripd.model.sentence import sentence
from litegripd.model.state import Restarted, Stop
from litegripd.rpc.service import RpcService

if TYPE_CHECKING:
    from litegripd.io.can.bus import FrameBus

_MAX_DESCRIPTORS = 8
_FILE_NAME = "litegripd handover"


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet from the other end: kind, members, and descriptors, which this end now owns."""

    kind: str
    body: Mapping[str, Any]
    descriptors: Sequence[int] = ()


class Link:
    """One end of the line; it does not block. `has_ended` is True once the other end is gone."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        self.has_ended = False
        self._socket = connected

    @classmethod
    def pair(cls) -> "tuple[Link, socket.socket]":
        """Return a new line: the daemon's end, and the socket that the successor inherits."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(ours), theirs

    @classmethod
    def inherited(cls) -> "Link":
        """Return the successor's end. Raises `OSError` if this process has inherited none."""
        os.set_inheritable(CHILD_FD, False)
        return cls(socket.socket(fileno=CHILD_FD))

    def fileno(self) -> int:
        """Return the descriptor; it is readable when a packet has come, or the end."""
        return self._socket.fileno()

    def send(self, kind: str, descriptors: Sequence[int] = (), **body: object) -> None:
        """Send a packet, as a whole or not at all; raises `OSError` if that is not possible."""
        packet = json.dumps([kind, body]).encode()
        socket.send_fds(self._socket, [packet], descriptors)

    def receive(self) -> Packet | None:
        """Return the next packet, or None if there is none; raises `ValueError` for any other."""
        try:
            packet, descriptors = receive_descriptors(
                self._socket, MAX_PACKET_BYTES, _MAX_DESCRIPTORS
            )
        except BlockingIOError:
            return None
        if not packet:
            self.has_ended = True
            return None
        try:
            match json.loads(packet):
                case [str(kind), dict(body)]:
                    return Packet(kind, body, descriptors)
        except (ValueError, RecursionError):  # no JSON, or JSON of great depth: below
            pass
        close_all(descriptors)
        raise ValueError(f"{packet[:40]!r} is no packet of this line")

    def wait(self, within_s: float) -> Packet | None:
        """Return the next packet, or None at the end of the line or of the time."""
        select.select((self._socket,), (), (), max(within_s, 0.0))
        return self.receive()

    def is_left(self) -> bool:
        """Return True if the other end is gone; packets from it may still be unread."""
        poll = select.poll()
        poll.register(self._socket, 0)
        return bool(poll.poll(0))

    def close(self) -> None:
        """Close this end."""
        self._socket.close()


def close_all(descriptors: Sequence[int]) -> None:
    """Close descriptors that came with a packet, and that nobody wants."""
    for descriptor in descriptors:
        os.close(descriptor)


def write_document(plain: Any) -> int:
    """Return the descriptor of a new file in memory that holds `plain` as JSON."""
    descriptor = os.memfd_create(_FILE_NAME, os.MFD_CLOEXEC)
    left = json.dumps(plain).encode()
    while left:
        left = left[os.write(descriptor, left) :]
    return descriptor


def read_document(descriptor: int) -> Any:
    """Return the value that `write_document` has written, and close the descriptor."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    with open(descriptor, "rb") as file:
        return json.loads(file.read())


_log = logging.getLogger(__name__)

MODULE = "litegripd.app.main"
PROGRAM = "litegripd"
SUCCESSOR_OPTION = "--successor"

READY_WITHIN_S = 60.0  # how long a successor may need until it has taken over

TAKE_WITHIN_S = 0.06
"""How long a successor may need from the state to its first command. The motor's watchdog disarms
after 0.1 s without one: in the rest of that time the old daemon kills it and continues."""
_DIE_WITHIN_S = 0.5
DRAIN_WITHIN_S = 0.05
"""How long a daemon that has handed over still answers requests sent before."""


def installed_program() -> str | None:
    """Return the path of the installed program by which this process was started.

    At a restart a link in that path may lead to another version, which then runs. None if the
    process was started as a Python module.
    """
    program = Path(sys.argv[0])
    if program.name != PROGRAM or not os.access(program, os.X_OK):
        return None
    return str(program.absolute())


class Succession:
    """At most one restart at a time; `begin` asks for it, `step` advances it once per tick.

    `settings` are the parts of the configuration that must be the same for a successor.
    """

    def __init__(
        self,
        settings: Mapping[str, Any],
        arguments: Sequence[str],
        epoch: str,
        *,
        interface: str,
        channel: str,
        machine: Machine,
        service: RpcService,
        helper: Helper,
        bus: "FrameBus",
        places: Places,
    ) -> None:
        self._settings = settings
        self._interface = interface
        self._channel = channel
        self._program = installed_program()
        self._arguments = arguments
        self._epoch = epoch
        self._machine = machine
        self._service = service
        self._helper = helper
        self._bus = bus
        self._places = places
        self._link: Link | None = None
        self._on_restarted: OnRestarted | None = None
        self._deadline_s = 0.0
        self.pid = 0
        """The successor's process id, once it is ready."""
        self._gap_s = 0.0
        self._is_started = False  # the helper has reported that the process runs
        self._pidfd: int | None = None
        self._history: tuple[int, int] | None = None

    def begin(self, on_restarted: OnRestarted, now_s: float) -> Refusal | None:
        """Start a successor, or return a refusal; `on_restarted` gets the outcome."""
        refusal = self._impossible() or self._not_now()
        if refusal is not None:
            return refusal
        self._link, inherited = Link.pair()
        self._on_restarted = on_restarted
        self._deadline_s = now_s + READY_WITHIN_S
        self._is_started = False
        with inherited:
            try:
                self._greet(self._link)
            except (PlainError, OSError) as error:
                self._fail(f"the state cannot be handed over: {error}")
                return None
            arguments = [MODULE, SUCCESSOR_OPTION, *self._arguments]
            self._helper.request(
                "successor.start",
                {"program": self._program, "arguments": arguments},
                self._note_start,
                (inherited.fileno(),),
            )
        return None

    def step(self, now_s: float, next_tick_s: float) -> Link | None:
        """Advance; return the line to the successor once it has taken over."""
        link = self._link
        if link is None:
            return None
        self._listen(link)
        if self._link is None:
            return None
        refusal = self._not_now(is_under_way=True)
        if now_s >= self._deadline_s:
            why = "the successor was not ready" if refusal is None else refusal.message
            self._fail(f"{why} for {READY_WITHIN_S:g} s")
        elif self._pidfd is not None and refusal is None and self._has_history():
            return self._hand_over(link, now_s, next_tick_s)
        return None

    def close(self) -> None:
        """End a successor that has not taken over."""
        if self._link is not None:
            self._fail("the daemon is about to end")

    def _impossible(self) -> Refusal | None:
        interface = self._interface
        if interface in IN_PROCESS_INTERFACES:
            text = f"a bus of the interface {interface} lives and ends with this process: nothing"
            text += " on it can be held through a restart"
            return Refusal(
                "restart_failed", text, {"hint": sentence("end the daemon and start it again")}
            )
        if os.getpid() == 1:
            text = "this daemon is process 1, with which its container ends: no successor is left"
            return Refusal("restart_failed", text)
        if self._link is not None:
            return Refusal("busy", "a restart is under way already: wait for it")
        return None

    def _not_now(self, *, is_under_way: bool = False) -> Refusal | None:
        refusal = why_not_restartable(self._machine)
        refusal = refusal or self._bus.condition.refusal(self._channel)
        has_work = self._helper.is_busy or self._machine.controller.tasks
        if refusal is None and is_under_way and has_work:
            refusal = Refusal("busy", "the helper process is at work")
        return refusal

    def _greet(self, link: Link) -> None:
        """Send what the successor needs to prepare, with a copy of the present state."""
        document = write_document(
            {
                "epoch": self._epoch,
                "path": str(self._places.path),
                "settings": self._settings,
                "state": export(self._machine, self._service),
            }
        )
        try:
            link.send("hello", (*self._places.descriptors, document))
        finally:
            os.close(document)

    def _note_start(self, result: HelperResult) -> None:
        if result.error is None:
            self._is_started = True
        elif self._link is not None:
            self._fail(f"the successor cannot be started: {result.error}")

    def _listen(self, link: Link) -> None:
        """Take a packet of a successor that has not taken over."""
        try:
            packet = link.receive()
        except (OSError, ValueError) as error:
            self._fail(f"what the successor says cannot be read: {error}")
            return
        if packet is None:
            # A program that cannot be started also ends the line; then the helper reports why.
            if link.has_ended and self._is_started:
                self._fail("the successor ended before it was ready; see the log")
            return
        pid = packet.body.get("pid")
        if (
            packet.kind == "ready"
            and self._pidfd is None
            and isinstance(pid, int)
            and len(packet.descriptors) == 1
            and _is_process(packet.descriptors[0])
        ):
            self.pid, self._pidfd = pid, packet.descriptors[0]
        else:
            close_all(packet.descriptors)
            self._fail(str(packet.body.get("why", f"the successor said {packet.kind}")))

    def _has_history(self) -> bool:
        """Return True if the history is encoded; if not, encode it: the next tick can hand over."""
        newest = max((job.number for job in self._machine.controller.jobs), default=0)
        if self._history is not None and self._history[0] == newest:
            return True
        self._forget_history()
        try:
            document = write_document(export_history(self._machine, self._service))
        except (PlainError, OSError) as error:
            self._fail(f"the jobs cannot be handed over: {error}")
            return False
        self._history = (newest, document)
        return False

    def _hand_over(self, link: Link, now_s: float, next_tick_s: float) -> Link | None:
        """Send the state and wait for the successor's first command; else continue as before.

        `now_s` is the time of this process's last command.
        """
        history = self._history
        if history is None:
            return None
        try:
            state = write_document(export(self._machine, self._service))
        except (PlainError, OSError) as error:
            self._fail(f"the state cannot be handed over: {error}")
            return None
        adapter, pump_pid = self._bus.hand_over()
        try:
            link.send(
                "state",
                (state, history[1], *adapter),
                sent_s=now_s,
                due_s=next_tick_s,
                pump=pump_pid,
            )
        except OSError as error:  # nothing was sent: the bus is still ours
            self._fail(f"the successor is gone: {error}")
            return None
        finally:
            os.close(state)
        packet = _reply(link, next_tick_s + TAKE_WITHIN_S)
        if packet is not None and packet.kind == "running":
            gap_s = packet.body.get("gap_s")
            self._gap_s = gap_s if isinstance(gap_s, float) and math.isfinite(gap_s) else 0.0
            self._link = None  # the caller owns it now
            return link
        self._end_successor()
        self._fail(_why_not(packet, link))
        return None

    def _end_successor(self) -> None:
        """Kill the successor, so that it sends no more commands."""
        if self._pidfd is not None:
            try:
                signal.pidfd_send_signal(self._pidfd, signal.SIGKILL)
            except ProcessLookupError:
                return
            # After the signal it runs no instruction of its own, however long its end takes.
            select.select((self._pidfd,), (), (), _DIE_WITHIN_S)

    def report_outcome(self) -> None:
        """Report to the client that asked for the restart that the successor has taken over."""
        self._forget_successor()
        on_restarted, self._on_restarted = self._on_restarted, None
        if on_restarted is not None:
            on_restarted(Restarted(self.pid, self._gap_s))

    def _fail(self, why: str) -> None:
        """Continue as before, and report why."""
        _log.error("no restart: %s", why)
        if self._link is not None:
            self._link.close()  # this ends a successor that has no state
            self._link = None
        self._forget_successor()
        self._places.name_owner()
        on_restarted, self._on_restarted = self._on_restarted, None
        if on_restarted is not None:
            on_restarted(Refusal("restart_failed", f"the daemon continues unchanged: {why}"))

    def _forget_successor(self) -> None:
        self._forget_history()
        if self._pidfd is not None:
            os.close(self._pidfd)
            self._pidfd = None

    def _forget_history(self) -> None:
        if self._history is not None:
            os.close(self._history[1])
            self._history = None


def _is_process(descriptor: int) -> bool:
    """Return True if a descriptor is a process that lives, and that we can end."""
    try:
        signal.pidfd_send_signal(descriptor, 0)
    except OSError:
        return False
    return True


def _reply(link: Link, until_s: float) -> Packet | None:
    """Return the successor's answer to the state; None if there is none, or an unreadable one."""
    try:
        return link.wait(until_s - time.monotonic())
    except (OSError, ValueError) as error:
        _log.error("the successor's answer cannot be read: %s", error)
        return None


def _why_not(packet: Packet | None, link: Link) -> str:
    if packet is not None:
        return str(packet.body.get("why", f"the successor said {packet.kind}"))
    if link.has_ended:
        return "the successor ended while it took over; see the log"
    return f"the successor did not take over within {TAKE_WITHIN_S * 1e3:g} ms, and was ended"


class Retirement:
    """The last duties of a daemon whose successor is at the other end of `link`."""

    def __init__(
        self, link: Link, controller: Controller, urgent: Urgent, is_ending: Callable[[], bool]
    ) -> None:
        self._link = link
        self._controller = controller
        self._urgent = urgent
        self._is_ending = is_ending
        self._passed_on = controller.stop_latch.generation
        self._end_is_passed_on = False

    def release_clients(self, server: Server, stops: StopListener) -> None:
        """Answer the requests that were sent before, and close: the successor takes new clients."""
        self._controller.leave_to_successor()
        server.let_in(False)
        stops.let_in_no_more()
        self.pass_on()
        server.drain(time.monotonic() + DRAIN_WITHIN_S)
        server.flush()
        self.pass_on()
        server.close()
        stops.close()

    def pass_on(self) -> None:
        """Pass on the stops and signals that have come."""
        self._urgent.serve()
        latch = self._controller.stop_latch
        if latch.generation != self._passed_on and latch.latched is not None:
            self._passed_on = latch.generation
            pass_stop(self._link, latch.latched, latch.generation)
        if self._is_ending() and not self._end_is_passed_on:
            self._end_is_passed_on = True
            pass_end(self._link)

    def is_followed(self) -> bool:
        """Pass on stops and signals; return True while the successor is there."""
        self.pass_on()
        return not self._link.is_left()

    def close(self) -> None:
        """Pass on stops and signals of the last moment, and close the line."""
        self.pass_on()
        self._link.close()


def pass_stop(link: Link, stop: Stop, generation: int) -> None:
    """Pass on a stop that this process received after the handover."""
    _pass_on(link, "stop", plain_of(stop), generation)


def pass_end(link: Link) -> None:
    """Pass on a SIGTERM that this process received after the handover."""
    _pass_on(link, "end")


def _pass_on(link: Link, kind: str, stop: object = None, generation: int = 0) -> None:
    try:
        link.send(kind, stop=stop, generation=generation)
    except OSError as error:
        _log.error("the successor takes no %s: %s", kind, error)
