"""Jaws that something has held up, or that are stopped on their way: neither is a throw."""

from collections.abc import Callable
from typing import Any

import pytest

from litegripd.model.gripper import FASTEST_MM_S
from tests.plants.parameters import MM_RAD, PlantParameters
from tests.plants.world import PlantWorld
from tests.world import Client, World

MOST_MM_S = 1.3 * FASTEST_MM_S
MOST_MJ = 10.0
INERTIA_KG_M2 = 1.85e-3
MOTIONS: dict[str, dict[str, Any]] = {"motion.move": {"opening_mm": 15.0}, "motion.close": {}}


class Seen:
    """A world whose jaws' true speed is looked at in every millisecond."""

    def __init__(self, plant: str, rate_hz: int = 200, opening_mm: float = 75.0) -> None:
        self.is_other = plant == "other plant"
        if self.is_other:
            self.world: World = PlantWorld(
                PlantParameters(), rate_hz=rate_hz, opening_mm=opening_mm
            )
        else:
            self.world = World(period_s=1.0 / rate_hz)
        self.client: Client = self.world.enabled()
        if not self.is_other:
            self.client.result("motion.move", opening_mm=opening_mm)
        self.peak_mm_s = 0.0
        self.back_mm_s = 0.0
        """The fastest that they were towards open."""

    def run(self, duration_s: float, each: Callable[[], object] = lambda: None) -> None:
        world = self.world
        for _ in range(round(duration_s / world.period_s)):
            if not self.is_other:
                for look in range(1, 5):
                    world.gripper.advance(world.now_s + look * world.period_s / 5.0)
                    self._note(world.gripper.velocity_rad_s)
            world.tick()
            self._note(
                world.mechanics.rotor_rad_s
                if isinstance(world, PlantWorld)
                else world.gripper.velocity_rad_s
            )
            each()

    def _note(self, closing_rad_s: float) -> None:
        self.peak_mm_s = max(self.peak_mm_s, abs(closing_rad_s) * MM_RAD)
        self.back_mm_s = max(self.back_mm_s, -closing_rad_s * MM_RAD)

    def hold_fast(self, duration_s: float) -> None:
        """Let something hold the jaws where they are, and let go."""
        world = self.world
        if isinstance(world, PlantWorld):
            world.mechanics.hold_open(0.01, 1.0)
            self.run(duration_s)
            world.mechanics.let_go()
        else:
            world.gripper.jam()
            self.run(duration_s)
            world.gripper.free()

    @property
    def energy_mj(self) -> float:
        return 500.0 * INERTIA_KG_M2 * (self.peak_mm_s / MM_RAD) ** 2


@pytest.mark.parametrize("plant", ["simulator", "other plant"])
@pytest.mark.parametrize("method", MOTIONS)
@pytest.mark.parametrize("speed_mm_s", [50.0, 150.0])
@pytest.mark.parametrize("held_s", [0.05, 0.15])
def test_jaws_that_come_free_do_not_catch_up(
    plant: str, method: str, speed_mm_s: float, held_s: float
) -> None:
    seen = Seen(plant)
    seen.client.send(method, speed_mm_s=speed_mm_s, **MOTIONS[method])
    seen.run(0.1)
    seen.hold_fast(held_s)
    seen.run(0.4)
    assert seen.peak_mm_s < min(MOST_MM_S, 3.0 * speed_mm_s)
    assert seen.energy_mj < MOST_MJ


@pytest.mark.parametrize("method", MOTIONS)
@pytest.mark.parametrize("speed_mm_s", [50.0, 150.0])
@pytest.mark.parametrize("late_s", [0.05, 0.08])
def test_after_a_late_tick_they_do_not_either(
    method: str, speed_mm_s: float, late_s: float
) -> None:
    seen = Seen("simulator")
    seen.client.send(method, speed_mm_s=speed_mm_s, **MOTIONS[method])
    seen.run(0.1)
    seen.world.now_s += late_s
    seen.run(0.4)
    assert seen.peak_mm_s < 1.15 * speed_mm_s
    assert seen.energy_mj < MOST_MJ


@pytest.mark.parametrize("plant", ["simulator", "other plant"])
@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
def test_a_move_that_was_held_up_for_a_moment_arrives(plant: str, rate_hz: int) -> None:
    seen = Seen(plant, rate_hz)
    number = seen.client.send("motion.move", opening_mm=15.0, speed_mm_s=100.0)
    seen.run(0.1)
    seen.hold_fast(0.1)
    began_s = seen.world.now_s
    seen.world.run_until(lambda: seen.client.has_answer(number))
    assert seen.client.answers[number]["result"]["outcome"] == "reached"
    assert seen.world.now_s - began_s < 0.06 / 0.1 + 0.6


@pytest.mark.parametrize("plant", ["simulator", "other plant"])
@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("ticks", range(8))
def test_running_jaws_that_are_stopped_are_not_thrown_back(
    plant: str, rate_hz: int, ticks: int
) -> None:
    """A hold where they were measured last would: they came back at 270 mm/s."""
    seen = Seen(plant, rate_hz)
    seen.client.send("motion.move", opening_mm=15.0, speed_mm_s=150.0)
    seen.run(0.2 + ticks * seen.world.period_s)
    seen.client.result("stop")
    seen.peak_mm_s = seen.back_mm_s = 0.0
    seen.run(0.3)
    assert seen.peak_mm_s < 1.15 * 150.0
    assert seen.back_mm_s < 75.0


@pytest.mark.parametrize("jump_rad", [0.3, -0.8])
def test_an_encoder_that_slips_while_disabled_presses_little_and_its_missing_stop_is_told(
    jump_rad: float,
) -> None:
    """Jaws that a hand has moved look the same, until a stop is met early or not at all."""
    texts: list[str] = []
    for method in MOTIONS:
        seen = Seen("simulator", opening_mm=45.0)
        world, client = seen.world, seen.client
        client.result("events.subscribe")
        client.result("motor.disable")
        world.gripper.jump(jump_rad)
        world.run(0.3)
        client.result("motor.enable")
        number = client.send(method if method != "motion.move" else "motion.open")
        strongest_nm = 0.0
        while not client.has_answer(number):
            world.tick()
            strongest_nm = max(strongest_nm, abs(world.gripper.motor_torque_nm))
        assert strongest_nm < 3.0
        assert client.answers[number]["result"]["outcome"] in ("protected", "no_stop")
        world.run(0.02)
        client.read()
        texts += [
            note["params"]["message"]
            for note in client.notifications
            if note["method"] == "event" and note["params"]["kind"] == "job_ended"
        ]
    assert any("the motor's zero has shifted" in text for text in texts)
