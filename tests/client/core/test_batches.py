"""Samples that travel in batches: they come one by one, and what was lost is told."""

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from litegrip_client import CommandError, GripperState, LiteGrip, aio
from litegrip_client.line.connection import Connection
from litegrip_client.line.feeds import StateSample
from litegrip_client.threads.blocking import connect
from litegrip_client.values.results import NEWER_FIELDS, STATE_FIELDS
from tests.client.rig import Asked, Asyncio, Bench, Heard, Refuse

BATCH = 4


@pytest.fixture
def state(site: Bench, daemon: Heard) -> dict[str, Any]:
    """Have the daemon send batches again, of which it would send none; return its first state."""
    state = {**daemon.wire_state, "seq": 7}

    def subscribe(request: Asked) -> Any:
        if set(request.params["fields"]) - set(state):
            return Refuse("invalid_params", -32602)
        for seq in (4, 8, 8, 4, 12):
            site.after(0.0, lambda seq=seq: send(daemon, state, seq))  # type: ignore[misc]
        return {"subscription": 5, "state": state}

    daemon.instead["state.subscribe"] = subscribe
    daemon.instead["state.unsubscribe"] = {"subscription": 5}
    return state


def send(daemon: Heard, state: dict[str, Any], seq: int, dropped: int = 0) -> None:
    """Put the samples up to `seq` in the daemon's mouth."""
    fields = daemon.asked("state.subscribe")[-1]["fields"]
    states = [{**state, "seq": n, "monotonic_s": n / 10} for n in range(seq - BATCH + 1, seq + 1)]
    rows = [[one[name] for name in fields] for one in states]
    own = {"subscription": 5, "seq": seq, "dropped": dropped}
    daemon.streams[-1].say("state.batch", {**own, "fields": fields, "rows": rows})


@pytest.fixture
def connection(state: dict[str, Any]) -> Iterator[Connection]:
    with connect("can0") as connection:
        yield connection


def test_the_daemons_own_batches_come_one_by_one(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    began_s = site.now_s
    with gripper.states(200, batch=BATCH) as states:
        got = [next(states) for _ in range(9)]
    assert site.now_s - began_s == pytest.approx(0.04, abs=0.006)
    times_s = [one.monotonic_s for one in got]
    assert times_s == sorted(set(times_s))


def test_whole_states_come_one_by_one_and_none_twice(
    daemon: Heard, gripper: LiteGrip, state: dict[str, Any]
) -> None:
    with gripper.states(200, batch=BATCH) as states:
        got = [next(states) for _ in range(13)]
    assert [one.seq for one in got] == [7, *range(1, 13)]
    assert got[3] == GripperState.from_wire({**state, "seq": 3, "monotonic_s": 0.3})
    asked = {"hz": 200.0, "batch": BATCH, "fields": list(STATE_FIELDS)}
    assert daemon.asked("state.subscribe") == [asked]
    assert daemon.methods() == ["hello", "state.get", "state.subscribe", "state.unsubscribe"]


def test_what_a_slow_reader_has_missed_is_counted(
    site: Bench, daemon: Heard, gripper: LiteGrip, state: dict[str, Any]
) -> None:
    with gripper.states(200, batch=BATCH) as states:
        assert (next(states).seq, states.dropped) == (7, 0)
        site.after(0.01, lambda: send(daemon, state, 60, dropped=44))
        seen = [(next(states).seq, states.dropped) for _ in range(12 + BATCH)]
    assert seen[11:] == [(12, 0), *((seq, 44) for seq in range(57, 61))]


def test_a_daemon_that_lacks_a_newer_field_is_not_asked_for_it(
    daemon: Heard, gripper: LiteGrip, state: dict[str, Any]
) -> None:
    """It would refuse the whole subscription; the field is None in each state."""
    del state[NEWER_FIELDS[-1]]
    daemon.instead["state.get"] = state
    with gripper.states(200, batch=BATCH) as states:
        got = [next(states) for _ in range(5)]
    assert [one.seq for one in got] == [7, 1, 2, 3, 4]
    assert all(getattr(one, NEWER_FIELDS[-1]) is None for one in got)


@pytest.mark.parametrize("fields", [["seq"], ["mode", "monotonic_s", "seq"]])
@pytest.mark.usefixtures("state")
def test_fields_are_those_asked_for_and_no_other(gripper: LiteGrip, fields: list[str]) -> None:
    with gripper.states(200, fields, BATCH) as states:
        got = [next(states) for _ in range(13)]
    assert [list(one) for one in got] == [fields] * 13
    assert [one["seq"] for one in got] == [7, *range(1, 13)]


def test_what_is_lost_is_told_and_which_samples_are_missing_is_not_made_up(
    daemon: Heard, connection: Connection, state: dict[str, Any]
) -> None:
    with connection.subscribe_state(200, ["seq"], BATCH) as samples:
        got = [next(samples) for _ in range(13)]
        send(daemon, state, 18, dropped=2)
        send(daemon, state, 22, dropped=2)
        told = [(one.seq, one.dropped) for one in (next(samples) for _ in range(8))]
    assert got[0] == StateSample(None, 0, state["monotonic_s"], {"seq": 7})
    assert got[1:] == [StateSample(n, 0, n / 10, {"seq": n}) for n in range(1, 13)]
    assert told == [*[(None, 2)] * 3, (18, 2), (19, 2), (20, 2), (21, 2), (22, 2)]


def test_what_a_slow_reader_loses_here_is_told_as_well(
    daemon: Heard, connection: Connection, state: dict[str, Any]
) -> None:
    with connection.subscribe_state(200, ["seq"], BATCH) as samples:
        for _ in range(13):
            next(samples)
        for seq in range(16, 416, 4):
            send(daemon, state, seq, dropped=1)
        connection.call("state.get")
        got = [next(samples) for _ in range(256)]
    assert [one.state["seq"] for one in got] == list(range(412 - 255, 413))
    assert got[-1].dropped == 1 + 400 - 256


def test_what_a_slow_task_gets_is_new_and_never_less_than_a_batch(
    daemon: Heard, tasks: Asyncio, state: dict[str, Any]
) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper, gripper.states(5, ["seq"], BATCH) as states:
            await asyncio.sleep(0.01)
            for seq in range(16, 416, 4):
                send(daemon, state, seq)
            await gripper.get_state()
            got = [(await states.__anext__())["seq"] for _ in range(2 * BATCH)]
            assert got == list(range(413 - 2 * BATCH, 413))

    tasks.run(main())


@pytest.mark.parametrize("size", [2.5, "4", True, None])
def test_what_is_no_size_is_refused_here(daemon: Heard, gripper: LiteGrip, size: Any) -> None:
    with pytest.raises(CommandError, match=r"batch is .*, it must be a whole number"):
        gripper.states(200, batch=size)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(("hz", "size"), [(200, 0), (200, -3), (200, 10**30), (0, 4), (0, 1)])
def test_what_is_out_of_range_is_refused_by_the_daemon(
    daemon: Heard, gripper: LiteGrip, hz: float, size: int
) -> None:
    with pytest.raises(CommandError) as caught:
        gripper.states(hz, batch=size).__enter__()
    assert caught.value.reason == "invalid_params"
    assert daemon.requests[-1].params.get("batch", 1) == size
