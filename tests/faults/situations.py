"""What the gripper does when a fault comes: a row each in every table of the matrix."""

from collections.abc import Callable
from dataclasses import dataclass

from tests.faults.fault_world import FaultWorld
from tests.world import Client

FORCE_N = 10.0
OBJECT_MM = 55.0


@dataclass(frozen=True, slots=True)
class Situation:
    """What the gripper does when the fault comes.

    `begin` returns the request that is answered when the running motion ends; `moves` says that
    this moves the jaws.
    """

    name: str
    begin: Callable[[FaultWorld, Client], int | None]
    is_enabled: bool = True
    moves: bool = False


def squeeze_n(world: FaultWorld) -> float:
    """Return with what force the motor squeezes, in newtons as the page has them."""
    return world.gripper.motor_torque_nm * world.gripper.parameters.close_sign * 10.0


def idle(_world: FaultWorld, _client: Client) -> None:
    """Stay as the daemon has found the gripper: disabled."""


def enabled(world: FaultWorld, client: Client) -> None:
    """Be enabled and hold."""
    assert client.result("motor.enable")["ok"]
    world.run(0.2)


def moving(world: FaultWorld, client: Client) -> int:
    """Close slowly, from 60 mm on."""
    enabled(world, client)
    number = client.send("motion.close", speed_mm_s=20)
    world.run(0.5)
    return number


def gripping(world: FaultWorld, client: Client) -> int:
    """Hold an object of 55 mm by 10 N, as long as the client waits."""
    world.gripper.put_object(width_mm=OBJECT_MM)
    enabled(world, client)
    number = client.send("motion.grasp", force_n=FORCE_N)
    world.run_until(lambda: world.state.is_grasped)
    world.run(0.5)
    assert squeeze_n(world) > 0.95 * FORCE_N
    return number


def following(world: FaultWorld, client: Client) -> int:
    """Follow a leader that sweeps, aligned to it."""
    enabled(world, client)
    status = client.result("teleop.start", mode="slave", fake_leader=True)
    number = client.send("job.wait", job=status["job"])
    world.run_until(lambda: client.result("teleop.status")["phase"] == "following")
    world.run(0.2)
    return number


def recording(world: FaultWorld, client: Client) -> int:
    """Be recorded by hand, the jaws slack, with nobody's hand in them."""
    enabled(world, client)
    client.result("trajectory.record_start")
    running = world.running
    number = client.send("job.wait", job=running.number)
    world.run(0.2)
    return number


SITUATIONS = (
    Situation("disabled", idle, is_enabled=False),
    Situation("holding", enabled),
    Situation("closing at 20 mm/s", moving, moves=True),
    Situation("gripping with 10 N", gripping),
    Situation("following a leader", following, moves=True),
    Situation("recording by hand", recording),
)
