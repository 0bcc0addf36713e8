"""Samples of the state, alone and in batches: rate, sequence, and what a slow reader misses."""

from typing import Any

import pytest

from litegripd.control.snapshot import GripperState
from litegripd.rpc.jsonrpc import encode
from litegripd.rpc.methods.reading import STATE_FIELDS
from litegripd.rpc.subscriptions import MAX_BATCH, MAX_PER_SESSION
from tests.world import PERIOD_S, Client, World, enabled_world, found_world


def samples(client: Client) -> list[dict[str, Any]]:
    """Return what came as samples since the last call."""
    client.read()
    found = [m["params"] for m in client.notifications if m["method"] == "state.sample"]
    client.notifications.clear()
    return found


def subscribed(world: World, **params: Any) -> Client:
    """Let a client subscribe to the state."""
    client = world.client()
    client.result("state.subscribe", **params)
    return client


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
    world = World().start()
    client = subscribed(world, hz=hz)
    world.run(4.0)
    found = samples(client)
    assert len(found) == pytest.approx(4 * hz, abs=1)
    assert [s["seq"] for s in found] == list(range(1, len(found) + 1))
    assert not any(s["dropped"] for s in found)


def test_twenty_times_a_second_unless_asked_otherwise() -> None:
    world = World().start()
    client = subscribed(world)
    world.run(2.0)
    assert len(samples(client)) == 40


def test_only_the_chosen_fields_are_sent() -> None:
    world = World().start()
    client = subscribed(world, hz=200, fields=["enabled", "position_rad"])
    world.tick()
    (sample,) = samples(client)
    assert set(sample["state"]) == {"enabled", "position_rad"}


def test_a_congested_client_misses_samples_and_is_told_how_many() -> None:
    world = World().start()
    client = subscribed(world, hz=200)
    world.tick()
    client.session.congested = True
    world.run(0.05)
    assert [s["seq"] for s in samples(client)] == [1]
    client.session.congested = False
    world.tick()
    (sample,) = samples(client)
    assert (sample["seq"], sample["dropped"]) == (12, 10)


def test_a_sample_that_was_not_sent_in_its_period_is_dropped_and_counted() -> None:
    world = World().start()
    client = subscribed(world, hz=200)
    service = world.service
    for _ in range(3):  # three ticks in which the transport has no time for samples
        world.now_s += PERIOD_S
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
    world.now_s += PERIOD_S
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
    data = client.refused("state.subscribe", "too_many_requests")
    assert data["limit"] == MAX_PER_SESSION
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
    world = World().start()
    client = subscribed(world, hz=200)
    world.client().result("events.subscribe")
    world.now_s += PERIOD_S
    world.service.after_tick(world.now_s)
    client.leave()
    assert world.service.pending
    world.service.send_one()
    world.run(0.1)
    assert not client.session.outgoing
    assert world.service.is_idle(client.session)


def test_a_higher_rate_than_the_control_rate_is_refused_with_the_limit() -> None:
    world = World().start()
    data = world.client().refused("state.subscribe", "invalid_params", hz=200.5)
    assert data["limit"] == 200


def test_the_fields_are_those_of_the_state() -> None:
    assert set(STATE_FIELDS) == set(GripperState.__dataclass_fields__)


# Batches: rows of the chosen fields


FIELDS = ["monotonic_s", "seq", "position_rad"]


def batches(client: Client) -> list[dict[str, Any]]:
    """Return what came as batches since the last call; nothing else may have come."""
    client.read()
    assert {message["method"] for message in client.notifications} <= {"state.batch"}
    found = [message["params"] for message in client.notifications]
    client.notifications.clear()
    return found


def column(found: list[dict[str, Any]], name: str) -> list[Any]:
    """Return the values of one field in all rows."""
    return [row[batch["fields"].index(name)] for batch in found for row in batch["rows"]]


def test_a_batch_has_a_header_and_a_row_for_each_sample() -> None:
    world, client = found_world()
    answer = client.result("state.subscribe", hz=200, batch=10, fields=FIELDS)
    assert set(answer["state"]) == set(STATE_FIELDS)
    world.run(9 * PERIOD_S)
    assert batches(client) == []
    world.tick()
    (batch,) = batches(client)
    assert set(batch) == {"subscription", "seq", "dropped", "fields", "rows"}
    assert batch["subscription"] == answer["subscription"]
    assert (batch["seq"], batch["dropped"], batch["fields"]) == (10, 0, FIELDS)
    assert len(batch["rows"]) == 10
    ticks = column([batch], "seq")
    assert ticks == list(range(ticks[0], ticks[0] + 10))
    assert ticks[-1] == world.state.seq
    assert column([batch], "monotonic_s")[-1] == pytest.approx(world.now_s)


@pytest.mark.parametrize("hz", [200, 100, 50])
@pytest.mark.parametrize("after_s", [0.0, 0.2 * PERIOD_S, 0.9 * PERIOD_S])
def test_no_sample_is_missing_after_the_state_of_the_answer(hz: float, after_s: float) -> None:
    """A request comes at any time of a period; ticks come a little early or late."""
    world, client = found_world()
    world.now_s += after_s
    first = client.result("state.subscribe", hz=hz, batch=2, fields=FIELDS)["state"]["seq"]
    world.now_s -= after_s
    for number in range(16):
        world.tick_after(PERIOD_S + (-1) ** number * 0.1 * PERIOD_S)
    ticks = column(batches(client), "seq")
    assert ticks[:2] == [first + 200 // hz, first + 2 * 200 // hz]


@pytest.mark.parametrize(("hz", "size"), [(200, 2), (200, MAX_BATCH), (50, 7), (33, 3)])
def test_no_sample_is_missing_between_batches(hz: float, size: int) -> None:
    world = World().start()
    client = subscribed(world, hz=hz, batch=size, fields=FIELDS)
    world.run(4.0)
    found = batches(client)
    assert len(found) == pytest.approx(4.0 * hz / size, abs=1)
    assert [batch["seq"] for batch in found] == [size * (n + 1) for n in range(len(found))]
    assert {len(batch["rows"]) for batch in found} == {size}
    stamps = column(found, "monotonic_s")
    mean_s = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    assert mean_s == pytest.approx(1.0 / hz, rel=0.01)


def test_the_rows_hold_the_same_values_as_samples() -> None:
    world, mover = enabled_world()
    fields = [name for name in STATE_FIELDS if name != "monotonic_s"]
    one = subscribed(world, hz=200, fields=fields)
    many = subscribed(world, hz=200, fields=fields, batch=5)
    mover.send("motion.open")
    world.run(0.1)
    mover.send("stop", why="a test")
    world.run(0.1)
    one.read()
    samples = [message["params"]["state"] for message in one.notifications]
    found = batches(many)
    rows = [
        dict(zip(batch["fields"], row, strict=True)) for batch in found for row in batch["rows"]
    ]
    assert rows == samples
    assert any(row["job"] for row in rows)
    assert rows[-1]["stop"]["why"] == "a test"


def test_a_batch_of_one_is_a_sample() -> None:
    world = World().start()
    client = subscribed(world, hz=200, batch=1)
    world.tick()
    client.read()
    (message,) = client.notifications
    assert message["method"] == "state.sample"
    assert set(message["params"]["state"]) == set(STATE_FIELDS)


def test_a_congested_client_misses_whole_batches_and_is_told_how_many_samples() -> None:
    world = World().start()
    client = subscribed(world, hz=200, batch=5, fields=FIELDS)
    world.run(3 * PERIOD_S)
    client.session.congested = True
    world.run(8 * PERIOD_S)  # two batches end meanwhile
    client.session.congested = False
    world.run(4 * PERIOD_S)
    (batch,) = batches(client)
    assert (batch["seq"], batch["dropped"], len(batch["rows"])) == (15, 10, 5)
    assert client.session.counters.dropped == 10


def test_congestion_that_ends_before_the_batch_does_costs_nothing() -> None:
    world = World().start()
    client = subscribed(world, hz=200, batch=5, fields=FIELDS)
    client.session.congested = True
    world.run(4 * PERIOD_S)
    client.session.congested = False
    world.tick()
    (batch,) = batches(client)
    assert (batch["seq"], batch["dropped"]) == (5, 0)


def test_a_row_that_was_not_taken_in_its_period_is_dropped_and_counted() -> None:
    world = World().start()
    client = subscribed(world, hz=200, batch=2, fields=FIELDS)
    service = world.service
    for _ in range(3):  # three ticks in which the transport has no time for samples
        world.now_s += PERIOD_S
        service.after_tick(world.now_s)
    service.send_one()
    world.tick()
    (batch,) = batches(client)
    assert (batch["seq"], batch["dropped"], len(batch["rows"])) == (4, 2, 2)


def test_a_whole_batch_that_was_not_sent_in_its_period_is_dropped_and_counted() -> None:
    world = World().start()
    client = subscribed(world, hz=200, batch=2, fields=FIELDS)
    world.tick()
    world.now_s += PERIOD_S
    world.service.after_tick(world.now_s)
    world.service.send_one()  # takes the second row; there is no time to send the batch
    world.run(2 * PERIOD_S)
    (batch,) = batches(client)
    assert (batch["seq"], batch["dropped"], len(batch["rows"])) == (4, 2, 2)


def test_the_same_choice_is_encoded_once_a_tick_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World().start()
    clients = [subscribed(world, hz=200, batch=4, fields=FIELDS) for _ in range(20)]
    encoded: list[object] = []

    def counted(value: object) -> bytes:
        encoded.append(value)
        return encode(value)

    monkeypatch.setattr("litegripd.rpc.subscriptions.encode", counted)
    world.run(4 * PERIOD_S)
    assert len(encoded) == 4
    assert {len(batches(client)) for client in clients} == {1}


def test_two_orders_of_the_same_fields_are_two_choices() -> None:
    world = World().start()
    one = subscribed(world, hz=200, batch=2, fields=["seq", "enabled"])
    other = subscribed(world, hz=200, batch=2, fields=["enabled", "seq"])
    world.run(2 * PERIOD_S)
    (first,), (second,) = batches(one), batches(other)
    assert second["fields"] == first["fields"][::-1]
    assert second["rows"] == [row[::-1] for row in first["rows"]]


def test_an_ended_subscription_sends_no_begun_batch() -> None:
    world, client = found_world()
    number = client.result("state.subscribe", hz=200, batch=3, fields=FIELDS)["subscription"]
    world.run(2 * PERIOD_S)
    client.result("state.unsubscribe", subscription=number)
    world.run(0.1)
    assert batches(client) == []


@pytest.mark.parametrize("params", [{"batch": 2}, {"batch": 2, "fields": []}])
def test_a_batch_needs_fields(params: dict[str, Any]) -> None:
    client = World().start().client()
    data = client.refused("state.subscribe", "invalid_params", **params)
    assert data["parameter"] == "fields"
    assert not client.session.subscriptions


@pytest.mark.parametrize("batch", [0, -1, MAX_BATCH + 1, 2.5, True, "2"])
def test_a_size_that_is_none_is_refused(batch: object) -> None:
    client = World().start().client()
    data = client.refused("state.subscribe", "invalid_params", batch=batch, fields=FIELDS)
    assert data["parameter"] == "batch"


def test_a_field_that_is_named_twice_is_refused() -> None:
    client = World().start().client()
    client.refused(
        "state.subscribe", "invalid_params", "seq twice", fields=["seq", "enabled", "seq"]
    )
