"""Lets another process start processes, so that the control thread never waits.

A process that starts another one waits until that one runs its program. That takes long on a busy
disk or machine, and a motor that gets no command meanwhile lets go. So the control thread waits
only for the start of the spawner itself, before any motor is commanded.
"""

import errno
import json
import logging
import os
import select
from collections.abc import Sequence

from litegripd.io.helper.child import (
    MAX_PACKET_BYTES,
    Child,
    receive_descriptors,
    socket_pair,
    start_here,
)
from litegripd.io.helper.helper import Helper, HelperResult

_log = logging.getLogger(__name__)

MODULE = "litegripd.io.helper.spawner_main"
OPERATION = "spawner.start"
"""The helper's operation that starts another spawner."""

_LOOK_EVERY_S = 0.5
_END_WITHIN_S = 0.5

_IRREPLACEABLE = "the process that starts the others cannot be replaced: %s"


class Spawner:
    """Keeps one spawning process, and starts others by it: `start` never waits.

    A spawner that dies is replaced by the helper process; where that is gone, too, by this one as
    soon as it may wait. Raises `OSError` where the first one cannot be started.
    """

    def __init__(self) -> None:
        self.deaths = 0
        self._child: Child | None = start_here(MODULE)
        self._coming: Child | None = None
        self._starting: dict[int, Child] = {}
        self._last = 0
        self._look_at_s = float("-inf")

    @property
    def pid(self) -> int | None:
        """The spawner's process id, None while there is none."""
        return None if self._child is None else self._child.pid

    @property
    def is_running(self) -> bool:
        """True while processes can be started."""
        return self._child is not None

    def start(
        self, module: str, arguments: Sequence[str] = (), memory_fd: int | None = None
    ) -> Child:
        """Have `module` run; raises `OSError` where nobody can start it now."""
        if self._child is None:
            raise OSError(errno.ESRCH, "the process that starts the others is gone")
        self._last += 1
        ours, theirs = socket_pair()
        packet = json.dumps([self._last, module, list(arguments)]).encode()
        descriptors = [theirs.fileno()] if memory_fd is None else [theirs.fileno(), memory_fd]
        with theirs:
            is_sent = self._child.send(packet, descriptors)
        if not is_sent:
            ours.close()
            raise OSError(errno.EAGAIN, "the process that starts the others takes no request")
        child = Child(ours, settle=self._settle)
        self._starting[self._last] = child
        return child

    def poll(self, now_s: float, helper: Helper, *, may_wait: bool) -> None:
        """Replace a spawner that is gone; `may_wait` is true while no motor would miss commands."""
        if now_s < self._look_at_s:
            return
        self._look_at_s = now_s + _LOOK_EVERY_S
        self._settle(0.0)
        if self._child is not None or self._coming is not None:
            return
        if helper.is_running:
            self._replace_by(helper)
        elif may_wait:
            try:
                self._child = start_here(MODULE)
            except OSError as error:
                _log.error(_IRREPLACEABLE, error)

    def let_go(self) -> None:
        """Leave the spawner to end by itself, as it does without its daemon."""
        for child in (self._child, self._coming):
            if child is not None:
                child.let_go()
        self._child = self._coming = None

    def close(self) -> None:
        """End the spawner; what it has started ends by itself, with its sockets."""
        for child in (self._child, self._coming):
            if child is not None:
                child.close(_END_WITHIN_S)
        self._child = self._coming = None

    def _replace_by(self, helper: Helper) -> None:
        ours, theirs = socket_pair()
        self._coming = coming = Child(ours)

        def started(result: HelperResult) -> None:
            if self._coming is not coming:
                return
            self._coming = None
            try:
                if result.error is not None or not isinstance(result.value, dict):
                    raise OSError(errno.ECHILD, str(result.error))
                pid = int(result.value["pid"])
                coming.started(pid, os.pidfd_open(pid))
            except OSError as error:
                coming.close()
                _log.error(_IRREPLACEABLE, error)
            else:
                self._child = coming

        with theirs:
            helper.request(OPERATION, {}, started, (theirs.fileno(),))

    def _settle(self, within_s: float) -> None:
        """Learn which processes have been started, or that the spawner is gone."""
        while self._child is not None:
            connected = self._child.socket
            if within_s > 0.0:
                select.select((connected,), (), (), within_s)
                within_s = 0.0
            try:
                packet, descriptors = receive_descriptors(connected, MAX_PACKET_BYTES, 1)
            except BlockingIOError:
                return
            if packet:
                self._note(packet, descriptors)
            else:
                self._bury(self._child)

    def _note(self, packet: bytes, descriptors: Sequence[int]) -> None:
        number, pid, why = json.loads(packet)
        child = self._starting.pop(number)
        if descriptors:
            child.started(pid, descriptors[0])
        else:
            child.failure = why or "there was no descriptor left to watch it by"

    def _bury(self, spawner: Child) -> None:
        self._child = None
        self.deaths += 1
        spawner.close()
        _log.error("the process that starts the others died; it will be started again")
        orphans, self._starting = list(self._starting.values()), {}
        for child in orphans:
            child.failure = "the process that starts the others died"
