"""The faults, one row each: how it begins, what it does in every tick, how it ends.

They are the rows of what python-can reports of a CAN bus and of what drivers of this motor get
wrong. Each can be put on any `FaultWorld` at any time and taken away again; the matrix and the
chaos both use them.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import can

from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, MitCommand
from litegripd.motor import codec
from litegripd.sim.motor import REGISTER_CAN_ID
from litegripd.sim.plant import SimulatorParameters
from tests.faults.fault_world import FaultWorld
from tests.world import CAN_ID

Act = Callable[[FaultWorld], object]


def nothing(_world: FaultWorld) -> None:
    """What a fault does that is over at once, or needs no further care."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault; `lasts_s` is for how long the matrix leaves it on.

    `moves_jaws` marks those in which the jaws obey somebody else than the daemon, or a measurement
    that lies: where they go then is not the daemon's doing, but jaws that nobody has asked to move
    go no further by it than `at_most_mm`. Some need a client: with `switches_power` it enables a
    disabled motor at the beginning, and disables an enabled one; with `enables` it enables before
    the end.
    """

    group: str
    name: str
    begin: Act
    end: Act = nothing
    tick: Act = nothing
    lasts_s: float = 1.0
    moves_jaws: bool = False
    at_most_mm: float = math.inf
    switches_power: bool = False
    enables: bool = False


ERROR_CODES = {
    0x8: "over-voltage",
    0x9: "under-voltage",
    0xA: "over-current",
    0xB: "driver hot",
    0xC: "coil hot",
    0xD: "communication lost",
    0xE: "overload",
}
JUMP_RAD, FAR_JUMP_RAD = 0.5, 1.5
LINK, FRAMES, MOTOR, JAWS, DAEMON = (
    "The link",
    "Frames",
    "The motor",
    "Jaws and encoder",
    "The daemon",
)
BUFFER_FULL = can.CanOperationError("Transmit buffer full")
NO_CODE = can.CanOperationError("the adapter answers nonsense")
CLOSED = ValueError("file descriptor cannot be a negative integer (-1)")
LIKE_FEEDBACK = bytes([0x10 | CAN_ID]) + bytes(7)
PULL_RAD = SimulatorParameters().open_rad + 0.2
"""0.3 rad more open than the jaws are when most faults come."""
PULL = codec.encode_command(MitCommand(PULL_RAD, 0.0, 20.0, 1.0, 0.0), DM4310.ranges)
FREE = codec.encode_command(MitCommand(0.0, 0.0, 0.0, 0.0, 0.0), DM4310.ranges)


def clear_frames(world: FaultWorld) -> None:
    world.faults.to_motor.clear()
    world.faults.from_motor.clear()


def silence(world: FaultWorld) -> None:
    world.faults.to_motor.drop(1.0)
    world.faults.from_motor.drop(1.0)


def late(to_s: float, from_s: float) -> Act:
    def begin(world: FaultWorld) -> None:
        world.faults.to_motor.delay(to_s)
        world.faults.from_motor.delay(from_s)

    return begin


def doubled(world: FaultWorld) -> None:
    world.faults.to_motor.double(1.0)
    world.faults.from_motor.double(1.0)


def uncorrupted(world: FaultWorld) -> None:
    """What changed frames may have written into the motor, a power cycle takes out of it."""
    clear_frames(world)
    world.gripper.power_cycle()


def sends(*frames: CanFrame) -> Act:
    def act(world: FaultWorld) -> None:
        for frame in frames:
            world.inject(frame)

    return act


def latches(code: int) -> Act:
    def begin(world: FaultWorld) -> None:
        if world.gripper.motor.is_powered:
            world.gripper.latch_fault(code)

    return begin


def deaf_to(data: bytes, count: int) -> Act:
    def begin(world: FaultWorld) -> None:
        world.gripper.deaf_to[data] = count

    return begin


def hearing(world: FaultWorld) -> None:
    world.gripper.deaf_to.clear()


READS = CanFrame(REGISTER_CAN_ID, bytes([CAN_ID, 0, 0x33, 21, 0, 0, 0, 0]))
WRITES = CanFrame(REGISTER_CAN_ID, bytes([CAN_ID, 0, 0x55, 9, 0xD0, 0x07, 0, 0]))
"""Register 9, the watchdog, to 2000 units of 50 µs: what it is already."""

FAULTS: tuple[Fault, ...] = (
    Fault(LINK, "link down for 50 ms", lambda w: w.faults.link_down(),
          lambda w: w.faults.link_up(), lasts_s=0.05),
    Fault(LINK, "link down", lambda w: w.faults.link_down(), lambda w: w.faults.link_up()),
    Fault(LINK, "adapter unplugged", lambda w: w.faults.unplug(), lambda w: w.faults.replug()),
    Fault(LINK, "bus-off", lambda w: w.faults.bus_off(), lambda w: w.faults.recover()),
    Fault(LINK, "nobody acknowledges for 50 ms, then the queue is replayed",
          lambda w: w.faults.stall(), lambda w: w.faults.unstall(), lasts_s=0.05),
    Fault(LINK, "nobody acknowledges for 0.5 s, then the queue is replayed",
          lambda w: w.faults.stall(), lambda w: w.faults.unstall(), lasts_s=0.5),
    Fault(LINK, "nobody acknowledges for 3 s, then the queue is replayed",
          lambda w: w.faults.stall(), lambda w: w.faults.unstall(), lasts_s=3.0),
    Fault(LINK, "transmit buffer full, an error without a number",
          lambda w: w.fail_sending(BUFFER_FULL), lambda w: w.work_again(), lasts_s=0.5),
    Fault(LINK, "an adapter's error without a number", lambda w: w.fail_receiving(NO_CODE),
          lambda w: w.work_again()),
    Fault(LINK, "the socket is closed", lambda w: w.fail_receiving(CLOSED)),
    Fault(FRAMES, "one frame to the motor lost", lambda w: w.faults.to_motor.drop_next(1),
          clear_frames, lasts_s=0.5),
    Fault(FRAMES, "one frame from the motor lost", lambda w: w.faults.from_motor.drop_next(1),
          clear_frames, lasts_s=0.5),
    Fault(FRAMES, "three frames to the motor lost", lambda w: w.faults.to_motor.drop_next(3),
          clear_frames, lasts_s=0.5),
    Fault(FRAMES, "three frames from the motor lost", lambda w: w.faults.from_motor.drop_next(3),
          clear_frames, lasts_s=0.5),
    Fault(FRAMES, "each fifth frame to the motor lost", lambda w: w.faults.to_motor.drop(0.2),
          clear_frames),
    Fault(FRAMES, "each fifth frame from the motor lost", lambda w: w.faults.from_motor.drop(0.2),
          clear_frames),
    Fault(FRAMES, "all frames to the motor lost", lambda w: w.faults.to_motor.drop(1.0),
          clear_frames),
    Fault(FRAMES, "all frames from the motor lost", lambda w: w.faults.from_motor.drop(1.0),
          clear_frames),
    Fault(FRAMES, "silence: all frames lost", silence, clear_frames),
    Fault(FRAMES, "frames to the motor 10 ms late", late(0.01, 0.0), clear_frames),
    Fault(FRAMES, "frames from the motor 10 ms late", late(0.0, 0.01), clear_frames),
    Fault(FRAMES, "frames both ways 30 ms late", late(0.03, 0.03), clear_frames),
    Fault(FRAMES, "all frames doubled", doubled, clear_frames),
    Fault(FRAMES, "each tenth frame from the motor changed",
          lambda w: w.faults.from_motor.corrupt(0.1), clear_frames, moves_jaws=True,
          at_most_mm=5.0),
    Fault(FRAMES, "each tenth frame to the motor changed, then a power cycle",
          lambda w: w.faults.to_motor.corrupt(0.1), uncorrupted, moves_jaws=True),
    Fault(FRAMES, "error frames with the feedback's id", nothing,
          tick=lambda w: w.faults.inject_error(0x08 | 0x10, LIKE_FEEDBACK)),
    Fault(FRAMES, "frames of other nodes", nothing,
          tick=sends(CanFrame(0x18, bytes(8)), CanFrame(0x123, PULL), CanFrame(0x09, PULL))),
    Fault(FRAMES, "another node reads and writes registers", nothing, tick=sends(READS, WRITES)),
    Fault(FRAMES, "a second master commands zero gains", nothing,
          tick=sends(CanFrame(CAN_ID, FREE)), moves_jaws=True, at_most_mm=0.0),
    Fault(FRAMES, "one command of a second master, 20 N·m/rad towards open",
          sends(CanFrame(CAN_ID, PULL)), moves_jaws=True, at_most_mm=2.0),
    Fault(FRAMES, "a second master enables", sends(CanFrame(CAN_ID, codec.ENABLE))),
    Fault(FRAMES, "a second master disables", sends(CanFrame(CAN_ID, codec.DISABLE))),
    Fault(FRAMES, "the client's next enable or disable frame lost",
          lambda w: (deaf_to(codec.ENABLE, 1)(w), deaf_to(codec.DISABLE, 1)(w)), hearing,
          switches_power=True),
    Fault(FRAMES, "all enable and disable frames lost",
          lambda w: (deaf_to(codec.ENABLE, 1000)(w), deaf_to(codec.DISABLE, 1000)(w)), hearing,
          switches_power=True, lasts_s=2.0),
    *(
        Fault(MOTOR, f"status {code:X}, {name}", latches(code), lasts_s=0.5)
        for code, name in ERROR_CODES.items()
    ),
    Fault(MOTOR, "24 V lost; the motor answers on", lambda w: w.gripper.set_supply(0.0),
          lambda w: w.gripper.set_supply(24.0)),
    Fault(MOTOR, "the motor switched off", lambda w: w.gripper.power_off(),
          lambda w: w.gripper.power_on()),
    Fault(MOTOR, "the motor makes 15 % of the commanded torque",
          lambda w: w.gripper.weaken(0.15), lambda w: w.gripper.weaken(1.0), lasts_s=2.0),
    Fault(MOTOR, "a power cycle within one tick", lambda w: w.gripper.power_cycle()),
    Fault(JAWS, "2π more after a power cycle, then enabled; later another power cycle",
          lambda w: w.gripper.power_cycle(turns=1), lambda w: w.gripper.power_cycle(),
          enables=True),
    Fault(JAWS, "the encoder jumps by 0.5 rad, and later back",
          lambda w: w.gripper.jump(JUMP_RAD), lambda w: w.gripper.jump(-JUMP_RAD),
          moves_jaws=True),
    Fault(JAWS, "the encoder jumps by 1.5 rad, and later back",
          lambda w: w.gripper.jump(FAR_JUMP_RAD), lambda w: w.gripper.jump(-FAR_JUMP_RAD),
          moves_jaws=True),
    Fault(JAWS, "the rotor is stuck", lambda w: w.gripper.jam(), lambda w: w.gripper.free(),
          lasts_s=2.5),
    Fault(DAEMON, "a tick 60 ms late", lambda w: w.skip(0.06), lasts_s=0.5),
    Fault(DAEMON, "a tick 300 ms late", lambda w: w.skip(0.3), lasts_s=0.5),
)  # fmt: skip
