"""Nothing presses for ever with more than somebody has set, in any mode, on any kind of plant.

Also what is reported meanwhile, and how much the motor makes while the jaws meet something.
"""

import math
from collections.abc import Callable
from typing import Any

import pytest

from bench.teleop.follow import SETTLE_S
from litegripd.app.build import METHODS
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MotorPhase
from tests.plants.parameters import Item, PlantParameters, random_plant
from tests.plants.worst import PRESSING
from tests.pressing import (
    FROM_MM,
    LASTS_S,
    NOT_PRESSING,
    OBJECT_MM,
    PRESSES,
    TO_MM,
    TRAVEL_MM,
    Act,
    Press,
    Pressing,
    calls,
    cancelled,
    closing,
    ended_by,
    follows,
    paused,
    rig_of,
    stopped,
    streamed,
)

SIMULATOR = None
SOFTNESSES_NM_RAD = (5.0, 60.0)
"""Of a finger, cushion and bone."""
CORDS_NM_RAD = (5.0, 20.0)
CREEPS = Item(OBJECT_MM, 60.0, yield_mm_s=2.0, yield_nm=0.5)
DAMPED = Item(OBJECT_MM, 20.0, damping_nm_s_rad=5.0)
REPORT_NM = 0.06
"""What codes, and damping of jaws that still creep back, add."""
MOST_FRICTIONS = 1.1
SAID_N = 4.2
"""From this on, the torque is more than friction usually takes."""

PLANTS: dict[str, PlantParameters | None] = {
    "simulator": SIMULATOR,
    "usual": PlantParameters(),
    "random": random_plant(3),
    **{name: plant for name, plant in PRESSING.items() if "press" in name},
}


def pressed(
    name: str, plant: PlantParameters | None, item: Item, mount: str = "normal"
) -> Pressing:
    """Let a scene press; return the gripper when nothing changes any more."""
    press = PRESSES[name]
    rig = rig_of(plant, mount, opening_mm=15.0 if press.opens else FROM_MM)
    if press.opens:
        rig.pull_by_a_cord(item.stiffness_nm_rad)
    else:
        rig.put(item)
    set_nm = press.act(rig)
    rig.run(LASTS_S)
    judge(rig, MotionConfig().stop_nm if set_nm is None else set_nm)
    return rig


def judge(rig: Pressing, set_nm: float) -> None:
    """Nothing feels more than the set torque and friction, and the state says what presses."""
    assert rig.in_phase(MotorPhase.ENABLED)
    looks = [look for look in rig.looks if look.at_s > rig.now_s - 0.5]
    motor_nm = max(abs(look.torque_nm) for look in looks) / rig.torque_factor
    felt_nm = max(rig.felt_nm(look) for look in looks)
    assert motor_nm <= set_nm + REPORT_NM
    assert felt_nm <= set_nm * rig.torque_factor + MOST_FRICTIONS * rig.friction_nm + REPORT_NM
    state, motor_n = rig.state, 10.0 * motor_nm
    if motor_n > SAID_N + 0.5:
        assert state.pressing_n == pytest.approx(motor_n, abs=0.8)
        told = rig.watcher.events("pressing")
        assert len(told) == (0 if state.is_grasped else 1)
        assert all(event["data"]["most_n"] >= event["data"]["pressing_n"] for event in told)
    elif motor_n < SAID_N - 0.5 and not state.is_grasped:
        assert state.pressing_n is None


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS.keys())
@pytest.mark.parametrize("name", PRESSES)
def test_nothing_presses_for_ever_with_more_than_is_set(
    name: str, plant: PlantParameters | None
) -> None:
    softnesses = CORDS_NM_RAD if PRESSES[name].opens else SOFTNESSES_NM_RAD
    for stiffness_nm_rad in softnesses:
        pressed(name, plant, Item(OBJECT_MM, stiffness_nm_rad))


@pytest.mark.parametrize("item", [CREEPS, DAMPED, Item(OBJECT_MM, 1500.0)])
@pytest.mark.parametrize("name", ["move", "close", "follow", "play", "stream", "stop"])
def test_nor_on_what_yields_or_damps_or_is_rigid(name: str, item: Item) -> None:
    for plant in (SIMULATOR, PlantParameters()):
        if item is CREEPS and name in ("stop",):
            continue  # it gives way before anybody can stop
        pressed(name, plant, item, "reverse")


def test_every_method_that_a_stop_voids_presses_here_or_cannot() -> None:
    tried = {method for press in PRESSES.values() for method in press.methods}
    assert tried.isdisjoint(NOT_PRESSING)
    assert tried | set(NOT_PRESSING) == {m.name for m in METHODS if m.stop_voids}


def opening(opens_s: float) -> Callable[[float], float]:
    """Return a leader that opens again from a time on."""
    return lambda at_s: min(TO_MM + 60.0 * max(at_s - opens_s, 0.0), FROM_MM) / TRAVEL_MM


def test_a_follower_follows_on_when_its_leader_reopens_or_the_object_is_gone() -> None:
    for plant in (SIMULATOR, PlantParameters(), random_plant(3)):
        rig = pressed("follow", plant, Item(OBJECT_MM, 20.0))
        told_mm = rig.state.opening_mm or 0.0
        assert told_mm > TO_MM + 20.0
        rig.leader.silent_s = math.inf
        opens_s = rig.now_s - rig.leader.began_s
        rig.leader.openness_from(opening(opens_s))
        rig.run(1.5)
        assert rig.state.opening_mm == pytest.approx(FROM_MM, abs=1.5)
        rig = pressed("follow", plant, Item(OBJECT_MM, 20.0))
        rig.remove()
        rig.run(2.5)
        assert rig.state.opening_mm == pytest.approx(TO_MM, abs=1.5)
        assert (rig.state.pressing_n or 0.0) <= 11.0 * rig.friction_nm / rig.torque_factor


def test_the_same_kind_of_press_fills_no_journal() -> None:
    rig = rig_of(SIMULATOR)
    rig.put(Item(OBJECT_MM, 20.0))
    for _ in range(8):
        rig.owner.call("motion.move", opening_mm=TO_MM)
        rig.run(2.0)
        rig.owner.call("motion.move", opening_mm=FROM_MM)
    assert len(rig.watcher.events("pressing")) == 1
    rig.run(60.0)
    rig.owner.call("motion.move", opening_mm=TO_MM)
    rig.run(2.0)
    assert len(rig.watcher.events("pressing")) == 2


@pytest.mark.parametrize("method", ["motion.open", "motion.close"])
def test_a_stop_that_is_looked_for_is_not_reported(method: str) -> None:
    for plant in (SIMULATOR, PlantParameters()):
        rig = rig_of(plant)
        rig.owner.call(method)
        rig.run(3.0)
        assert rig.watcher.events("pressing") == []
        assert (rig.state.pressing_n or 0.0) < 6.0  # the closed stop is soft, and pushes back


@pytest.mark.parametrize(
    ("method", "params"), [("motion.open", {}), ("motion.move", {"opening_mm": FROM_MM})]
)
def test_a_grasp_is_not_reported_by_what_opens_the_jaws_after_it(
    method: str, params: dict[str, Any]
) -> None:
    for plant in (SIMULATOR, PlantParameters()):
        rig = rig_of(plant)
        rig.put(Item(OBJECT_MM, 20.0))
        rig.owner.result("motion.grasp", force_n=20.0, until="verdict")
        rig.run(LASTS_S)
        rig.owner.result(method, **params)
        assert [event["message"] for event in rig.watcher.events("pressing")] == []


# What the motor makes while the jaws meet something

PEAK_NM = 7.0
CODES_NM = 0.1
BOUNCE_NM, BOUNCE_S = 8.5, 0.015
"""Jaws that something rigid throws back, within a period, at a speed that nobody has measured."""
QUICK_MM_S = 150.0
STIFF = {"kp": 500.0, "kd": 5.0}
SUDDEN = Item(45.0, 1500.0)


def jumping(at_s: float) -> float:
    return (FROM_MM if at_s < SETTLE_S else TO_MM) / TRAVEL_MM


def sweeping(at_s: float) -> float:
    return (45.0 + 25.0 * math.cos(2.0 * math.pi * max(at_s - SETTLE_S, 0.0))) / TRAVEL_MM


def led(openness: Callable[[float], float], **params: Any) -> Act:
    """Return a follower of another leader."""

    def act(rig: Pressing) -> float | None:
        rig.leader.openness_from(openness)
        return follows(**params)(rig)

    return act


def _quick(method: str, **params: Any) -> Press:
    return Press(calls(method, speed_mm_s=QUICK_MM_S, **params), (method,))


QUICK: dict[str, Press] = {
    "move": _quick("motion.move", opening_mm=TO_MM),
    "stiff move": _quick("motion.move", opening_mm=TO_MM, **STIFF),
    "close": _quick("motion.close"),
    "open": _quick("motion.open"),
    "grasp": _quick("motion.grasp", force_n=40.0, until="verdict"),
    "stream": Press(streamed(3.0, speed_mm_s=QUICK_MM_S), ()),
    "stiff stream": Press(streamed(3.0, speed_mm_s=QUICK_MM_S, **STIFF), ()),
    "pause": Press(paused, ()),
    "follow": Press(led(closing(QUICK_MM_S)), ()),
    "follow a jump": Press(led(jumping), ()),
    "follow a sweep": Press(led(sweeping), ()),
    "follow stiffly": Press(led(closing(QUICK_MM_S), **STIFF), ()),
    "follow a sweep stiffly": Press(led(sweeping, **STIFF), ()),
    "follow with a limit": Press(led(jumping, force_limit_n=30.0, **STIFF), ()),
    "cancel": Press(
        ended_by("motion.move", cancelled, 0.0, opening_mm=TO_MM, speed_mm_s=QUICK_MM_S), ()
    ),
    "stop": Press(
        ended_by("motion.move", stopped, 0.0, opening_mm=TO_MM, speed_mm_s=QUICK_MM_S, **STIFF), ()
    ),
}


def peak(name: str, plant: PlantParameters | None, rate_hz: int, item: Item | None) -> Pressing:
    """Let jaws meet something fast; return the gripper afterwards."""
    rig = rig_of(plant, rate_hz=rate_hz)
    if item is not None:
        rig.put(item)
    if name == "pause" and item is None:
        return rig
    QUICK[name].act(rig)
    rig.run(0.5)
    return rig


@pytest.mark.parametrize("rate_hz", [100, 200, 1000])
@pytest.mark.parametrize("name", QUICK)
def test_no_mode_makes_more_than_the_peak_torque(name: str, rate_hz: int) -> None:
    items = (None, SUDDEN, Item(45.0, 20.0)) if rate_hz == 200 else (SUDDEN,)
    for plant in (SIMULATOR, PlantParameters()):
        for item in items:
            rig = peak(name, plant, rate_hz, item)
            assert max(abs(look.torque_nm) for look in rig.looks) <= PEAK_NM + CODES_NM


@pytest.mark.parametrize("plant", [*PRESSING.values(), random_plant(6)])
@pytest.mark.parametrize("name", [n for n in QUICK if n != "follow a jump"])
def test_but_for_a_bounce_on_the_worst_plants(name: str, plant: PlantParameters) -> None:
    for item in (None, SUDDEN):
        rig = peak(name, plant, 200, item)
        above = [abs(look.torque_nm) / rig.torque_factor for look in rig.looks]
        assert max(above) <= BOUNCE_NM
        assert sum(torque_nm > PEAK_NM + CODES_NM for torque_nm in above) <= 1e3 * BOUNCE_S
