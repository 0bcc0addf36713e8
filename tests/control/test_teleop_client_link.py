"""A link that a client carries: what it brings is bounded, and without it the jaws hold."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import pytest

from tests.control.states import is_slack
from tests.control.teleop_scene import TeleopWorld, packed, sweep
from tests.world import PERIOD_S, Client

TOPIC, READY_TOPIC = "litearm/v4/gripA/gripper_teleop", "litearm/v4/gripA/gripper_ready"
CARRIED: dict[str, Any] = {"link": "client"}
Sent = list[tuple[str, bytes]]


def carrying(mode: str, **params: Any) -> tuple[TeleopWorld, Client]:
    world = TeleopWorld()
    client = world.enabled()
    client.result("teleop.start", mode=mode, **CARRIED, **params)
    return world, client


def sent(client: Client) -> Sent:
    """Return what the client is to send, since the last call."""
    told = client.told("teleop.send")
    client.notifications.clear()
    return [(row["topic"], bytes.fromhex(row["payload"])) for row in told]


def bring(client: Client, payload: bytes, topic: str = TOPIC) -> None:
    """Bring a payload as a client does that waits for no answer."""
    client.notify("teleop.receive", topic=topic, payload=payload.hex())


def lead(
    world: TeleopWorld, client: Client, course: Callable[[float], float], duration_s: float
) -> None:
    began_s = world.now_s
    for _ in range(round(duration_s / PERIOD_S)):
        bring(client, packed(course(world.now_s - began_s), world.now_s))
        world.tick()


def refused(client: Client) -> list[str]:
    return [error["data"]["reason"] for error in client.told("teleop.refused")]


@pytest.mark.parametrize("rate_hz", [50, 200])
def test_a_leader_has_its_client_send_frames_at_its_rate(rate_hz: float) -> None:
    world, client = carrying("master", rate_hz=rate_hz)
    world.run(1.0)
    frames = sent(client)
    assert {topic for topic, _ in frames} == {TOPIC}
    assert {len(payload) for _, payload in frames} == {32}
    assert len(frames) == pytest.approx(rate_hz, abs=2)
    status = client.result("teleop.status")
    assert status["frames"] == pytest.approx(len(frames), abs=1)
    assert (status["link"], status["matching"], status["port"]) == ("client", None, None)
    assert (status["link_state"], status["link_protected"]) == ("open", None)


def test_a_leader_waits_for_the_ready_byte_that_its_client_brings() -> None:
    world, client = carrying("master")
    world.run(0.3)
    assert client.result("teleop.status")["phase"] == "waiting"
    bring(client, b"\x00", READY_TOPIC)
    bring(client, b"\x01", TOPIC)  # not where a follower says so
    world.run(0.1)
    status = client.result("teleop.status")
    assert (status["phase"], status["ready_rx"], status["dropped"]) == ("waiting", 1, 1)
    bring(client, b"\x01", READY_TOPIC)
    world.run(0.02)
    assert client.result("teleop.status")["phase"] == "leading"
    assert is_slack(world)


def test_a_follower_goes_where_the_frames_lead_and_has_its_client_say_when_it_is_ready() -> None:
    world, client = carrying("slave")
    world.tick()
    assert sent(client) == [(READY_TOPIC, b"\x00")]
    lead(world, client, lambda _t: 0.8, 1.5)
    assert world.openness == pytest.approx(0.8, abs=0.01)
    said = sent(client)
    assert {topic for topic, _ in said} == {READY_TOPIC}
    assert {payload for _, payload in said} == {b"\x00", b"\x01"}
    assert said[-1][1] == b"\x01"
    status = client.result("teleop.status")
    assert (status["phase"], status["ready"], status["rejected"]) == ("following", True, 0)
    assert status["last_frame_age_ms"] <= 1e3 * PERIOD_S + 0.01
    client.result("teleop.stop")
    assert sent(client)[-1] == (READY_TOPIC, b"\x00")
    assert not client.result("teleop.status")["active"]


def test_a_leader_and_a_follower_meet_by_a_program_that_carries_both() -> None:
    (leads, leader), (follows, follower) = carrying("master", grip_id="a"), carrying("slave")
    for _ in range(300):
        leads.tick()
        follows.tick()
        for topic, payload in sent(leader):
            bring(follower, payload, topic.replace("/a/", "/gripA/"))
        for topic, payload in sent(follower):
            bring(leader, payload, topic.replace("/gripA/", "/a/"))
    assert leader.result("teleop.status")["phase"] == "leading"
    assert follower.result("teleop.status")["ready"]


def test_with_an_id_it_is_answered() -> None:
    _, client = carrying("slave")
    number = client.result("teleop.status")["job"]
    payload = packed(0.5, 1.0).hex()
    assert client.result("teleop.receive", topic=TOPIC, payload=payload) == {"job": number}


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x01", bytes(31), bytes(33), bytes(1000), packed(math.nan, 1.0), packed(0.5, math.inf)],
)
def test_what_is_no_frame_is_counted_and_moves_nothing(payload: bytes) -> None:
    world, client = carrying("slave")
    before = world.openness
    for _ in range(20):
        bring(client, payload)
        world.tick()
    status = client.result("teleop.status")
    assert (status["rejected"], status["frames"], status["phase"]) == (20, 0, "waiting")
    assert world.openness == pytest.approx(before, abs=0.002)
    assert refused(client) == []


@pytest.mark.parametrize("topic", ["", "x", READY_TOPIC, TOPIC.replace("gripA", "gripB")])
def test_what_comes_under_another_key_is_dropped(topic: str) -> None:
    world, client = carrying("slave")
    bring(client, packed(0.9, 1.0), topic)
    world.run(0.1)
    status = client.result("teleop.status")
    assert (status["dropped"], status["frames"]) == (1, 0)


@pytest.mark.parametrize("payload", ["zz", "0", "00 0g", "a" * 4097])
def test_what_is_no_hexadecimal_text_is_refused(payload: str) -> None:
    _, client = carrying("slave")
    error = client.call("teleop.receive", topic=TOPIC, payload=payload)["error"]
    assert (error["data"]["reason"], error["data"]["parameter"]) == ("invalid_params", "payload")


def test_of_a_flood_the_newest_frames_count() -> None:
    world, client = carrying("slave")
    lead(world, client, lambda _t: 0.5, 0.3)
    for number in range(500):
        bring(client, packed(0.9 if number < 499 else 0.55, world.now_s + 1e-4 * number))
    world.tick()
    status = client.result("teleop.status")
    assert status["dropped"] == 500 - 32
    assert status["openness"] == pytest.approx(0.55)


def test_another_connection_is_refused() -> None:
    world, client = carrying("slave")
    other = world.client()
    payload = packed(0.9, 1.0).hex()
    assert other.refusal("teleop.receive", topic=TOPIC, payload=payload) == "teleop_not_ready"
    client.result("teleop.stop")
    assert client.refusal("teleop.receive", topic=TOPIC, payload=payload) == "teleop_not_ready"
    client.result("teleop.start", mode="slave", host="leader")
    assert client.refusal("teleop.receive", topic=TOPIC, payload=payload) == "teleop_not_ready"


def test_a_refusal_without_an_id_is_told_once_for_each_reason() -> None:
    world = TeleopWorld()
    client = world.enabled()
    for _ in range(50):
        bring(client, packed(0.9, 1.0))
    assert refused(client) == ["teleop_not_ready"]
    client.result("teleop.start", mode="slave", **CARRIED)
    bring(client, packed(0.5, 1.0))
    client.result("teleop.stop")
    bring(client, packed(0.5, 1.0))
    assert refused(client) == ["teleop_not_ready"] * 2


def test_a_client_that_does_not_read_gets_no_more_frames() -> None:
    world, client = carrying("master")
    world.run(0.1)
    sent(client)
    client.session.congested = True
    world.run(0.5)
    assert sent(client) == []
    assert client.result("teleop.status")["send_failed"] == 100
    client.session.congested = False
    world.run(0.1)
    assert len(sent(client)) == 20


@pytest.mark.parametrize("mode", ["master", "slave"])
def test_it_ends_with_its_client_and_the_jaws_hold(mode: str) -> None:
    world, client = carrying(mode)
    if mode == "slave":
        lead(world, client, sweep(world.openness, 0.8, 0.5), 0.3)
    world.run(0.05)
    client.leave()
    world.tick()
    assert world.state.mode == "holding"
    status = world.client().result("teleop.status")
    assert not status["active"]
    assert "went away" in status["fault"]
    before = world.openness
    world.run(0.5)
    assert world.openness == pytest.approx(before, abs=0.03)


def test_frames_that_stop_coming_make_it_hold_and_are_followed_again() -> None:
    world, client = carrying("slave")
    lead(world, client, lambda _t: 0.6, 1.0)
    world.run(0.5)
    assert client.result("teleop.status")["phase"] == "stale"
    lead(world, client, lambda _t: 0.4, 1.0)
    assert client.result("teleop.status")["phase"] == "following"
    assert world.openness == pytest.approx(0.4, abs=0.01)


def test_what_was_sent_before_a_stop_does_not_count_after_it() -> None:
    world, client = carrying("slave")
    client.result("stop")
    client.result("stop.clear")
    client.result("teleop.start", mode="slave", **CARRIED)
    refusal = client.refusal(
        "teleop.receive", topic=TOPIC, payload=packed(0.9, 1.0).hex(), stop_generation=0
    )
    assert refusal == "sent_before_stop"
    world.run(0.1)
    assert client.result("teleop.status")["frames"] == 0


def test_what_a_client_brings_presses_no_harder_than_any_leader() -> None:
    """Frames that leap to and fro: the command leads the jaws by the torque of a lead at most."""
    world, client = carrying("slave", align=False)
    for number, _ in itertools.product(range(30), range(4)):
        bring(client, packed(float(number % 2), world.now_s))
        world.tick()
        wanted, measured = world.wanted, world.measured
        asked_nm = wanted.kp_nm_rad * (wanted.position_rad - measured.position_rad)
        assert abs(asked_nm) <= 2.05
