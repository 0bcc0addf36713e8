"""The torque against a leader's hand: bounded, gentle, and passive whatever is felt."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import Geometry
from litegripd.model.motor import Feedback, MitCommand
from litegripd.model.teleop import Arrival
from litegripd.teleop.intake import MOST_FOLLOWERS, ForceIntake
from litegripd.teleop.leader import (
    DEAD_BAND_N,
    GRANT_J,
    MOST_N,
    MOST_STORED_J,
    RAMP_S,
    PushBack,
)
from tests.control.reflection_pair import force_frame
from tests.properties import examples
from tests.world import PERIOD_S

NORMAL, REVERSE = NOMINAL
STEP_NM = PERIOD_S / RAMP_S


class Jaws:
    """Jaws whose place is given, and what pushes against them."""

    def __init__(self, push: PushBack) -> None:
        self.push = push
        self.now_s = 50.0
        self.given_j = 0.0
        self.at_rad = -0.7
        self.command = MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)

    def step(self, felt_n: float, moved_rad: float = 0.0, elapsed_s: float = PERIOD_S) -> float:
        self.now_s += elapsed_s
        self.at_rad += moved_rad
        self.given_j += self.command.torque_nm * moved_rad
        measured = Feedback(1, self.at_rad, 0.0, 0.0, 30, 30, self.now_s)
        self.command = self.push.step(self.now_s, felt_n, measured)
        return self.command.torque_nm


@pytest.mark.parametrize(("geometry", "opens"), [(NORMAL, -1.0), (REVERSE, 1.0)])
def test_a_squeeze_is_felt_as_a_push_that_opens(geometry: Geometry, opens: float) -> None:
    jaws = Jaws(PushBack(5.0, 0.5, geometry))
    torques = [opens * jaws.step(10.0) for _ in range(100)]
    assert torques[0] == 0.0
    assert torques == sorted(torques)
    assert torques[-1] == pytest.approx(0.5 * (10.0 - DEAD_BAND_N) / 10.0, rel=1e-3)
    assert jaws.push.force_n == pytest.approx(4.0, rel=1e-3)
    assert jaws.command.kp_nm_rad == 0.0
    assert jaws.command.kd_nm_s_rad > 0.0
    assert opens * [jaws.step(-10.0) for _ in range(100)][-1] == pytest.approx(-0.4, rel=1e-3)


def test_no_followers_own_friction_is_felt() -> None:
    jaws = Jaws(PushBack(5.0, 1.0, NORMAL))
    assert {jaws.step(DEAD_BAND_N) for _ in range(50)} == {0.0}


def test_it_ends_gently_when_nobody_is_heard_any_more() -> None:
    jaws = Jaws(PushBack(MOST_N, 1.0, NORMAL))
    for _ in range(100):
        jaws.step(1e300)
    assert jaws.push.force_n == pytest.approx(MOST_N)
    ending = [abs(jaws.step(0.0)) for _ in range(100)]
    assert ending == sorted(ending, reverse=True)
    assert ending[2] > 0.5
    assert ending[round(2 * RAMP_S / PERIOD_S)] < 0.05
    assert ending[-1] == 0.0


def test_nobody_asks_for_more_than_a_finger_holds() -> None:
    jaws = Jaws(PushBack(500.0, 1.0, NORMAL))
    assert max(abs(jaws.step(1e308)) for _ in range(200)) <= MOST_N / 10.0 + 1e-12


felt = st.floats(-1e308, 1e308) | st.floats(-60.0, 60.0)
moves = st.floats(-0.02, 0.02) | st.just(0.0)
moments = st.tuples(felt, moves, st.sampled_from([PERIOD_S] * 8 + [0.0, 0.06, 1.0]))


@examples(150)
@given(
    st.sampled_from([NORMAL, REVERSE]),
    st.floats(0.0, 20.0),
    st.floats(0.05, 1.0),
    st.lists(moments, max_size=120),
)
def test_whatever_is_felt_little_is_given_and_no_more_work_than_was_taken(
    geometry: Geometry, most_n: float, gain: float, course: list[tuple[float, float, float]]
) -> None:
    """What is given beyond the grant is what one tick's movement brings before it is seen."""
    jaws = Jaws(PushBack(most_n, gain, geometry))
    most_nm = min(most_n, MOST_N) / 10.0
    since_j = most_j = 0.0
    for felt_n, moved_rad, elapsed_s in course:
        was_nm, was_j = jaws.command.torque_nm, jaws.given_j
        torque_nm = jaws.step(felt_n, moved_rad, elapsed_s)
        assert math.isfinite(torque_nm)
        assert abs(torque_nm) <= most_nm + 1e-9
        grows_nm = max(abs(torque_nm) - abs(was_nm), 0.0)
        assert grows_nm <= 2.0 * most_nm * min(elapsed_s, 0.05) / RAMP_S + 1e-9
        since_j = max(since_j + jaws.given_j - was_j, -MOST_STORED_J)
        most_j = max(most_j, since_j)
        if torque_nm == 0.0:
            since_j = 0.0
    assert most_j <= GRANT_J + MOST_STORED_J + most_nm * 0.02 + 1e-9


def test_who_only_yields_is_given_the_grant_alone() -> None:
    """Jaws that go where they are pushed, and a force that is reported for ever."""
    jaws = Jaws(PushBack(MOST_N, 1.0, NORMAL))
    for _ in range(2000):
        jaws.step(50.0, -0.001)
    assert GRANT_J * 0.5 < jaws.given_j < GRANT_J + 0.001
    assert jaws.command.torque_nm == pytest.approx(0.0, abs=1e-6)


def test_who_presses_on_feels_it_again() -> None:
    jaws = Jaws(PushBack(MOST_N, 1.0, NORMAL))
    for _ in range(500):
        jaws.step(50.0, -0.001)
    for _ in range(60):
        jaws.step(50.0, 0.001)
    assert jaws.push.force_n == pytest.approx(MOST_N)
    assert jaws.given_j < 0.0


# What followers report


def heard(intake: ForceIntake, now_s: float, **frame: float) -> None:
    values = {"force_n": 5.0, "at_s": now_s, "echo_s": now_s - 0.01, **frame}
    payload = force_frame(
        values["force_n"], values["at_s"], values["echo_s"], int(values.get("sender", 7))
    )
    intake.take(Arrival(payload, now_s), now_s)


def test_the_hardest_of_several_followers_is_felt_while_it_is_heard() -> None:
    intake = ForceIntake()
    heard(intake, 100.0, sender=1, force_n=5.0)
    heard(intake, 100.05, sender=2, force_n=-9.0)
    assert (intake.followers(100.05), intake.force_n(100.05)) == (2, -9.0)
    assert intake.round_trip_s == pytest.approx(0.01)
    heard(intake, 100.2, sender=1, force_n=6.0)
    assert (intake.followers(100.26), intake.force_n(100.26)) == (1, 6.0)
    assert (intake.followers(100.5), intake.force_n(100.5)) == (0, 0.0)


@pytest.mark.parametrize("echo_s", [99.0, 99.79, 100.01, -1e300, 1e300, 0.0])
def test_what_answers_no_recent_position_is_not_felt(echo_s: float) -> None:
    intake = ForceIntake()
    heard(intake, 100.0, echo_s=echo_s)
    assert (intake.force_n(100.0), intake.late) == (0.0, 1)


def test_frames_that_were_overtaken_are_not_felt() -> None:
    intake = ForceIntake()
    heard(intake, 100.0, at_s=5.0, force_n=1.0)
    heard(intake, 100.005, at_s=4.9, force_n=8.0)
    heard(intake, 100.01, at_s=5.0, force_n=9.0)
    assert (intake.force_n(100.01), intake.out_of_order) == (1.0, 2)
    heard(intake, 101.0, at_s=2.0, force_n=3.0)  # after a silence its clock may be another one
    assert (intake.force_n(101.0), intake.out_of_order) == (3.0, 2)


def test_a_crowd_takes_no_memory() -> None:
    intake = ForceIntake()
    for sender in range(1000):
        heard(intake, 100.0, sender=sender)
    assert intake.followers(100.0) == MOST_FOLLOWERS
    assert intake.late == 1000 - MOST_FOLLOWERS


def test_what_is_no_frame_is_counted() -> None:
    intake = ForceIntake()
    for payload in (b"", bytes(32), bytes(40), force_frame(math.nan, 1.0, 1.0)):
        intake.take(Arrival(payload, 100.0), 100.0)
    assert (intake.rejected, intake.followers(100.0)) == (4, 0)
