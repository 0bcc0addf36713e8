"""A hold that heats the coil, through the whole daemon: limited, and always reported."""

from dataclasses import replace

import pytest

from litegripd.sim.plant import SimulatorParameters
from tests.world import Client, World

HOT_ROOM = replace(SimulatorParameters(), ambient_c=64.0, initial_opening_mm=60.0)
"""So hot that 3 N·m pass the limit within half a minute."""


def holding(force_n: float) -> tuple[World, Client]:
    world = World(parameters=HOT_ROOM)
    world.gripper.put_object(width_mm=50.0)
    client = world.enabled()
    client.result("motion.grasp", until="verdict", force_n=force_n, config={"force_rate_n_s": 100})
    return world, client


def test_a_hold_that_would_pass_the_limit_is_reduced_step_by_step_and_told() -> None:
    world, client = holding(30.0)
    heat = world.controller.output.heat
    world.run(1.0)
    assert world.state.limited == ()
    first_s = heat.model.time_to_limit_s()
    assert first_s is not None
    hottest_c, reported = 0.0, []
    for _ in range(60):
        world.run(1.0)
        hottest_c = max(hottest_c, world.gripper.motor.coil_c)
        while events := world.service.take_events():
            reported += [event for event in events if event.kind == "heat"]
    assert 79.0 < hottest_c < 81.0
    foretold, *reported = reported  # that it cannot be held for ever
    assert foretold.data["force_n"] == 30.0
    assert len(reported) >= 3
    steps = [event.data["to_nm"] for event in reported]
    assert steps == sorted(steps, reverse=True)  # type: ignore[type-var]
    state = world.state
    assert state.limited == ("heat",)
    assert state.force_set_n == 30.0  # what was asked for is not forgotten
    assert state.requested_torque_nm == pytest.approx(3.0)
    assert state.command_torque_nm == pytest.approx(heat.allowance_nm, rel=0.05)
    assert world.torque_nm == pytest.approx(heat.allowance_nm, rel=0.1)
    assert state.is_grasped
    assert client.result("motion.open")["ok"]


def test_a_hold_that_the_coil_bears_is_left_alone() -> None:
    world, _ = holding(10.0)
    world.run(60.0)
    assert world.state.limited == ()
    assert world.torque_nm == pytest.approx(1.0, abs=0.05)
    while events := world.service.take_events():
        assert not [event for event in events if event.kind == "heat"]
