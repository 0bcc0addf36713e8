"""The coil's estimate and the torque that its heat allows, against the simulated motor's heat."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from litegripd.control.heat import Course, HeatChange, HeatGuard, HeatModel
from litegripd.model.gripper import DM4310
from litegripd.model.motor import Feedback
from litegripd.sim.motor import Thermal
from litegripd.sim.plant import SimulatorParameters

STEP_S = 0.1
NOMINAL = (1.0, 1.0, 1.0)
OTHERS = [  # the resistances of winding and housing and the winding's time, as nominal is 1
    (1.4, 1.4, 1.0),
    (0.6, 0.6, 1.0),
    (1.4, 0.6, 1.0),
    (0.6, 1.4, 1.0),
    (1.4, 1.4, 1.4),
    (1.4, 1.4, 0.6),
]
COIL_LIMIT_C, LEAST_NM = DM4310.coil_limit_c, DM4310.least_useful_nm
ROOMS_C = [25.0, 40.0, 60.0]


def test_how_long_a_coil_that_has_cooled_is_still_limited() -> None:
    bench = Bench(40.0)
    bench.run(600.0, 3.0, guarded=False)
    assert bench.guard.allowance_nm < math.inf
    assert bench.guard.lasts_s(bench.now_s) is None, "it is hot, and its use decides"
    while (told_s := bench.guard.lasts_s(bench.now_s)) is None:
        bench.run(1.0, 0.0)
    began_s = bench.now_s
    while bench.guard.allowance_nm < math.inf:
        bench.run(1.0, 0.0)
    assert bench.now_s - began_s == pytest.approx(told_s, abs=3.0)
    assert told_s > 20.0
    assert bench.guard.lasts_s(bench.now_s) is None


def measured(now_s: float, torque_nm: float, coil_c: float) -> Feedback:
    """A frame as the firmware sends it: whole degrees, truncated."""
    return Feedback(1, 0.0, 0.0, torque_nm, 30, min(max(int(coil_c), 0), 255), now_s)


class Bench:
    """A motor that applies what is asked for as far as the guard allows it, and gets warm."""

    def __init__(
        self,
        room_c: float,
        motor: tuple[float, float, float] = NOMINAL,
        read: Callable[[int, float], float] = lambda _, coil_c: coil_c,
    ) -> None:
        parameters = SimulatorParameters(
            ambient_c=room_c,
            winding_k_w=2.8 * motor[0],
            housing_k_w=1.5 * motor[1],
            winding_time_s=60.0 * motor[2],
        )
        self.thermal = Thermal(parameters, STEP_S)
        self.guard = HeatGuard()
        self.step = 0
        self.peak_c = -math.inf
        self.errors_k: list[float] = []
        self.changes: list[tuple[float, HeatChange]] = []
        self._read = read

    @property
    def now_s(self) -> float:
        return self.step * STEP_S

    @property
    def coil_c(self) -> float:
        return self.thermal.coil_c

    def run(self, duration_s: float, asked_nm: float, *, guarded: bool = True) -> None:
        for _ in range(round(duration_s / STEP_S)):
            self.step += 1
            torque_nm = min(asked_nm, self.guard.allowance_nm) if guarded else asked_nm
            self.thermal.step(torque_nm**2)
            self.peak_c = max(self.peak_c, self.coil_c)
            feedback = measured(self.now_s, torque_nm, self._read(self.step, self.coil_c))
            change = self.guard.update(self.now_s, feedback, asked_nm)
            if change is not None:
                self.changes.append((self.now_s, change))
            if self.guard.model.coil_c is not None:
                self.errors_k.append(self.guard.model.coil_c - self.coil_c)

    def most_changes_a_minute(self, from_s: float = 0.0) -> int:
        times_s = [at_s for at_s, _ in self.changes if at_s >= from_s]
        return max((sum(0 <= b - a < 60 for b in times_s) for a in times_s), default=0)


# The guard: how warm the coil gets --------------------------------------------------------------


@pytest.mark.parametrize("room_c", ROOMS_C)
@pytest.mark.parametrize("torque_nm", [1.0, 2.0, 3.0])
def test_the_nominal_coil_stays_at_its_limit_and_the_estimate_within_half_a_degree(
    room_c: float, torque_nm: float
) -> None:
    bench = Bench(room_c)
    bench.run(800, torque_nm)
    assert bench.peak_c <= COIL_LIMIT_C + 0.3
    assert max(map(abs, bench.errors_k)) <= 0.55
    # Nothing is limited that would have stayed cool: 1.43 W for (1 N·m)², 4.3 K/W in all.
    if room_c + 4.3 * 1.43 * torque_nm**2 < COIL_LIMIT_C:
        assert not bench.changes


@pytest.mark.parametrize("motor", OTHERS)
@pytest.mark.parametrize(("room_c", "torque_nm"), [(25.0, 3.0), (40.0, 3.0), (60.0, 2.0), (60, 3)])
def test_another_coil_stays_near_its_limit_and_the_estimate_near_the_coil(
    motor: tuple[float, float, float], room_c: float, torque_nm: float
) -> None:
    bench = Bench(room_c, motor)
    bench.run(600, torque_nm)
    assert bench.peak_c <= COIL_LIMIT_C + 1.5
    assert max(map(abs, bench.errors_k)) <= 1.6
    assert bench.most_changes_a_minute(from_s=150) <= 2


def test_even_a_motor_out_of_all_bounds_does_not_lead_the_estimate_astray() -> None:
    bench = Bench(40.0, (3.0, 3.0, 0.5))  # it warms by 3.6 K in a second
    bench.run(600, 3.0)
    assert max(map(abs, bench.errors_k)) <= 3.6
    assert bench.peak_c <= COIL_LIMIT_C + 3.0


def test_without_the_guard_the_coil_would_have_tripped() -> None:
    """So that the tests above show the guard's work, not the scene's."""
    bench = Bench(60.0)
    bench.run(600, 3.0, guarded=False)
    assert bench.peak_c > 100.0


def test_noisy_readings_are_no_reason_for_more_changes() -> None:
    noise_k = (0.0, 1.0, -1.0, 0.0, -1.0, 1.0, 1.0, 0.0, -1.0, 0.0, 0.0)
    bench = Bench(40.0, read=lambda step, coil_c: coil_c + noise_k[step * 7 % len(noise_k)])
    bench.run(1500, 3.0)
    assert bench.peak_c <= COIL_LIMIT_C + 1.5
    assert 1 <= len(bench.changes) <= 4


# The guard: how it changes the allowance --------------------------------------------------------


def test_each_step_is_a_tenth_of_what_is_applied_and_is_announced() -> None:
    bench = Bench(60.0)
    bench.run(300, 3.0)
    assert len(bench.changes) >= 3
    allowed_nm, at_s = math.inf, -math.inf
    for changed_s, change in bench.changes:
        applied_nm = min(3.0, allowed_nm)
        assert change.from_nm == allowed_nm
        assert change.to_nm == pytest.approx(0.9 * applied_nm)
        assert change.coil_c < COIL_LIMIT_C + 0.3
        assert f"{change.coil_c:.1f} °C" in change.why
        assert f"{change.to_nm:.2f} N·m allowed" in change.why
        assert changed_s - at_s >= 2.0 - 1e-9
        allowed_nm, at_s = change.to_nm, changed_s
    assert bench.guard.allowance_nm == allowed_nm


def test_a_coil_already_too_hot_is_relieved_step_by_step_down_to_the_least() -> None:
    bench = Bench(86.0)
    bench.run(60, 0.2)
    assert not bench.changes  # so little torque is not what heats it
    bench.run(200, 3.0)
    first = bench.changes[0][1]
    assert first.to_nm == pytest.approx(2.7)  # of the whole torque, though it had only begun
    steps_s = [b - a for (a, _), (b, _) in pairwise(bench.changes)]
    assert steps_s[0] == pytest.approx(2.0, abs=0.51)  # sooner, as it still rises
    assert all(2.0 - 1e-9 <= step_s <= 4.5 for step_s in steps_s)
    assert bench.guard.allowance_nm == LEAST_NM


def test_a_coil_beyond_its_limit_that_cools_by_itself_is_left_alone() -> None:
    thermal, guard = Thermal(SimulatorParameters(ambient_c=60.0), STEP_S), HeatGuard()
    for step in range(2500):
        now_s = step * STEP_S
        torque_nm = 3.0 if now_s < 75.0 else 1.0
        thermal.step(torque_nm**2)
        feedback = measured(now_s, torque_nm, thermal.coil_c)
        if now_s < 80.0:
            guard.model.update(now_s, feedback)
        elif now_s == 80.0:
            assert thermal.coil_c > COIL_LIMIT_C + 3.0
        else:
            assert guard.update(now_s, feedback, torque_nm) is None
    assert thermal.coil_c < COIL_LIMIT_C - 5.0


def test_nobody_asks_any_more_so_nothing_stays_limited() -> None:
    bench = Bench(40.0)
    bench.run(900, 3.0)
    assert bench.guard.allowance_nm < 3.0
    lowered = len(bench.changes)
    bench.run(60, 0.2)
    assert bench.guard.allowance_nm == math.inf
    assert bench.changes[-1][1].to_nm == math.inf
    assert all(c.coil_c < 75.0 and c.to_nm > c.from_nm for _, c in bench.changes[lowered:])
    bench.run(200, 0.2)
    bench.run(300, 3.0)
    assert bench.peak_c <= COIL_LIMIT_C + 0.3


def test_a_hold_gets_its_torque_back_step_by_step_when_the_room_cools() -> None:
    bench = Bench(60.0)
    bench.run(600, 3.0)
    allowed_nm, lowered = bench.guard.allowance_nm, len(bench.changes)
    assert allowed_nm < 2.2
    bench.thermal._ambient_c = 22.0
    bench.run(2400, 3.0)
    at_s = bench.changes[lowered - 1][0]
    assert len(bench.changes) >= lowered + 3
    for changed_s, change in bench.changes[lowered:]:
        assert change.from_nm == allowed_nm
        assert changed_s - at_s >= 20.0 - 1e-9
        assert change.to_nm == math.inf or change.to_nm == pytest.approx(allowed_nm / 0.9)
        assert "cooled" in change.why
        allowed_nm, at_s = change.to_nm, changed_s
    assert bench.guard.allowance_nm == math.inf
    assert bench.peak_c <= COIL_LIMIT_C + 0.3


@pytest.mark.parametrize("bound_is_limited", [True, False])
def test_the_bound_may_be_that_before_or_after_it_was_limited(bound_is_limited: bool) -> None:
    """A bound equal to the allowance must not pass for a command that asks for less.

    3.5 N·m come down to 2.84 N·m, which keep the coil below 75 °C, but one step more would not.
    """
    thermal, guard, changes = Thermal(SimulatorParameters(ambient_c=25.0), STEP_S), HeatGuard(), 0
    for step in range(10000):
        torque_nm = min(3.5, guard.allowance_nm)
        thermal.step(torque_nm**2)
        feedback = measured(step * STEP_S, torque_nm, thermal.coil_c)
        asked_nm = torque_nm if bound_is_limited else 3.5
        changes += guard.update(step * STEP_S, feedback, asked_nm) is not None
    assert guard.allowance_nm == pytest.approx(3.5 * 0.9**2, rel=0.01)
    assert thermal.coil_c < 75.0
    assert changes == 2


def test_once_cool_the_torque_is_back_soon_even_after_many_raises_that_did_not_last() -> None:
    bench = Bench(40.0, (1.4, 1.4, 0.6))
    bench.run(2800, 3.0)
    assert bench.guard.allowance_nm < 2.5
    bench.run(180, 0.1)
    assert bench.guard.allowance_nm == math.inf


def test_a_raise_that_does_not_last_makes_the_next_one_wait() -> None:
    """This motor differs so much that the model is wrong about every raise."""
    bench = Bench(40.0, (1.4, 1.4, 0.6))
    bench.run(4000, 3.0)
    raises_s = [at_s for at_s, change in bench.changes if change.to_nm > change.from_nm]
    waits_s = [b - a for a, b in pairwise(raises_s)]
    assert len(waits_s) >= 5
    assert waits_s[-1] > 2 * waits_s[0]
    assert bench.most_changes_a_minute(from_s=60) <= 2
    assert bench.peak_c <= COIL_LIMIT_C + 1.5


# The time to the limit --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("motor", "room_c", "torque_nm", "known_after_s"),
    [
        (NOMINAL, 25.0, 3.0, 60),  # ends at 80.26 °C, after 54 minutes: nothing is harder
        (NOMINAL, 25.0, 3.2, 5),
        (NOMINAL, 25.0, 3.5, 5),
        (NOMINAL, 40.0, 3.0, 5),
        (NOMINAL, 60.0, 3.0, 5),
        ((1.4, 1.4, 1.0), 25.0, 3.0, 20),
        ((1.4, 1.4, 1.0), 40.0, 2.5, 20),
        ((0.6, 0.6, 1.0), 60.0, 3.0, 20),
    ],
)
def test_the_time_to_the_limit_is_foretold_within_a_quarter(
    motor: tuple[float, float, float], room_c: float, torque_nm: float, known_after_s: float
) -> None:
    bench = Bench(room_c, motor)
    bench.run(known_after_s, torque_nm, guarded=False)
    foretold: list[tuple[float, float | None]] = []
    while bench.coil_c < COIL_LIMIT_C:
        foretold.append((bench.now_s, bench.guard.model.time_to_limit_s()))
        bench.run(5, torque_nm, guarded=False)
        assert bench.now_s < 4000
    for at_s, left_s in foretold:
        assert left_s == pytest.approx(bench.now_s - at_s, rel=0.25, abs=6.0)


def test_there_is_no_time_to_the_limit_below_an_hour_or_without_a_reading() -> None:
    bench = Bench(25.0)
    assert bench.guard.model.coil_c is None
    assert bench.guard.model.time_to_limit_s() is None
    bench.run(600, 2.0)
    assert bench.guard.model.time_to_limit_s() is None


def test_the_time_to_the_limit_is_zero_beyond_it() -> None:
    bench = Bench(81.0)
    bench.run(5, 0.0)
    assert bench.guard.model.time_to_limit_s() == 0.0


kelvins = st.floats(-60.0, 60.0)


@example(60.0, -30.0, 40.0, 3600.0)  # passes on the way, and ends below
@given(st.floats(0.0, 120.0), kelvins, kelvins, st.floats(1.0, 3600.0))
def test_the_first_passing_is_found_wherever_a_search_finds_it(
    end_c: float, winding_k: float, housing_k: float, within_s: float
) -> None:
    course = Course(end_c, winding_k, housing_k)
    found_s = course.passes_s(COIL_LIMIT_C, within_s)
    times_s = [within_s * i / 200 for i in range(201)]
    searched_s = next((t for t in times_s if course.at(t) >= COIL_LIMIT_C), None)
    if searched_s is not None:
        assert found_s is not None
        assert searched_s - within_s / 200 - 0.01 <= found_s <= searched_s + 0.01
    elif found_s is not None:  # a passing too short for the search
        assert course.at(found_s) >= COIL_LIMIT_C - 1e-6


# What a bus may bring ---------------------------------------------------------------------------


def test_frames_with_senseless_readings_are_ignored() -> None:
    wrong_c = {3: 0.0, 5: 200.0, 8: 200.0, 9: 0.0}
    spoiled = Bench(25.0, read=lambda n, coil_c: wrong_c.get(n % 11, coil_c) if n > 20 else coil_c)
    clean = Bench(25.0)
    for bench in (spoiled, clean):
        bench.run(600, 2.8)
    assert not spoiled.changes
    assert spoiled.guard.model.coil_c == pytest.approx(clean.guard.model.coil_c, abs=0.3)


@pytest.mark.parametrize("reading_c", [0, 200])
def test_a_jump_that_persists_is_believed_after_a_second_and_starts_no_cascade(
    reading_c: int,
) -> None:
    bench = Bench(25.0, read=lambda step, c: reading_c if step > 300 else c)
    bench.run(30.9, 1.0)
    assert bench.guard.model.coil_c == pytest.approx(bench.coil_c, abs=0.6)
    assert not bench.changes
    bench.run(1, 1.0)
    assert bench.guard.model.coil_c == pytest.approx(reading_c + 0.5, abs=0.1)
    bench.run(9, 1.0)
    assert len(bench.changes) <= 5
    assert bench.guard.allowance_nm >= 0.9**5


def test_one_frame_seen_many_times_is_no_persistence() -> None:
    model = HeatModel()
    for tick in range(400):
        model.update(tick * 0.005, measured(tick * 0.005, 0.0, 30))
    jump = measured(2.0, 0.0, 200)
    for tick in range(400, 1000):
        model.update(tick * 0.005, jump)
    assert model.coil_c == pytest.approx(30.5)


def test_two_frames_far_apart_are_no_persistence() -> None:
    model = HeatModel()
    for tick in range(400):
        model.update(tick * 0.005, measured(tick * 0.005, 0.0, 30))
    for now_s in (2.0, 7.0):
        model.update(now_s, measured(now_s, 0.0, 200))
    assert model.coil_c == pytest.approx(30.5)


def test_a_stale_measurement_changes_nothing() -> None:
    bench = Bench(60.0)
    bench.run(36, 3.0)
    guard, last = bench.guard, measured(bench.now_s, 3.0, bench.coil_c)
    coil_c, allowed_nm = guard.model.coil_c, guard.allowance_nm
    for second in range(1, 600):
        assert guard.update(bench.now_s + second, last, 3.0) is None
    assert (guard.model.coil_c, guard.allowance_nm) == (coil_c, allowed_nm)


def test_after_a_long_gap_the_motor_counts_as_unpowered() -> None:
    bench = Bench(40.0)
    bench.run(200, 3.0)
    model = bench.guard.model
    assert model.coil_c is not None
    before_c, later_s = model.coil_c, bench.now_s + 300.0
    for _ in range(round(300 / STEP_S)):
        bench.thermal.step(0.0)
    model.update(later_s, measured(later_s, 3.0, bench.coil_c))
    assert bench.coil_c < before_c - 20.0
    assert model.coil_c == pytest.approx(bench.coil_c, abs=0.6)


def test_calls_at_the_same_time_or_an_earlier_one_change_nothing() -> None:
    bench = Bench(60.0)
    bench.run(36, 3.0)
    model, now_s = bench.guard.model, bench.now_s
    coil_c, left_s = model.coil_c, model.time_to_limit_s()
    for earlier_s in (0.0, 0.0, 0.4, 0.8, 1.2):
        feedback = measured(now_s, 3.0, bench.coil_c)
        assert bench.guard.update(now_s - earlier_s, feedback, 3.0) is None
    assert (model.coil_c, model.time_to_limit_s()) == (coil_c, left_s)


spells = st.tuples(
    st.integers(1, 60),  # frames
    st.sampled_from([0.0, 0.005, 0.05, 0.3, 0.5, 2.0, 700.0]),  # apart in s
    st.just(0.0) | st.floats(-10.0, 10.0) | st.floats(allow_nan=False, allow_infinity=False),
    st.integers(0, 255) | st.integers(70, 90),
    st.floats(0.0, 10.0) | st.just(math.inf),
    st.sampled_from([0.0, 0.0, 0.3, 5.0]),  # age in s
)


@settings(deadline=None)
@given(st.lists(spells, min_size=1, max_size=12))
def test_whatever_is_measured_the_allowance_is_sound_and_changes_only_with_a_word(
    course: list[tuple[int, float, float, int, float, float]],
) -> None:
    guard, now_s, allowed_nm = HeatGuard(), 0.0, math.inf
    for frames, apart_s, torque_nm, reading_c, bound_nm, age_s in course:
        for _ in range(frames):
            now_s += apart_s
            feedback = measured(now_s - age_s, torque_nm, reading_c)
            change = guard.update(now_s, feedback, bound_nm)
            if change is not None:
                assert change.from_nm == allowed_nm != change.to_nm
                allowed_nm = change.to_nm
            assert guard.allowance_nm == allowed_nm >= LEAST_NM
            left_s = guard.model.time_to_limit_s()
            assert left_s is None or 0.0 <= left_s <= 3600.0
    coil_c = guard.model.coil_c
    assert coil_c is None or math.isfinite(coil_c)
