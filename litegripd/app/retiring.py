"""The end of a daemon that has handed over: who had come to it before is not forgotten.

The motor is the successor's. What is left is to answer the clients, to tell the service manager,
and, until the very last, to pass on every stop and SIGTERM that still comes here.
"""

import time

from litegripd.app.ending import Ending
from litegripd.app.succession import Succession
from litegripd.control.engine import Engine
from litegripd.handover.link import Link
from litegripd.io.loop import Urgent
from litegripd.io.server import Server
from litegripd.io.stop_socket import StopListener

DRAIN_WITHIN_S = 0.05
"""So long a daemon that has handed over serves what its clients have sent before."""


class Retirement:
    """What a daemon still does for the successor at the other end of `link`."""

    def __init__(
        self, link: Link, succession: Succession, engine: Engine, urgent: Urgent, ending: Ending
    ) -> None:
        self._link = link
        self._succession = succession
        self._engine = engine
        self._urgent = urgent
        self._ending = ending
        self._passed_on = engine.stop_latch.generation
        self._end_is_passed_on = False

    def part_with_clients(self, server: Server, stops: StopListener) -> None:
        """Answer what clients have sent before, and close: whoever comes now is the successor's."""
        self._engine.shut_down()  # it has no motor any more: it only refuses
        server.let_in(False)
        stops.let_in_no_more()
        self.pass_on()
        server.drain(time.monotonic() + DRAIN_WITHIN_S)
        server.flush()
        self.pass_on()
        server.close()
        stops.close()

    def pass_on(self) -> None:
        """Take the stops and signals that have come, and pass them on."""
        self._urgent.serve()
        latch = self._engine.stop_latch
        if latch.generation != self._passed_on and latch.latched is not None:
            self._passed_on = latch.generation
            self._succession.tell_stop(self._link, latch.latched, latch.generation)
        if self._ending.has_begun and not self._end_is_passed_on:
            self._end_is_passed_on = True
            self._succession.tell_end(self._link)

    def goes_on(self) -> bool:
        """Pass on what has come; return whether the successor is still there."""
        self.pass_on()
        return not self._link.is_left()

    def close(self) -> None:
        """Pass on what has come at the last moment, and close the line."""
        self.pass_on()
        self._link.close()
