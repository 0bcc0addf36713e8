import asyncio
import os
from typing import Any

import pytest

from litegrip_client import (
    ConnectError,
    MoveProgress,
    StoppedError,
)
from litegrip_client.aio import LiteGrip
from tests.client.aio_helpers import arrived, cancel, with_gripper
from tests.client.fake_daemon import HELLO, MOVE, FakeDaemon, Request

# What a motion asks for is tested by the client for threads, which is made from the same core.


def test_progress_is_reported_while_other_tasks_go_on(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        seen: list[MoveProgress] = []
        moving = asyncio.create_task(gripper.open(progress=seen.append))
        (motion,) = await arrived(daemon, "motion.open")
        motion.progress(1)
        assert (await gripper.get_state()).openness == 0.5
        motion.progress(2)
        motion.reply(MOVE)
        assert await moving
        assert [one.i for one in seen] == [1, 2]
        assert seen[0] == MoveProgress("travel", 1, 10, 0.1, 0.2, 0.3)

    with_gripper(daemon, use)


# Cancelling


def job(number: int, state: str = "running", **owner: int) -> dict[str, Any]:
    return {"job": number, "kind": "open", "state": state, "owner": {"pid": os.getpid(), **owner}}


@pytest.fixture(autouse=True)
def _jobs(daemon: FakeDaemon) -> None:
    daemon.handlers["job.list"] = lambda request: {"jobs": [job(5, "done"), job(6)]}
    daemon.handlers["job.cancel"] = lambda request: job(request.params["job"], "cancelled")


def test_a_cancelled_task_cancels_its_motion_before_it_ends(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        await arrived(daemon, "motion.open")
        await cancel(moving)
        assert daemon.methods()[-2:] == ["job.list", "job.cancel"]
        assert daemon.requests[-1].params == {"job": 6}
        assert (await gripper.get_state()).mode == "holding"

    with_gripper(daemon, use)


def test_a_job_whose_number_is_known_needs_no_list(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        reported = asyncio.Event()
        moving = asyncio.create_task(gripper.grasp(progress=lambda progress: reported.set()))
        await reported.wait()
        await cancel(moving)
        assert daemon.methods()[-2:] == ["motion.grasp", "job.cancel"]
        assert daemon.requests[-1].params == {"job": 9}

    daemon.handlers["motion.grasp"] = lambda request: request.progress(job=9, phase="hold")
    with_gripper(daemon, use)


def test_a_timeout_cancels_the_motion(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(gripper.close(), 0.05)
        assert daemon.methods()[-1] == "job.cancel"

    with_gripper(daemon, use)


def test_being_cancelled_again_does_not_keep_it_from_cancelling(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        await arrived(daemon, "motion.open")
        moving.cancel()
        (listing,) = await arrived(daemon, "job.list")
        for _ in range(3):
            moving.cancel()
            await asyncio.sleep(0)
        assert not moving.done()
        listing.reply({"jobs": [job(6)]})
        (cancelling,) = await arrived(daemon, "job.cancel")
        moving.cancel()
        await asyncio.sleep(0)
        assert not moving.done()
        cancelling.reply(job(6, "cancelled"))
        await asyncio.wait([moving])
        assert moving.cancelled()

    del daemon.handlers["job.list"], daemon.handlers["job.cancel"]
    with_gripper(daemon, use)


def test_the_end_of_the_event_loop_cancels_the_motion(daemon: FakeDaemon) -> None:
    async def main() -> None:
        gripper = LiteGrip(socket_path=daemon.path)
        await gripper.connect()
        tasks.append(asyncio.create_task(move(gripper)))
        await arrived(daemon, "motion.open")

    async def move(gripper: LiteGrip) -> None:
        async with gripper:
            await gripper.open()

    tasks: list[asyncio.Task[None]] = []
    asyncio.run(main(), debug=True)
    assert tasks[0].cancelled()
    assert daemon.methods() == ["hello", "motion.open", "job.list", "job.cancel"]


def test_the_own_job_is_found_by_the_number_of_the_connection(daemon: FakeDaemon) -> None:
    """A process has several connections perhaps, or another pid in the daemon's view."""

    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        await arrived(daemon, "motion.open")
        await cancel(moving)
        assert daemon.requests[-1].params == {"job": 8}

    daemon.handlers["hello"] = lambda request: {**HELLO, "client": 71}
    jobs = [job(7, client=70), job(8, client=71, pid=1)]
    daemon.handlers["job.list"] = lambda request: {"jobs": jobs}
    with_gripper(daemon, use)


def test_a_motion_refused_while_cancelled_cancels_nobody_elses(daemon: FakeDaemon) -> None:
    def refuse_then_list(request: Request) -> Any:
        daemon.wait_for("motion.open")[0].fail("busy", -32020)
        return {"jobs": [job(7)]}  # of another task of this process

    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        await arrived(daemon, "motion.open")
        await cancel(moving)
        assert daemon.methods()[-1] == "job.list"

    daemon.handlers["job.list"] = refuse_then_list
    with_gripper(daemon, use)


def test_a_motion_that_ended_before_the_cancelling_is_not_cancelled(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        (motion,) = await arrived(daemon, "motion.open")
        router = gripper._session.connection._router
        (call,) = router.calls.values()
        motion.reply(MOVE)
        while not call.answered:
            await asyncio.sleep(0)
        assert not moving.done()  # its turn comes after this task's
        await cancel(moving)

    with_gripper(daemon, use)
    assert daemon.methods() == ["hello", "motion.open"]


def test_being_cancelled_while_an_error_is_dealt_with_is_not_forgotten(
    daemon: FakeDaemon,
) -> None:
    def fail(progress: MoveProgress) -> None:
        raise StoppedError("of the callback's own")

    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open(progress=fail))
        (cancelling,) = await arrived(daemon, "job.cancel")
        moving.cancel()
        await asyncio.sleep(0)
        cancelling.reply(job(9, "cancelled"))
        await asyncio.wait([moving])
        assert moving.cancelled()

    del daemon.handlers["job.cancel"]
    daemon.handlers["motion.open"] = lambda request: request.progress(job=9)
    with_gripper(daemon, use)


def test_the_end_of_the_daemon_ends_the_motion_and_cancels_nothing(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        moves = [asyncio.create_task(gripper.open()) for _ in range(3)]
        (motion, *_) = await arrived(daemon, "motion.open", 3)
        motion.hang_up()
        for move in moves:
            with pytest.raises(ConnectError):
                await move
        assert not gripper.is_connected

    with_gripper(daemon, use)
    assert "job.list" not in daemon.methods()
