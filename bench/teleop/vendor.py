"""A follower as the vendor's SDK describes it, with a simulated gripper of its own, in real time.

python -m bench.teleop.vendor PORT FILE

Every 20 ms it takes the newest datagram that has come to UDP port PORT, and commands what that
says: the target itself, and a velocity by differencing frames by its own clock. After 0.2 s without
one it holds the last target. Until SIGTERM; then FILE has a row for each cycle: time, jaws (mm),
command (mm), the motor's largest torque in the cycle before (N·m).
"""

import json
import signal
import socket
import struct
import sys
import time
from pathlib import Path

from bench.teleop.follow import SEED_PERIOD_S
from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.model.gripper import DM4310, Geometry
from litegripd.model.motor import CanFrame, MitCommand
from litegripd.motor import codec
from litegripd.sim.gripper import SimulatedGripper, build_gripper
from litegripd.sim.plant import limits_of_mount
from litegripd.teleop.intake import MAX_FRAME_GAP_S

CAN_ID = 0x08
DQ_MAX_RAD_S = 10.0
LOOKS = 4


class Vendor:
    """Makes the command of each cycle."""

    def __init__(self, geometry: Geometry) -> None:
        self.target_rad: float | None = None
        self._geometry = geometry
        self._came_s = 0.0

    def command(self, now_s: float, openness: float | None) -> MitCommand | None:
        """Take the newest frame's openness, if one has come."""
        velocity_rad_s = 0.0
        if openness is not None:
            geometry, before_rad = self._geometry, self.target_rad
            share = min(max(openness, 0.0), 1.0)
            self.target_rad = (
                geometry.closed_rad - geometry.close_sign * share * geometry.travel_rad
            )
            gap_s, self._came_s = now_s - self._came_s, now_s
            if before_rad is not None and 0.0 < gap_s <= MAX_FRAME_GAP_S:
                rate = (self.target_rad - before_rad) / gap_s
                velocity_rad_s = min(max(rate, -DQ_MAX_RAD_S), DQ_MAX_RAD_S)
        if self.target_rad is None:
            return None
        return DEFAULT_GAINS.at(self.target_rad, velocity_rad_s)


def newest(own: socket.socket) -> float | None:
    """Return the openness in the newest datagram that waits, if one does."""
    openness = None
    while True:
        try:
            payload = own.recv(64)
        except BlockingIOError:
            return openness
        openness = float(struct.unpack(">4d", payload)[0])


def run(port: int, file: Path) -> None:
    gripper: SimulatedGripper = build_gripper(watchdog_s=10.0)
    geometry = Geometry(*limits_of_mount("normal"), gripper.parameters.rad_to_mm)
    vendor, rows = Vendor(geometry), []
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.bind(("127.0.0.1", port))
    own.setblocking(False)
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: ended.append(number))
    gripper.receive(time.monotonic(), CanFrame(CAN_ID, codec.ENABLE))
    due_s, peak_nm = time.monotonic(), 0.0
    while not ended:
        now_s = time.monotonic()
        gripper.advance(now_s)
        command = vendor.command(now_s, newest(own))
        if command is not None:
            frame = CanFrame(CAN_ID, codec.encode_command(command, DM4310.ranges))
            gripper.receive(now_s, frame)
            wanted_mm = geometry.opening_mm(command.position_rad)
            rows.append((now_s, gripper.opening_mm, wanted_mm, peak_nm))
            peak_nm = 0.0
        for _ in range(LOOKS):
            due_s = max(due_s + SEED_PERIOD_S / LOOKS, time.monotonic())
            time.sleep(max(due_s - time.monotonic(), 0.0))
            gripper.advance(time.monotonic())
            peak_nm = max(peak_nm, abs(gripper.motor_torque_nm))
    own.close()
    file.write_text(json.dumps(rows), encoding="utf-8")


if __name__ == "__main__":
    run(int(sys.argv[1]), Path(sys.argv[2]))
