"""Worlds in every state of the gripper, and what is seen of them."""

from typing import Any

from litegripd.motor import codec
from tests.world import Client, World, ready

LEVELS = ("hold", "relax", "disable")


def at_opening(
    opening_mm: float = 60.0, mount: str = "normal", **more: Any
) -> tuple[World, Client]:
    """Return an enabled gripper whose jaws are open so far."""
    return ready(mount, initial_opening_mm=opening_mm, **more)


def is_slack(world: World) -> bool:
    _, command = world.commands_since(world.now_s)[-1]
    return command.kp_nm_rad == 0.0 and command.kd_nm_s_rad == 0.0


def sends_disable(world: World) -> bool:
    return any(sent.frame.data == codec.DISABLE for sent in world.sent_since(world.now_s))


def errors_of(client: Client) -> list[str]:
    client.read()
    return [a["error"]["data"]["reason"] for a in client.answers.values() if "error" in a]


def in_state(name: str, world: World | None = None) -> tuple[World, Client]:
    """Bring the gripper of a world into a state; return it, and the client that did so."""
    world = world or World()
    if name == "disabled":
        return world.start(), world.client()
    if name == "enabling":
        client = world.start().client()
        world.lose_to_motor = lambda frame: frame.data == codec.ENABLE
        client.send("motor.enable", retries=20)
        world.run(0.3)
        return world, client
    client = world.enabled()
    if name in ("opening", "closing"):
        client.send("motion.open" if name == "opening" else "motion.close")
        world.run(0.4)
    elif name == "pressing":
        client.send("motion.close")
        world.run_until(lambda: phase_of(world) == "settle")
    elif name == "disabling":
        world.lose_to_motor = lambda frame: frame.data == codec.DISABLE
        client.send("motor.disable")
        world.run(0.02)
    elif name == "fault":
        world.gripper.set_supply(40.0)
        world.run(0.1)
    elif name == "lost":
        world.lose_to_motor = lambda _frame: True
        world.run(0.04)
    return world, client


def phase_of(world: World) -> str | None:
    return None if world.state.job is None else world.state.job.phase


POWERED = ("holding", "opening", "closing", "pressing")
STATES = (*POWERED, "disabled", "enabling", "disabling", "fault", "lost")
