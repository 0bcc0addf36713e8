"""The openness over the time, read out of bytes."""

import bisect
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.trajectories.values import PIECE_BYTES, PIECE_SAMPLES, Path
from tests.trajectories import HEADER_BYTES, Point, lgt, sampled, swing

points = st.lists(st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 1.0)), min_size=1, max_size=30)


def path_of(points: list[Point]) -> Path:
    body = lgt(points)[HEADER_BYTES:]
    pieces = [body[at : at + PIECE_BYTES] for at in range(0, len(body), PIECE_BYTES)]
    return Path(pieces, len(points))


def expected(points: list[Point], elapsed_s: float) -> float:
    """Interpolate as the text says, with lists."""
    times = [t_s - points[0][0] for t_s, _ in points]
    after = bisect.bisect_right(times, elapsed_s)
    if after == 0:
        return points[0][1]
    if after == len(points):
        return points[-1][1]
    share = (elapsed_s - times[after - 1]) / (times[after] - times[after - 1])
    low, high = points[after - 1][1], points[after][1]
    return low + (high - low) * share


@given(points=points, at=st.floats(-1.0, 101.0))
def test_it_is_straight_between_the_samples(points: list[Point], at: float) -> None:
    ordered = sorted(points, key=lambda point: point[0])
    path = path_of(ordered)
    openness = path.openness_at(at)
    assert openness == pytest.approx(expected(ordered, at), abs=1e-6)
    assert 0.0 <= openness <= 1.0
    assert path.duration_s == ordered[-1][0] - ordered[0][0]


@pytest.mark.parametrize(
    "count", [1, PIECE_SAMPLES - 1, PIECE_SAMPLES, PIECE_SAMPLES + 1, 2 * PIECE_SAMPLES]
)
def test_the_borders_of_the_pieces_make_no_difference(count: int) -> None:
    motion = sampled(swing(), (count - 1) / 100.0)
    path = path_of(motion)
    for number in range(count):
        assert path.openness_at(number / 100.0) == pytest.approx(motion[number][1], abs=1e-9)


@pytest.mark.parametrize("first_s", [-1e6, 0.0, 123.456, 1.7e9])
def test_the_first_sample_is_the_start_whatever_its_time(first_s: float) -> None:
    path = path_of(sampled(swing(), 3.0, first_s=first_s))
    assert path.openness_at(0.0) == 0.5
    assert path.openness_at(1.0) == pytest.approx(0.8, abs=1e-6)
    assert path.duration_s == pytest.approx(3.0, abs=1e-6)


def test_of_several_samples_at_one_time_the_last_counts() -> None:
    path = path_of([(0.0, 0.1), (1.0, 0.2), (1.0, 0.9), (1.0, 0.3), (2.0, 0.4)])
    assert path.openness_at(1.0) == 0.3
    assert path.openness_at(0.999999) == pytest.approx(0.2, abs=1e-5)


def test_a_look_into_the_longest_path_takes_few_samples() -> None:
    """Whatever the times in the file are: one that stands still must not cost a tick more."""

    class Counting(list[bytes]):
        reads = 0

        def __getitem__(self, index: object) -> bytes:  # type: ignore[override]
            self.reads += 1
            return piece

    piece = struct.pack("<5d", 0.0, 0.5, 0.0, 0.0, 0.0) * PIECE_SAMPLES
    pieces = Counting()
    path = Path(pieces, 360_000)
    pieces.reads = 0
    assert path.openness_at(0.0) == 0.5
    assert pieces.reads < 25
