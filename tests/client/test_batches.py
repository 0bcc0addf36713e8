"""Samples that travel in batches: they come one by one, and what was lost is told."""

from typing import Any

import pytest

from litegrip_client import CommandError, GripperState, LiteGrip, aio
from litegrip_client.line.connection import Connection
from litegrip_client.line.feeds import StateSample
from litegrip_client.values.results import NEWER_FIELDS, STATE_FIELDS
from tests.client.aio_helpers import arrived, run
from tests.client.fake_daemon import STATE, FakeDaemon, Request

BATCH = 4


def batch(request: Request, seq: int, dropped: int = 0) -> None:
    """Send the samples up to `seq` of the subscription 5, which `request` began."""
    fields = request.params["fields"]
    states = [{**STATE, "seq": n, "monotonic_s": n / 10} for n in range(seq - BATCH + 1, seq + 1)]
    rows = [[state[name] for name in fields] for state in states]
    params = {"subscription": 5, "seq": seq, "dropped": dropped, "fields": fields, "rows": rows}
    request.notify("state.batch", params)


@pytest.fixture(autouse=True)
def _subscriptions(daemon: FakeDaemon) -> None:
    def subscribe(request: Request) -> None:
        request.reply({"subscription": 5, "state": STATE})
        for seq in (4, 8, 8, 4, 12):
            batch(request, seq)

    daemon.handlers["state.subscribe"] = subscribe
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 5}


def test_whole_states_come_one_by_one_and_none_twice(daemon: FakeDaemon) -> None:
    with (
        LiteGrip(socket_path=daemon.path) as gripper,
        gripper.states(200, batch=BATCH) as states,
    ):
        got = [next(states) for _ in range(13)]
    assert [one.seq for one in got] == [7, *range(1, 13)]
    assert all(isinstance(one, GripperState) for one in got)
    assert got[3] == GripperState.from_wire({**STATE, "seq": 3, "monotonic_s": 0.3})
    params = {"hz": 200.0, "batch": BATCH, "fields": list(STATE_FIELDS)}
    assert daemon.requests[2].params == params
    assert daemon.methods() == ["hello", "state.get", "state.subscribe", "state.unsubscribe"]


@pytest.mark.parametrize("kind", ["threads", "asyncio"])
def test_a_daemon_that_lacks_a_newer_field_is_not_asked_for_it(
    daemon: FakeDaemon, kind: str
) -> None:
    """It would refuse the whole subscription; the field is None in each state."""
    older = {name: value for name, value in STATE.items() if name != NEWER_FIELDS[-1]}
    daemon.handlers["state.get"] = lambda request: older

    def subscribe(request: Request) -> None:
        if set(request.params["fields"]) - set(older):
            request.fail("invalid_params", -32602)
            return
        request.reply({"subscription": 5, "state": older})
        batch(request, 4)

    daemon.handlers["state.subscribe"] = subscribe
    if kind == "threads":
        with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.states(200, batch=BATCH) as states,
        ):
            got = [next(states) for _ in range(5)]
    else:

        async def read() -> list[GripperState]:
            async with (
                aio.LiteGrip(socket_path=daemon.path) as gripper,
                gripper.states(200, batch=BATCH) as states,
            ):
                return [await anext(states) for _ in range(5)]

        got = run(read())
    assert [one.seq for one in got] == [7, 1, 2, 3, 4]
    assert all(getattr(one, NEWER_FIELDS[-1]) is None for one in got)


@pytest.mark.parametrize("fields", [["seq"], ["mode", "monotonic_s", "seq"]])
def test_fields_are_those_asked_for_and_no_other(daemon: FakeDaemon, fields: list[str]) -> None:
    with (
        LiteGrip(socket_path=daemon.path) as gripper,
        gripper.states(200, fields, BATCH) as states,
    ):
        got = [next(states) for _ in range(13)]
    assert [list(one) for one in got] == [fields] * 13
    assert [one["seq"] for one in got] == [STATE["seq"], *range(1, 13)]


def test_tasks_get_the_same(daemon: FakeDaemon) -> None:
    async def main() -> list[GripperState]:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            got = []
            async for state in gripper.states(200, batch=BATCH):
                got.append(state)
                if state.seq == 12:
                    break
            async with gripper.states(200, ["mode"], BATCH) as states:
                await states.__anext__()
                assert await states.__anext__() == {"mode": "holding"}
            return got

    assert [one.seq for one in run(main())] == [7, *range(1, 13)]


def test_a_sample_of_a_batch_is_told_as_any_other(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with connection.subscribe_state(200, ["seq"], BATCH) as samples:
        got = [next(samples) for _ in range(13)]
    assert got[0] == StateSample(None, 0, 100.0, {"seq": 7})
    assert got[1:] == [StateSample(n, 0, n / 10, {"seq": n}) for n in range(1, 13)]


def test_which_samples_are_missing_is_not_made_up(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with connection.subscribe_state(200, ["seq"], BATCH) as samples:
        for _ in range(13):
            next(samples)
        batch(daemon.requests[0], 18, dropped=2)
        batch(daemon.requests[0], 22, dropped=2)
        told = [(one.seq, one.dropped) for one in (next(samples) for _ in range(8))]
    lost = [(None, 2), (None, 2), (None, 2), (18, 2)]
    assert told == [*lost, (19, 2), (20, 2), (21, 2), (22, 2)]


def test_what_a_slow_reader_loses_here_is_told_as_well(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with connection.subscribe_state(200, ["seq"], BATCH) as samples:
        for _ in range(13):
            next(samples)
        for seq in range(16, 416, 4):
            batch(daemon.requests[0], seq, dropped=1)
        connection.call("state.get")
        got = [next(samples) for _ in range(256)]
    assert [one.state["seq"] for one in got] == list(range(412 - 255, 413))
    assert got[-1].dropped == 1 + 400 - 256


def test_what_a_slow_task_gets_is_new_and_never_less_than_a_batch(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with (
            aio.LiteGrip(socket_path=daemon.path) as gripper,
            gripper.states(5, ["seq"], BATCH) as states,
        ):
            (request,) = await arrived(daemon, "state.subscribe")
            for seq in range(16, 416, 4):
                batch(request, seq)
            await gripper.get_state()
            got = [(await states.__anext__())["seq"] for _ in range(2 * BATCH)]
            assert got == list(range(413 - 2 * BATCH, 413))

    run(main())


def test_one_that_nobody_has_any_more_is_ended(daemon: FakeDaemon, connection: Connection) -> None:
    samples = connection.subscribe_state(200, ["seq"], BATCH)
    next(samples)
    del samples
    batch(daemon.requests[0], 16)
    connection.call("state.get")
    assert daemon.wait_for("state.unsubscribe")[0].params == {"subscription": 5}


@pytest.mark.parametrize("size", [2.5, "4", True, None])
def test_what_is_no_size_is_refused_here(daemon: FakeDaemon, size: Any) -> None:
    with (
        LiteGrip(socket_path=daemon.path) as gripper,
        pytest.raises(CommandError, match=r"batch is .*, it must be a whole number"),
    ):
        gripper.states(200, batch=size)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(("hz", "size"), [(200, 0), (200, -3), (200, 10**30), (0, 4), (0, 1)])
def test_what_is_out_of_range_is_refused_by_the_daemon(
    daemon: FakeDaemon, hz: float, size: int
) -> None:
    daemon.handlers["state.subscribe"] = lambda request: request.fail("invalid_params", -32602)
    with LiteGrip(socket_path=daemon.path) as gripper:
        with pytest.raises(CommandError) as caught:
            gripper.states(hz, batch=size)
        assert caught.value.reason == "invalid_params"
    assert daemon.requests[-1].params.get("batch", 1) == size
