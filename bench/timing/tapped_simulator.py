"""A simulated gripper as an SLCAN adapter that notes each command, for `bench.timing.restart`.

python -m bench.timing.tapped_simulator FILE OBJECT_MM

Prints the terminal's path. At SIGTERM it writes to FILE, as doubles, of each command frame: when it
came (CLOCK_MONOTONIC), the torque it asks for, the true position of the jaws in mm, and 1 while the
motor is energised.
"""

import array
import os
import signal
import sys
from pathlib import Path

from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, Status
from litegripd.motor import codec
from litegripd.sim.gripper import SimulatedGripper, build_gripper
from litegripd.sim.interface import MotorWire
from litegripd.sim.server import PtyServer, StopSignal

PRIORITY = 40


class Tap:
    """Passes frames on to a gripper and keeps what they were."""

    def __init__(self, gripper: SimulatedGripper) -> None:
        self.rows = array.array("d")
        self._gripper = gripper
        self._receive = gripper.receive

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        answers = self._receive(now_s, frame)
        if frame.can_id == 0x08 and frame.data[:7] != b"\xff" * 7:
            command = codec.decode_command(frame.data, DM4310.ranges)
            is_on = self._gripper.motor.status == Status.ENABLED
            self.rows.extend((now_s, command.torque_nm, self._gripper.opening_mm, float(is_on)))
        return answers


def prefer(pid: int) -> bool:
    """Give every thread of a process real-time priority, so that only the daemon is measured."""
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True


def main() -> None:
    gripper = build_gripper(
        mount="normal",
        seed=None,
        object_mm=float(sys.argv[2]),
        object_stiffness_nm_rad=250.0,
        can_id=0x08,
        master_id=0x18,
    )
    tap = Tap(gripper)
    gripper.receive = tap.receive  # type: ignore[method-assign]
    stop = StopSignal()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    prefer(os.getpid())
    server = PtyServer(MotorWire(gripper), announce=lambda path: print(path, flush=True))
    server.run(stop)
    Path(sys.argv[1]).write_bytes(tap.rows.tobytes())


if __name__ == "__main__":
    main()
