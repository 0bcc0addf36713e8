"""The grippers that were thrown hardest, when something let go of them and when they were stopped.

Their motors and cables are worse than any that was seen: what the simulator's gripper does is on
the page of safety.
"""

import pytest

from tests.plants.parameters import PlantParameters
from tests.plants.world import Look, PlantWorld
from tests.plants.worst import FREED

FASTEST_MM_S = 150.0
MOST_MM_S = 1.5 * FASTEST_MM_S


def moving(plant: PlantParameters) -> PlantWorld:
    world = PlantWorld(plant, opening_mm=75.0)
    client = world.enabled()
    client.send("motion.move", opening_mm=10.0, speed_mm_s=FASTEST_MM_S)
    world.run(0.12)
    return world


def seen_since(world: PlantWorld, began_s: float) -> list[Look]:
    world.run(0.3)
    return world.looks_since(began_s)


@pytest.mark.parametrize("name", FREED)
def test_jaws_that_come_free_are_not_thrown(name: str) -> None:
    world = moving(FREED[name])
    world.mechanics.hold_open(0.01, 1.0)
    world.run(0.1)
    world.mechanics.let_go()
    looks = seen_since(world, world.now_s)
    assert max(abs(look.rotor_mm_s) for look in looks) < MOST_MM_S


@pytest.mark.parametrize("name", FREED)
def test_a_stop_does_not_throw_running_jaws_back(name: str) -> None:
    world = moving(FREED[name])
    world.run(0.1)
    began_s = world.now_s
    world.client().result("stop")
    looks = seen_since(world, began_s)
    assert max(look.rotor_mm_s for look in looks) < 1.2 * FASTEST_MM_S
    assert min(look.rotor_mm_s for look in looks) > -0.4 * FASTEST_MM_S
