"""Scenes of a motor: its registers, simulated or from a table; its answers, as they came or not."""

import math
import struct
from collections.abc import Callable

from litegripd.model.motor import CanFrame, MotorInput
from litegripd.motor import codec
from litegripd.motor.motor import Motor
from tests.world import CAN_ID, PERIOD_S, Client, World, enabled_world

MASTER_ID = 0x18


def set_register(world: World, number: int, raw: bytes) -> None:
    registers = world.gripper.motor.registers
    assert registers.write(number, raw)
    registers.save()
    world.gripper.power_cycle()


def world_with(number: int, raw: bytes, master_id: int | None = None) -> World:
    world = World(master_id=master_id)
    set_register(world, number, raw)
    return world


def replace_answers(
    world: World, changed: Callable[[CanFrame], CanFrame | None], count: float = math.inf
) -> None:
    """Let others come in the place of the motor's next answers, as many as are changed at all."""
    left = count

    def is_replaced(frame: CanFrame) -> bool:
        nonlocal left
        other = changed(frame) if left > 0 else None
        if other is None:
            return False
        left -= 1
        world.inject(other)
        return True

    world.lose_from_motor = is_replaced


def gripping() -> tuple[World, Client]:
    """Return a world whose jaws have held an object by 1 N·m for a while."""
    world, client = enabled_world()
    world.gripper.put_object(width_mm=50.0)
    assert client.result("motion.grasp", force_n=10.0, until="verdict")["ok"]
    world.run(1.5)
    return world, client


def answer(number: int, raw: bytes, opcode: int = 0x33, can_id: int = MASTER_ID) -> CanFrame:
    return CanFrame(can_id, bytes([CAN_ID, 0, opcode, number]) + raw)


class Registers:
    """Answers a Motor's requests from a table, frame by frame."""

    def __init__(self, motor: Motor, **changes: bytes) -> None:
        self.motor = motor
        self.now_s = 0.0
        self.values = {
            number: struct.pack("<I", value)
            for number, value in {7: 0x18, 8: 8, 9: 2000, 10: 1, 13: 1, 14: 1, 15: 1, 35: 4}.items()
        }
        for number, value in {20: 10.0, 21: 12.5, 22: 30.0, 23: 10.0}.items():
            self.values[number] = struct.pack("<f", value)
        self.values |= {int(name[1:]): raw for name, raw in changes.items()}
        self.status = 0
        self.extra: list[CanFrame] = []

    def tick(self, wanted: MotorInput | None = None, *, answers: bool = True) -> list[CanFrame]:
        """Let one period pass: the motor's frames, their answers if any, and `extra`."""
        self.now_s += PERIOD_S
        sent = self.motor.step(self.now_s, wanted or MotorInput())
        replies = [reply for frame in sent for reply in self._answer(frame)] if answers else []
        self.motor.receive(self.now_s, self.extra + replies)
        return sent

    def _answer(self, frame: CanFrame) -> list[CanFrame]:
        if frame.can_id != CAN_ID and frame.data[2] == 0x33:
            raw = self.values.get(frame.data[3])
            return [] if raw is None else [CanFrame(MASTER_ID, frame.data[:4] + raw)]
        if frame.data == codec.ENABLE and self.status == 0:
            self.status = 1
        if frame.data in (codec.DISABLE, codec.CLEAR_FAULT) and self.status in (0, 1):
            self.status = 0
        if frame.data == codec.CLEAR_FAULT:
            self.status = 0
        head = bytes([self.status << 4 | CAN_ID])
        return [CanFrame(MASTER_ID, head + bytes.fromhex("80007FF8002020"))]


def started(**changes: bytes) -> Registers:
    bus = Registers(Motor(CAN_ID), **changes)
    for _ in range(60):
        bus.tick()
    assert bus.motor.view().identity is not None
    return bus
