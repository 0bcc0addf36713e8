"""Jaws that something has held up, or that are stopped on their way: neither is a throw."""

from functools import partial
from typing import Any

import pytest

from litegripd.model.gripper import FASTEST_MM_S
from tests.plants.parameters import MM_RAD, PlantParameters
from tests.plants.rigs import Rig
from tests.pressing import rig_of
from tests.world import ready

MOST_MM_S = 1.3 * FASTEST_MM_S
MOST_MJ = 10.0
INERTIA_KG_M2 = 1.85e-3
MOTIONS: dict[str, dict[str, Any]] = {"motion.move": {"opening_mm": 15.0}, "motion.close": {}}


every_plant = pytest.mark.parametrize(
    "plant", [None, PlantParameters()], ids=["simulator", "other plant"]
)


def check_thrown(rig: Rig, since_s: float, most_mm_s: float) -> None:
    """Neither speed nor energy of the jaws has been too much since a time."""
    peak_mm_s = max(map(abs, rig.speeds_mm_s(since_s)))
    assert peak_mm_s < most_mm_s
    assert 500.0 * INERTIA_KG_M2 * (peak_mm_s / MM_RAD) ** 2 < MOST_MJ


@every_plant
@pytest.mark.parametrize("method", MOTIONS)
@pytest.mark.parametrize("speed_mm_s", [50.0, 150.0])
@pytest.mark.parametrize("held_s", [0.05, 0.15])
def test_jaws_that_come_free_do_not_catch_up(
    plant: PlantParameters | None, method: str, speed_mm_s: float, held_s: float
) -> None:
    rig = rig_of(plant, opening_mm=75.0)
    began_s = rig.now_s
    rig.owner.send(method, speed_mm_s=speed_mm_s, **MOTIONS[method])
    rig.run(0.1)
    rig.hold_fast(held_s)
    rig.run(0.4)
    check_thrown(rig, began_s, min(MOST_MM_S, 3.0 * speed_mm_s))


@pytest.mark.parametrize("method", MOTIONS)
@pytest.mark.parametrize("speed_mm_s", [50.0, 150.0])
@pytest.mark.parametrize("late_s", [0.05, 0.08])
def test_after_a_late_tick_they_do_not_either(
    method: str, speed_mm_s: float, late_s: float
) -> None:
    rig = rig_of(None, opening_mm=75.0)
    began_s = rig.now_s
    rig.owner.send(method, speed_mm_s=speed_mm_s, **MOTIONS[method])
    rig.run(0.1)
    rig.now_s += late_s
    rig.run(0.4)
    check_thrown(rig, began_s, 1.15 * speed_mm_s)


@every_plant
@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
def test_a_move_that_was_held_up_for_a_moment_arrives(
    plant: PlantParameters | None, rate_hz: int
) -> None:
    rig = rig_of(plant, rate_hz=rate_hz, opening_mm=75.0)
    number = rig.owner.send("motion.move", opening_mm=15.0, speed_mm_s=100.0)
    rig.run(0.1)
    rig.hold_fast(0.1)
    began_s = rig.now_s
    assert rig.owner.wait(number)["result"]["outcome"] == "reached"
    assert rig.now_s - began_s < 0.06 / 0.1 + 0.6


@every_plant
@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("ticks", range(8))
def test_running_jaws_that_are_stopped_are_not_thrown_back(
    plant: PlantParameters | None, rate_hz: int, ticks: int
) -> None:
    """A hold where they were measured last would: they came back at 270 mm/s."""
    rig = rig_of(plant, rate_hz=rate_hz, opening_mm=75.0)
    rig.owner.send("motion.move", opening_mm=15.0, speed_mm_s=150.0)
    rig.run(0.2 + ticks * rig.period_s)
    rig.owner.result("stop")
    began_s = rig.now_s
    rig.run(0.3)
    assert min(rig.speeds_mm_s(began_s)) > -75.0
    assert max(rig.speeds_mm_s(began_s)) < 1.15 * 150.0


@pytest.mark.parametrize("jump_rad", [0.3, -0.8])
def test_an_encoder_that_slips_while_disabled_presses_little_and_its_missing_stop_is_told(
    jump_rad: float,
) -> None:
    """Jaws that a hand has moved look the same, until a stop is met early or not at all."""
    texts: list[str] = []
    for method in ("motion.open", "motion.close"):
        world, client = ready(initial_opening_mm=45.0)
        client.result("events.subscribe")
        client.result("motor.disable")
        world.gripper.jump(jump_rad)
        world.run(0.3)
        client.result("motor.enable")
        number = client.send(method)
        assert max(client.track(number, partial(getattr, world, "torque_nm"))) < 3.0
        assert client.answers[number]["result"]["outcome"] in ("protected", "no_stop")
        world.run(0.02)
        texts += [event["message"] for event in client.events("job_ended")]
    assert any("the motor's zero has shifted" in text for text in texts)
