"""What is counted of each client, and the list of clients that all of them may see."""

from typing import Any

import pytest

from litegripd.rpc.sessions import Counters
from tests.rpc.raw import Raw, request
from tests.world import Client, World, enabled_world, found_world

MEMBERS = {
    "client",
    "pid",
    "uid",
    "program",
    "role",
    "connected_s",
    "requests",
    "refused",
    "bytes_in",
    "bytes_out",
    "dropped",
    "worst_latency_ms",
    "subscriptions",
    "waiting",
    "is_me",
}


def listed(world: World, client: Client) -> dict[str, Any]:
    """Return what another client is told about `client`."""
    clients = world.client().result("clients.list")["clients"]
    (found,) = [entry for entry in clients if entry["client"] == client.session.identity]
    assert set(found) == MEMBERS
    assert not found["is_me"]
    result: dict[str, Any] = found
    return result


def test_all_clients_are_listed_and_each_finds_itself() -> None:
    world = World().start()
    clients = [world.client() for _ in range(3)]
    for client in clients:
        entries = client.result("clients.list")["clients"]
        assert [entry["client"] for entry in entries] == [c.session.identity for c in clients]
        assert [entry["pid"] for entry in entries] == [c.session.peer.pid for c in clients]
        (me,) = [entry for entry in entries if entry["is_me"]]
        assert me["client"] == client.session.identity


def test_hello_tells_the_number_by_which_a_client_is_listed() -> None:
    world, client = found_world()
    number = client.result("hello", client='a "name"\\ ü')["client"]
    entry = listed(world, client)
    assert (entry["client"], entry["program"]) == (number, 'a "name"\\ ü')
    assert (entry["uid"], entry["role"]) == (client.session.peer.uid, client.session.role)


def test_who_has_gone_is_listed_no_more() -> None:
    world = World().start()
    client, other = world.client(), world.client()
    client.leave()
    entries = other.result("clients.list")["clients"]
    assert [entry["client"] for entry in entries] == [other.session.identity]


def test_the_time_since_the_connection_is_told() -> None:
    world, client = found_world()
    world.run(2.5)
    assert listed(world, client)["connected_s"] == pytest.approx(2.5)


def test_requests_and_those_that_were_refused_are_counted() -> None:
    world = World().start()
    raw = Raw(world)
    for line in (b"no JSON", request("no such method"), request("state.get", hz=1), b"[]"):
        raw.error(line)
    for _ in range(3):
        assert raw.is_alive()
    entry = listed(world, raw.client)
    assert (entry["requests"], entry["refused"]) == (7, 4)


def test_every_refused_set_point_is_counted_though_it_is_told_once() -> None:
    world = World().start()
    raw = Raw(world)
    line = b'{"jsonrpc":"2.0","method":"stream.set","params":{"openness":0.5}}'
    told = [message for _ in range(5) for message in raw.send(line)]
    assert [message["method"] for message in told] == ["stream.refused"]
    entry = listed(world, raw.client)
    assert (entry["requests"], entry["refused"]) == (5, 5)


def test_subscriptions_and_requests_that_wait_are_counted_while_they_last() -> None:
    world, client = enabled_world()
    number = client.result("state.subscribe")["subscription"]
    client.result("events.subscribe")
    motion = client.send("motion.open")
    entry = listed(world, client)
    assert (entry["subscriptions"], entry["waiting"]) == (2, 1)
    world.run_until(lambda: client.has_answer(motion))
    client.result("state.unsubscribe", subscription=number)
    entry = listed(world, client)
    assert (entry["subscriptions"], entry["waiting"]) == (1, 0)


def test_dropped_samples_of_all_subscriptions_are_counted() -> None:
    world, client = found_world()
    client.result("state.subscribe", hz=200)
    client.result("state.subscribe", hz=100)
    client.session.congested = True
    world.run(0.1)
    assert listed(world, client)["dropped"] == 30


def test_the_worst_latency_is_kept_and_told_in_milliseconds() -> None:
    world, client = found_world()
    assert listed(world, client)["worst_latency_ms"] is None
    for latency_s in (0.001, 0.0125, 0.003):
        client.session.counters.note_latency(latency_s)
    assert listed(world, client)["worst_latency_ms"] == 12.5


def test_a_latency_of_nothing_is_one() -> None:
    counters = Counters()
    counters.note_latency(0.0)
    assert counters.worst_latency_s == 0.0
