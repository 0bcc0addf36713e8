"""Teleoperation as a job: who may begin it, what ends it, what is refused meanwhile; the leader."""

import itertools
import struct
from typing import Any

import pytest

from litegripd.model.teleop import LinkStatus
from tests.control.states import is_slack
from tests.control.teleop_scene import (
    FAKE,
    MASTER,
    OBJECT_MM,
    SLAVE,
    TRAVEL_MM,
    TeleopWorld,
    following,
)
from tests.world import PERIOD_S, Client, ready


def leading(mount: str = "normal", **params: Any) -> tuple[TeleopWorld, Client]:
    """Return a leader whose jaws are slack at once: here is no follower to wait for."""
    world = TeleopWorld(mount)
    client = world.enabled()
    client.result("teleop.start", **MASTER, require_ready=False, **params)
    return world, client


def frames(world: TeleopWorld) -> list[tuple[float, tuple[float, ...]]]:
    """Return what was sent, by one who knows the wire alone."""
    assert all(len(payload) == 32 for _, payload in world.wire.sent)
    return [(at_s, struct.unpack(">4d", payload)) for at_s, payload in world.wire.sent]


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_leader_is_slack_and_publishes_how_far_it_is_open(mount: str) -> None:
    world, client = leading(mount)
    world.run(0.2)
    assert is_slack(world)
    before_mm = world.gripper.opening_mm
    world.gripper.push(-0.5 * world.gripper.parameters.close_sign)
    world.run(0.15)
    world.gripper.push(0.0)
    world.run(0.3)
    assert world.gripper.opening_mm > before_mm + 5.0
    at_s, (openness, position_mm, force_n, _) = frames(world)[-1]
    assert at_s == world.now_s
    assert openness == pytest.approx(world.gripper.opening_mm / TRAVEL_MM, abs=0.002)
    assert position_mm == pytest.approx(world.gripper.opening_mm, abs=0.2)
    assert force_n == pytest.approx(0.0, abs=0.1)
    status = client.result("teleop.status")
    assert status["frames"] == len(world.wire.sent)
    assert status["openness"] == openness
    assert status["loop_hz"] == pytest.approx(200.0, abs=2.0)
    assert status["last_frame_age_ms"] == 0.0
    assert status["phase"] == "leading"


@pytest.mark.parametrize(
    ("rate_hz", "apart_s"), [(None, 0.005), (50, 0.02), (200, 0.005), (80, None)]
)
def test_a_leader_publishes_at_its_rate(rate_hz: float | None, apart_s: float | None) -> None:
    params: dict[str, Any] = {} if rate_hz is None else {"rate_hz": rate_hz}
    world, _ = leading(**params)
    world.run(2.0)
    sent = frames(world)
    assert len(sent) == pytest.approx(2.0 * (rate_hz or 200), abs=2)
    times = [values[3] for _, values in sent]
    assert times == sorted(set(times))
    if apart_s is not None:
        gaps = [b - a for a, b in itertools.pairwise(times)]
        assert gaps == pytest.approx([apart_s] * len(gaps), abs=1e-6)


def test_every_frame_is_of_the_tick_in_which_its_measurement_came() -> None:
    world, _ = leading()
    world.run(0.5)
    assert all(at_s - values[3] == pytest.approx(PERIOD_S) for at_s, values in frames(world))


def test_a_leader_whose_motor_does_not_answer_sends_nothing_old() -> None:
    world, _ = leading()
    world.run(0.1)
    world.lose_from_motor = lambda _frame: True
    count = len(world.wire.sent)
    world.run(0.015)
    assert len(world.wire.sent) <= count + 1


def test_frames_that_cannot_leave_are_counted() -> None:
    world, client = leading()
    world.run(0.1)
    world.wire.takes = False
    world.run(0.1)
    status = client.result("teleop.status")
    assert status["send_failed"] == 20
    assert status["active"]


@pytest.mark.parametrize("how", ["teleop.stop", "leave"])
def test_a_leader_that_stops_holds_where_it_is(how: str) -> None:
    world, client = leading()
    world.run(0.2)
    if how == "leave":
        client.leave()
    else:
        status = client.result("teleop.stop")
        assert not status["active"]
        assert status["mode"] == "master"
        assert status["frames"] > 30
    world.run(0.2)
    assert world.state.mode == "holding"
    assert world.wire.is_closed
    count = len(world.wire.sent)
    world.run(0.1)
    assert len(world.wire.sent) == count


def test_what_is_asked_for_meanwhile_is_refused_by_name() -> None:
    follower = following()
    other = follower.world.client()
    for method, params in (
        ("motion.open", {}),
        ("motion.hold", {}),
        ("teleop.start", SLAVE),
        ("teleop.start", MASTER),
        ("calibration.load", {"template": "normal"}),
        ("stream.set", {"openness": 0.5}),
    ):
        for client in (other, follower.client):
            assert client.refusal(method, **params) == "teleop_busy"
    follower.stay(0.5, 0.3)
    assert follower.status()["active"]
    assert len(follower.world.wires.made) == 1


def test_only_the_holder_of_the_lease_begins_and_ends_it() -> None:
    world = TeleopWorld()
    client, other = world.enabled(), world.client()
    client.result("lease.acquire", purpose="mine")
    assert other.refusal("teleop.start", **SLAVE) == "lease_held"
    client.result("teleop.start", **SLAVE)
    assert other.refusal("teleop.stop") == "lease_held"
    assert other.result("teleop.status")["active"]
    assert not client.result("teleop.stop")["active"]


@pytest.mark.parametrize("on_lost", ["hold", "relax", "disable"])
@pytest.mark.parametrize("mode", ["master", "slave"])
def test_a_lost_client_leaves_the_jaws_as_wished(on_lost: str, mode: str) -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("lease.acquire", on_lost=on_lost)
    client.result("teleop.start", **(MASTER if mode == "master" else SLAVE))
    world.run(0.3)
    client.leave()
    world.run(0.5)
    wanted = {"hold": "holding", "relax": "relaxed", "disable": "disabled"}
    assert world.state.mode == wanted[on_lost]
    assert world.wire.is_closed
    status = world.client().result("teleop.status")
    assert not status["active"]
    assert "went away" in status["fault"]


def test_detached_it_outlives_its_client() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("teleop.start", **SLAVE, detach=True)
    client.leave()
    world.run(0.3)
    other = world.client()
    assert other.result("teleop.status")["active"]
    assert not other.result("teleop.stop")["active"]


def test_a_request_that_was_sent_before_a_stop_never_runs() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("stop")
    client.result("stop.clear")
    assert client.refusal("teleop.start", **SLAVE, stop_generation=0) == "sent_before_stop"


def test_a_motor_that_is_lost_ends_it_and_is_named() -> None:
    follower = following()
    follower.world.gripper.latch_fault(0xB)
    follower.world.run(0.2)
    status = follower.status()
    assert not status["active"]
    assert "driver" in status["fault"]
    assert follower.world.wire.is_closed


@pytest.mark.parametrize("asked", [MASTER, FAKE])
def test_no_successor_takes_over_meanwhile(asked: dict[str, Any]) -> None:
    """Who restarts the daemon ends teleoperation first: a link cannot be handed over."""
    world = TeleopWorld()
    client = world.enabled()
    assert world.controller.why_not_restartable() is None
    client.result("teleop.start", **asked)
    refusal = world.controller.why_not_restartable()
    assert refusal is not None
    assert refusal.reason == "teleop_busy"
    client.result("teleop.stop")
    assert world.controller.why_not_restartable() is None


def test_its_job_has_a_result() -> None:
    follower = following()
    number = follower.status()["job"]
    waiting = follower.client.send("job.wait", job=number)
    follower.client.result("teleop.stop")
    follower.world.tick()
    follower.client.read()
    job = follower.client.answers[waiting]["result"]
    assert (job["kind"], job["state"]) == ("teleop", "done")
    assert job["result"]["frames"] == follower.sent
    assert job["result"]["mode"] == "slave"


def test_the_state_tells_of_it_at_once() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.send("teleop.start", **SLAVE)
    assert client.result("state.get")["job"]["kind"] == "teleop"
    client.send("teleop.stop")
    assert client.result("state.get")["mode"] == "holding"


def test_stopping_what_does_not_run_does_nothing() -> None:
    world = TeleopWorld()
    client = world.enabled()
    assert client.result("teleop.stop")["active"] is False
    opening = client.send("motion.open")
    world.run(0.1)
    assert client.result("teleop.stop")["active"] is False
    assert client.wait(opening)["result"]["ok"]


def test_the_links_state_is_told_once_and_shown() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("events.subscribe", kinds=["teleop"])
    client.result("teleop.start", **MASTER)
    world.wire.status = LinkStatus("failed", "port 17448 is taken")
    world.run(0.5)
    status = client.result("teleop.status")
    assert (status["link_state"], status["link_error"]) == ("failed", "port 17448 is taken")
    world.wire.status = LinkStatus("open", matching=True)
    world.run(0.1)
    assert client.result("teleop.status")["matching"] is True
    reported = client.events()
    texts = [event["message"] for event in reported]
    assert texts == [
        "teleop: zenoh is open to everybody",
        "teleop: the link is failed: port 17448 is taken",
        "teleop: the link is open",
    ]
    assert [event["data"]["warning"] for event in reported] == [True, True, False]


def test_a_link_that_was_let_go_of_is_not_shown_as_open() -> None:
    world = TeleopWorld()
    client = world.enabled()
    client.result("teleop.start", **MASTER)
    world.wire.status = LinkStatus("open", matching=True, is_protected=False)
    world.run(0.1)
    assert client.result("teleop.status")["link_state"] == "open"
    stopped = client.result("teleop.stop")
    for status in (stopped, client.result("teleop.status")):
        assert status["link"] == "zenoh"
        assert status["link_state"] is status["link_protected"] is status["matching"] is None


def test_the_fake_leader_sweeps_and_trips_the_guard_on_a_rigid_object() -> None:
    world = TeleopWorld(opening_mm=0.916 * TRAVEL_MM)
    client = world.enabled()
    world.gripper.put_object(width_mm=OBJECT_MM)
    client.result("teleop.start", **FAKE, torque_limit_nm=1.0)
    world.run_until(lambda: bool(client.result("teleop.status")["over_torque"]), 8.0)
    assert world.gripper.opening_mm == pytest.approx(OBJECT_MM, abs=1.4)
    world.run_until(lambda: bool(not client.result("teleop.status")["over_torque"]), 8.0)
    world.run_until(lambda: world.gripper.opening_mm > 0.83 * TRAVEL_MM, 8.0)
    world.run_until(lambda: bool(client.result("teleop.status")["torque_trips"] == 2), 12.0)
    status = client.result("teleop.status")
    assert status["frames"] > 1000
    assert status["stale"] is False
    assert world.wires.made == []


def test_leader_and_follower_of_one_process_meet() -> None:
    """Without links of its own, a service has those inside the process."""
    world, client = ready()
    client.result("teleop.start", mode="master", link="none")
    world.run(0.5)
    status = client.result("teleop.status")
    assert status["frames"] >= 99
    assert status["matching"] is False
