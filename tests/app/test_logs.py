"""What the log says of the motor: once of its type, and of one that is not the configured one."""

import logging
from pathlib import Path

import pytest

from litegripd.app.config import load
from litegripd.app.status import MotorGreeting, warn_of_superseded, warn_of_untried
from litegripd.model.gripper import DM4310, MOTOR_TYPES, MotorType
from tests.motor.test_wrong_type import BOTH_WAYS, world_of


@pytest.mark.parametrize("motor_type", MOTOR_TYPES.values(), ids=MOTOR_TYPES)
def test_one_warning_says_that_nobody_has_tried_a_type(
    motor_type: MotorType, caplog: pytest.LogCaptureFixture
) -> None:
    warn_of_untried(motor_type)
    assert len(caplog.records) == motor_type.is_untried
    for record in caplog.records:
        assert record.levelno == logging.WARNING
        assert motor_type.name in record.getMessage()
        assert "NEVER BEEN TRIED" in record.getMessage()


@BOTH_WAYS
def test_a_motor_of_another_type_is_a_warning(
    configured: MotorType, on_the_bus: MotorType, caplog: pytest.LogCaptureFixture
) -> None:
    world = world_of(configured, on_the_bus).start()
    greeting = MotorGreeting(configured)
    for _ in range(3):
        greeting.note(world.machine.motor.view().identity)
    (warning,) = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert warning.getMessage().startswith(f"the motor is no {configured.name}")


def test_the_usual_motor_is_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    world = world_of(DM4310, DM4310).start()
    MotorGreeting(DM4310).note(world.machine.motor.view().identity)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


@pytest.mark.parametrize(
    ("stroke", "is_warned"), [("120.0", True), ("120", True), ("119.9", False), ("85.0", False)]
)
def test_the_stroke_of_earlier_versions_is_one_warning_with_what_counts(
    stroke: str, is_warned: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "can0.toml"
    path.write_text(f"[gripper]\nstroke_mm = {stroke}\n", encoding="utf-8")
    warn_of_superseded(load("can0", path))
    assert len(caplog.records) == is_warned
    for record in caplog.records:
        assert record.levelno == logging.WARNING
        text = record.getMessage()
        assert text.startswith(f"[gripper] stroke_mm = 120 in {path} is the default of earlier")
        assert text.endswith("opens 85 mm, and that counts; correct the file")


def test_without_a_file_no_stroke_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    warn_of_superseded(load("can0", None))
    assert not caplog.records
