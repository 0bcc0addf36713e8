"""Holds that swing are calmed and told of; what a hand, a bump or noise does is none of that."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest

from litegripd.control.controller import Controller
from litegripd.control.holds import Hold
from litegripd.control.limiter import (
    HOLDING_KD_NM_S_RAD,
    HOLDING_KP_NM_RAD,
    HOLDING_LEAST_KD_NM_S_RAD,
    Gains,
    SwingGuard,
)
from litegripd.model.gripper import DM4310, DM4340
from tests.plants.parameters import PlantParameters
from tests.plants.watch import is_shaking
from tests.plants.world import PlantWorld
from tests.plants.worst import SWINGING
from tests.world import Client

SWINGS = ("damping, fast filter", "damping, little friction", "a hold at the vendor's gains")


class Held:
    """A gripper that holds a position with these gains, and a client that hears events."""

    def __init__(self, plant: PlantParameters, gains: Gains, rate_hz: int = 200) -> None:
        self.world = PlantWorld(plant, "normal", rate_hz, opening_mm=45.0)
        self.client: Client = self.world.enabled()
        self.client.result("events.subscribe")
        self.world.run(0.05)
        state = self.world.state
        assert state.position_rad is not None
        self.controller: Controller = self.world.controller
        self.controller.idle = Hold(state.position_rad, gains)
        self.world.run(0.1)

    def pushed(self) -> "Held":
        self.world.push_open(3.0, 0.03)
        self.world.run(0.03)
        return self

    def shakes(self) -> bool:
        return is_shaking(self.world.looks_since(self.world.now_s - 0.45))

    def told(self) -> list[dict[str, Any]]:
        return self.client.events("swing")


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize(("kp", "kd"), [(500.0, 1.0), (500.0, 5.0), (100.0, 2.0), (5.0, 2.0)])
@pytest.mark.parametrize("name", SWINGING)
def test_a_hold_does_not_swing_whatever_a_file_has(
    name: str, kp: float, kd: float, rate_hz: int
) -> None:
    held = Held(SWINGING[name], Gains(kp, kd), rate_hz).pushed()
    held.world.run(0.9)
    assert not held.shakes()
    assert held.told() == []


@pytest.mark.parametrize("name", SWINGS)
def test_a_hold_that_swings_all_the_same_is_calmed_and_told_of(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = Held(SWINGING[name], Gains(100.0, 5.0))
    monkeypatch.setattr(held.controller.swing, "bound", lambda command: command)
    held.pushed()
    held.world.run(0.3)
    assert is_shaking(held.world.looks_since(held.world.now_s - 0.4))
    held.world.run(1.5)
    assert not held.shakes()
    events = held.told()
    assert [event["data"]["share"] for event in events] == [0.5, 0.25][: len(events)]
    assert events
    held.client.result("motor.disable")
    assert held.controller.swing.share < 1.0
    held.client.result("motor.enable")
    assert held.controller.swing.share == 1.0


@pytest.mark.parametrize("name", SWINGS[:2])  # a follower is damped too little for the third
def test_a_follower_that_swings_at_rest_is_calmed_and_told_of(name: str) -> None:
    world = PlantWorld(SWINGING[name], "normal", 200, opening_mm=45.0)
    client = world.enabled()
    client.result("events.subscribe")
    client.result("teleop.start", mode="slave", link="udp", kp=100, kd=5)
    world.run(0.2)
    world.push_open(3.0, 0.03)
    world.run(0.3)
    torques_nm = [look.torque_nm for look in world.looks_since(world.now_s - 0.05)]
    assert max(torques_nm) - min(torques_nm) > 8.0
    world.run(2.0)
    assert not is_shaking(world.looks_since(world.now_s - 0.45))
    assert client.events("swing")


def pushes(world: PlantWorld) -> None:
    for number in range(6):
        world.push_open(0.5 + 0.6 * number, 0.02 + 0.05 * number)
        world.run(0.3)


def knocks(world: PlantWorld) -> None:
    for _ in range(5):
        world.push_open(6.0, 0.004)
        world.run(0.3)


def shakes_by_hand(world: PlantWorld) -> None:
    """To and fro at 8 Hz; the force changes every millisecond, as no tick would show it."""

    def push(torque_nm: float) -> None:
        world.mechanics.hand_nm = torque_nm

    for number in range(1500):
        after_s = 1e-3 * number
        torque_nm = 2.0 * math.sin(2.0 * math.pi * 8.0 * after_s)
        world.at(world.now_s + after_s, partial(push, torque_nm))
    world.at(world.now_s + 1.5, partial(push, 0.0))
    world.run(1.6)


def leaves(world: PlantWorld) -> None:
    world.run(2.0)


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("gains", [Gains(100.0, 2.0), Gains(5.0, 2.0), Gains(20.0, 0.08)])
@pytest.mark.parametrize("disturb", [pushes, knocks, shakes_by_hand, leaves])
def test_hands_bumps_and_noise_are_no_swing(
    disturb: Callable[[PlantWorld], None], gains: Gains, rate_hz: int
) -> None:
    for plant in (PlantParameters(), SWINGING["damping, fast filter"]):
        held = Held(replace(plant, speed_noise_rad_s=0.3), gains, rate_hz)
        disturb(held.world)
        held.world.run(0.5)
        assert held.controller.swing.share == 1.0


def test_gains_are_bounded_by_what_the_rotor_bears() -> None:
    wild = Gains(500.0, 5.0)
    light = SwingGuard(DM4310).bound(wild)
    assert (light.kp_nm_rad, light.kd_nm_s_rad) == (HOLDING_KP_NM_RAD, HOLDING_KD_NM_S_RAD)
    assert SwingGuard(DM4340).bound(wild).kd_nm_s_rad == 5.0
    soft = SwingGuard(DM4310).bound(Gains(5.0, 0.01))
    assert (soft.kp_nm_rad, soft.kd_nm_s_rad) == (5.0, HOLDING_LEAST_KD_NM_S_RAD)
