"""Notifications to the service manager: that the daemon is ready, its status, and that it works.

The protocol (sd_notify) is one datagram of lines `NAME=value` to the socket that NOTIFY_SOCKET
names. A control thread that hangs sends nothing, and the manager restarts it. This file checks a
loop that still runs: whether it does its work. Nothing here waits.
"""

import logging
import os
import select
import socket
import time
from collections.abc import Callable

from litegripd.app.machine import Machine
from litegripd.app.status import DaemonFacts
from litegripd.io.server import Server
from litegripd.model.motor import MotorPhase

_BARRIER = b"BARRIER=1"
_LOOK_EVERY_MS = 5


class Notifier:
    """A socket to the manager that stays open, for frequent notifications."""

    def __init__(self) -> None:
        path = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + path[1:] if path[:1] == "@" else path if path[:1] == "/" else None
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.is_full = False
        """True if the last notification found no room: the manager has not read the earlier
        ones."""

    def send(self, text: str) -> bool:
        """Send lines (READY=1); return True if they left. Never waits, raises nothing."""
        data = text.encode(errors="replace")
        return self._left(lambda address: self._socket.sendto(data, address))

    def insist(self, text: str, goes_on: Callable[[], bool]) -> bool:
        """Send lines, and retry while there is no room; return True if they left.

        `goes_on` is called every few milliseconds; when it returns False, the attempt ends.
        """
        return self._insist(lambda: self.send(text), goes_on)

    def barrier(self, within_s: float, goes_on: Callable[[], bool]) -> bool:
        """Wait until the manager has read all that was sent; False if it has not in time.

        It closes the descriptor that it gets, which we see (systemd 246; other managers never do).
        The time counts from when there was room for that. `goes_on` is as for `insist`.
        """
        ours, theirs = os.pipe()
        try:
            waits = self._insist(
                lambda: self._left(lambda address: self._send_descriptor(theirs, address)), goes_on
            )
        finally:
            os.close(theirs)
        ends_s = time.monotonic() + within_s
        try:
            poll = select.poll()
            poll.register(ours, 0)
            while waits and not poll.poll(_LOOK_EVERY_MS):
                waits = goes_on() and time.monotonic() < ends_s
            return waits
        finally:
            os.close(ours)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _insist(self, send: Callable[[], bool], goes_on: Callable[[], bool]) -> bool:
        while not send():
            if not self.is_full or not goes_on():
                return False
            select.select((), (), (), _LOOK_EVERY_MS * 1e-3)
        return True

    def _left(self, send: Callable[[str], object]) -> bool:
        self.is_full = False
        if self._address is None:
            return False
        try:
            send(self._address)
        except BlockingIOError:
            self.is_full = True
            return False
        except OSError:
            return False
        return True

    def _send_descriptor(self, descriptor: int, address: str) -> None:
        self._socket.connect(address)  # before Python 3.12 `send_fds` ignores an address
        socket.send_fds(self._socket, [_BARRIER], (descriptor,))


def watchdog_s(*, follows: bool = False) -> float | None:
    """Return the time within which the manager expects WATCHDOG=1, or None.

    It names the process that it means; a successor of that one has inherited the name.
    """
    named = os.environ.get("WATCHDOG_PID", "")
    if named and not follows and named != str(os.getpid()):
        return None
    given = os.environ.get("WATCHDOG_USEC", "")
    return int(given) * 1e-6 if given.isascii() and given.isdigit() and int(given) else None


def one_line(text: str) -> str:
    """Return a text as one line: in a message to the manager each line is a command of its own."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


_log = logging.getLogger(__name__)

STATUS_EVERY_S = 1.0
BEATS_PER_WATCHDOG = 4
"""The beats in the manager's watchdog time: one failed check alone does not end the daemon."""

FEEDBACK_WITHIN_S = 1.0
"""Far longer than the time in which a silent motor is noticed."""

MANAGER_WITHIN_S = 1.0
"""How long a daemon waits until the manager knows its successor as the main process."""

_LONGEST_STATUS = 300  # characters
_READY = "READY=1"
_ANSWERS = (MotorPhase.ENABLED, MotorPhase.DISABLED)


class Supervision:
    """Sends a datagram to the manager now and then; call `tick` at the end of every tick.

    `follows` is True for a successor: the manager accepts its messages only after the predecessor
    has named it, and the predecessor has just fed the watchdog.
    """

    def __init__(
        self,
        machine: Machine,
        server: Server,
        facts: DaemonFacts,
        mode: Callable[[], str],
        *,
        follows: bool = False,
    ) -> None:
        self._machine = machine
        self._server = server
        self._facts = facts
        self._mode = mode
        self._watchdog_s = watchdog_s(follows=follows)
        wanted_s = (self._watchdog_s or STATUS_EVERY_S * BEATS_PER_WATCHDOG) / BEATS_PER_WATCHDOG
        self._beat_s = min(wanted_s, STATUS_EVERY_S)
        self._next_beat_s: float | None = None
        self._next_status_s = 0.0
        self._shown_status = ""
        self._complaint: str | None = None
        self._worked = False
        self._waited = False
        self._requests = 0
        self._owed = ""
        self._notifier = Notifier()

    def ready(self) -> None:
        """Notify the manager that clients are let in; repeat in each tick until there is room."""
        is_sent = self._notifier.send(_READY)
        self._owed = _READY if not is_sent and self._notifier.is_full else ""

    def ends(self) -> None:
        """Notify the manager that the end has begun."""
        self._notifier.send("STOPPING=1")

    def followed_by(self, pid: int, goes_on: Callable[[], bool]) -> None:
        """Notify the manager that another process is the daemon, and wait until the manager knows.

        Otherwise the manager would take the end of this process for the daemon's, and end the
        successor. So this process waits for room as long as `goes_on` returns True.
        """
        message = f"MAINPID={pid}\n{self._owed}".rstrip()
        if self._notifier.insist(message, goes_on):
            self._notifier.barrier(MANAGER_WITHIN_S, goes_on)

    def tick(self, now_s: float, *, failed: bool) -> None:
        """Record whether the tick succeeded; send any due watchdog or status message."""
        self._worked = self._worked or not failed
        if self._owed:
            self.ready()
        if self._next_beat_s is None:
            self._next_beat_s = now_s + self._beat_s
        if now_s < self._next_beat_s:
            return
        self._next_beat_s = now_s + self._beat_s
        if self._watchdog_s is not None:
            self._feed(now_s)
        if now_s >= self._next_status_s:
            self._next_status_s = now_s + STATUS_EVERY_S
            self._send_status()

    def close(self) -> None:
        """Close the socket."""
        self._notifier.close()

    def _feed(self, now_s: float) -> None:
        """Notify the manager that the daemon works, or log why not."""
        complaint = self._idle(now_s)
        if complaint is None:
            self._notifier.send("WATCHDOG=1")
        elif self._complaint is None:
            _log.error("the watchdog is not fed, this daemon will be restarted: %s", complaint)
        self._complaint = complaint

    def _idle(self, now_s: float) -> str | None:
        """Return what has not been done since the last beat, or None."""
        worked, self._worked = self._worked, False
        waited, self._waited = self._waited, self._server.lines_wait
        requests, self._requests = self._requests, self._server.requests
        view = self._machine.motor.view()
        if not worked:
            return "every tick fails"
        if view.phase in _ANSWERS and self._machine.controller.bus.is_usable:
            age_s = now_s - view.feedback.at_s if view.feedback is not None else None
            if age_s is None or age_s > FEEDBACK_WITHIN_S:
                return "the motor counts as answering, but does not answer"
        if not self._server.is_open:
            return "no new client is accepted"
        if waited and self._waited and requests == self._requests:
            return "requests wait, and none is answered"
        return None

    def _send_status(self) -> None:
        verdict, reasons = self._facts.verdict()
        clients = self._server.clients
        text = f"{self._mode()}, {clients} client{'' if clients == 1 else 's'}, {verdict}"
        if reasons:
            text += f": {'; '.join(reasons)}"
        text = one_line(text)[:_LONGEST_STATUS]
        if text != self._shown_status and self._notifier.send(f"STATUS={text}"):
            self._shown_status = text
