"""What the log says of the motor: once of its type, and of one that is not the configured one."""

import logging

import pytest

from litegripd.app.status import MotorGreeting, warn_of_untried
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
