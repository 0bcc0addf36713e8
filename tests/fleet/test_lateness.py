"""The clock of the gripper's machine, as a portal reckons it from round trips."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.wire.lateness import MOTION_COUNTS_S, RemoteClock, is_over, late_by


def trip(clock: RemoteClock, sent_s: float, there_s: float, back_s: float, ahead_s: float) -> None:
    """Let a message go there and back; the other clock is ahead by `ahead_s`."""
    clock.note(sent_s, sent_s + there_s + back_s, sent_s + there_s + ahead_s)


def error_s(clock: RemoteClock, ahead_s: float, own_s: float = 100.0) -> float:
    at_s = clock.at(own_s)
    assert at_s is not None
    return abs(at_s - (own_s + ahead_s))


def test_nothing_is_known_before_the_first_answer() -> None:
    assert RemoteClock().at(1.0) is None
    assert late_by(None, 1.0, MOTION_COUNTS_S) == float("inf")


@given(
    st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(0.0, 2.0)), min_size=1, max_size=20),
    st.floats(-1e5, 1e5),
)
def test_the_error_is_at_most_half_of_the_quickest_of_the_last_trips(
    trips: list[tuple[float, float]], ahead_s: float
) -> None:
    clock = RemoteClock()
    for number, (there_s, back_s) in enumerate(trips):
        trip(clock, float(number), there_s, back_s, ahead_s)
    quickest_s = min(there_s + back_s for there_s, back_s in trips[-8:])
    assert error_s(clock, ahead_s) <= quickest_s / 2 + 1e-6


@pytest.mark.parametrize("jump_s", [-3600.0, -0.6, 0.6, 3600.0])
def test_what_was_known_ends_when_a_machine_has_slept_or_was_started_again(jump_s: float) -> None:
    """One slow trip afterwards is enough: motions are neither refused nor let through for it."""
    clock = RemoteClock()
    for number in range(8):
        trip(clock, float(number), 0.001, 0.001, ahead_s=50.0)
    trip(clock, 9.0, 0.05, 0.15, ahead_s=50.0 + jump_s)
    assert error_s(clock, 50.0 + jump_s) <= 0.1 + 1e-9


@given(st.lists(st.floats(0.001, 1.0), min_size=2, max_size=30), st.floats(-5.0, 5.0))
def test_the_error_stays_below_the_latest_trip_while_clocks_drift(
    trips_s: list[float], drift_s: float
) -> None:
    """The drift is that between two trips, as between sessions that are days apart."""
    clock = RemoteClock()
    for number, trip_s in enumerate(trips_s):
        ahead_s = drift_s * number
        trip(clock, 100.0 * number, trip_s / 2, trip_s / 2, ahead_s)
        assert error_s(clock, ahead_s) <= trip_s + 1e-6


@pytest.mark.parametrize(
    ("at_s", "cleared_s", "over"),
    [
        (97.0, 97.5, True),
        (97.0, 99.9, True),
        (97.0, 96.9, False),  # cleared before it was sent
        (97.0, None, False),
        (None, 99.9, False),  # when it was sent is not known: it counts
        (98.1, 99.9, False),  # somebody may still wait for it
    ],
)
def test_a_stop_that_nobody_waits_for_is_over_once_one_was_cleared(
    at_s: float | None, cleared_s: float | None, over: bool
) -> None:
    assert is_over(at_s, 100.0, cleared_s) is over
