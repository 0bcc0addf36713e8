"""A hold by force shakes on no motor, whatever happens; bench/jaws/damping.py has the motors."""

from collections.abc import Callable

import pytest

from bench.jaws.damping import MOTORS, Motor, swing_of_hold
from bench.jaws.held import HeldRig
from bench.jaws.holding import vanish

SWING_NM = 0.3


def give_way(rig: HeldRig) -> None:
    rig.gripper.give_way(2.0)


@pytest.mark.parametrize("happen", [vanish, give_way])
@pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: motor.name)
def test_a_strong_hold_is_calm_after_a_disturbance(
    motor: Motor, happen: Callable[[HeldRig], None]
) -> None:
    assert swing_of_hold(motor, happen) < SWING_NM
