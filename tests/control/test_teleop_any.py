"""Whatever arrives, from whomever and whenever: no command leaves its limits, nothing breaks."""

import json
import math
import struct
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.gripper import DM4310, FASTEST_RAD_S
from litegripd.model.motion_config import (
    LEAST_DAMPING_S,
    MOVING_KP_NM_RAD,
    REACHING_KP_NM_RAD,
)
from tests.control.any_requests import NORMAL, REVERSE, Values, calls
from tests.control.bench import Bench, Course, Request
from tests.control.teleop_scene import CODE_RAD, Follower, TeleopWorld, packed
from tests.properties import examples
from tests.world import PERIOD_S

openness = st.floats(0.0, 1.0) | st.floats(-5.0, 5.0) | st.sampled_from([0.0, 1.0, 1e300, -1e300])
stamps = st.floats(-0.1, 0.1) | st.sampled_from([0.0, 0.005, 1e9, -1e9])
payloads = st.one_of(
    st.tuples(openness, stamps),
    st.tuples(openness, stamps),
    st.binary(max_size=40),
    st.sampled_from([struct.pack(">4d", math.nan, 0, 0, 0), struct.pack(">4d", 0, math.inf, 0, 0)]),
)
arrivals = st.lists(st.tuples(payloads, st.sampled_from(["", "", "", "other"])), max_size=3)
moments = st.tuples(
    arrivals,
    st.sampled_from([1, 1, 1, 2, 4, 9, 11, 45]),
    st.sampled_from([None] * 8 + [0.0, 1.5, -1.5]),
)
settings_given = st.fixed_dictionaries(
    {},
    optional={
        "kp": st.floats(1.0, 500.0),
        "kd": st.floats(0.0, 5.0),
        "dq_max": st.floats(0.0, 30.0),
        "torque_limit_nm": st.floats(0.0, 3.0),
        "force_limit_n": st.floats(1.0, 55.0),
        "watchdog_s": st.floats(0.02, 1.0),
    },
)


def damped(given: dict[str, Any]) -> dict[str, Any]:
    """Return settings with as much damping as is asked for at least."""
    least = LEAST_DAMPING_S * given.get("kp", 100.0)
    return {**given, "kd": max(given["kd"], least)} if "kd" in given else given


def check(follower: Follower, given: dict[str, Any]) -> None:
    """Check what was wanted and sent in this tick, and what is reported."""
    world, wanted, feedback = follower.world, follower.world.wanted, follower.world.measured
    lead_rad = abs(wanted.position_rad - feedback.position_rad)
    travel_nm = world.controller.config.travel_nm
    most_nm = min(travel_nm, given.get("force_limit_n", math.inf) / 10.0)
    usual_kp = min(max(given.get("kp", MOVING_KP_NM_RAD), REACHING_KP_NM_RAD), MOVING_KP_NM_RAD)
    assert lead_rad <= travel_nm / usual_kp + 1e-9
    assert wanted.kp_nm_rad * lead_rad <= most_nm + 1e-9
    assert abs(wanted.velocity_rad_s) <= min(given.get("dq_max", 10.0), FASTEST_RAD_S) + 1e-9
    assert wanted.torque_nm == 0.0
    geometry = world.geometry
    low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad, feedback.position_rad))[::2]
    assert low_rad - CODE_RAD <= wanted.position_rad <= high_rad + CODE_RAD
    json.dumps(follower.status(), allow_nan=False)


@examples(60)
@given(
    settings_given.map(damped),
    st.sampled_from(["normal", "reverse"]),
    st.lists(moments, max_size=25),
)
def test_no_frames_bring_the_jaws_beyond_their_limits(
    given: dict[str, Any], mount: str, course: list[Any]
) -> None:
    world = TeleopWorld(mount)
    client = world.enabled()
    client.result("teleop.start", mode="slave", host="leader", **given)
    follower = Follower(world, client)
    stamp_s = 1000.0
    for arriving, ticks, push_nm in course:
        for payload, source in arriving:
            if isinstance(payload, bytes):
                follower.put(payload, source)
            else:
                stamp_s += payload[1]
                follower.put(packed(payload[0], stamp_s), source)
        if push_nm is not None:
            world.gripper.push(push_nm)
        for _ in range(ticks):
            world.tick()
            check(follower, given)
    began_s = world.now_s
    client.result("teleop.stop")
    world.run(0.05)
    assert world.longest_gap_s(began_s) <= PERIOD_S + 1e-9


def _starts(**fixed: Any) -> st.SearchStrategy[tuple[str, Values]]:
    return settings_given.map(lambda given: ("teleop.start", {**fixed, **given}))


teleop_calls: st.SearchStrategy[tuple[str, Values]] = st.one_of(
    _starts(mode="slave", fake_leader=True),
    _starts(mode="slave", fake_leader=True, detach=True),
    _starts(mode="slave", host="leader"),
    _starts(mode="master", link="none"),
    st.sampled_from(["teleop.stop", "teleop.status"]).map(lambda method: (method, {})),
)
requests: st.SearchStrategy[Request] = st.tuples(
    st.integers(0, 1), teleop_calls | teleop_calls | calls, st.just(True)
)
courses = st.builds(
    Course,
    is_ready=st.booleans(),
    requests=st.lists(requests, max_size=2).map(tuple),
    late_s=st.sampled_from([0.0] * 8 + [-PERIOD_S, 0.03, 0.3]),
    ticks=st.sampled_from([1, 2, 10, 60]),
    phase=st.none(),
    follows=st.sampled_from([0.0, 0.02, 0.3, 1.0]),
    measured=st.just({})
    | st.fixed_dictionaries(
        {},
        optional={
            "position_rad": st.floats(-1.6, 0.2) | st.floats(-30.0, 30.0),
            "velocity_rad_s": st.floats(-50.0, 50.0),
            "torque_nm": st.floats(-20.0, 20.0),
        },
    ),
    is_silent=st.sampled_from([False] * 6 + [True]),
    zero=st.none(),
)


@examples(80)
@given(st.sampled_from([NORMAL, REVERSE]), st.lists(courses, max_size=12))
def test_beside_any_other_requests_every_limit_is_kept(
    content: Values, course: list[Course]
) -> None:
    bench = Bench({}, content, DM4310.ranges)
    for part in course:
        bench.run(part)
