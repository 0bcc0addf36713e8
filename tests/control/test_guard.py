"""The torque guard of open and close: lets go of a jam that yields too slowly to be a stall."""

from typing import Any

import pytest

from litegripd.control.detectors import TorqueGuard
from litegripd.model.motion_config import MotionConfig
from litegripd.sim.plant import MOUNTS
from tests.world import Client, World, ready

JAM: dict[str, float] = {"stiffness_nm_rad": 250.0, "yield_mm_s": 18.0, "yield_torque_nm": 0.5}
"""Gives way at 18 mm/s: more than a fifth of 50 mm/s, so the windowed test never calls it a stall;
less than half, so the guard does."""
LATE = {"stop_torque_cycles": 100}


def jammed(mount: str, **item: float) -> tuple[World, Client]:
    world = World(mount, initial_opening_mm=80.0)
    world.gripper.put_object(width_mm=60.0, **{**JAM, **item})
    return world, world.enabled()


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_jam_that_creeps_is_let_go_and_reported(mount: str) -> None:
    world, client = jammed(mount)
    number = client.send("motion.close")
    world.run_until(lambda: world.gripper.opening_mm <= 60.0)
    touched_s = world.now_s
    result = client.wait(number)["result"]
    assert (result["ok"], result["outcome"]) == (False, "protected")
    assert (result["stalled"], result["protected"]) == (True, True)
    assert world.now_s - touched_s < 0.15 + 0.1 + 0.2 + 0.05  # samples, build-up, release
    assert world.gripper.opening_mm > 50.0
    let_go = [
        (at_s, command)
        for at_s, command in world.commands_since(touched_s)
        if command.kp_nm_rad == 0.0 and abs(command.torque_nm) < 0.003
    ]
    assert let_go[-1][0] - let_go[0][0] == pytest.approx(0.2, abs=0.011)
    assert {round(command.velocity_rad_s, 1) for _, command in let_go} == {0.0}
    world.run(0.5)
    assert world.state.mode == "holding"
    assert world.torque_nm < 0.3


def test_without_the_guard_that_jam_is_never_called_a_stall() -> None:
    world, client = jammed("normal")
    assert not client.result("motion.close", config=LATE)["protected"]
    assert world.gripper.opening_mm < 5.0  # pressed all the way to the stop


def test_pressing_home_is_no_jam() -> None:
    _world, client = ready()
    config = {"settle_s": 2.0, "stop_torque_nm": 0.5}
    for method in ("motion.open", "motion.close"):
        result = client.result(method, config=config)
        assert (result["outcome"], result["protected"]) == ("pressed_home", False)


def test_a_free_way_at_any_allowed_speed_is_no_jam() -> None:
    _world, client = ready()
    for speed in (5.0, 50.0, 139.0):
        for method in ("motion.open", "motion.close"):
            answer = client.call(method, within_s=60.0, speed_mm_s=speed)
            assert answer["result"]["outcome"] == "pressed_home"


def samples(guard: TorqueGuard, *rows: tuple[float, float]) -> list[bool]:
    """Feed (speed in rad/s, torque) for one sample interval each, in ticks of 5 ms."""
    now_s, position_rad, tripped = 0.0, 0.0, []
    guard.add(now_s, position_rad, 0.0)
    for speed_rad_s, torque_nm in rows:
        trips = False
        for _ in range(10):
            now_s += 0.005
            position_rad += speed_rad_s * 0.005
            trips = guard.add(now_s, position_rad, torque_nm) or trips
        tripped.append(trips)
    return tripped


@pytest.mark.parametrize(
    ("rows", "trips"),
    [
        ([(0.1, 0.8)] * 3, True),
        ([(0.1, -0.8)] * 3, True),
        ([(0.1, 0.8)] * 2, False),
        ([(0.1, 0.8), (0.1, 0.8), (0.1, 0.6), (0.1, 0.8), (0.1, 0.8)], False),
        ([(0.1, 0.8), (0.1, 0.8), (0.6, 0.8), (0.1, 0.8), (0.1, 0.8)], False),
        ([(0.1, 0.69)] * 10, False),
        ([(0.55, 2.0)] * 10, False),
    ],
)
def test_three_samples_of_much_torque_and_little_speed_in_a_row(
    rows: list[tuple[float, float]], trips: bool
) -> None:
    guard = TorqueGuard(MotionConfig(), speed_rad_s=1.0)
    assert any(samples(guard, *rows)) is trips


def test_the_guard_is_tuned_by_its_fields() -> None:
    changes: dict[str, Any] = {"stop_torque_nm": 1.5, "stop_torque_cycles": 5}
    guard = TorqueGuard(MotionConfig(**changes), speed_rad_s=1.0)
    assert samples(guard, *[(0.1, 1.6)] * 5) == [False] * 4 + [True]
    guard.reset()
    assert not any(samples(guard, *[(0.1, 1.4)] * 9))
