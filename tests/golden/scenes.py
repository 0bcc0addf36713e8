"""The scenes of the golden runs: together they pass through every room of the core.

What they assert is little: they are to be alike, not right. What is right is asked elsewhere.
"""

import json
import random
from collections.abc import Callable
from typing import Any

from bench.hostile.lines import HostileLines
from litegripd.model.motor import UP, BusCondition, BusState, CanFrame
from tests.control.exchange import exchange
from tests.control.teleop_scene import Follower, sweep
from tests.golden.world import GoldenClient, GoldenWorld
from tests.rpc.transcripts import conversation
from tests.trajectories import sampled, swing, uploaded

Scene = Callable[[], GoldenWorld]
SCENES: dict[str, Scene] = {}


def scene(play: Scene) -> Scene:
    """Keep a scene by its name."""
    SCENES[play.__name__] = play
    return play


def enabled(**more: Any) -> tuple[GoldenWorld, GoldenClient]:
    """Make a world whose motor is enabled by a client that hears every event."""
    world = GoldenWorld(**more)
    world.start()
    client = world.client()
    client.result("events.subscribe")
    assert client.result("motor.enable")["ok"]
    return world, client


def gripping(width_mm: float = 40.0, **params: Any) -> tuple[GoldenWorld, GoldenClient]:
    """Make a world that holds an object."""
    world, client = enabled()
    world.gripper.put_object(width_mm=width_mm)
    client.call("motion.grasp", force_n=8, until="verdict", **params)
    return world, client


@scene
def every_method() -> GoldenWorld:
    """Use each method at least once."""
    world = GoldenWorld()
    world.start()
    client = world.client()
    for method, params in conversation(client):
        client.call(method, **params)
    world.run(0.5)
    return world


@scene
def motions_on_both_mounts() -> GoldenWorld:
    """Open, close and move, with progress, one in the place of another, one after another."""
    worlds = [enabled(), enabled(mount="reverse")]
    for world, client in worlds:
        client.call("motion.open", progress=True)
        waiting = client.send("motion.close", speed_mm_s=40)
        world.run(0.4)
        client.call("motion.move", opening_mm=30, if_busy="replace")
        client.has_answer(waiting)
        client.send("motion.move", openness=0.9, duration_s=1.5)
        client.call("motion.close", if_busy="queue", config={"settle_s": 0.05})
        client.call("motion.move", opening_mm=500)
        client.call("motion.hold")
    worlds[0][0].kept += worlds[1][0].kept
    return worlds[0][0]


@scene
def grasps() -> GoldenWorld:
    """Hold something stiff, something soft, and nothing."""
    world, client = gripping(progress=True)
    world.run(2.0)
    for force_n in (2, 20):
        client.call("motion.set_force", force_n=force_n)
        world.run(0.5)
    client.call("motion.open")
    world.gripper.put_object(width_mm=70.0, stiffness_nm_rad=30.0, yield_mm_s=2.0)
    client.call("motion.grasp", force_n=5, hold_s=1.0, width_mm=60, tolerance_mm=8)
    client.call("motion.open")
    world.gripper.remove_object()
    client.call("motion.grasp", force_n=5, until="verdict")
    return world


@scene
def grasp_by_gains() -> GoldenWorld:
    """Hold by position and gains, through a bump."""
    world, client = gripping(hold_by="gains", config={"hold_interval": 0.3})
    world.gripper.push(-2.0)
    world.run(0.03)
    world.gripper.push(0.0)
    world.run(1.0)
    client.call("motor.disable")
    return world


@scene
def what_is_held_is_bumped_gives_way_and_vanishes() -> GoldenWorld:
    """Lose an object at last."""
    world, client = gripping()
    world.gripper.push(-2.5)
    world.run(0.015)
    world.gripper.push(0.0)
    world.run(0.5)
    world.gripper.give_way(1.0)
    world.run(0.5)
    world.gripper.remove_object()
    world.run(1.5)
    client.call("state.get")
    return world


@scene
def set_points() -> GoldenWorld:
    """Stream openings, positions and torques, and fall silent."""
    world, client = enabled()
    client.call("lease.acquire", ttl_s=5)
    for step in range(100):
        line = {"opening_mm": 60 - 0.2 * step, "valid_s": 0.05, "speed_mm_s": 80}
        client.send_line(notification("stream.set", line))
        world.run(0.01)
    world.run(0.3)
    client.send_line(notification("stream.set", {"opening_mm": 900, "valid_s": 0.05}))
    world.run(0.3)
    return world


def notification(method: str, params: dict[str, Any]) -> bytes:
    """Write a request that gets no answer."""
    return json.dumps({"jsonrpc": "2.0", "method": method, "params": params}).encode()


@scene
def stops() -> GoldenWorld:
    """Stop a motion by each level; what is asked under the stop is refused."""
    world, client = enabled()
    other = world.client(uid=2000, role="observer")
    for level in ("hold", "relax", "disable"):
        client.send("motion.close", speed_mm_s=30)
        world.run(0.5)
        other.call("stop", level=level, why="a scene")
        world.run(0.2)
        client.call("motion.open")
        client.call("stop.clear")
        client.call("motor.enable")
    return world


@scene
def leases() -> GoldenWorld:
    """Acquire, wait, take, lapse, resume, lose."""
    world, client = enabled()
    other, third = world.client(uid=2000), world.client(role="operator")
    client.call("lease.acquire", ttl_s=0.5, on_lost="disable", purpose="a scene")
    waiting = other.send("lease.acquire", wait_s=2.0)
    third.call("motion.open")
    client.send("motion.close", speed_mm_s=20)
    world.run(0.4)
    other.call("lease.take", why="it is my turn", jaws="hold")
    client.call("motion.open")
    client.call("lease.acquire")
    other.has_answer(waiting)
    other.leave()
    world.clients.remove(other)
    world.run(0.5)
    client.call("lease.acquire", ttl_s=0.3, on_lost="relax")
    world.run(1.0)
    client.call("lease.resume", lease="token-1")
    client.call("lease.get")
    return world


@scene
def subscriptions() -> GoldenWorld:
    """Watch the state at some rates, whole and in parts, through a motion."""
    world, client = enabled()
    watcher = world.client(role="observer")
    watcher.call("state.subscribe", hz=200, fields=["position_rad", "torque_nm", "mode"])
    watcher.call("state.subscribe", hz=20)
    client.call("motion.move", opening_mm=40, progress=True)
    watcher.call("state.unsubscribe", subscription=1)
    world.run(0.5)
    return world


@scene
def calibrating() -> GoldenWorld:
    """Find both stops, keep them, load others."""
    world, client = enabled(calibrated=False)
    client.call("motion.open")
    client.call("calibration.zero", within_s=60.0, mount="normal", progress=True)
    client.call("motion.close")
    client.call("calibration.load", template="reverse")
    client.call("calibration.get")
    return world


@scene
def calibrating_by_hand() -> GoldenWorld:
    """Mark both stops by hand."""
    world, client = enabled()
    client.call("calibration.manual", step="begin")
    for side, sign in (("closed", 1), ("open", -1)):
        push = sign * world.gripper.parameters.close_sign
        world.gripper.push(push * 2.0)
        world.run(2.0)
        world.gripper.push(push * 0.94)
        world.run(0.3)
        client.call("calibration.manual", step=side)
    world.gripper.push(0.0)
    client.call("calibration.manual", step="finish")
    world.run(0.3)
    return world


@scene
def trajectories() -> GoldenWorld:
    """Record by hand and beside a motion, and play it, paused, faster, twice."""
    world, client = enabled()
    client.call("trajectory.record_start", rate_hz=100)
    world.gripper.push(1.5)
    world.run(0.5)
    world.gripper.push(0.0)
    world.run(0.2)
    client.call("trajectory.record_stop", name="pushed")
    client.call("trajectory.play", name="pushed", repeat=2, speed=0.2, progress=True)
    number = client.send("trajectory.play", name=uploaded(client, sampled(swing(), 4.0)))
    world.run(1.5)
    client.call("trajectory.control", action="pause")
    world.run(0.3)
    client.call("trajectory.control", action="resume")
    client.call("trajectory.control", action="speed", speed=2.0)
    client.wait(number)
    client.call("trajectory.list")
    client.call("trajectory.status")
    return world


@scene
def taught_grips() -> GoldenWorld:
    """Record a grasp and do it again on another object."""
    world, client = enabled()
    world.gripper.put_object(width_mm=40.0)
    client.call("trajectory.record_start", zero_gravity=False)
    client.call("motion.grasp", force_n=8, until="verdict")
    world.run(0.5)
    client.call("motion.open")
    client.call("trajectory.record_stop", name="pick")
    world.gripper.put_object(width_mm=42.0)
    client.call("trajectory.play", name="pick", force="replay", progress=True)
    world.gripper.remove_object()
    client.call("trajectory.play", name="pick", force="replay")
    return world


@scene
def following() -> GoldenWorld:
    """Follow a leader that moves, leaps, falls silent and comes back; then press on something."""
    world, client = enabled()
    client.result("teleop.start", mode="slave", host="leader", reflect=True)
    follower = Follower(world, client)
    follower.stay(world.openness, 0.3)
    follower.lead(sweep(world.openness, 0.2, 1.0), 1.2)
    follower.stay(0.9, 0.3)
    world.run(1.0)
    follower.put(b"nonsense")
    world.gripper.put_object(width_mm=world.gripper.opening_mm - 5.0)
    follower.stay(world.openness, 0.3)
    follower.lead(sweep(world.openness, 0.0, 1.0), 1.5)
    follower.status()
    client.call("teleop.stop")
    keep_wire(world)
    return world


@scene
def leading() -> GoldenWorld:
    """Lead by hand, with forces that are reflected."""
    world, client = enabled()
    client.result("teleop.start", mode="master", rate_hz=100, link="udp", host="127.0.0.1")
    for push_nm in (0.8, -0.8, 0.0):
        world.gripper.push(push_nm)
        world.run(0.4)
    client.call("teleop.status")
    client.call("teleop.stop")
    keep_wire(world)
    return world


def keep_wire(world: GoldenWorld) -> None:
    """Keep what went over the links of teleoperation, too."""
    for wire in world.wires.made:
        for at_s, payload in wire.sent:
            world.keep("link", f"{at_s:.6f} {payload.hex()}")
        for at_s, payload, to in wire.replied:
            world.keep("link", f"{at_s:.6f} {to} {payload.hex()}")


@scene
def the_motor_is_lost() -> GoldenWorld:
    """Lose the motor's answers, its power, its registers; see faults and their end."""
    world, client = enabled()
    client.send("motion.close", speed_mm_s=20)
    world.run(0.3)
    world.lose_from_motor = lambda _frame: True
    world.run(1.0)
    world.lose_from_motor = lambda _frame: False
    world.run(1.0)
    client.call("motor.enable")
    world.gripper.power_cycle(turns=1)
    world.run(1.0)
    client.call("motor.enable")
    world.gripper.latch_fault(0xB)
    world.run(0.5)
    client.call("motion.open")
    client.call("motor.clear_fault")
    client.call("motor.enable")
    world.gripper.jump(0.2)
    world.run(0.5)
    client.call("state.get")
    return world


@scene
def the_bus_is_lost() -> GoldenWorld:
    """Let the bus fail in each way while the jaws close."""
    world, client = enabled()
    states: tuple[BusState, ...] = ("bus_off", "bus_stalled", "adapter_gone", "link_down")
    for state in states:
        client.send("motion.close", speed_mm_s=20)
        world.run(0.2)
        world.condition = BusCondition(state, "as the scene wants it")
        world.lose_to_motor = lambda _frame: True
        world.run(0.5)
        world.condition, world.lose_to_motor = UP, lambda _frame: False
        world.run(0.5)
        client.call("state.get")
        client.call("motor.enable")
        client.call("motion.open")
    return world


@scene
def another_master() -> GoldenWorld:
    """See another program's commands and register writes on the bus."""
    world, client = gripping()
    world.inject(CanFrame(0x08, bytes.fromhex("7fff7ff0000007ff")))
    world.run(0.3)
    world.inject(CanFrame(0x7FF, bytes.fromhex("0800551700005842")))
    world.run(0.5)
    client.call("state.get")
    return world


@scene
def heat_and_blocked_jaws() -> GoldenWorld:
    """Heat the coil until force is taken back; jam the jaws on their way."""
    world, client = gripping()
    world.gripper.heat_coil(95.0)
    world.run(1.0)
    client.call("motion.open")
    client.send("motion.close")
    world.run(0.3)
    world.gripper.jam()
    world.run(1.5)
    world.gripper.free()
    client.call("state.get")
    return world


@scene
def a_successor_takes_over() -> GoldenWorld:
    """Restart in the midst of a hold."""
    world, client = gripping()
    world.run(0.3)
    client.read()
    handed_over = exchange(world)
    world.keep("successor", json.dumps(handed_over, sort_keys=True))
    world.run(0.5)
    client = world.client()
    client.call("job.list")
    client.call("motion.open")
    return world


@scene
def hostile_lines() -> GoldenWorld:
    """Answer what nobody should send."""
    world, _client = enabled()
    hostile, other = HostileLines(random.Random(1)), world.client(role="operator")
    for number in range(2000):
        other.send_line(hostile.line())
        if number % 20 == 0:
            world.tick()
    world.run(0.5)
    return world
