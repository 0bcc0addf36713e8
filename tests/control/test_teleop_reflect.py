"""A leader's hand feels what its follower presses with: off unless asked for, small, passive."""

import math
import struct
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.teleop import Arrival, LinkOptions
from litegripd.teleop.leader import DEAD_BAND_N
from litegripd.teleop.link import InProcessLinks
from tests.control.reflection_pair import FORCE, force_frame, pair
from tests.control.teleop_scene import (
    HALF_MM,
    MASTER,
    MM_RAD,
    OBJECT_MM,
    TRAVEL_MM,
    TeleopWorld,
    following,
    packed,
)
from tests.properties import examples
from tests.world import PERIOD_S

NEAR_MM, PRESSED_MM = OBJECT_MM + 0.025 * TRAVEL_MM, 0.8 * OBJECT_MM


@pytest.mark.parametrize("mounts", [("normal", "normal"), ("normal", "reverse")])
def test_a_hand_feels_the_contact_and_nothing_before_or_after(mounts: tuple[str, str]) -> None:
    both = pair(5.0, mounts=mounts)
    on_the_way = both.move(0.4, to_mm=NEAR_MM)
    assert max(map(abs, on_the_way)) == 0.0
    felt = both.move(0.6, to_mm=PRESSED_MM)
    assert felt[-1] > 0.25
    assert max(felt) <= 0.5 + 1e-9
    leader, follower = both.leads, both.follows
    assert leader["reflects"] is follower["reflects"] is True
    assert leader["followers"] == 1
    assert leader["reflected_n"] == pytest.approx(10.0 * felt[-1])
    assert leader["round_trip_ms"] < 30.0
    assert follower["reflected_n"] > 5.0
    assert leader["rejected"] == leader["late"] == leader["out_of_order"] == 0
    both.move(0.6, to_mm=HALF_MM)
    assert abs(both.move(0.2)[-1]) < 0.001


def test_it_is_off_unless_both_ends_ask_for_it() -> None:
    for reflect_n, reflect in ((0.0, True), (5.0, False), (0.0, False)):
        both = pair(reflect_n, reflect=reflect)
        felt = both.move(0.8, to_mm=PRESSED_MM)
        assert max(map(abs, felt)) == 0.0
        leader, follower = both.leads, both.follows
        assert leader["reflects"] is (reflect_n > 0.0)
        assert follower["reflects"] is reflect
        assert (follower["reflected_n"] is None) is not reflect
        assert leader["followers"] == (0 if reflect_n else None)
        assert bool(both.follower.wire.replied) is reflect


def test_a_cut_cable_lets_go_of_the_hand_gently() -> None:
    both = pair(10.0, gain=1.0)
    both.hand.stiffness_nm_mm = 0.2
    before = both.move(1.0, to_mm=PRESSED_MM)[-1]
    assert before > 0.9
    both.is_cut = True
    ending = both.move(0.6)
    steps = [abs(later - earlier) for earlier, later in pairwise(ending)]
    assert max(steps) <= 10.0 / 10.0 * PERIOD_S / 0.1 + 1e-9
    assert ending[20] > 0.5 * before  # for 0.2 s the last force counts
    assert abs(ending[80]) < 0.01
    assert both.leads["followers"] == 0
    both.is_cut = False
    assert both.move(0.8)[-1] > 0.2


@pytest.mark.parametrize("delay_s", [0.0, 0.01, 0.03, 0.06, 0.09])
@pytest.mark.parametrize("stiffness_nm_mm", [0.0, 0.02, 0.06, 0.2])
def test_no_delay_and_no_hand_make_it_swing(delay_s: float, stiffness_nm_mm: float) -> None:
    """The most force and the whole gain, into a rigid object: all comes to rest."""
    both = pair(10.0, delay_s=delay_s, gain=1.0)
    both.hand.stiffness_nm_mm = stiffness_nm_mm or 0.06
    both.move(1.0, to_mm=PRESSED_MM)
    both.hand.stiffness_nm_mm = stiffness_nm_mm  # 0: it lets go
    speeds_mm_s, places_mm = [], []
    for _ in range(600):
        both.tick()
        speeds_mm_s.append(abs(both.leader.gripper.velocity_rad_s) * MM_RAD)
        places_mm.append(both.leader.gripper.opening_mm)
    assert max(places_mm[400:]) - min(places_mm[400:]) < 0.1
    assert max(speeds_mm_s[:400]) < 100.0


def test_over_a_network_that_is_too_slow_nothing_is_felt() -> None:
    both = pair(10.0, delay_s=0.12, gain=1.0)
    assert max(map(abs, both.move(1.5, to_mm=PRESSED_MM))) == 0.0
    leader = both.leads
    assert leader["followers"] == 0
    assert leader["late"] > 50


def test_a_tripped_guard_is_not_felt_nor_is_the_way_to_the_leader() -> None:
    both = pair(10.0, gain=1.0, torque_limit_nm=1.0)
    both.hand.stiffness_nm_mm = 0.2
    both.move(0.8, to_mm=PRESSED_MM)
    assert both.follows["over_torque"] is True
    assert abs(both.move(0.4)[-1]) < 0.001
    follower = following(reflect=True, aligned=False, opening_mm=72.0)
    follower.stay(0.1, 0.2)
    assert follower.status()["phase"] == "aligning"
    reported = [FORCE.unpack(payload)[2] for _, payload, _ in follower.world.wire.replied]
    assert 0.0 < max(map(abs, reported)) < DEAD_BAND_N


def test_a_script_that_knows_the_page_alone_is_felt_and_reads_ours() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("teleop.start", **MASTER, reflect_n=4.0, reflect_gain=1.0, require_ready=False)
    for tick in range(100):
        world.tick()
        _, _, _, echo_s = struct.unpack(">4d", world.wire.sent[-1][1])
        payload = force_frame(30.0, 7000.0 + tick, echo_s)
        world.wire.arriving.append(Arrival(payload, world.now_s))
        world.gripper.push(0.45)  # a hand that does not give way
    status = client.result("teleop.status")
    assert status["reflected_n"] == pytest.approx(4.0)
    assert status["round_trip_ms"] == pytest.approx(10.0, abs=5.1)
    follower = following(reflect=True)
    follower.stay(0.5, 0.5)
    replied = follower.world.wire.replied
    assert len(replied) == pytest.approx(100 * 0.5, abs=35)
    for at_s, payload, to in replied:
        magic, sender, force_n, timestamp_s, echo_s = FORCE.unpack(payload)
        assert (magic, sender, to) == (b"LGFORCE1", 0, "")
        assert abs(force_n) < 3.0
        assert at_s - PERIOD_S - 1e-9 <= timestamp_s <= at_s
        assert at_s - 2 * PERIOD_S - 1e-9 <= echo_s <= at_s


@pytest.mark.parametrize("watchdog_s", [0.05, 0.2, 1.0])
def test_one_datagram_gets_no_answers_without_end(watchdog_s: float) -> None:
    """Anybody can forge one; the address that it names would be flooded."""
    follower = following(reflect=True, aligned=False, watchdog_s=watchdog_s)
    follower.put(packed(0.5, 7.0), "forged:17448")
    follower.world.run(3.0)
    most = min(watchdog_s, 0.2) * 100.0
    assert 0 < len(follower.world.wire.replied) <= most + 1
    assert follower.status()["reflected_n"] is None


def test_a_leader_that_is_heard_again_is_answered_again() -> None:
    follower = following(reflect=True)
    follower.world.run(1.0)
    before = len(follower.world.wire.replied)
    assert follower.status()["reflected_n"] is None
    follower.stay(0.5, 0.5)
    assert len(follower.world.wire.replied) - before == pytest.approx(50, abs=5)
    assert follower.status()["reflected_n"] is not None


def test_it_ends_with_teleoperation() -> None:
    both = pair(10.0, gain=1.0)
    both.move(0.8, to_mm=PRESSED_MM)
    assert both.commanded_nm > 0.2
    both.leading.result("teleop.stop")
    both.leader.tick()
    assert both.commanded_nm == 0.0
    assert both.leader.state.mode == "holding"
    status = both.leads
    assert (status["active"], status["reflected_n"], status["followers"]) == (False, None, None)


def test_inside_one_process_forces_come_to_the_leader() -> None:
    links = InProcessLinks()
    leader = links.open(LinkOptions("master", "none", reflects=True))
    deaf = links.open(LinkOptions("master", "none"))
    follower = links.open(LinkOptions("slave", "none", reflects=True))
    assert follower.reply(b"force", "", 5.0)
    leader.publish(b"frame", 5.0)
    assert [arrival.payload for arrival in leader.receive(5.0)] == [b"force"]
    assert [arrival.payload for arrival in follower.receive(5.0)] == [b"frame"]
    assert deaf.receive(5.0) == ()


payloads = st.one_of(
    st.binary(max_size=60),
    st.builds(
        lambda *values: values,
        st.floats(allow_nan=True, allow_infinity=True),
        st.floats(-1e9, 1e9),
        st.floats(-0.1, 0.3) | st.floats(-1e300, 1e300),
        st.integers(0, 20),
    ),
)
moments = st.tuples(
    st.lists(payloads, max_size=4),
    st.sampled_from([1, 1, 2, 5, 30]),
    st.sampled_from([None] * 5 + [0.0, 1.0, -1.0]),
)


def made(now_s: float, force_n: float, at_s: float, age_s: float, sender: int) -> bytes:
    return force_frame(force_n, at_s, now_s - age_s, sender)


@examples(50)
@given(st.floats(0.1, 10.0), st.floats(0.05, 1.0), st.lists(moments, max_size=20))
def test_no_frames_push_a_hand_beyond_the_bounds(
    reflect_n: float, gain: float, course: list[Any]
) -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result(
        "teleop.start", **MASTER, reflect_n=reflect_n, reflect_gain=gain, require_ready=False
    )
    was_nm = 0.0
    for arriving, ticks, push_nm in course:
        for payload in arriving:
            content = payload if isinstance(payload, bytes) else made(world.now_s, *payload)
            world.wire.arriving.append(Arrival(content, world.now_s))
        if push_nm is not None:
            world.gripper.push(push_nm)
        for _ in range(ticks):
            world.tick()
            wanted, measured = world.wanted, world.measured
            assert (wanted.kp_nm_rad, wanted.velocity_rad_s) == (0.0, 0.0)
            assert wanted.position_rad == measured.position_rad
            assert abs(wanted.torque_nm) <= reflect_n / 10.0 + 1e-9
            grows_nm = abs(wanted.torque_nm) - abs(was_nm)
            assert grows_nm <= 2.0 * reflect_n / 10.0 * PERIOD_S / 0.1 + 1e-9
            was_nm = wanted.torque_nm
    status = client.result("teleop.status")
    assert status["active"]
    assert math.isfinite(status["reflected_n"])
