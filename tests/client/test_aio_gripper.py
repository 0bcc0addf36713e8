import asyncio
import inspect
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

import litegrip_client
from litegrip_client import (
    CommandError,
    ConnectError,
    ProtocolError,
    StoppedError,
    aio,
)
from litegrip_client.aio import LiteGrip
from litegrip_client.line.feeds import EventSubscription, Subscription
from litegrip_client.threads.actions import BlockingGripper, Lease
from litegrip_client.threads.sdk_gripper import SdkGripper
from litegripd.model.sentence import method_name, with_terms
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon

METHODS_HERE = {"config", "mount"}
"""Properties of the other client that ask the daemon."""


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def parameters(function: Any) -> list[tuple[str, Any, Any, str]]:
    return [
        (one.name, one.kind, one.default, one.annotation)
        for one in inspect.signature(function).parameters.values()
    ]


def test_names_and_parameters_are_those_of_the_other_client() -> None:
    only_in_threads = public(SdkGripper) - public(BlockingGripper)
    assert public(LiteGrip) == public(litegrip_client.LiteGrip) - only_in_threads
    for name in public(LiteGrip):
        here = inspect.getattr_static(LiteGrip, name)
        there = inspect.getattr_static(litegrip_client.LiteGrip, name)
        if name in METHODS_HERE:
            assert inspect.iscoroutinefunction(here)
            assert isinstance(there, property)
        else:
            assert type(here) is type(there), name
        if inspect.isfunction(here) and inspect.isfunction(there):
            assert parameters(here) == parameters(there), name
    assert [one[:3] for one in parameters(LiteGrip.__init__)] == [
        one[:3] for one in parameters(litegrip_client.LiteGrip.__init__)
    ]


@pytest.mark.parametrize(
    ("here", "there"),
    [
        (aio.ManualCalibration, litegrip_client.ManualCalibration),
        (aio.SetpointStream, litegrip_client.SetpointStream),
        (aio.Lease, Lease),
        (aio.Subscription, Subscription),
        (aio.EventSubscription, EventSubscription),
    ],
)
def test_what_comes_with_a_block_has_the_same_names(here: type, there: type) -> None:
    assert public(here) == public(there)
    for one in public(here):
        if inspect.isfunction(getattr(here, one)):
            assert parameters(getattr(here, one)) == parameters(getattr(there, one))


# Connection


def test_what_is_not_the_gripper_is_refused_and_leaves_no_connection(daemon: FakeDaemon) -> None:
    async def main() -> None:
        with pytest.raises(CommandError, match="has can_id 0x08, not 0x09"):
            await LiteGrip("can0", 0x09, socket_path=daemon.path).connect()
        with pytest.raises(CommandError, match="has channel can0, not can1"):
            await LiteGrip("can1", socket_path=daemon.path).connect()
        daemon.handlers["hello"] = lambda request: {**HELLO, "protocol": 2}
        gripper = LiteGrip(socket_path=daemon.path)
        with pytest.raises(ProtocolError, match="speaks protocol 2"):
            await gripper.connect()
        assert not gripper.is_connected

    run(main())


def test_a_cancelled_connecting_leaves_nothing(daemon: FakeDaemon) -> None:
    async def main() -> None:
        gripper = LiteGrip(socket_path=daemon.path)
        connecting = asyncio.create_task(gripper.connect())
        await arrived(daemon, "hello")
        await cancel(connecting)
        assert not gripper.is_connected

    del daemon.handlers["hello"]
    run(main())


def test_tasks_that_connect_at_once_share_the_first_connection(daemon: FakeDaemon) -> None:
    async def main() -> None:
        gripper = LiteGrip(socket_path=daemon.path)
        tasks = [asyncio.create_task(gripper.connect()) for _ in range(2)]
        for hello in await arrived(daemon, "hello", 2):
            hello.reply(HELLO)
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            wires.append(gripper._session.wire)
        await asyncio.gather(*tasks)
        wires.append(gripper._session.wire)
        await gripper.get_state()
        await gripper.disconnect()

    wires: list[object] = []
    del daemon.handlers["hello"]
    run(main())
    assert wires[0] is wires[1] is wires[2]


def test_nobody_sees_the_connection_before_the_mount_is_loaded(daemon: FakeDaemon) -> None:
    async def main() -> None:
        gripper = LiteGrip(mount="reverse", socket_path=daemon.path)
        connecting = asyncio.create_task(gripper.connect())
        (loading,) = await arrived(daemon, "calibration.load")
        assert loading.params["template"] == "reverse"
        assert not gripper.is_connected
        loading.fail("calibration_unreadable", -32010)
        with pytest.raises(CommandError):
            await connecting
        assert not gripper.is_connected

    run(main())


def test_a_daemon_that_went_is_noticed_and_connecting_again_works(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            daemon.requests[0].hang_up()
            while gripper.is_connected:
                await asyncio.sleep(0)
            with pytest.raises(ConnectError):
                await gripper.get_state()
            await gripper.connect()
            assert (await gripper.get_state()).openness == 0.5

    run(main())


# Enabling, and what the end does

ENABLED = ["hello", "lease.acquire", "motor.enable"]


async def break_off(daemon: FakeDaemon) -> None:
    async with LiteGrip(socket_path=daemon.path) as gripper:
        await gripper.enable()
        raise ZeroDivisionError


def test_leaving_by_a_cancelling_disables_too(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async def stay() -> None:
            async with LiteGrip(socket_path=daemon.path) as gripper:
                await gripper.enable()
                enabled.set()
                await asyncio.Event().wait()

        enabled = asyncio.Event()
        staying = asyncio.create_task(stay())
        await enabled.wait()
        await cancel(staying)

    run(main())
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def test_a_cancelled_enable_may_have_enabled(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            enabling = asyncio.create_task(gripper.enable())
            await arrived(daemon, "motor.enable")
            await cancel(enabling)

    del daemon.handlers["motor.enable"]
    run(main())
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def test_an_enable_that_is_refused_gives_the_lease_back(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            with pytest.raises(StoppedError):
                await gripper.enable()

    daemon.handlers["motor.enable"] = lambda request: request.fail("stopped", -32021)
    run(main())
    assert daemon.methods() == [*ENABLED, "lease.release"]


# The lease


def test_a_lease_of_several_tasks_is_given_back_by_the_last(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            first, second = gripper.lease("first"), gripper.lease("second")
            await first.__aenter__()
            await second.__aenter__()
            await first.__aexit__(None, None, None)
            assert "lease.release" not in daemon.methods()
            await second.__aexit__(None, None, None)
            assert daemon.methods()[-1] == "lease.release"
            async with gripper.lease():
                await gripper.enable()
            assert daemon.methods()[-1] == "motor.enable"

    run(main())
    assert daemon.methods()[-2:] == ["motor.disable", "lease.release"]


@pytest.mark.parametrize("answered", [False, True])
def test_a_lease_that_nobody_waits_for_any_more_is_given_back(
    daemon: FakeDaemon, answered: bool
) -> None:
    async def wait(gripper: LiteGrip) -> None:
        async with gripper.lease(wait_s=60):
            raise ZeroDivisionError

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            waiting = asyncio.create_task(wait(gripper))
            (acquiring,) = await arrived(daemon, "lease.acquire")
            granted = {"lease": "e:7", "number": 7, "state": STATE}
            if answered:
                (call,) = gripper._session.connection._router.calls.values()
                acquiring.reply(granted)
                while not call.answered:
                    await asyncio.sleep(0)
            await cancel(waiting)
            acquiring.reply(granted)
            (release,) = await arrived(daemon, "lease.release")
            assert release.params == {"lease": "e:7"}

    del daemon.handlers["lease.acquire"]
    run(main())
    assert daemon.methods().count("lease.release") == 1


def test_a_lease_that_comes_late_is_kept_for_who_wants_it_by_then(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            waiting = asyncio.create_task(gripper.lease(wait_s=60).__aenter__())
            (acquiring,) = await arrived(daemon, "lease.acquire")
            await cancel(waiting)
            daemon.handlers["lease.acquire"] = lambda request: {"lease": "e:7", "state": STATE}
            async with gripper.lease():
                acquiring.reply({"lease": "e:7", "state": STATE})
                await gripper.get_state()
                assert "lease.release" not in daemon.methods()

    del daemon.handlers["lease.acquire"]
    run(main())
    assert daemon.methods()[-1] == "lease.release"


def test_a_lease_of_an_earlier_connection_gives_nothing_back(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            async with gripper.lease():
                await gripper.disconnect()
                await gripper.connect()
            assert daemon.methods()[-1] == "hello"

    run(main())


# Stop, and reading


def test_a_stop_overtakes_a_motion(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            moving = asyncio.create_task(gripper.open())
            (motion,) = await arrived(daemon, "motion.open")
            assert (await gripper.software_stop("relax", why="smoke")).mode == "holding"
            assert daemon.requests[-1].params == {"level": "relax", "why": "smoke"}
            motion.fail("stopped", -32021, stop_generation=4)
            with pytest.raises(StoppedError):
                await moving
            assert (await gripper.clear_stop()).mode == "holding"
            await gripper.hold()
            assert daemon.requests[-1].params["stop_generation"] == 5

    daemon.handlers["stop"] = lambda request: {"generation": 4, "state": STATE}
    daemon.handlers["stop.clear"] = lambda request: {"generation": 5, "state": STATE}
    daemon.handlers["motion.hold"] = lambda request: {"state": STATE}
    run(main())


@pytest.mark.parametrize(
    ("read", "method", "answer", "expected"),
    [
        (lambda g: g.mount(), "state.get", STATE, "reverse"),
        (
            lambda g: g.health(),
            "health",
            with_terms({"verdict": "ok", "reasons": [method_name("motor.enable")]}),
            {"verdict": "ok", "reasons": ["gripper.enable()"]},
        ),
        (lambda g: g.info(), "info.get", {"version": "1"}, {"version": "1"}),
        (lambda g: g.jobs(), "job.list", {"jobs": []}, []),
        (lambda g: g.read_param(21), "motor.read_register", {"value": 12.5}, 12.5),
    ],
)
def test_reading(
    daemon: FakeDaemon,
    read: Callable[[LiteGrip], Awaitable[Any]],
    method: str,
    answer: Any,
    expected: Any,
) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            assert await read(gripper) == expected

    daemon.handlers[method] = lambda request: answer
    run(main())
