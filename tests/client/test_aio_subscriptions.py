import asyncio
import gc
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_client import CommandError, ConnectError, Event, GripperState
from litegrip_client.aio import LiteGrip
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import event, sample


@pytest.fixture(autouse=True)
def _subscriptions(daemon: FakeDaemon) -> None:
    def subscribe(request: Request) -> None:
        request.reply({"subscription": 5, "state": STATE})
        for seq in (1, 2, 2, 1, 3):
            sample(request, seq)

    def subscribe_to_events(request: Request) -> None:
        recent = [event(None, seq, "stop") for seq in (40, 41)]
        request.reply({"subscription": 5, "state": STATE, "events": recent})
        for seq in (41, 42, 42, 44):
            event(request, seq)

    daemon.handlers["state.subscribe"] = subscribe
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 5}
    daemon.handlers["events.subscribe"] = subscribe_to_events
    daemon.handlers["events.unsubscribe"] = lambda request: {"subscription": 5}


def flood(send: Callable[[Request, int], object], request: Request, numbers: range) -> None:
    for seq in numbers:
        send(request, seq)


# States


def test_the_present_state_comes_first_and_no_sample_twice(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            async with gripper.states(50) as states:
                got = [await states.__anext__() for _ in range(4)]
            assert daemon.requests[-1].params == {"subscription": 5}
            with pytest.raises(StopAsyncIteration):
                await states.__anext__()
            await states.close()
        assert [one.seq for one in got] == [7, 1, 2, 3]
        assert isinstance(got[0], GripperState)

    run(main())
    assert daemon.requests[1].params == {"hz": 50.0}
    assert daemon.methods() == ["hello", "state.subscribe", "state.unsubscribe"]


def test_fields_are_dictionaries_and_calls_between_them_lose_none(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            seen: list[int] = []
            async for one in gripper.states(50, ["seq"]):
                assert seen or list(one) == ["seq"]
                assert (await gripper.get_state()).mode == "holding"
                seen.append(one["seq"])
                if one["seq"] == 3:
                    break
            assert seen == [7, 1, 2, 3]

    run(main())
    assert daemon.requests[1].params == {"hz": 50.0, "fields": ["seq"]}


def test_leaving_the_iteration_ends_the_subscription(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            async for state in gripper.states():
                assert state.mode == "holding"
                break
            gc.collect()
            (request,) = await arrived(daemon, "state.subscribe")
            sample(request, 4)
            (ending,) = await arrived(daemon, "state.unsubscribe")
            assert ending.params == {"subscription": 5}
            sample(request, 5)
            await gripper.get_state()

    run(main())
    assert daemon.methods().count("state.unsubscribe") == 1


def test_what_a_slow_task_gets_is_new(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.states(20, ["seq"]) as states,
        ):
            (request,) = await arrived(daemon, "state.subscribe")
            await asyncio.to_thread(flood, sample, request, range(4, 501))
            await gripper.get_state()
            got = [(await states.__anext__())["seq"] for _ in range(10)]
            assert got == list(range(491, 501))

    run(main())


def test_closing_ends_the_iteration_of_another_task(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            states = gripper.states()
            seen: list[int] = []

            async def read() -> None:
                async for state in states:
                    seen.append(state.seq)
                    if state.seq == 3:
                        three.set()

            three = asyncio.Event()
            reading = asyncio.create_task(read())
            await three.wait()
            await states.close()
            await reading
            assert seen == [7, 1, 2, 3]

    run(main())


def test_several_tasks_may_share_a_subscription(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.states(50, ["seq"]) as states,
        ):
            got = await asyncio.gather(*(states.__anext__() for _ in range(4)))
            assert sorted(one["seq"] for one in got) == [1, 2, 3, 7]

    run(main())


def test_a_cancelled_subscription_is_ended_when_its_number_comes(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            waiting = asyncio.create_task(gripper.states().__aenter__())
            (request,) = await arrived(daemon, "state.subscribe")
            await cancel(waiting)
            request.reply({"subscription": 5, "state": STATE})
            (ending,) = await arrived(daemon, "state.unsubscribe")
            assert ending.params == {"subscription": 5}

    del daemon.handlers["state.subscribe"]
    run(main())


def test_an_iteration_that_was_cancelled_can_go_on(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.states(50, ["seq"]) as states,
        ):
            for _ in range(4):
                await states.__anext__()
            waiting = asyncio.create_task(states.__anext__())
            await asyncio.sleep(0)
            await cancel(waiting)
            sample(daemon.requests[1], 4)
            assert (await states.__anext__())["seq"] == 4

    run(main())


def test_silence_and_the_daemons_end_are_errors(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.states(200) as states:
            for _ in range(4):
                await states.__anext__()
            gripper._session.connection.timeout_s = 0.01
            with pytest.raises(ConnectError, match="did not answer with a state sample"):
                await states.__anext__()
            gripper._session.connection.timeout_s = 20.0
            waiting = asyncio.create_task(states.__anext__())
            await asyncio.sleep(0)
            daemon.hang_up()
            with pytest.raises(ConnectError, match="ended the connection"):
                await waiting

    run(main())


@pytest.mark.parametrize("names", ["mode", "stop"])
def test_a_text_is_no_list_of_names(daemon: FakeDaemon, names: Any) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            with pytest.raises(CommandError, match="must be a list of names"):
                gripper.states(20, names)
            with pytest.raises(CommandError, match="must be a list of names"):
                gripper.events(names)

    run(main())
    assert daemon.methods() == ["hello"]


def test_a_refused_subscription_raises(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            for states in (gripper.states(0), gripper.states(1000)):
                for _ in range(2):
                    with pytest.raises(CommandError):
                        await states.__anext__()
            assert await gripper.mount() == "reverse"

    daemon.handlers["state.subscribe"] = lambda request: request.fail("invalid_params", -32602)
    run(main())


# Events


def test_events_are_those_from_the_begin_on(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            async with gripper.events(["stop", "job_ended"]) as events:
                got = [await events.__anext__() for _ in range(2)]
                assert [one.seq for one in events.recent] == [40, 41]
            assert got == [
                Event(42, 4.2, "job_ended", "the job ended", {"job": 42}),
                Event(44, 4.4, "job_ended", "the job ended", {"job": 44}),
            ]

    run(main())
    assert daemon.requests[1].params == {"kinds": ["stop", "job_ended"]}
    assert daemon.methods() == ["hello", "events.subscribe", "events.unsubscribe"]


def test_events_and_states_may_have_the_same_number(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.events() as events,
            gripper.states() as states,
        ):
            assert [(await events.__anext__()).seq for _ in range(2)] == [42, 44]
            assert [(await states.__anext__()).seq for _ in range(4)] == [7, 1, 2, 3]

    run(main())
    assert daemon.requests[1].params == {}
    assert daemon.methods()[-2:] == ["state.unsubscribe", "events.unsubscribe"]


def test_events_may_be_long_in_coming(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            gripper._session.connection.timeout_s = 0.01
            async with gripper.events() as events:
                for _ in range(2):
                    await events.__anext__()
                waiting = asyncio.create_task(events.__anext__())
                done, _ = await asyncio.wait([waiting], timeout=0.05)
                assert not done
                gripper._session.connection.timeout_s = 20.0
                event(daemon.requests[1], 45)
                assert (await waiting).seq == 45

    run(main())


def test_who_leaves_thousands_of_events_unread_gets_an_error(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.events() as events:
            (request,) = await arrived(daemon, "events.subscribe")
            await asyncio.to_thread(flood, event, request, range(45, 4200))
            await gripper.get_state()
            got = [(await events.__anext__()).seq for _ in range(4096)]
            assert got == [42, *range(44, 4139)]
            for _ in range(2):
                with pytest.raises(ConnectError, match="4096 are waiting") as caught:
                    await events.__anext__()
            assert caught.value.reason == "backlog_full"

    run(main())
