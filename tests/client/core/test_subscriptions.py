"""Subscriptions to states and events: each item once, in order, until the end of any of the two."""

import asyncio
import gc
import re
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_client import CommandError, ConnectError, GripperState, LiteGrip, ParameterError, aio
from litegrip_client.line.feeds import StateSample
from litegrip_client.threads.blocking import connect
from tests.client.rig import Asked, Asyncio, Bench, Heard, Kind


def test_states_come_at_their_rate_the_present_one_first(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    began_s = site.now_s
    with gripper.states(50) as states:
        got = [next(states) for _ in range(5)]
        assert site.now_s - began_s == pytest.approx(0.08, abs=0.011)
    assert all(isinstance(one, GripperState) for one in got)
    assert [one.monotonic_s for one in got] == sorted({one.monotonic_s for one in got})
    begin, end = daemon.requests[1:]
    assert (begin.method, begin.params) == ("state.subscribe", {"hz": 50.0})
    assert (end.method, list(end.params)) == ("state.unsubscribe", ["subscription"])
    with pytest.raises(StopIteration):
        next(states)
    states.close()
    assert daemon.methods().count("state.unsubscribe") == 1


@pytest.mark.parametrize(
    ("subscribe", "call"),
    [(lambda g: g.states(50), "gripper.states()"), (lambda g: g.events(), "gripper.events()")],
)
def test_who_begins_to_iterate_after_the_end_is_told(
    gripper: LiteGrip, subscribe: Callable[[LiteGrip], Any], call: str
) -> None:
    with subscribe(gripper) as items:
        pass
    told = r"^no .* comes any more: the block of this subscription has ended, or it was closed$"
    with pytest.raises(ConnectError) as caught:
        list(items)
    assert re.match(told, caught.value.message)
    assert (caught.value.reason, caught.value.hint) == (
        "not_connected",
        f"begin a new one: {call}",
    )


def test_a_loop_that_runs_when_it_is_closed_ends_quietly(gripper: LiteGrip) -> None:
    seen = []
    with gripper.states(50) as states:
        for state in states:
            seen.append(state)
            if len(seen) == 3:
                states.close()
    assert len(seen) == 3


def test_fields_are_dictionaries_and_calls_between_them_lose_none(
    daemon: Heard, gripper: LiteGrip
) -> None:
    seen: list[int] = []
    for one in gripper.states(50, ["seq", "mode"]):
        assert list(one) == ["seq", "mode"]
        assert gripper.get_state().mode == one["mode"]
        seen.append(one["seq"])
        if len(seen) == 5:
            break
    assert len(set(seen)) == 5
    assert daemon.asked("state.subscribe") == [{"hz": 50.0, "fields": ["seq", "mode"]}]


@pytest.mark.parametrize(
    ("subscribe", "end"),
    [
        (lambda g: g.states(5, ["opening"]), "; did you mean 'opening_mm'?"),
        (lambda g: g.states(5, ["seq", "positon_rad"]), "; did you mean 'position_rad'?"),
        (lambda g: g.events(["job_end"]), "; did you mean 'job_ended'?"),
        (lambda g: g.events(["nothing_like_it"]), ", teleop"),
    ],
)
def test_a_wrong_field_or_kind_is_told_the_one_that_was_meant(
    gripper: LiteGrip, subscribe: Callable[[LiteGrip], Any], end: str
) -> None:
    with pytest.raises(CommandError, match="it must be one of: ") as caught, subscribe(gripper):
        pass
    assert caught.value.message.endswith(end)


@pytest.mark.parametrize(
    ("subscribe", "told"),
    [
        (lambda g: g.events(kinds="stop"), "kinds is the text 'stop'"),
        (lambda g: g.events(kinds=3), "kinds is 3"),
        (lambda g: g.events(["stop", 3]), "kinds has 3 in it"),
        (lambda g: g.states(10, 5), "fields is 5"),
        (lambda g: g.states(10, ["seq", [5]]), r"fields has \[5\] in it"),
    ],
)
def test_what_is_no_list_of_names_is_told_as_it_was_written(
    gripper: LiteGrip, subscribe: Callable[[LiteGrip], Any], told: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{told}, it must be a list of names$"):
        subscribe(gripper)


@pytest.mark.parametrize("subscribe", [lambda g: g.states(5000), lambda g: g.latest(5000)])
def test_too_high_a_rate_is_told_the_highest_at_once(
    gripper: LiteGrip, subscribe: Callable[[LiteGrip], Any]
) -> None:
    told = "^hz is 5000, it must be at most the control rate, 200 Hz$"
    with pytest.raises(ParameterError, match=told), subscribe(gripper):
        pass


def test_too_low_a_rate_is_told_with_its_unit(gripper: LiteGrip) -> None:
    told = r"^hz is 0, it must be at least 0.1 Hz$"
    with pytest.raises(ParameterError, match=told), gripper.states(0):
        pass


Subscribe = Callable[[LiteGrip], Any]
BOTH: dict[str, Subscribe] = {"state": lambda g: g.states(50), "events": lambda g: g.events()}


def scripted(site: Bench, daemon: Heard, *numbers: int) -> None:
    """Have the daemon send these samples, of which it would send none again."""

    def subscribe(_request: Asked) -> dict[str, Any]:
        def send() -> None:
            for seq in numbers:
                sample = {"seq": seq, "dropped": 0, "monotonic_s": seq / 10, "state": {"seq": seq}}
                daemon.streams[-1].say("state.sample", {"subscription": 5, **sample})

        site.after(0.0, send)
        return {"subscription": 5, "state": state}

    state = daemon.wire_state
    daemon.instead["state.subscribe"] = subscribe
    daemon.instead["events.subscribe"] = {"subscription": 5, "state": state, "events": []}
    for what in BOTH:
        daemon.instead[f"{what}.unsubscribe"] = {"subscription": 5}


EVENT = {"subscription": 5, "monotonic_s": 1.0, "kind": "stop", "message": "again", "data": {}}


def test_no_sample_comes_twice(site: Bench, daemon: Heard, gripper: LiteGrip) -> None:
    scripted(site, daemon, 1, 2, 2, 1, 3)
    with gripper.states(50, ["seq"]) as states:
        assert [next(states)["seq"] for _ in range(4)][1:] == [1, 2, 3]


def test_a_sample_of_a_raw_connection_has_its_number_and_its_time(
    site: Bench, daemon: Heard
) -> None:
    scripted(site, daemon, 1, 3)
    with connect("can0") as connection, connection.subscribe_state(50, ["seq"]) as samples:
        first, *others = [next(samples) for _ in range(3)]
    assert (first.seq, first.dropped, list(first.state)) == (None, 0, ["seq"])
    assert first.monotonic_s == pytest.approx(site.now_s, abs=0.1)
    assert others == [StateSample(1, 0, 0.1, {"seq": 1}), StateSample(3, 0, 0.3, {"seq": 3})]


def test_silence_is_an_error(site: Bench, daemon: Heard, gripper: LiteGrip) -> None:
    scripted(site, daemon)
    with gripper.states(2) as states:
        next(states)
        began_s = site.now_s
        with pytest.raises(ConnectError, match="did not answer with a state sample within 6 s"):
            next(states)
        assert site.now_s - began_s == pytest.approx(6.0, abs=0.02)


@pytest.mark.parametrize("what", BOTH)
def test_a_daemon_that_ends_ends_the_iteration_by_an_error(
    site: Bench, daemon: Heard, kind: Kind, what: str
) -> None:
    gripper = kind.gripper()
    gripper.connect()
    with BOTH[what](gripper) as items:
        site.after(0.1, daemon.hang_up)
        with pytest.raises(ConnectError, match="ended the connection") as caught:
            list(items)
        assert caught.value.hint == (
            f"{kind.awaits}gripper.connect() connects again, then: {kind.awaits}gripper.enable();"
            f" after that, begin again: gripper.{'states' if what == 'state' else 'events'}()"
        )
        assert caught.value.retryable
        with pytest.raises(ConnectError) as caught:
            next(iter(items))
        assert "gripper.connect() connects again" in str(caught.value)
        assert not caught.value.retryable


@pytest.mark.parametrize("within", ["events", "lease"])
def test_a_block_that_a_closed_connection_ends_says_nothing(
    daemon: Heard, tasks: Asyncio, within: str, caplog: pytest.LogCaptureFixture
) -> None:
    """As Ctrl-C in `examples/aio_watch.py`: one task's end closes what the other still uses."""

    async def watch(gripper: aio.LiteGrip) -> None:
        block: Any = gripper.events() if within == "events" else gripper.lease()
        async with block:
            await asyncio.sleep(9.0)

    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            task = asyncio.create_task(watch(gripper))
            await asyncio.sleep(0.1)
            daemon.late[f"{within}.unsubscribe"] = daemon.late[f"{within}.release"] = 1.0
            task.cancel()
            await asyncio.sleep(0.1)
        with pytest.raises(asyncio.CancelledError):
            await task

    tasks.run(main())
    assert {f"{within}.unsubscribe", f"{within}.release"} & set(daemon.methods())
    assert not caplog.records


@pytest.mark.parametrize("what", BOTH)
def test_an_interrupted_subscription_is_ended_when_its_number_comes(
    daemon: Heard, gripper: LiteGrip, kind: Kind, what: str
) -> None:
    daemon.late[f"{what}.subscribe"] = 0.1
    kind.interrupt(0.05)
    with pytest.raises(kind.interrupted):
        BOTH[what](gripper).__enter__()
    kind.pause(0.1)
    gripper.get_state()
    number = daemon.asked(f"{what}.unsubscribe")[0]["subscription"]
    assert number >= 0


def test_an_iteration_can_be_interrupted_and_go_on(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    with gripper.states(1) as states:
        first = next(states)
        kind.interrupt(0.5)
        with pytest.raises(kind.interrupted):
            next(states)
        second = next(states)
        assert second.monotonic_s - first.monotonic_s == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("what", "subscribe"), [*BOTH.items(), ("state", lambda g: g.states(50, ["seq"], batch=4))]
)
def test_a_subscription_that_nobody_has_any_more_is_ended(
    daemon: Heard, gripper: LiteGrip, kind: Kind, what: str, subscribe: Subscribe
) -> None:
    daemon.client().result("stop")
    subscribe(gripper).__enter__()
    gc.collect(1)
    other = daemon.client()
    for level in ("relax", "disable", "relax"):
        other.result("stop", level=level)
        kind.pause(0.1)
        gripper.get_state()
    assert daemon.methods().count(f"{what}.unsubscribe") == 1


@pytest.mark.parametrize("names", ["mode", "stop"])
def test_a_text_is_no_list_of_names(daemon: Heard, gripper: LiteGrip, names: Any) -> None:
    for call in (lambda: gripper.states(20, names), lambda: gripper.events(names)):
        with pytest.raises(CommandError, match=f"is the text '{names}', it must be a list of nam"):
            call()
    assert daemon.methods() == ["hello"]


def test_a_refused_subscription_raises(gripper: LiteGrip) -> None:
    for hz in (0, 1000):
        with pytest.raises(CommandError) as caught:
            gripper.states(hz).__enter__()
        assert caught.value.reason == "invalid_params"
    assert gripper.mount == "normal"


# Events


def test_events_are_those_from_the_begin_on(site: Bench, daemon: Heard, gripper: LiteGrip) -> None:
    other = daemon.client()
    other.result("stop", level="relax")
    site.after(5.5, lambda: other.send("stop", level="disable"))  # longer than any answer takes
    with gripper.events() as events:
        recent = list(events.recent)
        event = next(events)
        assert event.kind == "stop"
        assert event.monotonic_s == pytest.approx(site.now_s, abs=0.02)
    assert [one.kind for one in recent].count("stop") == 1
    assert event.seq > max(one.seq for one in recent)
    assert event.data["level"] == "disable"
    with pytest.raises(StopIteration):
        next(events)
    assert daemon.methods() == ["hello", "events.subscribe", "events.unsubscribe"]
    assert daemon.asked("events.subscribe") == [{}]


def test_kinds_are_named_in_a_list(site: Bench, daemon: Heard, gripper: LiteGrip) -> None:
    site.after(0.1, lambda: daemon.client().send("stop"))
    with gripper.events(("lease_lost", "stop")) as events:
        assert next(events).kind == "stop"
        assert events.recent == ()
    assert daemon.asked("events.subscribe") == [{"kinds": ["lease_lost", "stop"]}]


def test_a_field_that_only_whole_states_have_is_told_so(daemon: Heard, gripper: LiteGrip) -> None:
    told = "fields has 'timestamp' in it, which only whole states have: leave fields out"
    with pytest.raises(ParameterError, match=f"^{told}$"):
        gripper.states(50, fields=["opening_mm", "timestamp"])


def test_events_and_states_may_have_the_same_number(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    """And no event comes twice."""
    scripted(site, daemon, 1, 2)
    with gripper.states(50, ["seq"]) as states, gripper.events() as events:
        for seq in (7, 7, 9):
            daemon.streams[-1].say("event", {**EVENT, "seq": seq})
        assert [next(events).seq for _ in range(2)] == [7, 9]
        assert [next(states)["seq"] for _ in range(3)][1:] == [1, 2]


def test_who_leaves_thousands_of_events_unread_gets_an_error(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    scripted(site, daemon)
    with gripper.events() as events:
        for seq in range(4200):
            daemon.streams[-1].say("event", {**EVENT, "seq": seq})
        gripper.get_state()
        assert [next(events).seq for _ in range(4096)] == list(range(4096))
        for _ in range(2):
            with pytest.raises(ConnectError, match="4096 are waiting") as caught:
                next(events)
        assert caught.value.reason == "backlog_full"


def test_what_a_slow_reader_gets_is_new_and_what_it_missed_is_counted(
    site: Bench, gripper: LiteGrip, kind: Kind
) -> None:
    with gripper.states(20, ["monotonic_s"]) as states:
        next(states)
        for _ in range(2):
            kind.pause(1.5)
            ages_s = [site.now_s - next(states)["monotonic_s"] for _ in range(10)]
            assert ages_s == sorted(ages_s, reverse=True)
            assert 0.4 < ages_s[0] < 0.55
        assert states.dropped == pytest.approx(40, abs=4)


# Tasks beside each other


def test_closing_ends_the_iteration_of_another_task(daemon: Heard, tasks: Asyncio) -> None:
    async def main() -> None:
        async def read() -> int:
            return len([state async for state in states])

        async with aio.LiteGrip() as gripper:
            states = gripper.states(10)
            reading = asyncio.create_task(read())
            await asyncio.sleep(0.35)
            await states.close()
            assert await reading == 4

    tasks.run(main())


def test_several_tasks_may_share_a_subscription(daemon: Heard, tasks: Asyncio) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper, gripper.states(50, ["seq"]) as states:
            got = await asyncio.gather(*(states.__anext__() for _ in range(4)))
            assert len({one["seq"] for one in got}) == 4

    tasks.run(main())
