"""A leader that falls silent, comes back, is overtaken by its own frames, or is not alone."""

from itertools import pairwise

import pytest

from litegripd.model.gripper import FASTEST_RAD_S
from litegripd.model.teleop import LinkStatus, Reach
from litegripd.teleop.link import TeleopAction
from tests.app.test_facts import verdict
from tests.control.teleop_scene import (
    CODE_RAD,
    MAX_LEAD_RAD,
    MM_RAD,
    OBJECT_MM,
    TRAVEL_MM,
    Follower,
    TeleopWorld,
    following,
    packed,
    sweep,
)
from tests.world import PERIOD_S


def dq(follower: Follower) -> float:
    return float(follower.status()["dq_cmd"])


def test_without_frames_it_holds_its_last_target_under_its_gains() -> None:
    follower = following(force_limit_n=20.0)
    follower.world.gripper.put_object(width_mm=OBJECT_MM)
    follower.lead(sweep(0.5, 0.4, 0.4), 0.5)
    pressing_nm = follower.status()["torque_nm"]
    target_rad = follower.command().position_rad
    assert pressing_nm > 1.0
    follower.world.run(0.19)
    assert not follower.status()["stale"]
    follower.world.run(0.02)
    status = follower.status()
    assert status["stale"]
    assert status["phase"] == "stale"
    assert status["active"]
    follower.world.run(2.0)
    assert follower.status()["torque_nm"] == pytest.approx(pressing_nm, abs=0.1)
    assert follower.command().position_rad == pytest.approx(target_rad, abs=CODE_RAD)
    assert follower.command().velocity_rad_s == pytest.approx(0.0, abs=0.01)
    assert follower.status()["last_frame_age_ms"] == pytest.approx(2210.0, abs=15.0)
    assert any("no frame for 0.2 s" in text for text in follower.reported())


@pytest.mark.parametrize("watchdog_s", [0.05, 0.2, 1.0])
def test_how_long_it_waits_is_counted_by_its_own_clock(watchdog_s: float) -> None:
    follower = following(watchdog_s=watchdog_s)
    follower.put(packed(0.5, 1e9))  # a sender whose clock is of another world
    follower.world.tick()
    waited_s = PERIOD_S
    while not follower.status()["stale"]:
        follower.world.tick()
        waited_s += PERIOD_S
        assert waited_s < 2.0
    assert waited_s == pytest.approx(watchdog_s, abs=1.5 * PERIOD_S)


def test_after_a_silence_it_aligns_anew_without_a_step() -> None:
    follower = following()
    follower.world.run(1.0)
    began_s, began_mm = follower.world.now_s, follower.world.gripper.opening_mm
    follower.stay(0.9, 0.5)
    assert follower.status()["phase"] == "aligning"
    assert follower.world.gripper.opening_mm - began_mm == pytest.approx(25.0, abs=3.0)
    follower.stay(0.9, 1.0)
    assert follower.status()["phase"] == "following"
    assert follower.world.openness == pytest.approx(0.9, abs=0.005)
    commands = [c.position_rad for _, c in follower.world.commands_since(began_s)]
    assert max(abs(b - a) for a, b in pairwise(commands)) < 50.0 / MM_RAD * PERIOD_S + 2 * CODE_RAD


def test_a_cable_that_is_cut_for_ten_seconds_is_no_step_though_the_leader_went_elsewhere() -> None:
    follower = following()
    follower.lead(sweep(0.5, 0.9, 0.8), 0.8)
    follower.world.run(0.5)
    held_mm = follower.world.gripper.opening_mm
    follower.world.run(9.5)
    assert follower.world.gripper.opening_mm == pytest.approx(held_mm, abs=0.01)
    assert follower.status()["phase"] == "stale"
    gripper = follower.world.gripper
    seen = follower.lead(
        lambda _t: 0.2, 2.5, each=lambda: (follower.lead_rad, abs(gripper.velocity_rad_s) * MM_RAD)
    )
    leads, speeds_mm_s = zip(*seen, strict=True)
    assert max(leads) < 0.04
    assert max(speeds_mm_s) < 65.0  # aligning is at 50 mm/s
    assert follower.status()["phase"] == "following"
    assert follower.world.openness == pytest.approx(0.2, abs=0.005)


def test_a_short_gap_needs_no_aligning_and_makes_no_step() -> None:
    follower = following()
    follower.lead(lambda t: 0.5 + 0.5 * t, 0.2)
    leads = follower.world.track(0.15, lambda: follower.lead_rad)
    leads += follower.lead(lambda _t: 0.7, 0.3, each=lambda: follower.lead_rad)
    assert follower.status()["phase"] == "following"
    assert max(leads) <= MAX_LEAD_RAD + CODE_RAD
    assert follower.world.openness == pytest.approx(0.7, abs=0.005)


def test_the_velocity_lasts_until_the_next_frame_of_a_slow_leader_but_not_long() -> None:
    follower = following(aligned=True)
    speeds = follower.lead(lambda t: 0.5 + 0.3 * t, 0.4, 50.0, each=lambda: dq(follower))
    expected = -0.3 * TRAVEL_MM / MM_RAD  # closing is +, on a normal mount
    assert speeds[20:] == pytest.approx([expected] * (len(speeds) - 20), rel=0.05)
    left = follower.world.track(0.075, lambda: dq(follower))
    fed = [at for at, speed in enumerate(left) if speed != 0.0]
    assert fed == list(range(len(fed)))
    assert 20e-3 + PERIOD_S * (len(fed) - 3) <= 0.05 + 1e-9  # the last frame was 3 ticks old
    assert left[-1] == 0.0


def other_clock(follower: Follower) -> None:
    """Let the leader have the clock that the frames of a test have: two of them say so."""
    for stamp_s in (4999.98, 4999.99):
        follower.put(packed(0.5, stamp_s))
        follower.world.tick()


@pytest.mark.parametrize("apart_s", [0.051, 0.1, 0.0001, -0.2])
def test_frames_that_tell_no_velocity_tell_none(apart_s: float) -> None:
    follower = following()
    other_clock(follower)
    follower.put(packed(0.5, 5000.0))
    follower.world.run(0.02)
    follower.put(packed(0.52, 5000.0 + apart_s))
    follower.world.tick()
    assert dq(follower) == 0.0


def test_frames_that_come_late_tell_no_velocity() -> None:
    follower = following()
    other_clock(follower)
    follower.put(packed(0.5, 5000.0))
    follower.world.run(0.06)
    follower.put(packed(0.52, 5000.02))
    follower.world.tick()
    assert dq(follower) == 0.0
    follower.put(packed(0.53, 5000.025))
    follower.world.tick()
    assert dq(follower) != 0.0


@pytest.mark.parametrize(("dq_max", "most"), [(10.0, FASTEST_RAD_S), (1.5, 1.5)])
def test_the_velocity_is_bounded(dq_max: float, most: float) -> None:
    follower = following(dq_max=dq_max, kp=50.0, kd=0.1)
    other_clock(follower)
    seen: list[float] = []
    for tick in range(16):
        follower.put(packed(0.5 + 0.01 * tick, 5000.0 + 0.001 * tick))
        follower.world.tick()
        seen.append(abs(dq(follower)))
    assert max(seen) == pytest.approx(most)


def test_a_leader_without_a_clock_is_followed_by_ours() -> None:
    follower = following()
    follower.world.run(0.3)
    for tick in range(100):
        follower.put(packed(0.5 + 0.001 * tick, 0.0))
        follower.world.tick()
    assert follower.status()["phase"] == "following"
    assert dq(follower) == pytest.approx(-0.2 * TRAVEL_MM / MM_RAD, rel=0.05)
    for _ in range(100):
        follower.put(packed(0.6, 0.0))
        follower.world.tick()
    status = follower.status()
    assert (status["stale"], status["dq_cmd"], status["out_of_order"]) == (False, 0.0, 0)


def test_frames_that_were_overtaken_are_dropped_and_counted() -> None:
    follower = following()
    for tick in range(40):
        at_s = 6000.0 + 0.005 * tick
        follower.put(packed(0.5 + 0.002 * tick, at_s))
        if tick % 4 == 3:
            follower.put(packed(0.2, at_s - 0.05))
        follower.world.tick()
    status = follower.status()
    assert status["out_of_order"] == 10
    assert status["openness"] == pytest.approx(0.578)
    assert follower.world.openness == pytest.approx(0.57, abs=0.02)


def test_a_leader_whose_clock_was_set_back_is_followed_on() -> None:
    for back_s, counted in ((0.5, "out_of_order"), (5000.0, "other_leaders")):
        follower = following()
        stamp_s = follower.world.now_s - back_s
        ticks = 0
        while follower.status()["openness"] != 0.54:
            follower.put(packed(0.54, stamp_s + ticks * PERIOD_S))
            follower.world.tick()
            ticks += 1
            assert ticks < 100
        assert ticks * PERIOD_S == pytest.approx(0.2, abs=2 * PERIOD_S)
        assert follower.status()[counted] == ticks - 1
        for _ in range(100):
            follower.put(packed(0.54, stamp_s + ticks * PERIOD_S))
            follower.world.tick()
            ticks += 1
        assert follower.world.openness == pytest.approx(0.54, abs=0.005)
        assert follower.status()[counted] < 50


def test_two_leaders_whom_only_their_clocks_tell_apart_are_not_mixed() -> None:
    follower = following()
    leads: list[float] = []
    for tick in range(300):
        follower.put(packed(0.9, 20_000.0 + PERIOD_S * tick))
        follower.put(packed(0.2, 3.0 + PERIOD_S * tick))
        follower.world.tick()
        leads.append(follower.lead_rad)
    status = follower.status()
    assert status["other_leaders"] == 300
    assert status["openness"] == 0.9
    assert follower.world.openness == pytest.approx(0.9, abs=0.005)
    assert max(leads) < 0.0334  # aligned, and not leapt
    assert any("second leader" in text for text in follower.reported())


def test_a_second_leader_is_told_and_not_followed() -> None:
    follower = following(aligned=False)
    for tick in range(200):
        follower.put(packed(0.6, 7000.0 + 0.005 * tick), "here")
        follower.put(packed(0.1, 7000.0 + 0.005 * tick), "there")
        follower.world.tick()
    status = follower.status()
    assert status["other_leaders"] == 200
    assert status["openness"] == 0.6
    assert follower.world.openness == pytest.approx(0.6, abs=0.005)
    assert sum("a second leader" in text for text in follower.reported()) == 1
    follower.world.run(0.3)
    for tick in range(200):  # the first one is gone: now the other may lead
        follower.put(packed(0.4, 8000.0 + 0.005 * tick), "there")
        follower.world.tick()
    assert follower.status()["openness"] == 0.4


def test_frames_that_come_in_bunches_are_all_taken() -> None:
    follower = following()
    for burst in range(10):
        for number in range(8):
            at_s = 9000.0 + 0.04 * burst + 0.005 * number
            follower.put(packed(0.5 + 0.1 * (at_s - 9000.0), at_s))
        follower.world.run(0.04)
    status = follower.status()
    assert status["frames"] == follower.sent + 80
    assert status["dq_cmd"] == pytest.approx(-0.1 * TRAVEL_MM / MM_RAD, rel=0.05)


def test_a_leader_that_comes_and_goes_all_the_time_is_told_of_now_and_then() -> None:
    follower = following(watchdog_s=0.02)
    began_s = follower.world.now_s
    for _ in range(80):
        follower.say(0.5)
        follower.world.run(0.05)
    passed_s = follower.world.now_s - began_s
    for words in ("no frame for", "the leader is heard", "aligned"):
        assert 2 <= sum(words in text for text in follower.reported()) <= passed_s + 2


def test_however_frames_jump_the_command_steps_by_no_more_than_any_motion_may() -> None:
    """Frames that say in turn wide open and shut, as fast as ticks: nothing is turned round."""
    follower = following()
    wanted: list[float] = []
    for tick in range(200):
        follower.say(0.9 if tick // 3 % 2 else 0.1)
        follower.world.tick()
        wanted.append(follower.world.wanted.position_rad)
        assert follower.lead_rad <= MAX_LEAD_RAD + CODE_RAD
    steps = [abs(later - earlier) for earlier, later in pairwise(wanted)]
    assert max(steps) == pytest.approx(FASTEST_RAD_S * PERIOD_S)


def complaint(follower: Follower) -> str | None:
    action = follower.world.controller.action
    assert isinstance(action, TeleopAction)
    return action.complaint()


def test_a_leader_that_is_not_heard_for_long_is_complained_of() -> None:
    follower = following(aligned=False)
    follower.world.run(2.9)
    assert complaint(follower) is None
    follower.world.run(0.2)
    words = "from a leader at leader, port 17448, for 3 s"
    assert complaint(follower) == f"teleoperation: nothing heard yet {words}"
    follower.stay(0.5, 0.3)
    assert complaint(follower) is None
    follower.world.run(2.9)
    assert complaint(follower) is None
    follower.world.run(0.2)
    assert complaint(follower) == f"teleoperation: nothing heard {words}"


def test_a_leader_complains_of_a_follower_that_refuses_its_frames_until_it_does_not() -> None:
    """The daemon's verdict and the doctor say so, not only the status of who asks for it."""
    world = TeleopWorld()
    world.enabled().result("teleop.start", mode="master", link="udp", host="follower")
    action = world.controller.action
    assert isinstance(action, TeleopAction)
    why = "10.0.0.3:17448 refuses what is sent: nobody listens at that port"
    world.wire.status = LinkStatus("open", reach=Reach("sending", why))
    world.run(0.1)
    assert action.complaint() == f"teleoperation: a follower is not reached: {why}"
    judged, reasons = verdict(world)
    assert judged == "degraded"
    assert f"teleoperation: a follower is not reached: {why}" in reasons
    world.wire.status = LinkStatus("open", reach=Reach("sending"))
    assert action.complaint() is None


def test_a_leader_itself_does_not_complain() -> None:
    world = TeleopWorld()
    world.enabled().result("teleop.start", mode="master")
    world.run(5.0)
    assert isinstance(world.controller.action, TeleopAction)
    assert world.controller.action.complaint() is None
