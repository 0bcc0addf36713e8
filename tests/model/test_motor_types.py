"""The types of motor: each row makes sense, what follows from it, and who else names a type."""

import re
from dataclasses import MISSING, fields
from pathlib import Path

import pytest

from litegripd.app.build import METHODS
from litegripd.model.gripper import (
    DM4310,
    FIGURES,
    MOTOR_FAMILY,
    MOTOR_TYPES,
    NUMBERED_TYPES,
    IncompleteType,
    MotorType,
    why_not_driven,
)
from litegripd.sim.plant import SimulatorParameters

ROOT = Path(__file__).parents[2]
every_type = pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)


@every_type
def test_the_figures_of_a_row_go_together(motor_type: MotorType) -> None:
    motor = motor_type
    assert MOTOR_TYPES[motor.name] is motor
    assert 0.0 < motor.rated_nm <= motor.holding_nm < motor.peak_nm <= motor.ranges.torque_nm
    assert 0.0 < motor.rated_speed_rad_s < motor.no_load_speed_rad_s < motor.ranges.velocity_rad_s
    assert 0.0 < motor.coulomb_nm <= motor.breakaway_nm < motor.least_useful_nm < motor.rated_nm
    assert motor.most_nm >= 0.9 * motor.peak_nm  # the current for the peak can flow
    assert 0.0 < motor.winding_s < motor.housing_s
    assert motor.largest_acceleration_rad_s2 > motor.peak_nm / motor.inertia_kg_m2


@every_type
def test_no_two_types_can_be_taken_for_each_other(motor_type: MotorType) -> None:
    for other in MOTOR_TYPES.values():
        same = (other.gear_ratio, other.ranges) == (motor_type.gear_ratio, motor_type.ranges)
        assert same == (other is motor_type)


def test_what_follows_from_the_usual_motor_is_what_it_always_was() -> None:
    motor = DM4310
    assert (motor.peak_impulse_nm_s, motor.least_useful_nm, motor.inertia_kg_m2) == (
        2,
        0.3,
        1.85e-3,
    )
    assert motor.largest_acceleration_rad_s2 == 6000.0
    assert (motor.most_force_n, motor.fastest_rad_s) == (40.0, 2.9)
    assert motor.watts_per_nm2 == pytest.approx(1.43, abs=0.005)


@every_type
def test_a_simulated_gripper_of_any_motor_has_the_same_ends(motor_type: MotorType) -> None:
    usual = SimulatorParameters()
    other = usual.of_motor(motor_type)
    assert other.closed_stiffness_nm_rad == pytest.approx(usual.closed_stiffness_nm_rad)
    assert other.open_stiffness_nm_rad == usual.open_stiffness_nm_rad
    assert (other == usual) == (motor_type is DM4310)


def test_a_limit_that_follows_from_the_motor_is_told_of_the_usual_one() -> None:
    following = [param for row in METHODS for param in row.params if param.maximum_of is not None]
    assert {param.name for param in following} >= {"force_n", "speed_mm_s", "torque_nm", "dq_max"}
    for param in following:
        assert param.with_motor(DM4310) is param


def test_a_further_type_touches_two_files() -> None:
    """Its row, and what its registers hold for `litegripctl doctor`, which knows no daemon."""
    further = "|".join(MOTOR_TYPES.keys() - {DM4310.name})
    sources = [
        path
        for room in ("litegripd", "litegrip_client")
        for path in ROOT.glob(f"{room}/**/*.py")
        if "drop_in" not in path.parts  # the vendor's numbers of the maker's whole family
    ]
    assert len(sources) > 100
    naming = {path for path in sources if re.search(rf"\b({further})\b", path.read_text("utf-8"))}
    assert {str(path.relative_to(ROOT)) for path in naming} == {
        "litegripd/model/gripper.py",
        "litegrip_client/ctl/doctor/gripper_checks.py",
    }


@every_type
def test_the_page_on_the_configuration_says_what_a_type_may_and_that_nobody_has_tried_it(
    motor_type: MotorType,
) -> None:
    lines = (ROOT / "docs" / "configuration.md").read_text("utf-8").splitlines()
    (row,) = [line for line in lines if line.startswith(f"| `{motor_type.name}`")]
    assert ("never tried" in row) == motor_type.is_untried
    assert f" {motor_type.peak_nm:g} N·m | {motor_type.most_force_n:g} N " in row


def test_the_figures_are_all_that_a_row_must_have() -> None:
    required = {one.name for one in fields(MotorType) if one.default is MISSING}
    assert required - {"name", "is_untried"} == set(FIGURES)


def test_the_family_has_each_type_that_the_maker_numbers() -> None:
    assert set(MOTOR_FAMILY) - set(NUMBERED_TYPES) == {"DM4310P", "DM4340P"}
    assert len(set(NUMBERED_TYPES) & set(MOTOR_FAMILY)) == 15
    assert all(name == row.name for name, row in MOTOR_FAMILY.items())


@pytest.mark.parametrize(
    "row", [row for row in MOTOR_FAMILY.values() if isinstance(row, IncompleteType)]
)
def test_what_is_missing_of_a_type_is_what_it_has_not(row: IncompleteType) -> None:
    assert set(row.figures) < set(FIGURES)
    assert {*row.known, *row.missing} == set(FIGURES.values())
    assert len(row.missing) == len(FIGURES) - len(row.figures)
    why = why_not_driven(row.name)
    assert why is not None
    assert f"missing: {', '.join(row.missing)}; use a motor of type DM4310 or DM4340" in why
    page = (ROOT / "docs" / "configuration.md").read_text("utf-8")
    (line,) = [line for line in page.splitlines() if f"`{row.name}`" in line]
    assert line.endswith(f" | {', '.join(row.missing)} |")


def test_a_type_with_all_its_figures_lacks_nothing() -> None:
    figures = {name: getattr(DM4310, name) for name in FIGURES}
    assert IncompleteType("like DM4310", figures).missing == ()
    assert MotorType("DM4310", is_untried=False, **figures) == DM4310


@every_type
def test_a_type_with_a_row_can_be_driven(motor_type: MotorType) -> None:
    assert why_not_driven(motor_type.name) is None
