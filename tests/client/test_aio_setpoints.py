import asyncio
from typing import Any

import pytest

from litegrip_client import BusyError, CommandError, ConnectError, StoppedError
from litegrip_client.aio import LiteGrip, SetpointStream
from tests.client.aio_helpers import run
from tests.client.fake_daemon import MOVE, FakeDaemon, Request
from tests.client.helpers import Clock

pytestmark = pytest.mark.usefixtures("jobs")


def test_the_first_target_is_answered_and_the_others_are_not(
    daemon: FakeDaemon, clock: Clock
) -> None:
    async def main() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.stream(speed_mm_s=40, torque_nm=0.5) as stream,
        ):
            await stream.set_target(opening_mm=20)
            await stream.set_target(openness=0.25, torque_nm=0.3)

    run(main())
    _, first, second, cancelling = daemon.requests
    assert (first.identity is None, second.identity) == (False, None)
    assert first.params["opening_mm"] == 20.0
    assert (second.params["openness"], second.params["torque_nm"]) == (0.25, 0.3)
    for request in (first, second):
        assert (request.params["valid_s"], request.params["speed_mm_s"]) == (0.2, 40.0)
        assert request.params["stop_generation"] == 3
    assert (cancelling.method, cancelling.params) == ("job.cancel", {"job": 11})


def test_a_set_point_has_exactly_one_target(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.stream() as stream:
            with pytest.raises(CommandError, match="exactly one"):
                await stream.set_target(opening_mm=1.0, openness=0.5)

    run(main())
    assert daemon.methods() == ["hello"]


def test_after_a_pause_the_answer_is_awaited_again(
    daemon: FakeDaemon, clock: Clock, jobs: list[int]
) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.stream() as stream:
            for pause_s in (0.0, 0.09, 0.11):
                clock.now_s += pause_s
                await stream.set_target(20.0)

    run(main())
    assert jobs == [11, 12]
    assert daemon.requests[-1].params == {"job": 12}


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


def test_a_refusal_of_the_first_is_raised_at_once(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper, gripper.stream() as stream:
            with pytest.raises(BusyError):
                await stream.set_target(20.0)

    daemon.handlers["stream.set"] = lambda request: request.fail("busy", -32020)
    run(main())
    assert "job.cancel" not in daemon.methods()


def test_what_comes_after_frames_does_not_have_to_wait_for_them(
    daemon: FakeDaemon, clock: Clock
) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            assert await gripper.send_mit_frame(-0.6, 0.0, 100.0, 2.0, -2.0) is True
            await gripper.close()
            await gripper.send_mit_frame(-0.6, 0.0, 100.0, 2.0, 0.0)
            async with gripper.stream() as stream:
                await stream.set_target(20.0)
            with pytest.raises(CommandError, match="kp = 0 asks for a speed"):
                await gripper.send_mit_frame(0.0, 1.0, 0.0, 2.0, 0.0)

    daemon.handlers["motion.close"] = lambda request: MOVE
    run(main())
    assert (daemon.requests[1].params["position_rad"], daemon.requests[1].params["torque_nm"]) == (
        -0.6,
        2.0,
    )
    assert daemon.methods()[1:] == [
        *("stream.set", "job.cancel", "motion.close"),
        *("stream.set", "job.cancel", "stream.set", "job.cancel"),
    ]
