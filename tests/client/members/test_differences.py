"""Calls of the client that mean something else than in the SDK."""

import re
from collections.abc import Callable

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    HardwareError,
    LiteGrip,
    MotionConfig,
)
from tests.drop_in import Daemon, Site
from tests.sdk.readme.scenes import tuned
from tests.sdk.readme.trajectories import swing


@pytest.fixture
def mount() -> str:
    """Return one mount: nothing here depends on the direction."""
    return "normal"


@pytest.fixture
def held(daemon: Daemon, gripper: LiteGrip) -> LiteGrip:
    """Return a gripper that holds 30 mm with 10 N."""
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(10.0, until="verdict")
    return gripper


# At rest


def test_what_a_motor_latches_at_rest_is_no_error_and_enabling_clears_it(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.disable()
    daemon.gripper.latch_fault(0xD)
    site.run(0.5)
    state = gripper.get_state()
    assert (state.motor, state.error_code, state.is_error) == ("disabled", 0xD, False)
    assert gripper.enable()
    assert (gripper.get_state().error_code, gripper.get_state().is_error) == (1, False)
    daemon.gripper.latch_fault(0xD)
    site.run(0.5)
    assert gripper.get_state().is_error


# Sharing


def test_one_program_moves_at_a_time_and_the_others_learn_who(
    site: Site, gripper: LiteGrip
) -> None:
    params = {"opening_mm": 5.0, "speed_mm_s": 20.0, "wait": False}
    gripper._session.connection.call("motion.move", params)
    site.run(0.1)
    with LiteGrip("can0") as other:
        assert other.get_state().mode == "moving"
        with pytest.raises(BusyError) as caught:
            other.open()
        assert re.search(r"\(pid \d+, this very program\) has the gripper", str(caught.value))


def test_a_field_that_was_not_set_is_the_daemons(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.client().result("config.set", config={"speed_mm_s": 25.0})
    began_s = site.now_s
    assert gripper.goto(35.0, duration=None)
    assert site.now_s - began_s > 0.95
    assert gripper.motion_config.speed_mm_s == 50.0
    gripper.motion_config.speed_mm_s = 50.0
    began_s = site.now_s
    assert gripper.goto(60.0, duration=None)
    assert site.now_s - began_s < 0.9


# Grasping


def test_a_grasp_on_nothing_returns_at_once_also_with_hold_s_0(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    began_s = site.now_s
    result = gripper.grasp(10.0, hold_s=0.0)
    assert (result.ok, result.outcome) == (False, "no_object")
    assert site.now_s - began_s < 3.0
    site.run(1.0)
    assert abs(daemon.closing_torque_nm) < 0.3


def test_the_verdict_ends_the_call_and_the_daemon_keeps_holding_until_it_is_told_otherwise(
    site: Site, daemon: Daemon, held: LiteGrip
) -> None:
    site.run(3.0)
    state = held.get_state()
    assert state.is_grasped
    assert daemon.closing_torque_nm == pytest.approx(1.0, abs=0.1)
    low_n, high_n = state.clamp_n or (0.0, 0.0)
    assert 0.0 < low_n <= high_n
    assert state.loss_detection is not None
    result = held.grasp(15.0, until="verdict")
    assert (result.outcome, result.state.is_grasped) == ("object_held", True)
    assert result.width_mm == pytest.approx(30.0, abs=1.0)
    assert result.held_s >= 0.0
    site.run(1.0)
    assert daemon.closing_torque_nm == pytest.approx(1.5, abs=0.1)
    assert held.open()
    assert not held.is_grasped()


@pytest.mark.parametrize(
    ("margin", "outcome", "most_nm"), [(None, "no_object", 0.6), (0.02, "object_held", 1.3)]
)
def test_an_object_within_the_margin_is_not_reached_unless_that_is_smaller(
    site: Site,
    daemon: Daemon,
    gripper: LiteGrip,
    margin: float | None,
    outcome: str,
    most_nm: float,
) -> None:
    daemon.gripper.put_object(width_mm=4.0)
    gripper.motion_config = MotionConfig() if margin is None else MotionConfig(margin=margin)
    with site.recorded(daemon) as moments:
        result = gripper.grasp(10.0, hold_s=1.0)
    assert result.outcome == outcome
    assert max(moment.closing_torque_nm for moment in moments) < most_nm


# Moving


def test_frames_press_with_one_newton_metre_at_most(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    closed_rad = gripper.config.pos_closed_rad
    assert closed_rad is not None
    daemon.gripper.put_object(width_mm=50.0)
    with site.recorded(daemon) as moments:
        for _ in range(100):
            gripper.send_mit_frame(closed_rad, 500.0, 5.0)
            site.run(0.01)
    standing = [moment.closing_torque_nm for moment in moments[120:]]
    assert 0.5 < max(standing) < 1.1


def test_a_frame_that_is_rejected_later_lets_a_later_call_raise(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    where_rad = daemon.gripper.position_rad
    assert gripper.send_mit_frame(where_rad, 50.0, 1.0) is True

    def beyond() -> None:
        for _ in range(3):
            gripper.send_mit_frame(5.0, 50.0, 1.0)
            site.run(0.01)

    with pytest.raises(CommandError):
        beyond()


# Trajectories


def test_the_error_of_a_replay_is_none_after_a_stop_and_a_sentence_otherwise(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.goto_openness(0.5)
    gripper.play_start(swing(), loop=True)
    site.run(0.3)
    assert gripper.play_stop()["error"] is None
    gripper.play_start(swing(), loop=True)
    site.run(0.3)
    daemon.gripper.latch_fault(0xE)
    site.run(0.2)
    assert len(gripper.trajectory_status()["error"].split()) > 3


# Reading


def test_reading_waits_for_nothing_and_says_how_old_it_is(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    state = gripper.get_state()
    assert state.stale is False
    assert state.age_s is not None
    assert state.age_s <= 0.006
    daemon.lose_from_motor = lambda _frame: True
    site.run(0.5)
    began_s = site.now_s
    state = gripper.get_state(wait=True)
    assert site.now_s - began_s <= 0.01
    assert state.stale is True
    assert state.age_s is not None
    assert state.age_s > 0.4
    daemon.lose_from_motor = lambda _frame: False
    site.run(0.1)


# Calibration


def test_a_calibration_is_for_all_and_is_not_changed_while_anything_moves(
    site: Site, daemon: Daemon
) -> None:
    with LiteGrip("can0") as gripper, LiteGrip("can0") as other:
        other.load_template("reverse")
        assert gripper.mount == "reverse"
        other.load_template("normal")
        assert gripper.enable()
        with pytest.raises(BusyError) as caught:
            other.load_template("reverse")
        assert caught.value.reason == "lease_held"
        params = {"opening_mm": 5.0, "speed_mm_s": 20.0, "wait": False}
        gripper._session.connection.call("motion.move", params)
        site.run(0.1)
        with pytest.raises(BusyError) as caught:
            gripper.load_template("reverse")
        assert caught.value.reason == "busy"
        assert gripper.mount == "normal"


def hold_without_damping(gripper: LiteGrip) -> None:
    gripper.motion_config = tuned(hold_kp=100.0, hold_kd=0.1)
    gripper.grasp(10.0, hold_by="gains")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda g: g.play(swing(), kp=100.0, kd=0.1),
        lambda g: g.teleop_start("slave", fake_leader=True, kp=100.0, kd=0.1),
        hold_without_damping,
    ],
)
def test_gains_that_damp_too_little_are_rejected(
    daemon: Daemon, gripper: LiteGrip, wrong: Callable[[LiteGrip], object]
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    with pytest.raises(CommandError, match="damp"):
        wrong(gripper)


def test_a_motor_that_stays_silent_names_the_fault(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.gripper.set_supply(40.0)
    site.run(0.2)
    with pytest.raises(HardwareError, match="voltage"):
        gripper.enable()


def test_what_is_beyond_channel_and_id_is_given_by_name() -> None:
    make: type = LiteGrip
    with pytest.raises(TypeError, match="positional"):
        make("can0", 8, 0x18)
