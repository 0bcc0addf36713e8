"""When a request was received: before a stop it is void, and a set-point counts from then on."""

import json
from typing import Any

import pytest

from tests.world import PERIOD_S, Client, World, enabled_world

MOVES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("stop.clear", {}),
    ("motion.open", {}),
    ("motor.enable", {}),
    ("stream.set", {"opening_mm": 10.0}),
)


def send(client: Client, method: str, received_s: float, **params: Any) -> dict[str, Any]:
    """Send a request that came at some time; return what is answered at once, if anything."""
    client.last_id += 1
    request = {"jsonrpc": "2.0", "id": client.last_id, "method": method, "params": params}
    line, world = json.dumps(request).encode(), client.world
    world.service.handle(client.session, line, world.now_s, received_s)
    client.read()
    return client.answers.get(client.last_id, {})


def reason(answer: dict[str, Any]) -> str | None:
    found: str | None = answer.get("error", {}).get("data", {}).get("reason")
    return found


@pytest.mark.parametrize(("method", "params"), MOVES)
def test_what_came_before_a_stop_neither_moves_nor_clears(
    method: str, params: dict[str, Any]
) -> None:
    world = World()
    client, other = world.enabled(), world.client()
    received_s = world.now_s
    world.run(0.02)
    other.result("stop")
    answer = send(client, method, received_s, **params)
    assert reason(answer) == "sent_before_stop"
    assert "it came 0.0" in answer["error"]["message"]
    latched = world.controller.stop_latch.latched
    assert latched is not None
    assert world.controller.jobs.running is None
    assert reason(send(client, "stop.clear", world.now_s)) is None


def test_a_take_over_that_came_before_a_stop_drops_nothing_that_the_stop_holds() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    world.gripper.put_object(width_mm=30.0)
    assert client.result("motion.grasp", force_n=8, until="verdict")["ok"]
    received_s = world.now_s
    world.run(0.02)
    other.result("stop")
    idle = world.controller.idle
    answer = send(client, "lease.take", received_s, why="it hangs", jaws="relax")
    assert reason(answer) == "sent_before_stop"
    world.run(0.1)
    assert world.controller.idle is idle
    assert "result" in send(client, "lease.take", world.now_s, why="it hangs", jaws="relax")


def test_what_says_that_it_was_sent_later_than_it_came_is_void_all_the_same() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    received_s = world.now_s
    world.run(0.02)
    other.result("stop")
    answer = send(client, "stop.clear", received_s, sent_s=world.now_s + 1e6, stop_generation=1)
    assert reason(answer) == "sent_before_stop"


def test_a_clear_behind_the_clients_own_stop_clears_though_both_came_at_once() -> None:
    world, client = enabled_world()
    received_s = world.now_s
    world.run(0.02)
    assert "result" in send(client, "stop", received_s)
    assert "result" in send(client, "stop.clear", received_s)
    assert world.controller.stop_latch.latched is None


@pytest.mark.parametrize("order", [("other", "own"), ("own", "other"), ("own", "other", "own")])
def test_a_stop_of_somebody_else_counts_beside_ones_own(order: tuple[str, ...]) -> None:
    world = World()
    client, other = world.enabled(), world.client()
    received_s = world.now_s
    for who in order:
        world.run(0.02)
        send(client if who == "own" else other, "stop", world.now_s)
    assert reason(send(client, "stop.clear", received_s)) == "sent_before_stop"
    assert world.controller.stop_latch.latched is not None


def test_what_only_reads_or_stops_is_carried_out_whenever_it_came() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    received_s = world.now_s
    world.run(0.02)
    other.result("stop")
    assert "result" in send(client, "state.get", received_s)
    assert "result" in send(client, "stop", received_s, level="relax")


@pytest.mark.parametrize("mark", ["received", "sent"])
def test_a_set_point_that_is_older_than_it_counts_moves_nothing(mark: str) -> None:
    world, client = enabled_world()
    before_mm, old_s = world.gripper.opening_mm, world.now_s
    world.run(0.2)
    came_s, marks = (old_s, {}) if mark == "received" else (world.now_s, {"sent_s": old_s})
    answer = send(client, "stream.set", came_s, opening_mm=10.0, valid_s=0.1, **marks)
    assert reason(answer) == "set_point_expired"
    assert answer["error"]["data"]["age_s"] == pytest.approx(0.2)
    assert answer["error"]["data"]["limit"] == 0.1
    world.run(0.5)
    assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.1)
    assert world.controller.jobs.running is None


@pytest.mark.parametrize("mark", ["received", "sent"])
def test_a_set_point_counts_from_when_it_was_sent_or_else_received(mark: str) -> None:
    world, client = enabled_world()
    old_s = world.now_s
    world.run(0.1)
    came_s, marks = (old_s, {}) if mark == "received" else (world.now_s, {"sent_s": old_s})
    assert reason(send(client, "stream.set", came_s, opening_mm=10.0, valid_s=0.3, **marks)) is None
    world.run_until(lambda: world.controller.jobs.running is None)
    assert world.now_s - old_s == pytest.approx(0.3, abs=2 * PERIOD_S)


def test_an_older_set_point_does_not_prolong_a_newer_one() -> None:
    """The latest that is carried out wins, with its own end."""
    world, client = enabled_world()
    began_s = world.now_s
    send(client, "stream.set", began_s, opening_mm=10.0, valid_s=0.5)
    world.run(0.1)
    send(client, "stream.set", world.now_s, opening_mm=10.0, valid_s=0.1)
    world.run_until(lambda: world.controller.jobs.running is None)
    assert world.now_s - began_s == pytest.approx(0.2, abs=2 * PERIOD_S)


def test_a_time_in_the_future_makes_no_set_point_last_longer() -> None:
    world, client = enabled_world()
    began_s = world.now_s
    send(client, "stream.set", began_s, opening_mm=10.0, valid_s=0.1, sent_s=began_s + 1e6)
    world.run_until(lambda: world.controller.jobs.running is None)
    assert world.now_s - began_s == pytest.approx(0.1, abs=2 * PERIOD_S)
