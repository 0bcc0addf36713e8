"""What a joint's position, velocity and effort are of the gripper's opening, speed and force."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_ros2.joints import (
    CLOSED_M,
    DEFAULT_NAMES,
    EDGE_MM,
    Joints,
    Layout,
    Scale,
    Target,
    UnusableError,
    within_travel,
)

OPENING = Joints(Layout.OPENING, DEFAULT_NAMES[Layout.OPENING])
SLIDES = Joints(Layout.SLIDES, DEFAULT_NAMES[Layout.SLIDES])
RIGHT, LEFT = SLIDES.names
INFO = {
    "gripper": {
        "calibrated": True,
        "travel_mm": 86.99,
        "closed_rad": 0.0,
        "open_rad": -1.651,
        "rad_to_mm": 52.69,
        "nm_to_n": 10.0,
    }
}


def test_one_joint_is_the_opening_in_metres() -> None:
    assert OPENING.position_m(40.0) == 0.04
    assert OPENING.velocity_m_s(-25.0) == -0.025
    assert OPENING.speed_mm_s(-0.025) == 25.0


def test_the_vendors_joints_are_0_when_open_and_each_goes_half_the_way() -> None:
    assert SLIDES.position_m(0.0) == CLOSED_M
    assert SLIDES.position_m(85.452) == pytest.approx(0.0, abs=1e-9)
    assert SLIDES.position_m(40.0) == pytest.approx(0.022726)
    assert SLIDES.velocity_m_s(-50.0) == 0.025  # closing is positive there
    assert SLIDES.speed_mm_s(0.025) == 50.0


@pytest.mark.parametrize("joints", [OPENING, SLIDES])
@given(opening_mm=st.floats(-5.0, 130.0))
def test_a_position_leads_back_to_its_opening(joints: Joints, opening_mm: float) -> None:
    assert joints.opening_mm(joints.position_m(opening_mm)) == pytest.approx(opening_mm, abs=1e-9)


def test_a_urdf_with_another_travel_has_another_closed_position() -> None:
    joints = Joints(Layout.SLIDES, ("a", "b"), closed_m=0.05)
    assert joints.position_m(0.0) == 0.05
    assert joints.opening_mm(0.05) == 0.0


@pytest.mark.parametrize(
    ("layout", "names", "closed_m"),
    [
        (Layout.OPENING, (), CLOSED_M),
        (Layout.OPENING, ("a", "b"), CLOSED_M),
        (Layout.OPENING, ("",), CLOSED_M),
        (Layout.SLIDES, ("a",), CLOSED_M),
        (Layout.SLIDES, ("a", "a"), CLOSED_M),
        (Layout.SLIDES, ("a", "b"), 0.0),
        (Layout.SLIDES, ("a", "b"), math.nan),
    ],
)
def test_what_cannot_be_joints_is_refused(
    layout: Layout, names: tuple[str, ...], closed_m: float
) -> None:
    with pytest.raises(ValueError, match=r"joint_names|closed_m"):
        Joints(layout, names, closed_m)


@pytest.mark.parametrize(
    ("joints", "values", "target"),
    [
        (OPENING, ([OPENING.names[0]], [0.04], [], []), Target(40.0)),
        (OPENING, ([], [0.04], [0.05], [12.0]), Target(40.0, 50.0, 12.0)),
        (OPENING, (OPENING.names, [0.04], [0.0], [0.0]), Target(40.0)),
        (OPENING, (OPENING.names, [0.04], [math.nan], [math.inf]), Target(40.0)),
        (OPENING, (OPENING.names, [0.04], [-0.05], [-12.0]), Target(40.0, 50.0, 12.0)),
        (OPENING, (["arm", *OPENING.names], [1.0, 0.04], [9.0, 0.05], []), Target(40.0, 50.0)),
        (SLIDES, ([RIGHT], [0.022726], [], []), Target(40.0)),
        (SLIDES, ([LEFT, RIGHT], [0.0229, 0.022552], [], []), Target(40.0)),
        (SLIDES, ([], [0.022726, 0.022726], [0.01, 0.02], [3, 5.0]), Target(40.0, 40.0, 5.0)),
    ],
)
def test_a_joint_state_is_read_as_a_command(
    joints: Joints, values: tuple[Any, ...], target: Target
) -> None:
    read = joints.target(*values)
    assert read.opening_mm == pytest.approx(target.opening_mm)
    assert read.speed_mm_s == (target.speed_mm_s and pytest.approx(target.speed_mm_s))
    assert read.force_n == target.force_n


@pytest.mark.parametrize(
    ("joints", "values", "why"),
    [
        (OPENING, (["arm"], [0.04], [], []), "no joint of this gripper in arm"),
        (OPENING, ([], [], [], []), "no joint"),
        (OPENING, (OPENING.names, [], [], []), "0 positions for 1 joints"),
        (OPENING, ([], [0.04, 0.05], [], []), "2 positions for 1 joints"),
        (OPENING, (OPENING.names, [math.nan], [], []), "not finite"),
        (OPENING, (OPENING.names, [math.inf], [], []), "not finite"),
        (OPENING, (OPENING.names, [0.04], [0.1, 0.1], []), "2 values of velocity"),
        (OPENING, (OPENING.names, [0.04], [], [1.0, 1.0]), "2 values of effort"),
        (OPENING, (OPENING.names * 2, [0.04, 0.05], [], []), "named twice"),
        (SLIDES, ([RIGHT, LEFT], [0.0, 0.02], [], []), "the jaws are coupled"),
    ],
)
def test_what_says_nothing_that_can_be_done_is_refused(
    joints: Joints, values: tuple[Any, ...], why: str
) -> None:
    with pytest.raises(UnusableError, match=why):
        joints.target(*values)


def test_a_little_beyond_the_travel_is_its_end_and_further_out_is_the_daemons_to_refuse() -> None:
    assert within_travel(85.452, 85.0) == 85.0
    assert within_travel(-0.5, 85.0) == 0.0
    assert within_travel(40.0, 85.0) == 40.0
    assert within_travel(85.0 + EDGE_MM + 0.1, 85.0) == 85.0 + EDGE_MM + 0.1
    assert within_travel(-EDGE_MM - 0.1, 85.0) == -EDGE_MM - 0.1


def test_the_scale_is_that_of_the_calibration_and_knows_which_way_opens() -> None:
    scale = Scale.from_info(INFO)
    assert scale is not None
    assert scale.travel_mm == 86.99
    assert scale.opening_mm_s(-1.0) == 52.69  # falling radians open
    assert scale.torque_nm(20.0) == pytest.approx(2.0)
    turned = Scale.from_info({"gripper": {**INFO["gripper"], "open_rad": 1.651}})
    assert turned is not None
    assert turned.opening_mm_s(-1.0) == -52.69


def test_there_is_no_scale_without_a_calibration() -> None:
    assert Scale.from_info({"gripper": {"calibrated": False}}) is None
    assert Scale.from_info({}) is None
