"""Samples of the state: their rate, their sequence, and what a slow reader misses."""

from typing import Any

import pytest

from litegripd.control.snapshot import GripperState
from litegripd.rpc.jsonrpc import encode
from litegripd.rpc.methods.reading import STATE_FIELDS
from litegripd.rpc.subscriptions import MAX_PER_SESSION
from tests.world import Client, World, found_world


def samples(client: Client) -> list[dict[str, Any]]:
    """Return what came as samples since the last call."""
    client.read()
    found = [m["params"] for m in client.notifications if m["method"] == "state.sample"]
    client.notifications.clear()
    return found


def test_the_present_state_comes_first() -> None:
    world, client = found_world()
    client.send("state.subscribe", hz=200)
    assert len(client.session.outgoing) == 1
    client.read()
    answer = client.answers[client.last_id]["result"]
    assert set(answer["state"]) == set(STATE_FIELDS)
    world.tick()
    (first,) = samples(client)
    assert (first["subscription"], first["seq"], first["dropped"]) == (
        answer["subscription"],
        1,
        0,
    )
    assert first["monotonic_s"] > answer["state"]["monotonic_s"]


@pytest.mark.parametrize("hz", [0.5, 20, 33, 200])
def test_the_rate_is_kept_over_time(hz: float) -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=hz)
    world.run(4.0)
    found = samples(client)
    assert len(found) == pytest.approx(4 * hz, abs=1)
    assert [s["seq"] for s in found] == list(range(1, len(found) + 1))
    assert not any(s["dropped"] for s in found)


def test_twenty_times_a_second_unless_asked_otherwise() -> None:
    world, client = found_world()
    client.result("state.subscribe")
    world.run(2.0)
    assert len(samples(client)) == 40


def test_only_the_chosen_fields_are_sent() -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=200, fields=["enabled", "position_rad"])
    world.tick()
    (sample,) = samples(client)
    assert set(sample["state"]) == {"enabled", "position_rad"}


def test_a_congested_client_misses_samples_and_is_told_how_many() -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=200)
    world.tick()
    client.session.congested = True
    world.run(0.05)
    assert [s["seq"] for s in samples(client)] == [1]
    client.session.congested = False
    world.tick()
    (sample,) = samples(client)
    assert (sample["seq"], sample["dropped"]) == (12, 10)


def test_a_sample_that_was_not_sent_in_its_period_is_dropped_and_counted() -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=200)
    service = world.service
    for _ in range(3):  # three ticks in which the transport has no time for samples
        world.now_s += 0.005
        service.after_tick(world.now_s)
    service.send_one()
    pending = service.pending
    assert not pending
    (sample,) = samples(client)
    assert (sample["seq"], sample["dropped"]) == (3, 2)


def test_a_sample_that_waits_shows_a_stop_that_came_meanwhile() -> None:
    world = World().start()
    client, other = world.client(), world.client()
    for watcher in (client, other):
        watcher.result("state.subscribe", hz=200, fields=["stop_generation"])
    world.now_s += 0.005
    world.service.after_tick(world.now_s)
    world.service.send_one()
    world.client().send("stop")
    world.service.send_one()
    assert samples(client)[0]["state"] == {"stop_generation": 0}
    assert samples(other)[0]["state"] == {"stop_generation": 1}


def test_the_same_choice_is_encoded_once_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World().start()
    clients = [world.client() for _ in range(20)]
    for client in clients:
        client.result("state.subscribe", hz=200, fields=["position_rad"])
    encoded: list[object] = []

    def counted(value: object) -> bytes:
        encoded.append(value)
        return encode(value)

    monkeypatch.setattr("litegripd.rpc.subscriptions.encode", counted)
    world.tick()
    assert sum(isinstance(value, dict) for value in encoded) == 1
    assert {len(samples(client)) for client in clients} == {1}


def test_a_connection_has_a_limited_number_of_subscriptions() -> None:
    world = World().start()
    client, other = world.client(), world.client()
    numbers = [client.result("state.subscribe")["subscription"] for _ in range(MAX_PER_SESSION)]
    error = client.call("state.subscribe")["error"]
    assert error["data"]["reason"] == "too_many_requests"
    assert error["data"]["limit"] == MAX_PER_SESSION
    other.result("state.subscribe")
    client.result("state.unsubscribe", subscription=numbers[0])
    client.result("state.subscribe")


def test_only_the_own_subscription_can_be_ended() -> None:
    world = World().start()
    client, other = world.client(), world.client()
    number = client.result("state.subscribe", hz=200)["subscription"]
    assert other.refusal("state.unsubscribe", subscription=number) == "invalid_params"
    assert client.result("state.unsubscribe", subscription=number) == {"subscription": number}
    assert client.refusal("state.unsubscribe", subscription=number) == "invalid_params"
    samples(client)
    world.run(0.1)
    assert not samples(client)


def test_a_closed_connection_is_sent_nothing_more() -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=200)
    world.client().result("events.subscribe")
    world.now_s += 0.005
    world.service.after_tick(world.now_s)
    client.leave()
    assert world.service.pending
    world.service.send_one()
    world.run(0.1)
    assert not client.session.outgoing
    assert world.service.is_idle(client.session)


def test_a_higher_rate_than_the_control_rate_is_refused_with_the_limit() -> None:
    world = World().start()
    error = world.client().call("state.subscribe", hz=200.5)["error"]
    assert error["data"]["reason"] == "invalid_params"
    assert error["data"]["limit"] == 200


def test_the_fields_are_those_of_the_state() -> None:
    assert set(STATE_FIELDS) == set(GripperState.__dataclass_fields__)
