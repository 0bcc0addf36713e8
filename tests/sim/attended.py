"""`litegrip-sim` with somebody beside it, for tests of processes: `python -m tests.sim.attended`.

What happens to its adapter, bus and jaws comes as lines on the standard input.
"""

import os
import select
import sys

from litegripd.app import sim_main
from litegripd.model.motor import CanFrame
from litegripd.sim import server
from litegripd.sim.server import PtyServer, StopSignal


class AttendedServer(PtyServer):
    """The adapter; before each of its rounds it does what was written."""

    def run(self, stop: StopSignal) -> None:
        """Serve until `stop` is set."""
        do_late = self.wire.late

        def late(now_s: float) -> list[tuple[float, CanFrame]]:
            while select.select([0], [], [], 0.0)[0] and (line := _line()):
                self._do(*line.split())
            return do_late(now_s)

        self.wire.late = late  # type: ignore[method-assign]
        super().run(stop)

    def _do(self, action: str, *words: str) -> None:
        if action == "inject":
            can_id, data = words
            self.inject(CanFrame(int(can_id, 16), bytes.fromhex(data)))
        elif action == "push":
            self.wire.gripper.push(float(words[0]))
        elif action == "latch_fault":
            self.wire.gripper.latch_fault(int(words[0], 16))
        else:
            {"unplug": self.unplug, "plug": self.plug}[action]()


def _line() -> str:
    """Read one line, and no byte of the next, which `select` would not see."""
    line = b""
    while (byte := os.read(0, 1)) not in (b"", b"\n"):
        line += byte
    return line.decode()


if __name__ == "__main__":
    vars(server)["PtyServer"] = AttendedServer
    sys.exit(sim_main.main())
