"""The windowed stall test."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.control.detectors import StallDetector
from litegripd.model.motion_config import MotionConfig

PERIOD_S = 0.005
SPEED = 0.668  # 50 mm/s
CONFIG = MotionConfig()


def first_stall(path: list[float], speed: float = SPEED, period_s: float = PERIOD_S) -> int | None:
    """Return the tick of the first stall along a path of positions, one per tick."""
    detector = StallDetector(CONFIG, speed)
    for tick, position_rad in enumerate(path):
        if detector.add(tick * period_s, position_rad):
            return tick
    return None


def test_jaws_that_stand_stall_after_one_window_and_not_before() -> None:
    assert first_stall([0.3] * 200) == round(CONFIG.stall_cycles * CONFIG.sample_interval / 0.005)


@given(st.floats(0.25, 1.5), st.sampled_from([1, -1]), st.floats(-1.5, 0.1))
def test_jaws_that_move_at_a_quarter_of_the_speed_do_not_stall(
    share: float, sign: int, began_rad: float
) -> None:
    path = [began_rad + sign * share * SPEED * t * PERIOD_S for t in range(300)]
    assert first_stall(path) is None


def test_jaws_slower_than_the_ratio_stall() -> None:
    assert first_stall([0.15 * SPEED * t * PERIOD_S for t in range(300)]) == 50


def test_a_short_stick_does_not_count() -> None:
    """The net movement over the window counts, not the single sample."""
    path = [SPEED * t * PERIOD_S for t in range(60)]
    path += [path[-1]] * 30  # 150 ms of standing
    path += [path[-1] + SPEED * t * PERIOD_S for t in range(1, 100)]
    assert first_stall(path) is None


def test_moving_to_and_fro_is_a_stall() -> None:
    path = [0.3 + 0.01 * (-1) ** (t // 10) for t in range(200)]
    assert first_stall(path) is not None


def test_at_a_very_low_speed_the_floor_decides() -> None:
    slow = 0.001
    assert first_stall([slow * t * PERIOD_S for t in range(100)], slow) == 50
    assert first_stall([0.007 * t * PERIOD_S for t in range(100)], slow) is None


@pytest.mark.parametrize("period_s", [0.004, 0.005, 0.0071, 0.013, 0.05])
def test_the_period_of_the_ticks_does_not_matter(period_s: float) -> None:
    standing = first_stall([0.0] * 400, period_s=period_s)
    assert standing is not None
    assert 0.25 <= standing * period_s + 1e-9 <= 0.25 + 6 * period_s
    assert first_stall([SPEED * t * period_s for t in range(100)], period_s=period_s) is None
