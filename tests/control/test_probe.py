"""The probe by itself: what ends it, and what it commands."""

from dataclasses import replace

import pytest

from litegripd.control.motions.calibrate import Probe
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback

CONFIG = MotionConfig()


def measured(position_rad: float, torque_nm: float) -> Feedback:
    return Feedback(1, position_rad, 0.0, torque_nm, 30, 30, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_structure_that_yields_freezes_the_probe_at_the_ceiling(sign: int) -> None:
    """It never stands still, so only the torque can end it."""
    probe = Probe(sign, CONFIG)
    for tick in range(100):
        here_rad = sign * 0.002 * tick
        command, verdict = probe.step(tick * 0.005, measured(here_rad, sign * 0.019 * tick))
        assert verdict is None
        assert command.position_rad == pytest.approx(here_rad + sign * CONFIG.calib_step_rad)
    command, verdict = probe.step(0.5, measured(sign * 0.2, sign * CONFIG.calib_tau_limit))
    assert verdict == "found"
    assert command.position_rad == sign * 0.2


@pytest.mark.parametrize("sign", [1, -1])
def test_the_torque_of_what_was_before_is_no_stop(sign: int) -> None:
    """As where the other stop was found by the torque that is still there in the first tick."""
    probe = Probe(sign, CONFIG)
    _, verdict = probe.step(0.0, measured(0.0, -sign * 1.5 * CONFIG.calib_tau_limit))
    assert verdict is None


def test_the_command_follows_from_the_measured_position_alone() -> None:
    """An accumulated target kept increasing its lead at a stop until the jaw broke."""
    probe = Probe(1, replace(CONFIG, calib_stall_cycles=100))
    for tick in range(400):
        command, verdict = probe.step(tick * 0.005, measured(0.1, 1.0))
        assert verdict is None
        assert command.position_rad == pytest.approx(0.1 + CONFIG.calib_step_rad)
        assert command.kp_nm_rad * CONFIG.calib_step_rad <= CONFIG.calib_tau_limit
