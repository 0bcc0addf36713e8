"""What of a gripper's state a data set has, and what an action means, on both mounts."""

import struct
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from lerobot_robot_litegrip.mapping import (
    AGE,
    OBSERVED,
    POS,
    STAMP,
    TORQUE,
    Travel,
    action_of,
    observation_of,
    target_of,
)
from litegrip_client import CommandError, GripperState, ParameterError
from tests.client.fake_daemon import STATE

NORMAL, REVERSE = Travel(0.0, -1.65), Travel(0.1, 1.75)
NEWEST = replace(
    GripperState.from_wire(STATE),
    openness=0.4,
    velocity_rad_s=0.0,
    torque_nm=0.0,
    coil_temperature_c=31,
    feedback_s=500.0,
    is_grasped=False,
    pressing_n=None,
)


def seen(travel: Travel = NORMAL, zero_s: float = 490.0, **figures: Any) -> dict[str, float]:
    return observation_of(replace(NEWEST, **figures), travel, zero_s)


def test_an_observation_has_each_figure_but_the_age() -> None:
    assert set(seen()) == {*OBSERVED, STAMP}
    assert AGE not in seen()
    assert seen()[POS] == pytest.approx(40.0)
    assert seen()["gripper.temp"] == 31.0
    assert seen()[STAMP] == 10.0


def test_opening_is_a_positive_speed_on_both_mounts() -> None:
    for travel, opening_rad_s in ((NORMAL, -0.165), (REVERSE, 0.165)):
        assert seen(travel, velocity_rad_s=opening_rad_s)["gripper.vel"] == pytest.approx(10.0)
        assert seen(travel, velocity_rad_s=-opening_rad_s)["gripper.vel"] == pytest.approx(-10.0)


def test_squeezing_is_a_positive_torque_on_both_mounts() -> None:
    for travel, squeezing_nm in ((NORMAL, 0.5), (REVERSE, -0.5)):
        assert seen(travel, torque_nm=squeezing_nm)[TORQUE] == 0.5
        assert seen(travel, torque_nm=-squeezing_nm)[TORQUE] == -0.5


@pytest.mark.parametrize(
    ("figures", "grasped"),
    [
        ({}, 0.0),
        ({"is_grasped": True}, 1.0),
        ({"is_grasped": None}, 0.0),
        ({"pressing_n": 9.0, "torque_nm": 0.9}, 1.0),
        ({"pressing_n": 9.0, "torque_nm": -0.9}, 0.0),  # presses outwards
        ({"pressing_n": 9.0, "torque_nm": 0.9, "openness": 0.01}, 0.0),  # on each other
    ],
)
def test_an_object_is_held_by_verdict_or_by_jaws_that_stand_and_squeeze(
    figures: dict[str, Any], grasped: float
) -> None:
    assert seen(**figures)["gripper.grasped"] == grasped


def test_stamps_tell_ticks_apart_in_a_data_set_of_a_machine_that_runs_for_months() -> None:
    """A data set keeps float32."""

    def kept(value: float) -> float:
        return float(struct.unpack("f", struct.pack("f", value))[0])

    months_s = 9_000_000.0
    ticks = [months_s + 3600.0 + 0.005 * tick for tick in range(200)]
    stamps = [kept(seen(zero_s=months_s, feedback_s=at_s)[STAMP]) for at_s in ticks]
    assert all(before < after for before, after in pairwise(stamps))
    assert stamps[-1] - stamps[0] == pytest.approx(0.995, abs=0.001)
    assert len({kept(at_s) for at_s in ticks}) == 2, "which a monotonic clock cannot do"


def test_an_observation_is_not_clipped() -> None:
    """It is what the daemon says."""
    assert seen(openness=1.01)[POS] == pytest.approx(101.0)
    assert seen(openness=-0.01)[POS] == pytest.approx(-1.0)


def test_an_action_of_a_leader_is_clipped_for_lerobot_stores_it_as_it_is() -> None:
    for openness, pos in ((0.4, 40.0), (1.01, 100.0), (-0.01, 0.0)):
        action = action_of(replace(NEWEST, openness=openness), 9.0)
        assert action == {POS: pytest.approx(pos), TORQUE: 3.0}


class Tensor:
    """As `lerobot-replay` has figures."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __float__(self) -> float:
        return self.value


def test_an_action_is_clipped_to_what_the_jaws_can() -> None:
    assert target_of({POS: 40, TORQUE: 0.5}, 1.0) == (0.4, 0.5)
    assert target_of({POS: Tensor(40.0), TORQUE: Tensor(0.5)}, 1.0) == (0.4, 0.5)
    assert target_of({POS: 130.0, TORQUE: 7.0}, 1.0) == (1.0, 3.0)
    assert target_of({POS: -3.0, TORQUE: 0.0}, 1.0) == (0.0, 0.1)
    assert target_of({POS: 40.0}, 1.5) == (0.4, 1.5)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (
            {TORQUE: 1.0, "elbow.pos": 1.0},
            r"needs gripper.pos, this one has: gripper.torque, elbow",
        ),
        ({POS: float("nan")}, "gripper.pos is nan"),
        ({POS: 1.0, TORQUE: float("inf")}, "gripper.torque is inf"),
        ({POS: "open"}, "gripper.pos is 'open'"),
        ({POS: None}, "gripper.pos is None"),
    ],
)
def test_what_is_no_action_is_refused(action: dict[str, Any], says: str) -> None:
    with pytest.raises(ParameterError, match=says):
        target_of(action, 1.0)


def test_figures_that_nobody_knows_are_refused() -> None:
    for unknown in ("openness", "velocity_rad_s", "torque_nm"):
        figures: dict[str, Any] = {unknown: None}
        with pytest.raises(CommandError, match="the gripper is not calibrated"):
            observation_of(replace(NEWEST, **figures), NORMAL, 0.0)
    for unknown in ("coil_temperature_c", "feedback_s"):
        figures = {unknown: None}
        with pytest.raises(CommandError, match="has not reported yet"):
            observation_of(replace(NEWEST, **figures), NORMAL, 0.0)
    with pytest.raises(CommandError, match="lerobot-calibrate"):
        action_of(replace(NEWEST, openness=None), 1.0)
    with pytest.raises(CommandError, match="not calibrated"):
        Travel.from_info({"gripper": {"calibrated": False}})
