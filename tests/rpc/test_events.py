"""Events on the wire: numbered, in order, each to all who want its kind, and none lost."""

from collections import Counter
from typing import Any, get_args

import pytest

from litegripd.model.motor import UP, BusCondition
from litegripd.model.state import Event, EventKind
from litegripd.rpc.jsonrpc import encode
from litegripd.rpc.subscriptions import EVENT_KINDS, KEPT_EVENTS, KEPT_OF_KIND, MAX_PER_SESSION
from tests.motor.bench import everything, nothing
from tests.rpc.raw import Raw, request
from tests.world import PERIOD_S, Client, World, enabled_world

MEMBERS = {"subscription", "seq", "monotonic_s", "kind", "message", "data"}


def events(client: Client) -> list[dict[str, Any]]:
    """Return what came as events since the last call."""
    client.read()
    found = [m["params"] for m in client.notifications if m["method"] == "event"]
    client.notifications.clear()
    return found


def watching(world: World, **params: Any) -> Client:
    """Let a client subscribe to events."""
    client = world.client()
    client.result("events.subscribe", **params)
    events(client)
    return client


def send_all(world: World) -> None:
    """Let the transport have time between two ticks."""
    while world.service.pending:
        world.service.send_one()


def waits(world: World) -> bool:
    """True if anything waits to be sent."""
    return world.service.pending


def settled() -> World:
    """Make a world whose motor has been found, and in which nothing more happens by itself."""
    world = World().start()
    world.run(0.1)
    return world


def test_the_state_and_the_latest_events_come_first_and_then_what_happens() -> None:
    world = settled()
    actor, watcher = world.client(), world.client()
    actor.result("stop", why="before")
    watcher.send("events.subscribe")
    watcher.read()
    answer = watcher.answers[watcher.last_id]["result"]
    assert answer["state"]["stop"]["why"] == "before"
    assert answer["events"][-1]["kind"] == "stop"
    assert set(answer["events"][-1]) == MEMBERS - {"subscription"}
    actor.result("stop.clear")
    world.tick()
    (cleared,) = events(watcher)
    assert set(cleared) == MEMBERS
    assert cleared["subscription"] == answer["subscription"]
    assert (cleared["kind"], cleared["seq"]) == ("stop_cleared", answer["events"][-1]["seq"] + 1)


def test_a_motion_is_told_from_its_begin_to_its_end_at_the_times_at_which_it_was() -> None:
    world, mover = enabled_world()
    watcher = watching(world)
    began_s = world.now_s
    number = mover.result("motion.close")["job"]
    world.tick()
    started, ended = events(watcher)
    owner = mover.result("job.get", job=number)["owner"]
    assert started["kind"] == "job_started"
    assert started["data"] == {
        "job": number,
        "kind": "close",
        "client": owner["client"],
        "pid": owner["pid"],
        "detached": False,
    }
    assert ended["kind"] == "job_ended"
    assert ended["data"] == {"job": number, "state": "done", "reason": None}
    assert started["monotonic_s"] == began_s
    job = mover.result("job.get", job=number)
    assert ended["monotonic_s"] == pytest.approx(job["ended_s"], abs=PERIOD_S)


def test_events_tell_a_program_whose_the_lease_was_and_why_a_motion_ended() -> None:
    world = settled()
    mover, watcher = world.enabled(), watching(world)
    number = mover.result("lease.acquire")["number"]
    motion = mover.result("motion.open", wait=False)["job"]
    owner = mover.result("job.get", job=motion)["owner"]
    mine = {"client": owner["client"], "pid": owner["pid"]}
    lost = {**mine, "uid": owner["uid"], "cause": "connection", "why": None, "on_lost": "hold"}
    mover.result("job.cancel", job=motion)
    mover.result("lease.release")
    mover.result("lease.acquire")
    mover.leave()
    world.tick()
    told = [(event["kind"], event["data"]) for event in events(watcher)]
    assert ("lease", {**mine, "lease": number, "held": True}) in told
    assert ("lease", {**mine, "lease": number, "held": False, "by": owner}) in told
    assert ("job_ended", {"job": motion, "state": "cancelled", "reason": "cancelled"}) in told
    assert ("lease_lost", lost) in told


def test_every_event_comes_once_and_in_order_to_each_subscription() -> None:
    world = settled()
    actor = world.client()
    early = watching(world)
    for _ in range(5):
        actor.result("stop")
        actor.result("stop.clear")
    late = world.client()
    told = late.result("events.subscribe")["events"]
    for _ in range(5):
        actor.result("stop")
        actor.result("stop.clear")
    world.tick()
    first, second = events(early), events(late)
    assert [event["kind"] for event in first] == ["stop", "stop_cleared"] * 10
    sequences = [event["seq"] for event in first]
    assert sequences == list(range(sequences[0], sequences[0] + 20))
    assert [event["seq"] for event in told][-10:] == sequences[:10]
    assert [event["seq"] for event in second] == sequences[10:]


def test_what_waits_to_be_told_when_a_client_subscribes_comes_once() -> None:
    """It is in the answer, or it is a notification, never both and never neither."""
    world = settled()
    actor, early, late = world.client(), watching(world), world.client()
    actor.send("stop")
    world.service.send_one()  # a row of one event is begun, and told to the early client
    actor.send("stop.clear")
    told = late.result("events.subscribe")["events"]
    actor.send("stop")
    world.tick()
    assert [event["kind"] for event in told][-2:] == ["stop", "stop_cleared"]
    assert [event["kind"] for event in events(late)] == ["stop"]
    assert [event["kind"] for event in events(early)] == ["stop", "stop_cleared", "stop"]


def test_only_the_chosen_kinds_are_told_but_all_are_counted() -> None:
    world = settled()
    actor = world.client()
    client = world.client()
    told = client.result("events.subscribe", kinds=["stop_cleared"])["events"]
    assert told == []
    for _ in range(2):
        actor.result("stop")
        actor.result("stop.clear")
    world.tick()
    first, second = events(client)
    assert (first["kind"], second["kind"]) == ("stop_cleared", "stop_cleared")
    assert second["seq"] == first["seq"] + 2
    other = world.client().result("events.subscribe", kinds=["stop_cleared", "stop_cleared"])
    assert [event["seq"] for event in other["events"]] == [first["seq"], second["seq"]]


def test_refusals_are_told_only_to_who_asks_for_them() -> None:
    world = settled()
    plain, curious = watching(world), watching(world, kinds=["refused", "stop"])
    bad = world.client()
    bad.result("stop")
    assert bad.refusal("motion.open") == "stopped"
    world.tick()
    assert [event["kind"] for event in events(plain)] == ["stop"]
    stop, refused = events(curious)
    assert (stop["kind"], refused["kind"]) == ("stop", "refused")
    assert refused["seq"] == stop["seq"] + 1
    assert refused["data"]["reason"] == "stopped"
    assert bad.session.peer.program in refused["message"]
    assert not any(
        event["kind"] == "refused" for event in world.client().result("events.subscribe")["events"]
    )


def test_a_flood_of_refusals_neither_hides_the_latest_events_nor_is_lost_on_the_wire() -> None:
    world = settled()
    world.client().result("stop")
    curious, plain = watching(world, kinds=["refused"]), world.client()
    raw = Raw(world)
    for number in range(1000):
        raw.error(request("no such method", number))
        if number % 40 == 0:
            world.tick()
    world.tick()
    sequences = [event["seq"] for event in events(curious)]
    assert sequences == list(range(sequences[0], sequences[0] + 1000))
    assert plain.result("events.subscribe")["events"][-1]["kind"] == "stop"
    asked = world.client().result("events.subscribe", kinds=["refused"])["events"]
    assert [event["seq"] for event in asked] == sequences[-KEPT_EVENTS:]
    world.run(0.1)
    assert len(world.take_log()) < 200  # the log, unlike the wire, leaves some out


def test_the_latest_events_are_bounded_in_number_whatever_their_kinds() -> None:
    world = settled()
    actor = world.client()
    before = actor.result("events.subscribe")["events"]
    watcher = watching(world)
    for _ in range(KEPT_EVENTS):
        actor.result("stop")
        actor.result("stop.clear")
    world.tick()
    told = world.client().result("events.subscribe")["events"]
    after = [event["seq"] for event in events(watcher)]
    of_kinds = [event["seq"] for event in before if event["kind"] not in ("stop", "stop_cleared")]
    assert [event["seq"] for event in told] == of_kinds + after[-KEPT_EVENTS:]
    world.controller.events += [
        Event(kind, kind, {"client": 0})
        for kind in get_args(EventKind)
        for _ in range(2 * KEPT_EVENTS)
    ]
    world.tick()
    told = world.client().result("events.subscribe", kinds=EVENT_KINDS)["events"]
    sequences = [event["seq"] for event in told]
    assert sequences == sorted(set(sequences))
    assert Counter(event["kind"] for event in told) == {
        **dict.fromkeys(EVENT_KINDS, KEPT_OF_KIND),
        EVENT_KINDS[-1]: KEPT_EVENTS,
    }


def flap(world: World) -> list[Event]:
    """Unplug the adapter for a second, and plug it in again; return what was reported."""
    world.take_log()
    for condition in (BusCondition("adapter_gone", "there is no can0"), UP):
        world.condition = condition
        world.lose_to_motor = nothing if condition is UP else everything
        world.run(1.0)
    return world.take_log()


def test_a_day_of_flapping_hides_neither_a_stop_nor_what_was_let_go() -> None:
    """A plug that is loose for a day: who looks in the evening sees what happened at its begin."""
    world, actor = enabled_world()
    actor.result("motion.open")
    world.gripper.put_object(width_mm=40.0)
    actor.send("motion.grasp", force_n=10.0)
    world.run(2.0)
    flap(world)
    actor.result("stop", why="in the morning")
    one_flap = flap(world)
    assert {event.kind for event in one_flap} == {"bus", "motor"}
    for _ in range(round(86_400 / 30.0)):
        world.controller.events += one_flap
        world.tick()
    told = world.client().result("events.subscribe")["events"]
    of_kind = {event["kind"]: event for event in told}
    assert "in the morning" in of_kind["stop"]["message"]
    assert "released_by_fault" in of_kind
    assert [event["seq"] for event in told] == sorted(event["seq"] for event in told)
    assert len(told) < 2 * KEPT_EVENTS
    assert told[-1]["message"] == one_flap[-1].message


def test_what_a_refused_request_did_all_the_same_is_told_before_its_refusal() -> None:
    world = settled()
    watcher = watching(world, kinds=["stop", "refused"])
    assert world.client().refusal("stop", level="halt") == "invalid_params"
    world.tick()
    assert [event["kind"] for event in events(watcher)] == ["stop", "refused"]


def test_a_client_that_does_not_read_misses_no_event_only_samples() -> None:
    world = settled()
    client = watching(world)
    client.result("state.subscribe", hz=200)
    client.session.congested = True
    actor = world.client()
    for _ in range(20):
        actor.result("stop")
        actor.result("stop.clear")
        world.tick()
    client.read()
    methods = [message["method"] for message in client.notifications]
    assert methods == ["event"] * 40
    assert client.session.counters.dropped == 20


def test_events_and_samples_take_turns() -> None:
    world = settled()
    noisy = [watching(world, kinds=["refused"]) for _ in range(3)]
    sampled = [world.client() for _ in range(3)]
    for client in sampled:
        client.result("state.subscribe", hz=200)
    raw = Raw(world)
    world.now_s += PERIOD_S
    world.service.after_tick(world.now_s)
    for number in range(8):  # a refusal after each that is served: events never cease to wait
        raw.error(request("no such method", number))
        world.service.send_one()
        if number == 1:
            assert sum(bool(client.session.outgoing) for client in noisy) == 1
            assert sum(bool(client.session.outgoing) for client in sampled) == 1
    assert all(client.session.outgoing for client in sampled)
    send_all(world)
    assert [len(events(client)) for client in noisy] == [8, 8, 8]


def test_an_event_is_encoded_once_for_all_who_want_it(monkeypatch: pytest.MonkeyPatch) -> None:
    world = settled()
    watchers = [watching(world) for _ in range(20)]
    actor = world.client()
    encoded: list[object] = []

    def counted(value: object) -> bytes:
        encoded.append(value)
        return encode(value)

    monkeypatch.setattr("litegripd.rpc.subscriptions.encode", counted)
    actor.result("stop")
    world.tick()
    actor.refusal("motion.open")
    assert not waits(world)  # it is wanted by nobody
    assert [len(events(watcher)) for watcher in watchers] == [1] * 20
    assert len(encoded) == 1


def test_who_has_unsubscribed_or_is_gone_is_told_nothing_more() -> None:
    world = settled()
    client, other = world.client(), watching(world)
    number = client.result("events.subscribe")["subscription"]
    assert other.refusal("events.unsubscribe", subscription=number) == "invalid_params"
    assert client.refusal("state.unsubscribe", subscription=number) == "invalid_params"
    world.client().send("stop")
    world.service.send_one()  # tells one of the two
    assert waits(world)
    events(client)
    events(other)
    assert client.result("events.unsubscribe", subscription=number) == {"subscription": number}
    assert client.refusal("events.unsubscribe", subscription=number) == "invalid_params"
    other.leave()
    send_all(world)
    world.client().send("stop.clear")
    assert not waits(world)
    world.tick()
    assert events(client) == []
    assert events(other) == []
    assert world.service.is_idle(client.session)


@pytest.mark.parametrize("how", ["leave", "unsubscribe"])
def test_when_the_last_subscriber_is_gone_nothing_waits_to_be_told(how: str) -> None:
    world = settled()
    client = world.client()
    number = client.result("events.subscribe")["subscription"]
    world.client().send("stop")
    if how == "leave":
        client.leave()
    else:
        client.result("events.unsubscribe", subscription=number)
    send_all(world)
    world.client().send("stop.clear")
    assert not waits(world)


def test_subscriptions_to_state_and_events_share_numbers_and_bound() -> None:
    world = settled()
    client = world.client()
    numbers = [client.result("state.subscribe")["subscription"] for _ in range(3)]
    numbers += [
        client.result("events.subscribe")["subscription"] for _ in range(MAX_PER_SESSION - 3)
    ]
    assert len(set(numbers)) == MAX_PER_SESSION
    assert client.refusal("events.subscribe") == "too_many_requests"
    assert client.refusal("state.subscribe") == "too_many_requests"
    client.result("state.unsubscribe", subscription=numbers[0])
    client.result("events.subscribe")
    assert client.refusal("events.subscribe") == "too_many_requests"


@pytest.mark.parametrize("kinds", [[], ["stops"], "stop", [1]])
def test_kinds_that_are_none_are_refused(kinds: object) -> None:
    client = settled().client()
    data = client.refused("events.subscribe", "invalid_params", kinds=kinds)
    assert data["parameter"] == "kinds"
    assert not client.session.subscriptions


def test_the_loss_of_a_client_is_told_to_the_others() -> None:
    world, mover = enabled_world()
    watcher = watching(world)
    mover.send("motion.open")
    world.run(0.3)
    events(watcher)
    mover.leave()
    world.tick()
    assert {"job_ended", "client_lost"} <= {event["kind"] for event in events(watcher)}


def test_the_kinds_are_those_of_the_events() -> None:
    assert get_args(EventKind) == EVENT_KINDS
