"""Ticks that a stop hastens, on plants that are not the simulator: sooner, and nothing worse.

Control counts in periods, and such a tick comes after a fifth of one.
"""

import random

import pytest

from litegripd.io.loop import APART_SHARE
from tests.plants.parameters import random_plant
from tests.plants.test_disturbed_holds import Holding
from tests.plants.world import PlantWorld
from tests.world import PERIOD_S

SOONEST_S = APART_SHARE * PERIOD_S


def overshoot_mm(seed: int, method: str, after_s: float) -> float:
    """Stop jaws that move as fast as they may; return how far they went on."""
    world = PlantWorld(random_plant(seed), opening_mm=10.0 if method == "motion.open" else 75.0)
    client = world.enabled()
    client.send(method, speed_mm_s=150.0)
    world.run(0.2 + seed % 7 * 0.01)
    at_mm = world.mechanics.opening_mm
    client.send("stop", level="hold")
    world.tick_after(after_s)
    world.run(1.0)
    assert world.state.enabled
    assert world.state.mode == "holding"
    assert abs(world.looks[-1].jaw_mm_s) < 0.5
    return max(abs(look.opening_mm - at_mm) for look in world.looks_since(world.now_s - 1.0))


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
def test_jaws_in_motion_go_no_further_than_after_a_tick_in_its_time(method: str) -> None:
    """The same measurement leads them to rest; slack and friction make the difference."""
    pairs = [
        (overshoot_mm(seed, method, SOONEST_S), overshoot_mm(seed, method, PERIOD_S))
        for seed in range(30)
    ]
    assert all(early_mm <= usual_mm + 0.6 for early_mm, usual_mm in pairs)
    assert sum(early_mm for early_mm, _ in pairs) <= 1.02 * sum(usual_mm for _, usual_mm in pairs)


def clamp_after_stops_n(seed: int, soonest_s: float) -> float:
    """Have an object of 30 N bumped while stops come for three seconds; return what clamps it."""
    holding = Holding(plant=random_plant(seed))
    holding.grasp(30.0)
    world = holding.world
    world.hold_open(2.0, 0.06)
    until_s, chance = world.now_s + 3.0, random.Random(seed)
    while world.now_s < until_s:
        holding.client.send("stop", level="hold")
        world.tick_after(chance.uniform(soonest_s, PERIOD_S))
        world.tick()
    assert world.state.is_grasped
    assert world.state.enabled
    assert holding.events("object_lost") == []
    return holding.clamp_n


def test_what_is_held_is_held_while_stops_come_without_end() -> None:
    """Every second tick is hastened: the hold is that of ticks which all come in their time."""
    for seed in range(6):
        assert clamp_after_stops_n(seed, SOONEST_S) > 0.8 * clamp_after_stops_n(seed, PERIOD_S)
