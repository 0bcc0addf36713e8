"""What `make lerobot` measures with: late and wrong tracks are found to be so."""

import math

import pytest

from tests.integrations.lerobot.measures import Track, delay_s, drifting, sweeps
from tests.integrations.lerobot.sight import seen_px

SWEEP_S = 2.0


def swept(at_s: float) -> float:
    return 0.5 + 0.3 * math.sin(2.0 * math.pi * at_s / SWEEP_S)


TIMES_S = [100.0 + 0.005 * tick for tick in range(2400)]
LEADER = Track(TIMES_S, [swept(at_s) for at_s in TIMES_S])
FRAMES = [(101.0 + frame / 30.0, swept(101.0 + frame / 30.0)) for frame in range(240)]


def test_a_track_is_read_between_its_samples_and_not_beyond_them() -> None:
    track = Track([1.0, 2.0], [0.2, 0.4])
    assert track.at(1.0) == 0.2
    assert track.at(1.25) == pytest.approx(0.25)
    assert track.at(2.0) == 0.4
    assert track.range(1.25, 1.75) == pytest.approx((0.25, 0.35))
    for outside_s in (0.9, 2.1):
        with pytest.raises(ValueError, match="is not in the log"):
            track.at(outside_s)


def test_the_fastest_of_a_sweep_is_its_middle() -> None:
    assert LEADER.fastest_s(101.0, 105.0) == pytest.approx(0.3 * math.pi, rel=0.02)


def test_a_follower_is_as_late_as_it_is() -> None:
    follower = Track(TIMES_S, [swept(at_s - 0.05) for at_s in TIMES_S])
    found = sweeps(LEADER, follower, 101.0, 109.0, SWEEP_S)
    assert [one.late_s for one in found] == pytest.approx([0.05] * 4, abs=0.002)
    assert found[0].fastest_s == pytest.approx(0.3 * math.pi, rel=0.02)
    assert len(sweeps(LEADER, follower, 101.0, 108.9, SWEEP_S)) == 3, "only whole sweeps"


def test_a_replay_that_is_elsewhere_is_off() -> None:
    off = Track(TIMES_S, [swept(at_s) + 0.04 for at_s in TIMES_S])
    assert delay_s(FRAMES, off)[1] > 0.03
    assert drifting(FRAMES, off)[0] > 0.02
    small = Track(TIMES_S, [0.5 + 0.7 * (swept(at_s) - 0.5) for at_s in TIMES_S])
    assert drifting(FRAMES, small)[0] > 0.03


def test_a_replay_whose_loop_is_ever_later_is_not_off() -> None:
    slower = Track(TIMES_S, [swept(101.0 + (at_s - 101.0) * 0.9) for at_s in TIMES_S])
    off, late_s = drifting(FRAMES, slower)
    assert off < 0.03
    assert late_s == sorted(late_s)
    assert late_s[-1] == pytest.approx(0.8, abs=0.1)


def test_jaws_are_seen_between_their_dark_inner_sides_and_only_there() -> None:
    table, dark, face = [160] * 20, [42] * 3, [126] * 9
    row = face[::-1] + dark + table + table + dark + face
    assert seen_px(row) == pytest.approx(46.0, abs=0.1)
    assert seen_px(table + table) is None
    assert seen_px(table + table + dark + face) is None  # one finger alone
    assert seen_px([42] * 80) is None
