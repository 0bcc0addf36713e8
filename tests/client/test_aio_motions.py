import asyncio
import os
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    ConnectError,
    GripperState,
    MoveProgress,
    MoveResult,
    StoppedError,
)
from litegrip_client.aio import LiteGrip
from tests.client.aio_helpers import arrived, cancel, with_gripper
from tests.client.fake_daemon import GRASP, HELLO, MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import last_params

# What is asked for, and what comes back


@pytest.mark.parametrize(
    ("move", "method", "sent"),
    [
        (lambda g: g.open(25), "motion.open", {"speed_mm_s": 25.0}),
        (lambda g: g.close(), "motion.close", {}),
        (lambda g: g.goto(30), "motion.move", {"opening_mm": 30.0, "duration_s": 1.0}),
        (lambda g: g.goto(30, duration=None), "motion.move", {"opening_mm": 30.0}),
        (lambda g: g.goto_rad(-0.5), "motion.move", {"position_rad": -0.5, "duration_s": 1.0}),
        (lambda g: g.goto_openness(0.5, 2), "motion.move", {"openness": 0.5, "duration_s": 2.0}),
        (
            lambda g: g.move_at_speed(30, 25),
            "motion.move",
            {"opening_mm": 30.0, "speed_mm_s": 25.0},
        ),
    ],
)
def test_a_motion_says_what_was_asked_and_returns_its_result(
    daemon: FakeDaemon,
    move: Callable[[LiteGrip], Awaitable[MoveResult]],
    method: str,
    sent: dict[str, float],
) -> None:
    async def use(gripper: LiteGrip) -> None:
        result = await move(gripper)
        assert isinstance(result, MoveResult)
        assert (bool(result), result.outcome) == (True, "pressed")
        assert last_params(daemon) == {**sent, "progress": True}

    daemon.handlers[method] = lambda request: MOVE
    with_gripper(daemon, use)


def test_a_grasp_until_the_verdict(daemon: FakeDaemon) -> None:
    async def use(gripper: LiteGrip) -> None:
        gripper.motion_config.grasp_speed_mm_s = 40.0
        result = await gripper.grasp(force_n=10, until="verdict")
        assert (bool(result), result.outcome, result.width_mm) == (True, "object_held", 31.5)
        assert last_params(daemon) == {
            "force_n": 10.0,
            "until": "verdict",
            "config": {"grasp_speed_mm_s": 40.0},
            "progress": True,
        }

    daemon.handlers["motion.grasp"] = lambda request: GRASP
    with_gripper(daemon, use)


@pytest.mark.parametrize(
    ("call", "method", "sent"),
    [
        (lambda g: g.set_force(12), "motion.set_force", {"force_n": 12.0}),
        (lambda g: g.zero_gravity(), "motion.zero_gravity", {}),
        (lambda g: g.zero_gravity(on=False), "motion.hold", {}),
        (lambda g: g.hold(), "motion.hold", {}),
    ],
)
def test_what_is_answered_at_once(
    daemon: FakeDaemon,
    call: Callable[[LiteGrip], Awaitable[GripperState]],
    method: str,
    sent: dict[str, float],
) -> None:
    async def use(gripper: LiteGrip) -> None:
        assert (await call(gripper)).mode == "holding"
        assert last_params(daemon) == sent
        daemon.handlers[method] = lambda request: request.fail("busy", -32020)
        with pytest.raises(BusyError):
            await call(gripper)

    daemon.handlers[method] = lambda request: {"job": 4, "force_n": 12.0, "state": STATE}
    with_gripper(daemon, use)


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


@pytest.mark.parametrize("force_n", ["20", float("nan"), [20]])
def test_what_is_no_number_is_refused_here(daemon: FakeDaemon, force_n: Any) -> None:
    async def use(gripper: LiteGrip) -> None:
        with pytest.raises(CommandError, match="force_n is"):
            await gripper.grasp(force_n)

    with_gripper(daemon, use)
    assert daemon.methods() == ["hello"]


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


def test_an_error_of_the_callback_cancels_the_motion_too(daemon: FakeDaemon) -> None:
    def fail(progress: MoveProgress) -> None:
        raise StoppedError("of the callback's own")

    async def use(gripper: LiteGrip) -> None:
        with pytest.raises(StoppedError, match="of the callback"):
            await gripper.open(progress=fail)
        assert daemon.requests[-1].params == {"job": 9}

    daemon.handlers["motion.open"] = lambda request: request.progress(job=9)
    with_gripper(daemon, use)


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


def test_a_motion_that_cannot_be_cancelled_is_told(
    daemon: FakeDaemon, caplog: pytest.LogCaptureFixture
) -> None:
    async def use(gripper: LiteGrip) -> None:
        moving = asyncio.create_task(gripper.open())
        await arrived(daemon, "motion.open")
        await cancel(moving)

    daemon.handlers["job.list"] = lambda request: {"jobs": [job(7, pid=1)]}
    with_gripper(daemon, use)
    assert "could not be cancelled: job 7 runs, but not as a job of process" in caplog.text


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
