import asyncio
from typing import Any

import pytest

from litegrip_client import ConnectError, StoppedError
from litegrip_client.aio import LiteGrip, SetpointStream
from tests.client.aio_helpers import run
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.helpers import Clock

pytestmark = pytest.mark.usefixtures("jobs")


async def keep_sending(stream: SetpointStream) -> None:
    while True:
        await stream.set_target(10.0)


def test_a_refusal_of_a_later_one_is_raised_and_the_next_knows_of_it(
    daemon: FakeDaemon, clock: Clock, jobs: list[int]
) -> None:
    begin = daemon.handlers["stream.set"]

    def handle(request: Request) -> Any:
        if request.identity is None:
            refusal = {"reason": "stopped", "message": "no", "data": {"stop_generation": 8}}
            request.notify("stream.refused", refusal)
        return begin(request)

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.stream() as stream:
            with pytest.raises(StoppedError):
                await keep_sending(stream)
            await stream.set_target(10.0)

    daemon.handlers["stream.set"] = handle
    run(main())
    assert jobs == [11, 12]
    assert daemon.requests[-2].params["stop_generation"] == 8


def test_a_task_that_only_sends_leaves_others_their_turn(daemon: FakeDaemon, clock: Clock) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.stream() as stream:
            sending = asyncio.create_task(keep_sending(stream))
            for _ in range(10):
                assert (await gripper.get_state()).openness == 0.5
            daemon.hang_up()
            with pytest.raises(ConnectError):
                await sending

    run(main())
