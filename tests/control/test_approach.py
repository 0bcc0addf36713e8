"""The torque of an approach where it ends: no more than its budget, and no less than it takes."""

import pytest

from litegripd.control.motions.grasp import BUDGET_NM, Approach
from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, Status
from tests.world import PERIOD_S

FORCE_NM = 1.0
GEOMETRY = dict(zip(("normal", "reverse"), NOMINAL, strict=True))


def at(position_rad: float, at_s: float) -> Feedback:
    return Feedback(Status.ENABLED, position_rad, 0.0, 0.0, 30, 30, at_s)


def commanded_at_the_end(approach: Approach, sign: float, short_rad: float) -> MitCommand:
    """Return the command once the ramp has ended, of jaws that stand so far before its end."""
    here_rad = approach.target_rad - sign * short_rad
    command, _ = approach.step(0.0, at(approach.target_rad - sign * 0.3, 0.0))
    command, _ = approach.step(10.0, at(here_rad, 10.0))
    return command


def pressing_nm(command: MitCommand, here_rad: float, sign: float) -> float:
    """Return what a command makes of jaws that stand here."""
    lead_rad = command.position_rad - here_rad
    return sign * (command.kp_nm_rad * lead_rad + command.kd_nm_s_rad * command.velocity_rad_s)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
@pytest.mark.parametrize("reach_tol", [0.001, 0.02, 0.1])
@pytest.mark.parametrize("speed_mm_s", [5.0, 50.0, FASTEST_MM_S])
def test_jaws_that_stand_before_the_end_are_pressed_with_the_budget(
    mount: str, reach_tol: float, speed_mm_s: float
) -> None:
    geometry, config = GEOMETRY[mount], MotionConfig(reach_tol=reach_tol)
    sign = float(geometry.close_sign)
    for short_rad in (0.5, 0.2, 0.1):
        approach = Approach(geometry, config, speed_mm_s, FORCE_NM, PERIOD_S)
        command = commanded_at_the_end(approach, sign, short_rad)
        here_rad = approach.target_rad - sign * short_rad
        assert pressing_nm(command, here_rad, sign) == pytest.approx(BUDGET_NM)
        assert command.torque_nm == 0.0


@pytest.mark.parametrize("reach_tol", [0.005, 0.0105, 0.02, 0.1])
def test_the_jaws_are_not_left_short_of_the_end(reach_tol: float) -> None:
    """At the edge of `reach_tol` the whole budget presses, as far as any stiffness makes it."""
    config = MotionConfig(reach_tol=reach_tol)
    approach = Approach(GEOMETRY["normal"], config, 50.0, FORCE_NM, PERIOD_S)
    command = commanded_at_the_end(approach, 1.0, reach_tol)
    here_rad = approach.target_rad - reach_tol
    assert pressing_nm(command, here_rad, 1.0) == pytest.approx(BUDGET_NM)
