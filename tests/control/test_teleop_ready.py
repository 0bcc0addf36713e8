"""The ready handshake: a leader holds until its follower is ready, whatever the network does."""

import itertools
import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.motion_config import PRESS_NM_PER_MM, MotionConfig
from litegripd.model.teleop import Arrival
from tests.control.states import is_slack
from tests.control.teleop_scene import (
    CODE_RAD,
    MASTER,
    MAX_LEAD_RAD,
    SLAVE,
    TRAVEL_MM,
    Pair,
    TeleopWorld,
    following,
    sweep,
)
from tests.properties import examples
from tests.world import PERIOD_S, Client

NOT_READY, READY = b"\x00", b"\x01"


def network(
    leader_mm: float = 20.0,
    follower_mm: float = 65.0,
    leads: dict[str, Any] | None = None,
    follows: dict[str, Any] | None = None,
    **more: Any,
) -> Pair:
    """Return a leader that has begun, and a follower that begins when it is told to."""
    leader, follower = TeleopWorld("normal", leader_mm), TeleopWorld("reverse", follower_mm)
    leading, following_ = leader.enabled(), follower.enabled()
    leading.result("events.subscribe", kinds=["teleop"])
    leading.result("teleop.start", **MASTER, **(leads or {}))
    between = Pair(leader, follower, leading, following_, **more)
    if follows is not None:
        between.following.result("teleop.start", **SLAVE, **follows)
    return between


def reported(client: Client) -> list[tuple[str, bool]]:
    return [(event["message"], event["data"]["warning"]) for event in client.events()]


# Two ends ----------------------------------------------------------------------------------------


def test_a_leader_holds_until_its_follower_is_where_it_is() -> None:
    between = network(follows={})
    leader = between.leader
    before_mm = leader.gripper.opening_mm
    leader.gripper.push(0.4)  # a hand tries
    phases: list[tuple[str, str]] = []

    def is_ready() -> bool:
        phases.append((between.leads["phase"], between.follows["phase"]))
        return bool(between.leads["ready"])

    waited_s = between.until(is_ready)
    assert waited_s == pytest.approx(45.0 / 50.0, abs=0.4)  # 45 mm at 50 mm/s, and a ramp
    assert {ours for ours, _ in phases[:-1]} == {"waiting"}
    assert leader.gripper.opening_mm == pytest.approx(before_mm, abs=0.5)
    assert between.follower.openness == pytest.approx(leader.openness, abs=0.03)
    between.run(0.02)
    assert between.leads["phase"] == "leading"
    assert is_slack(leader)
    leader.gripper.push(-0.6)
    between.run(0.5)
    assert abs(leader.gripper.opening_mm - before_mm) > 10.0
    assert ("teleop: a follower is ready: the jaws are slack now", False) in reported(
        between.leading
    )
    status = between.leads
    assert (status["ready"], status["ready_timed_out"], status["ready_pubs"]) == (True, False, 0)
    assert status["ready_rx"] == between.follows["ready_pubs"] > 10


def test_frames_are_published_from_the_first_cycle_on() -> None:
    between = network()
    between.run(0.5)
    times = [at_s for at_s, _ in between.leader.wire.sent]
    assert len(times) == 100
    assert between.leads["phase"] == "waiting"
    assert between.leads["frames"] == 100


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.6])
@pytest.mark.parametrize(("delay_s", "jitter_s"), [(0.0, 0.0), (0.05, 0.0), (0.1, 0.1)])
def test_no_loss_and_no_delay_keep_the_gate_shut(
    loss: float, delay_s: float, jitter_s: float
) -> None:
    between = network(follows={}, loss=loss, delay_s=delay_s, jitter_s=jitter_s)
    between.until(lambda: between.leads["phase"] == "leading", 8.0)
    assert not between.leads["ready_timed_out"]
    assert between.follower.openness == pytest.approx(between.leader.openness, abs=0.04)


def test_the_first_ready_opens_the_gate_for_the_session() -> None:
    between = network(follows={})
    between.until(lambda: between.leads["phase"] == "leading")
    between.is_cut = True
    between.run(1.0)
    assert between.follows["stale"]
    assert not between.follows["ready"]
    between.is_cut = False
    between.run(0.05)
    assert between.leads["ready"]  # though its follower has just said that it is not ready
    between.following.result("teleop.stop")
    between.run(0.5)
    assert is_slack(between.leader)
    assert between.leads["phase"] == "leading"


def test_a_follower_that_begins_again_is_aligned_and_says_when_it_is_ready() -> None:
    between = network(follows={})
    between.until(lambda: between.leads["phase"] == "leading")
    between.following.result("teleop.stop")
    between.leader.gripper.push(-0.6)
    between.run(0.5)
    between.leader.gripper.push(0.0)
    between.run(0.3)
    between.following.result("teleop.start", **SLAVE)
    between.run(0.2)
    assert not between.follows["ready"]
    between.until(lambda: between.follows["ready"])
    assert between.follower.openness == pytest.approx(between.leader.openness, abs=0.03)


def test_a_leader_that_begins_again_waits_again() -> None:
    between = network(follows={})
    between.until(lambda: between.leads["phase"] == "leading")
    between.leading.result("teleop.stop")
    between.run(0.5)
    assert not between.follows["ready"]
    between.leader.gripper.push(-0.6)
    between.leading.result("teleop.start", **MASTER)
    status = between.leads
    assert (status["phase"], status["ready"], status["ready_rx"]) == ("waiting", False, 0)
    assert 0.0 < between.until(lambda: between.leads["phase"] == "leading") < 1.0


def test_of_an_older_follower_nothing_is_heard_and_the_leader_goes_slack_after_10_s() -> None:
    between = network(follows={}, passes_ready=False)
    waited_s = between.until(lambda: between.leads["phase"] == "leading")
    assert waited_s == pytest.approx(10.0, abs=0.02)
    status = between.leads
    assert (status["ready"], status["ready_rx"], status["ready_timed_out"]) == (False, 0, True)
    assert is_slack(between.leader)
    ((text, is_warning),) = [
        event for event in reported(between.leading) if "no follower was ready" in event[0]
    ]
    assert "within 10 s" in text
    assert is_warning
    between.passes_ready = True
    between.run(0.3)
    assert between.leads["ready"]  # a late one is told, and changes nothing
    assert between.leads["ready_timed_out"]


def test_an_older_leader_is_followed_as_ever_and_hears_nothing() -> None:
    between = network(leads={"require_ready": False}, follows={}, passes_ready=False)
    assert between.leads["phase"] == "leading"
    between.until(lambda: between.follows["ready"])
    between.leader.gripper.push(-0.6)
    between.run(0.3)
    between.leader.gripper.push(0.0)
    between.run(1.5)
    assert between.follower.openness == pytest.approx(between.leader.openness, abs=0.02)
    assert between.leads["rejected"] == between.leads["ready_rx"] == 0


# The leader alone --------------------------------------------------------------------------------


@pytest.mark.parametrize(("timeout_s", "waits_s"), [(0.5, 0.5), (2.0, 2.0), (0, None)])
def test_the_time_of_waiting_is_the_callers_and_0_is_for_ever(
    timeout_s: float, waits_s: float | None
) -> None:
    between = network(leads={"ready_timeout_s": timeout_s})
    if waits_s is None:
        between.run(30.0)
        assert between.leads["phase"] == "waiting"
        assert not between.leads["ready_timed_out"]
    else:
        waited_s = between.until(lambda: between.leads["phase"] == "leading")
        assert waited_s == pytest.approx(waits_s, abs=0.02)


@pytest.mark.parametrize(
    "params",
    [
        {"require_ready": False},
        {"link": "udp", "host": "a"},
        {"link": "udp", "host": "a", "require_ready": True},
        {"link": "none"},
    ],
)
def test_where_nobody_can_say_so_or_need_not_the_jaws_are_slack_at_once(
    params: dict[str, Any],
) -> None:
    between = network(leads=params)
    between.run(0.05)
    assert is_slack(between.leader)
    status = between.leads
    assert (status["phase"], status["ready_timed_out"]) == ("leading", False)


def heard(payload: bytes) -> dict[str, Any]:
    between = network()
    between.run(0.1)
    between.leader.wire.arriving.append(Arrival(payload, between.leader.now_s))
    between.run(0.02)
    return between.leads


@pytest.mark.parametrize("payload", [READY, b"\x02", b"\xff", b"1"])
def test_any_byte_but_0_is_ready(payload: bytes) -> None:
    status = heard(payload)
    assert (status["phase"], status["ready_rx"], status["ready"]) == ("leading", 1, True)


@pytest.mark.parametrize(
    ("payload", "heard_of", "rejected"),
    [(NOT_READY, 1, 0), (b"", 0, 1), (b"\x01\x01", 0, 1), (bytes([1] * 32), 0, 1)],
)
def test_other_bytes_and_lengths_open_no_gate(payload: bytes, heard_of: int, rejected: int) -> None:
    status = heard(payload)
    assert (status["phase"], status["ready_rx"], status["ready"]) == ("waiting", heard_of, False)
    assert status["rejected"] == rejected


@pytest.mark.parametrize("how", ["teleop.stop", "leave", "stop"])
def test_a_leader_that_ends_before_a_follower_is_ready_holds(how: str) -> None:
    between = network()
    between.run(0.2)
    before_mm = between.leader.gripper.opening_mm
    if how == "leave":
        between.leading.leave()
    else:
        between.leading.result(how)
    between.leader.run(0.3)
    assert between.leader.state.mode == "holding"
    assert between.leader.gripper.opening_mm == pytest.approx(before_mm, abs=0.1)


pushes = st.lists(st.tuples(st.floats(-8.0, 8.0), st.integers(1, 60)), min_size=1, max_size=12)


@examples(40)
@given(pushes, st.sampled_from([(100.0, 2.0), (55.0, 0.5), (500.0, 5.0), (5.0, 0.1)]))
def test_whatever_pushes_a_leader_that_holds_it_pushes_back_within_a_followers_bounds(
    course: list[tuple[float, int]], gains: tuple[float, float]
) -> None:
    world = TeleopWorld("normal", 40.0)
    client = world.enabled()
    client.result("teleop.start", **MASTER, ready_timeout_s=0, kp=gains[0], kd=gains[1])
    for push_nm, ticks in course:
        world.gripper.push(push_nm)
        for _ in range(ticks):
            world.tick()
            wanted, measured = world.wanted, world.measured
            asked_nm = wanted.kp_nm_rad * (wanted.position_rad - measured.position_rad)
            assert abs(asked_nm) <= MotionConfig().travel_nm + 500.0 * CODE_RAD
            assert wanted.velocity_rad_s == 0.0
            assert wanted.kp_nm_rad <= 100.0
    assert client.result("teleop.status")["phase"] == "waiting"


def test_a_leader_that_holds_presses_no_harder_than_a_press_for_long() -> None:
    between = network(leads={"ready_timeout_s": 0})
    between.run(0.1)
    between.leader.gripper.push(1.6)
    between.run(1.5)
    wanted, measured = between.leader.wanted, between.leader.measured
    asked_nm = abs(wanted.kp_nm_rad * (wanted.position_rad - measured.position_rad))
    assert asked_nm <= MotionConfig().stop_nm + 100.0 * CODE_RAD


# The follower alone ------------------------------------------------------------------------------


def told(world: TeleopWorld) -> list[bytes]:
    return [payload for _, payload in world.wire.told]


def test_a_follower_says_first_and_last_that_it_is_not_ready() -> None:
    follower = following(aligned=False)
    follower.world.tick()
    assert told(follower.world) == [NOT_READY]
    follower.stay(follower.world.openness, 0.5)
    assert told(follower.world)[-1] == READY
    wire = follower.world.wire
    follower.client.result("teleop.stop")
    assert wire.told[-1][1] == NOT_READY
    assert follower.status()["ready_pubs"] == len(wire.told)
    assert not follower.status()["ready"]


@pytest.mark.parametrize("period_s", [0.02, 0.1, 1.0])
def test_it_says_so_on_each_change_and_at_least_every_period(period_s: float) -> None:
    follower = following(aligned=False, ready_period_s=period_s)
    follower.stay(follower.world.openness, 2.0)
    said = follower.world.wire.told
    changes = [later[0] for earlier, later in itertools.pairwise(said) if earlier[1] != later[1]]
    assert len(changes) == 1
    apart = [later[0] - earlier[0] for earlier, later in itertools.pairwise(said)]
    assert max(apart) <= period_s + PERIOD_S / 10
    same = [gap for gap, row in zip(apart, said[1:], strict=True) if row[0] not in changes]
    assert same == pytest.approx([period_s] * len(same), abs=PERIOD_S / 10)


def test_it_is_ready_only_while_it_follows_and_is_where_its_leader_is() -> None:
    follower = following(torque_limit_nm=1.0)
    assert follower.status()["ready"]
    follower.world.run(0.3)
    assert (follower.status()["phase"], follower.status()["ready"]) == ("stale", False)
    far = 0.9
    follower.stay(far, 0.1)
    assert (follower.status()["phase"], follower.status()["ready"]) == ("aligning", False)
    follower.stay(far, 1.5)
    assert (follower.status()["phase"], follower.status()["ready"]) == ("following", True)
    follower.stay(0.5, 0.05)  # a leap, in which it lags behind
    assert (follower.status()["phase"], follower.status()["ready"]) == ("following", False)
    follower.stay(0.5, 1.0)
    assert follower.status()["ready"]
    follower.world.gripper.put_object(width_mm=follower.world.gripper.opening_mm - 5.0)
    follower.lead(sweep(0.5, 0.2, 0.5), 1.0)
    status = follower.status()
    assert (status["phase"], status["over_torque"], status["ready"]) == ("released", True, False)


@pytest.mark.parametrize(("tolerance_mm", "is_ready"), [(8.0, True), (4.0, False), (0.0, False)])
def test_how_near_is_ready_is_the_callers(tolerance_mm: float, is_ready: bool) -> None:
    """Jaws that something holds 6 mm before where they should be."""
    follower = following(ready_tolerance_mm=tolerance_mm)
    follower.world.gripper.put_object(width_mm=follower.world.gripper.opening_mm - 0.5)
    follower.lead(sweep(0.5, 0.5 - 6.5 / TRAVEL_MM, 0.5), 1.0)
    assert follower.status()["phase"] == "following"
    assert follower.status()["ready"] is is_ready


def test_over_udp_it_tells_nobody_but_its_status_has_it() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("teleop.start", mode="slave", fake_leader=True)
    world.run_until(lambda: bool(client.result("teleop.status")["ready"]), 5.0)
    assert client.result("teleop.status")["ready_pubs"] == 0


# How it gets there -------------------------------------------------------------------------------


@pytest.mark.parametrize("openness", [0.1, 0.9])
def test_without_aligning_it_goes_there_at_once_and_does_not_jump(openness: float) -> None:
    follower = following(aligned=False, align=False, align_speed_mm_s=10.0)
    began_s = follower.world.now_s
    seen = follower.lead(
        lambda _t: openness, 0.8, each=lambda: (follower.lead_rad, follower.status()["phase"])
    )
    leads, phases = zip(*seen, strict=True)
    assert follower.world.openness == pytest.approx(openness, abs=0.02)  # 35 mm
    assert set(phases) == {"following"}
    assert max(leads) <= MAX_LEAD_RAD + CODE_RAD
    commands = [command for _, command in follower.world.commands_since(began_s)]
    steps = [abs(b.position_rad - a.position_rad) for a, b in itertools.pairwise(commands)]
    assert max(steps) <= 2.9 * PERIOD_S + CODE_RAD
    follower.world.run(0.5)
    assert follower.status()["phase"] == "stale"
    follower.stay(0.5, 0.8)
    assert follower.world.openness == pytest.approx(0.5, abs=0.02)
    assert "teleop: the leader is heard: following" in follower.reported()


@pytest.mark.parametrize("speed_mm_s", [10.0, 100.0])
def test_it_aligns_at_the_callers_speed(speed_mm_s: float) -> None:
    follower = following(aligned=False, align_speed_mm_s=speed_mm_s)
    began_mm = follower.world.gripper.opening_mm
    follower.stay(0.95, 0.3)
    moved_mm = follower.world.gripper.opening_mm - began_mm
    assert moved_mm == pytest.approx(0.3 * speed_mm_s, rel=0.3)


@pytest.mark.parametrize(
    ("cap_mm", "most_nm"),
    [(0.5, 0.5 * PRESS_NM_PER_MM), (1.0, PRESS_NM_PER_MM), (4.0, 2.0), (0, 2.0)],
)
def test_the_lead_is_capped_and_never_beyond_what_presses_anyway(
    cap_mm: float, most_nm: float
) -> None:
    follower = following(lead_cap_mm=cap_mm)
    follower.world.gripper.put_object(width_mm=follower.world.gripper.opening_mm - 1.0)
    leads = follower.lead(sweep(0.5, 0.2, 0.3), 0.7, each=lambda: follower.lead_rad)
    assert 100.0 * max(leads) == pytest.approx(most_nm, abs=0.06)


@pytest.mark.parametrize(("rate_hz", "most_mm"), [(50, 2.7), (200, 1.1)])
def test_a_hand_at_110_mm_s_is_followed_without_lagging(rate_hz: float, most_mm: float) -> None:
    """To and fro by 52 mm: the jaws stay within a frame and 5 ms of the hand, at any time."""
    follower = following()
    swing_mm = 26.0

    def course(t_s: float) -> float:
        return 0.5 - swing_mm / TRAVEL_MM * math.cos(110.0 / swing_mm * t_s)

    follower.lead(sweep(follower.world.openness, course(0.0), 0.8), 1.2)
    began_s = follower.world.now_s

    def lag_mm() -> float:
        wanted = course(follower.world.now_s - began_s)
        return abs(wanted - follower.world.openness) * TRAVEL_MM

    assert max(follower.lead(course, 4.0 * math.pi * swing_mm / 110.0, rate_hz, lag_mm)) < most_mm
    assert follower.status()["phase"] == "following"


# The order of refusals, and the status ------------------------------------------------------------


def test_what_is_missing_is_told_before_who_is_in_the_way() -> None:
    """The SDK's order: enabled, calibrated, and then who is running."""
    world = TeleopWorld(calibrated=False)
    client = world.start().client()
    client.send("calibration.manual", step="begin")
    error = client.call("teleop.start", **MASTER)["error"]["data"]
    assert (error["reason"], error["cause"]) == ("teleop_not_ready", "not_enabled")
    client.result("motor.enable")
    client.send("calibration.manual", step="begin")
    error = client.call("teleop.start", **MASTER)["error"]["data"]
    assert (error["reason"], error["cause"]) == ("teleop_not_ready", "not_calibrated")


FIRST: dict[str, Any] = {
    "active": True,
    "frames": 0,
    "last_frame_age_ms": None,
    "stale": False,
    "openness": 0.0,
    "position_mm": 0.0,
    "force_n": 0.0,
    "loop_hz": 0.0,
    "dq_cmd": 0.0,
    "rejected": 0,
    "send_failed": 0,
    "fault": "",
    "torque_nm": 0.0,
    "over_torque": False,
    "torque_trips": 0,
    "matching": None,
    "ready": False,
    "ready_rx": 0,
    "ready_pubs": 0,
    "ready_timed_out": False,
}


@pytest.mark.parametrize("asked", [MASTER, SLAVE])
def test_the_first_status_has_every_field_with_its_type(asked: dict[str, Any]) -> None:
    client = TeleopWorld().enabled()
    status = client.result("teleop.start", **asked)
    assert {name: status[name] for name in FIRST} == FIRST
    assert status["mode"] == asked["mode"]
    client.world.run(0.1)
    later = client.result("teleop.status")
    kinds = {name: type(value) for name, value in FIRST.items() if value is not None}
    assert {name: type(later[name]) for name in kinds} == kinds


def test_a_frame_and_a_ready_byte_are_what_the_field_stack_sends() -> None:
    between = network(follows={})
    between.run(0.5)
    assert struct.unpack(">4d", between.leader.wire.sent[-1][1])
    assert set(told(between.follower)) <= {NOT_READY, READY}
    assert between.leader.wire.options.ready_topic == "litearm/v4/gripA/gripper_ready"
