"""What the tests of the client on asyncio need: an event loop that leaves nothing behind."""

import asyncio
import gc
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, TypeVar

from litegrip_client.aio import LiteGrip
from tests.client.fake_daemon import DEADLINE_S, FakeDaemon, Request

_Result = TypeVar("_Result")


def run(main: Coroutine[Any, Any, _Result]) -> _Result:
    """Run `main` in debug mode; fail for tasks that it leaves, and for errors of callbacks."""
    complaints: list[dict[str, Any]] = []

    async def watched() -> _Result:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: complaints.append(context))
        loop.slow_callback_duration = DEADLINE_S  # the machine may be busy with something else
        task = loop.create_task(main)
        done, _ = await asyncio.wait([task], timeout=DEADLINE_S)
        assert done
        result = task.result()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left
        return result

    try:
        return asyncio.run(watched(), debug=True)
    finally:
        gc.collect()  # what warns of being left behind does so now, which is an error
        assert not complaints


def with_gripper(daemon: FakeDaemon, use: Callable[[LiteGrip], Awaitable[Any]]) -> Any:
    """Return what comes of using a gripper of that daemon."""

    async def main() -> Any:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            return await use(gripper)

    return run(main())


async def arrived(daemon: FakeDaemon, method: str, count: int = 1) -> list[Request]:
    """Wait until `count` requests of `method` came; the event loop goes on meanwhile."""
    return await asyncio.to_thread(daemon.wait_for, method, count)


async def cancel(task: "asyncio.Task[Any]") -> None:
    """Cancel a task, and wait until it has ended by that."""
    task.cancel()
    await asyncio.wait([task], timeout=DEADLINE_S)
    assert task.cancelled()
