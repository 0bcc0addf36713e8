"""The follower's torque guard: it trips, stays free, re-arms, and decides what a stop leaves."""

from typing import Any

import pytest

from litegripd.teleop.follower import PressGuard
from tests.control.states import is_slack
from tests.control.teleop_scene import OBJECT_MM, TRAVEL_MM, Follower, TeleopWorld, following, sweep
from tests.world import PERIOD_S


def pressing(limit_nm: float = 1.0, rate_hz: float = 200.0, **more: Any) -> Follower:
    """Return a follower that has run onto a rigid object."""
    follower = following(torque_limit_nm=limit_nm, **more)
    follower.world.gripper.put_object(width_mm=OBJECT_MM)
    follower.lead(sweep(0.5, 0.3, 0.6), 0.8, rate_hz)
    return follower


@pytest.mark.parametrize("rate_hz", [200.0, 50.0])
def test_it_lets_go_and_goes_on_streaming(rate_hz: float) -> None:
    follower = pressing(rate_hz=rate_hz)
    began_s = follower.world.now_s
    follower.stay(0.3, 0.5)
    status = follower.status()
    assert status["over_torque"]
    assert status["torque_trips"] == 1
    assert status["phase"] == "released"
    assert status["active"]
    assert status["dq_cmd"] == 0.0
    assert is_slack(follower.world)
    assert abs(status["torque_nm"]) < 0.1
    assert follower.world.longest_gap_s(began_s) == pytest.approx(PERIOD_S)
    assert any("let go" in text for text in follower.reported())


def test_it_trips_after_60_ms_and_not_before() -> None:
    follower = following(torque_limit_nm=1.0)
    follower.world.gripper.put_object(width_mm=OBJECT_MM)
    over: list[bool] = []

    def note() -> None:
        feedback = follower.world.measured
        over.append(abs(feedback.torque_nm) >= 1.0)

    began = follower.world.now_s
    while not follower.status()["over_torque"]:
        follower.lead(lambda _t: max(0.3, 0.5 - 0.3 * (follower.world.now_s - began)), PERIOD_S)
        note()
    held = over[::-1].index(False)
    assert (held - 1) * PERIOD_S == pytest.approx(0.06, abs=0.1 * PERIOD_S)


def test_it_stays_free_until_the_leader_has_reopened_and_then_aligns() -> None:
    follower = following(torque_limit_nm=1.0)
    follower.world.gripper.put_object(width_mm=OBJECT_MM)
    began_s, tripped = follower.world.now_s, 1.0
    while not follower.status()["over_torque"]:
        tripped = 0.5 - 0.3 * (follower.world.now_s - began_s)
        follower.stay(tripped, PERIOD_S)
    for openness in (tripped, 0.1, tripped, tripped + 0.049):
        follower.stay(openness, 0.5)
        assert follower.status()["over_torque"]
        assert is_slack(follower.world)
    follower.stay(tripped + 0.051, 0.1)
    assert not follower.status()["over_torque"]
    follower.stay(0.6, 1.0)
    status = follower.status()
    assert (status["phase"], status["torque_trips"]) == ("following", 1)
    assert follower.world.openness == pytest.approx(0.6, abs=0.01)
    follower.lead(sweep(0.6, 0.3, 0.8), 1.2)
    assert follower.status()["torque_trips"] == 2
    assert any("armed again" in text for text in follower.reported())


@pytest.mark.parametrize("openness", [0.96, 0.99, 1.0])
def test_near_full_open_the_open_stop_is_enough(openness: float) -> None:
    guard = PressGuard(1.0)
    now_s = 10.0
    while not guard.is_tripped:
        guard.step(now_s, -1.5, openness)
        now_s += PERIOD_S
    if openness < 1.0:
        for _ in range(100):
            guard.step(now_s, 0.0, openness)
            now_s += PERIOD_S
        assert guard.is_tripped
    for _ in range(50):
        guard.step(now_s, 0.0, 1.0)
        now_s += PERIOD_S
    assert not guard.is_tripped


def test_near_full_open_in_a_scene() -> None:
    follower = following(torque_limit_nm=1.0, opening_mm=0.875 * TRAVEL_MM)
    follower.world.gripper.jam()
    follower.lead(sweep(0.875, 0.97, 0.4), 0.8)
    assert follower.status()["over_torque"]
    follower.world.gripper.free()
    follower.stay(0.97, 0.5)
    assert follower.status()["over_torque"]
    follower.stay(1.0, 1.0)
    assert follower.status()["phase"] == "following"
    assert follower.world.openness == pytest.approx(1.0, abs=0.012)


def test_at_the_open_stop_it_does_not_chatter() -> None:
    guard = PressGuard(1.0)
    changes = [PERIOD_S * tick for tick in range(400) if guard.step(PERIOD_S * tick, 2.0, 1.0)]
    gaps = [changes[n + 1] - changes[n] for n in range(0, len(changes) - 1, 2)]
    assert min(gaps) >= 0.2 - 1e-9


def test_without_a_limit_it_presses_on() -> None:
    follower = pressing(limit_nm=0.0)
    follower.stay(0.3, 0.5)
    status = follower.status()
    assert (status["over_torque"], status["torque_trips"]) == (False, 0)
    assert status["torque_nm"] == pytest.approx(follower.world.controller.config.stop_nm, abs=0.1)


def test_a_short_thump_does_not_trip() -> None:
    guard = PressGuard(1.0)
    now_s = 0.0
    for _ in range(50):
        for torque_nm in [1.5] * 11 + [0.9]:
            assert not guard.step(now_s, torque_nm, 0.5)
            now_s += PERIOD_S


def test_it_looks_at_either_direction() -> None:
    for sign in (1.0, -1.0):
        guard = PressGuard(0.5)
        assert any(guard.step(PERIOD_S * tick, sign * 0.5, 0.5) for tick in range(20))


def stop_by(world: TeleopWorld, follower: Follower, how: str) -> dict[str, Any] | None:
    client = follower.client
    if how == "teleop.stop":
        return client.result("teleop.stop")
    if how == "stop":
        client.result("stop")
    elif how == "cancel":
        job = world.running
        client.result("job.cancel", job=job.number)
    else:
        client.leave()
    return None


STOPS = ("teleop.stop", "stop", "cancel", "leave")


@pytest.mark.parametrize("how", STOPS)
def test_what_was_let_go_stays_free_after_a_stop(how: str) -> None:
    follower = pressing()
    follower.stay(0.3, 0.3)
    assert follower.status()["over_torque"]
    stop_by(follower.world, follower, how)
    follower.world.run(0.5)
    assert follower.world.controller.jobs.running is None
    assert is_slack(follower.world)
    assert follower.world.state.mode == "relaxed"


@pytest.mark.parametrize("how", STOPS)
def test_a_stop_without_a_trip_leaves_it_holding(how: str) -> None:
    follower = following()
    follower.lead(sweep(0.5, 0.8, 0.5), 0.8)
    before_mm = follower.world.gripper.opening_mm
    status = stop_by(follower.world, follower, how)
    if status is not None:
        assert not status["active"]
        assert status["fault"] == ""
    follower.world.run(0.5)
    assert follower.world.state.mode == "holding"
    assert follower.world.gripper.opening_mm == pytest.approx(before_mm, abs=0.3)
    assert follower.command().kp_nm_rad == pytest.approx(100.0, abs=0.2)
    assert follower.world.wire.is_closed


@pytest.mark.parametrize("how", STOPS)
def test_jaws_on_their_way_stop_where_they_are(how: str) -> None:
    follower = following()
    follower.lead(lambda t: 0.5 + 0.8 * t, 0.3)  # 96 mm/s
    before_mm = follower.world.gripper.opening_mm
    stop_by(follower.world, follower, how)
    follower.world.run(0.5)
    assert follower.world.state.mode == "holding"
    assert abs(follower.world.gripper.opening_mm - before_mm) < 1.5


def test_a_stop_holds_at_the_present_angle_but_a_loss_keeps_the_force() -> None:
    for how, share in (("teleop.stop", 0.3), ("leave", 1.0)):
        follower = pressing(limit_nm=0.0, force_limit_n=20.0)
        follower.stay(0.3, 0.5)
        before_nm = follower.world.state.torque_nm or 0.0
        assert before_nm > 1.5
        stop_by(follower.world, follower, how)
        follower.world.run(0.5)
        after_nm = follower.world.state.torque_nm or 0.0
        assert after_nm == pytest.approx(share * before_nm, abs=0.1 * before_nm)


def test_a_leader_beyond_its_stop_has_not_reopened() -> None:
    """Frames of other stacks are not clamped; what is followed is, and it presses as before."""
    follower = following(torque_limit_nm=1.0)
    follower.world.gripper.put_object(width_mm=OBJECT_MM)
    follower.stay(-0.20, 1.6)
    assert follower.status()["over_torque"]
    follower.stay(-0.03, 1.0)
    status = follower.status()
    assert (status["over_torque"], status["torque_trips"]) == (True, 1)
