"""A small `max_lead_mm` at full speed: jaws that are not the simulator's reach their stops."""

import pytest

from tests.plants.parameters import random_plant
from tests.plants.world import PlantWorld

STOP_MM = 3.0
"""How far a stop that is pressed with 0.67 N·m may be from where the calibration has it."""


@pytest.mark.parametrize(("seed", "rate_hz"), [(1, 100), (2, 100), (4, 100), (1, 200), (3, 200)])
def test_fast_jaws_with_a_small_lead_do_not_stop_on_the_way(seed: int, rate_hz: int) -> None:
    world = PlantWorld(random_plant(seed), "normal", rate_hz, opening_mm=60.0)
    client, geometry = world.enabled(), world.controller.geometry
    assert geometry is not None
    config, since_s = {"max_lead_mm": 0.5, "stop_lead_mm": 0.5}, world.now_s
    for method, stop_mm in (("motion.open", geometry.travel_mm), ("motion.close", 0.0)):
        client.call(method, within_s=60.0, speed_mm_s=150.0, config=config)
        assert world.state.opening_mm == pytest.approx(stop_mm, abs=STOP_MM)
    assert max(abs(look.rotor_mm_s) for look in world.looks_since(since_s)) < 190.0
