"""Set-points of torque on plants that are not ours: free jaws, vanishing objects, stops."""

from typing import Any

import pytest

from tests.plants.parameters import MM_RAD, Item, PlantParameters, random_plant
from tests.plants.world import PlantWorld
from tests.plants.worst import FREED, PRESSING, SWINGING
from tests.world import Client

NOMINAL = PlantParameters()
FASTEST_RAD_S, OVERSHOOT = 2.9, 1.15
PLANTS = {
    str(plant.seed): plant
    for plant in (NOMINAL, *SWINGING.values(), *FREED.values(), *PRESSING.values())
}
every_plant = pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)


def stream(world: PlantWorld, client: Client, duration_s: float, **params: Any) -> float:
    """Keep a stream up by a set-point every 20 ms; return the fastest speed, in rad/s."""
    since_s, sent_s = world.now_s, -1.0
    for _ in range(round(duration_s / world.period_s)):
        if world.now_s - sent_s >= 0.0199:
            sent_s = world.now_s
            client.notify("stream.set", **params)
        world.tick()
    return fastest_rad_s(world, since_s)


def fastest_rad_s(world: PlantWorld, since_s: float) -> float:
    """Return the fastest that the rotor was: the fingers hang on a cable, and swing alone."""
    return max(abs(look.rotor_mm_s) for look in world.looks_since(since_s)) / MM_RAD


def pressing(plant: PlantParameters, push_nm: float, stiffness: float) -> tuple[PlantWorld, Client]:
    """Return jaws that push on an object, with the whole torque."""
    world = PlantWorld(plant, opening_mm=45.0)
    client = world.enabled()
    world.mechanics.put(Item(40.0, stiffness, 0.5))
    stream(world, client, 1.5, push_nm=push_nm)
    return world, client


def gripping(plant: PlantParameters, force_n: float, stiffness: float) -> PlantWorld:
    """Return jaws that hold the same object by the same force."""
    world = PlantWorld(plant, opening_mm=45.0)
    client = world.enabled()
    world.mechanics.put(Item(40.0, stiffness, 0.5))
    client.result("motion.grasp", force_n=force_n, until="verdict")
    world.run(2.5)
    return world


@every_plant
@pytest.mark.parametrize("push_nm", [4.0, -4.0])
def test_free_jaws_are_not_flung(plant: PlantParameters, push_nm: float) -> None:
    world = PlantWorld(plant, opening_mm=60.0 if push_nm > 0.0 else 20.0)
    assert stream(world, world.enabled(), 1.5, push_nm=push_nm) <= FASTEST_RAD_S
    assert max(abs(look.torque_nm) for look in world.looks_since(world.now_s - 0.2)) < 1.3


@pytest.mark.parametrize("rate_hz", [100, 1000])
def test_nor_at_other_rates(rate_hz: int) -> None:
    for push_nm in (1.0, 4.0):
        world = PlantWorld(NOMINAL, rate_hz=rate_hz, opening_mm=60.0)
        assert stream(world, world.enabled(), 1.5, push_nm=push_nm) <= FASTEST_RAD_S


@every_plant
def test_jaws_whose_object_vanishes_run_no_faster_than_those_of_a_grip(
    plant: PlantParameters,
) -> None:
    world, client = pressing(plant, 4.0, 100.0)
    world.mechanics.put(None)
    pushed_rad_s = stream(world, client, 0.5, push_nm=4.0)
    held = gripping(plant, 40.0, 100.0)
    gone_s = held.now_s
    held.mechanics.put(None)
    held.run(0.5)
    assert pushed_rad_s <= 1.05 * fastest_rad_s(held, gone_s) + 0.1
    later_s = world.now_s - 0.4
    assert fastest_rad_s(world, later_s) <= FASTEST_RAD_S


@every_plant
@pytest.mark.parametrize("stiffness", [10.0, 1000.0])
def test_what_ends_a_push_throws_no_jaws_open(plant: PlantParameters, stiffness: float) -> None:
    most_rad_s = FASTEST_RAD_S * OVERSHOOT
    world, client = pressing(plant, 4.0, stiffness)
    assert stream(world, client, 1.0, push_nm=0.0) <= most_rad_s
    world, client = pressing(plant, 4.0, stiffness)
    assert stream(world, client, 1.0, opening_mm=50.0) <= most_rad_s
    world, client = pressing(plant, 4.0, stiffness)
    since_s = world.now_s
    world.run(1.5)  # it lapses
    assert fastest_rad_s(world, since_s) <= most_rad_s
    world, client = pressing(plant, 4.0, stiffness)
    since_s = world.now_s
    client.result("stop")
    world.run(1.0)
    assert fastest_rad_s(world, since_s) <= most_rad_s


@pytest.mark.parametrize("seed", range(1, 9))
def test_random_plants_keep_the_bound(seed: int) -> None:
    plant = random_plant(seed)
    for push_nm in (0.5, 2.0, -4.0):
        world = PlantWorld(plant, opening_mm=60.0 if push_nm > 0.0 else 20.0)
        assert stream(world, world.enabled(), 1.0, push_nm=push_nm) <= FASTEST_RAD_S
