"""What becomes of a motion whose caller is interrupted, or whose task is cancelled."""

import asyncio
import re

import pytest

from litegrip_client import CommandError, ConnectError, LiteGrip, MoveProgress, StoppedError, aio
from tests.client.rig import SILENT, Asyncio, Bench, Heard, Kind, Threads, cancelling


def older(daemon: Heard) -> None:
    """Have the daemon number no connections, as earlier ones did not."""
    hello = daemon.client().result("hello")
    daemon.instead["hello"] = {**hello, "client": None}


@pytest.mark.parametrize("is_older", [False, True])
def test_an_interrupt_cancels_the_job_of_the_motion(
    site: Bench, daemon: Heard, kind: Kind, is_older: bool
) -> None:
    if is_older:
        older(daemon)
    with kind.gripper() as gripper:
        gripper.enable()
        gripper.goto(55.0, duration=None)
        kind.interrupt()
        with pytest.raises(kind.interrupted):
            gripper.open()
        assert daemon.methods()[-2:] == ["job.list", "job.cancel"]
        cancelled = daemon.requests[-1].params
        last = gripper.jobs()[-1]
        assert (last["kind"], last["state"]) == ("open", "cancelled")
        assert cancelled == {"job": last["job"]}
        assert gripper.get_state().mode == "holding"


def test_an_interrupt_after_progress_needs_no_list(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with pytest.raises(kind.interrupted):
        enabled.open(progress=lambda _progress: kind.interrupt())
    assert daemon.methods()[-2:] == ["motion.open", "job.cancel"]
    assert enabled.get_state().mode == "holding"


def test_a_grasp_for_ever_waits_until_an_interrupt_which_cancels_it(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    phases: list[tuple[str, bool]] = []

    def show(progress: MoveProgress) -> None:
        phases.append((progress.phase, progress.total_steps > 0))
        if progress.phase == "hold" and len(phases) > 40:
            kind.interrupt()

    daemon.gripper.put_object(width_mm=50.0)
    with pytest.raises(kind.interrupted):
        enabled.grasp(progress=show)
    assert list(dict.fromkeys(phases))[-1] == ("hold", False)
    assert phases[0] == ("move", True)
    assert daemon.requests[-1].method == "job.cancel"
    kind.pause(1.0)
    assert daemon.state.is_grasped  # it is held on all the same
    assert daemon.closing_torque_nm == pytest.approx(2.0, abs=0.1)


def test_an_error_of_the_callback_cancels_the_motion_too(daemon: Heard, enabled: LiteGrip) -> None:
    def fail(_progress: MoveProgress) -> None:
        raise StoppedError("of the callback's own")

    with pytest.raises(StoppedError, match="of the callback"):
        enabled.open(progress=fail)
    assert daemon.methods()[-1] == "job.cancel"
    assert daemon.state.mode == "holding"


def test_a_refused_motion_cancels_nothing(daemon: Heard, enabled: LiteGrip) -> None:
    with pytest.raises(CommandError):
        enabled.goto(500.0)
    assert daemon.methods()[-1] == "motion.move"


def test_a_motion_refused_while_interrupted_cancels_nobody_elses(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    """By then another thread or task of this program moves, over the same connection."""
    daemon.late = {"motion.open": 0.05, "job.list": 0.1}
    kind.ask(enabled, "motion.close", wait=False)
    kind.interrupt(0.02)
    with pytest.raises(kind.interrupted):
        enabled.open()
    assert daemon.methods()[-1] == "job.list"
    assert daemon.state.mode == "moving"


@pytest.mark.parametrize("is_older", [False, True])
def test_a_job_that_cannot_be_found_is_told(
    daemon: Heard,
    kind: Kind,
    caplog: pytest.LogCaptureFixture,
    is_older: bool,
) -> None:
    """What runs is another connection's: of the same process, or where that counts, of another."""
    if is_older:
        older(daemon)
    with kind.gripper() as other, kind.gripper() as gripper:
        other.enable()
        running = daemon.client() if is_older else None
        if running is None:
            kind.ask(other, "motion.close", wait=False)
        else:
            other.disconnect()
            assert running.result("motor.enable", detach=True)
            running.send("motion.close")
        daemon.instead["motion.open"] = SILENT
        kind.interrupt(0.02)
        with pytest.raises(kind.interrupted):
            gripper.open()
        assert daemon.state.mode == "moving"
    told = r"could not be cancelled: job \d+ runs, but not as a job of process"
    assert re.search(told, caplog.text)


def test_the_end_of_the_daemon_ends_the_motion_and_cancels_nothing(
    site: Bench, daemon: Heard, kind: Kind
) -> None:
    gripper = kind.gripper(disable_on_disconnect=False)
    gripper.connect()
    gripper.enable()
    site.when(lambda: daemon.state.mode == "moving", daemon.hang_up)
    with pytest.raises(ConnectError, match="ended the connection"):
        gripper.open()
    assert not gripper.is_connected
    assert daemon.methods()[-1] == "motion.open"


def test_a_signal_handler_may_stop_while_its_thread_waits(site: Bench, daemon: Heard) -> None:
    with Threads(site).gripper() as gripper:
        gripper.enable()
        site.when(lambda: daemon.state.mode == "moving", gripper.software_stop)
        with pytest.raises(StoppedError):
            gripper.open()
        assert gripper.is_connected
    assert len(daemon.streams) == 2  # the stop had a connection of its own


def test_a_motion_that_a_signal_handler_could_not_begin_was_not_interrupted(
    site: Bench, daemon: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    refused: list[CommandError] = []
    with Threads(site).gripper() as gripper:
        gripper.enable()

        def handle() -> None:
            with pytest.raises(CommandError, match="its signal handler cannot use it") as caught:
                gripper.open()
            refused.append(caught.value)

        site.when(lambda: daemon.state.mode == "moving", handle)
        assert gripper.close()
    assert [error.reason for error in refused] == ["reentrant"]
    assert caplog.text == ""


# Tasks beside each other


def test_progress_is_reported_while_other_tasks_go_on(daemon: Heard, tasks: Asyncio) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        seen: list[MoveProgress] = []
        moving = asyncio.create_task(gripper.close(progress=seen.append))
        openings = [(await gripper.get_state()).openness or 0.0]
        while not moving.done():
            await asyncio.sleep(0.1)
            openings.append((await gripper.get_state()).openness or 0.0)
        assert await moving
        assert len(seen) > len(openings) > 5
        assert openings[:9] == sorted(openings[:9], reverse=True)

    tasks.use(scene)


def test_a_timeout_cancels_the_motion(daemon: Heard, tasks: Asyncio) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(gripper.close(), 0.05)
        assert daemon.methods()[-1] == "job.cancel"

    tasks.use(scene)


def test_being_cancelled_again_does_not_keep_it_from_cancelling(
    daemon: Heard, tasks: Asyncio
) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            await gripper.enable()
            daemon.late = {"job.list": 0.05, "job.cancel": 0.05}
            moving = asyncio.create_task(gripper.close())
            await asyncio.sleep(0)
            for _ in range(9):
                moving.cancel()
                await asyncio.sleep(0.01)
                assert not moving.done()
            await asyncio.wait([moving])
            assert moving.cancelled()
        assert daemon.methods()[-4:-2] == ["job.list", "job.cancel"]

    tasks.run(main())


def test_the_end_of_the_event_loop_cancels_the_motion(daemon: Heard, tasks: Asyncio) -> None:
    async def move() -> None:
        async with aio.LiteGrip() as gripper:
            await gripper.enable()
            await gripper.close()

    async def main() -> "asyncio.Task[None]":
        moving = asyncio.create_task(move())
        while daemon.methods()[-1:] != ["motion.close"]:
            await asyncio.sleep(0)
        return moving

    moving = tasks.run(main())
    moving.cancel()  # as asyncio.run does at its end
    with pytest.raises(asyncio.CancelledError):
        tasks.loop.run_until_complete(moving)
    ends = ["job.list", "job.cancel", "motor.disable", "lease.release"]
    assert daemon.methods()[-4:] == ends


def test_a_motion_that_ended_before_the_cancelling_is_not_cancelled(
    daemon: Heard, tasks: Asyncio
) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        moving = asyncio.create_task(gripper.goto(55.0, duration=None))
        await asyncio.sleep(0)
        (call,) = gripper._session.connection._router.calls.values()
        call.on_result = cancelling(moving)
        await asyncio.wait([moving])
        assert moving.cancelled()
        assert daemon.methods()[-1] == "motion.move"

    tasks.use(scene)


def test_being_cancelled_while_an_error_is_dealt_with_is_not_forgotten(
    daemon: Heard, tasks: Asyncio
) -> None:
    def fail(_progress: MoveProgress) -> None:
        raise StoppedError("of the callback's own")

    async def scene(gripper: aio.LiteGrip) -> None:
        daemon.late = {"job.cancel": 0.05}
        moving = asyncio.create_task(gripper.close(progress=fail))
        while daemon.methods()[-1] != "job.cancel":
            await asyncio.sleep(0.005)
        moving.cancel()
        await asyncio.wait([moving])
        assert moving.cancelled()

    tasks.use(scene)
