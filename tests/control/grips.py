"""Picks that are recorded with their grips, and replayed, for the scenes about them."""

import json
from typing import Any

from litegripd.trajectories.replay import Replay
from tests.trajectories import fetched, send
from tests.world import Client, World, ready

FORCE_CODE_N = 0.5


def gripper(mount: str = "normal", opening_mm: float = 72.0) -> tuple[World, Client]:
    """Return an enabled gripper whose jaws are open so far."""
    return ready(mount, initial_opening_mm=opening_mm)


def recording(width_mm: float = 36.0, **grasp: Any) -> tuple[World, Client]:
    """Return a gripper that is recorded, and that has grasped an object."""
    world, client = gripper()
    world.gripper.put_object(width_mm=width_mm)
    client.result("trajectory.record_start", zero_gravity=False)
    client.result("motion.grasp", until="verdict", **grasp)
    return world, client


def taught(client: Client) -> list[dict[str, Any]]:
    """End the recording; return its grips."""
    return grips(client, name=client.result("trajectory.record_stop")["name"])


def picked(
    width_mm: float = 36.0,
    force_n: float = 8.0,
    held_s: float = 1.0,
    *,
    release: bool = True,
    **item: float,
) -> tuple[World, Client, str]:
    """Record a pick, and its release; return the recording's name."""
    world, client = gripper()
    world.gripper.put_object(width_mm=width_mm, **item)
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.2)
    client.result("motion.grasp", force_n=force_n, until="verdict")
    world.run(held_s)
    if release:
        client.result("motion.move", opening_mm=72)
        world.run(0.2)
    name: str = client.result("trajectory.record_stop")["name"]
    return world, client, name


def beside(client: Client, **source: Any) -> dict[str, Any]:
    """Return the file of grips that is kept with a trajectory."""
    content: dict[str, Any] = json.loads(fetched(client, format="grip", **source))
    return content


def grips(client: Client, **source: Any) -> list[dict[str, Any]]:
    """Return the grips that are kept with a trajectory."""
    taught: list[dict[str, Any]] = beside(client, **source)["grips"]
    return taught


def both(client: Client, **source: Any) -> tuple[bytes, int]:
    """Return a trajectory with its grips, as it is sent, and the length of the latter."""
    end = fetched(client, format="grip", **source)
    return fetched(client, **source) + end, len(end)


def replaying(world: World) -> Replay:
    action = world.controller.action
    assert isinstance(action, Replay)
    return action


def in_phase(world: World, phase: str) -> bool:
    action = world.controller.action
    return isinstance(action, Replay) and action.phase == phase


def on_another(
    width_mm: float | None,
    mount: str = "reverse",
    force_n: float = 8.0,
    release: bool = True,
    **item: float,
) -> tuple[World, Client]:
    """Teach a pick on one gripper, and bring it to another one with another object."""
    _, teacher, name = picked(36.0, force_n, release=release)
    content, grip_bytes = both(teacher, name=name)
    world, client = gripper(mount)
    if width_mm is not None:
        world.gripper.put_object(width_mm=width_mm, **item)
    send(client, content, name="pick", grip_bytes=grip_bytes)
    return world, client


def started(world: World, client: Client, phase: str = "hold", **params: Any) -> int:
    number = client.send("trajectory.play", name="pick", force="replay", **params)
    world.run_until(lambda: in_phase(world, phase) or client.has_answer(number))
    assert not client.has_answer(number), client.answers[number]
    return number
