"""Drives a simulated gripper from a test: builds frames, reads feedback, lets virtual time pass."""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.registers import from_code, to_code

CAN_ID, MASTER_ID = 0x08, 0x18
PERIOD_S = 0.005


def command(
    q: float = 0.0, dq: float = 0.0, kp: float = 0.0, kd: float = 0.0, tau: float = 0.0
) -> CanFrame:
    """A command frame in the motor's default ranges, truncated like the maker's driver does."""
    word = (
        to_code(q, -12.5, 12.5, 16) << 48
        | to_code(dq, -30.0, 30.0, 12) << 36
        | to_code(kp, 0.0, 500.0, 12) << 24
        | to_code(kd, 0.0, 5.0, 12) << 12
        | to_code(tau, -10.0, 10.0, 12)
    )
    return CanFrame(CAN_ID, word.to_bytes(8, "big"))


def special(code: int) -> CanFrame:
    return CanFrame(CAN_ID, b"\xff" * 7 + bytes([code]))


ENABLE, DISABLE, ZERO, CLEAR = (special(code) for code in (0xFC, 0xFD, 0xFE, 0xFB))
STATUS = CanFrame(0x7FF, bytes([CAN_ID, 0, 0xCC, 0, 0, 0, 0, 0]))
SAVE = CanFrame(0x7FF, bytes([CAN_ID, 0, 0xAA, 1, 0, 0, 0, 0]))


def read(rid: int) -> CanFrame:
    return CanFrame(0x7FF, bytes([CAN_ID, 0, 0x33, rid, 0, 0, 0, 0]))


def write(rid: int, value: float) -> CanFrame:
    raw = struct.pack("<f" if isinstance(value, float) else "<I", value)
    return CanFrame(0x7FF, bytes([CAN_ID, 0, 0x55, rid]) + raw)


@dataclass(frozen=True, slots=True)
class Feedback:
    motor_id: int
    status: int
    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    driver_c: int
    coil_c: int


def decode(frame: CanFrame) -> Feedback:
    assert frame.can_id == MASTER_ID
    data = frame.data
    return Feedback(
        motor_id=data[0] & 0xF,
        status=data[0] >> 4,
        position_rad=from_code(data[1] << 8 | data[2], -12.5, 12.5, 16),
        velocity_rad_s=from_code(data[3] << 4 | data[4] >> 4, -30.0, 30.0, 12),
        torque_nm=from_code((data[4] & 0xF) << 8 | data[5], -10.0, 10.0, 12),
        driver_c=data[6],
        coil_c=data[7],
    )


class Driver:
    """Streams commands at 200 Hz in virtual time and keeps the last feedback."""

    def __init__(self, gripper: SimulatedGripper | None = None) -> None:
        self.gripper = SimulatedGripper() if gripper is None else gripper
        self.now_s = 0.0
        self.gripper.advance(0.0)

    def ask(self, frame: CanFrame) -> Feedback:
        """Send a frame that is answered with one feedback frame, and return that."""
        (answer,) = self.gripper.receive(self.now_s, frame)
        return decode(answer)

    def arm(self) -> Feedback:
        """Enable without a jump: zero gains first."""
        self.ask(command())
        return self.ask(ENABLE)

    def wait(self, duration_s: float) -> None:
        """Let time pass in silence."""
        self.now_s += duration_s
        self.gripper.advance(self.now_s)

    def stream(self, duration_s: float, frame: CanFrame | Callable[[float], CanFrame]) -> Feedback:
        """Send the frame in every period; a function gets the time since the start."""
        start_s = self.now_s
        for _ in range(round(duration_s / PERIOD_S)):
            sent = frame(self.now_s - start_s) if callable(frame) else frame
            self.gripper.receive(self.now_s, sent)
            self.wait(PERIOD_S)
        return self.ask(STATUS)

    def read(self, rid: int) -> bytes:
        """Read a register's 4 bytes."""
        (answer,) = self.gripper.receive(self.now_s, read(rid))
        assert answer.can_id == MASTER_ID
        assert answer.data[:4] == bytes([CAN_ID, 0, 0x33, rid])
        return answer.data[4:]

    def read_int(self, rid: int) -> int:
        return int.from_bytes(self.read(rid), "little")

    def read_float(self, rid: int) -> float:
        value: float = struct.unpack("<f", self.read(rid))[0]
        return value

    def write(self, rid: int, value: float) -> bytes:
        """Write a register and return the 4 bytes of the answer."""
        (answer,) = self.gripper.receive(self.now_s, write(rid, value))
        assert answer.data[:4] == bytes([CAN_ID, 0, 0x55, rid])
        return answer.data[4:]
