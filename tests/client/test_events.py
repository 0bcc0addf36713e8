import gc

import pytest

from litegrip_client import CommandError, ConnectError, Event, LiteGrip
from litegrip_client.line.connection import Connection
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import event, in_thread, sample, until_read


@pytest.fixture(autouse=True)
def _subscriptions(daemon: FakeDaemon) -> None:
    def subscribe(request: Request) -> None:
        recent = [event(None, seq, "stop") for seq in (40, 41)]
        request.reply({"subscription": 5, "state": STATE, "events": recent})
        for seq in (41, 42, 42, 44):
            event(request, seq)

    daemon.handlers["events.subscribe"] = subscribe
    daemon.handlers["events.unsubscribe"] = lambda request: {"subscription": 5}
    daemon.handlers["state.subscribe"] = lambda request: {"subscription": 5, "state": STATE}
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 5}


def test_events_are_those_from_the_begin_on(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    with gripper.events() as events:
        got = [next(events) for _ in range(2)]
        assert [(one.seq, one.kind) for one in events.recent] == [(40, "stop"), (41, "stop")]
    assert got == [
        Event(42, 4.2, "job_ended", "the job ended", {"job": 42}),
        Event(44, 4.4, "job_ended", "the job ended", {"job": 44}),
    ]
    assert daemon.requests[1].params == {}
    assert daemon.requests[2].params == {"subscription": 5}
    assert daemon.methods() == ["hello", "events.subscribe", "events.unsubscribe"]
    assert list(events) == []


def test_kinds_are_named_in_a_list(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    with gripper.events(("stop", "lease_lost")) as events:
        assert next(events).seq == 42
    assert daemon.requests[1].params == {"kinds": ["stop", "lease_lost"]}
    with pytest.raises(CommandError, match="kinds is the text 'stop'"):
        gripper.events("stop")


def test_events_and_states_may_have_the_same_number(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    with gripper.states() as states, gripper.events() as events:
        sample(daemon.requests[1], 1)
        assert [next(states).seq for _ in range(2)] == [7, 1]
        assert [next(events).seq for _ in range(2)] == [42, 44]


def test_events_are_waited_for_however_long(daemon: FakeDaemon) -> None:
    with Connection(daemon.path) as connection, connection.subscribe_events() as events:
        assert [next(events).seq for _ in range(2)] == [42, 44]
        connection.timeout_s = 0.0
        waiting = in_thread(lambda: next(events))
        until_read(connection)
        event(daemon.requests[0], 45)
        assert waiting().seq == 45
        connection.timeout_s = 20.0


def test_a_daemon_that_ends_ends_the_events(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    with gripper.events() as events:
        assert [next(events).seq for _ in range(2)] == [42, 44]
        daemon.hang_up()
        with pytest.raises(ConnectError):
            next(events)


def test_a_subscription_that_nobody_has_any_more_is_ended(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    for state in gripper.states():
        assert state.mode == "holding"
        break
    for one in gripper.events():
        assert one.seq == 42
        break
    gc.collect()
    for method, send in (("state", sample), ("events", event)):
        (begin,) = daemon.wait_for(f"{method}.subscribe")
        for seq in (50, 51):
            send(begin, seq)
            gripper.get_state()
        assert daemon.methods().count(f"{method}.unsubscribe") == 1
