"""`cancel()` of a gripper's own motion, from another thread or task and from a signal handler."""

import asyncio
import contextlib
from collections.abc import Iterator
from typing import Any, cast

import pytest

from litegrip_client import CancelledError, ConnectError, LiteGrip, aio
from tests.client.rig import Bench, Heard, Kind, Threads


def mode(daemon: Heard) -> str:
    return daemon.state.mode


@contextlib.contextmanager
def beside(
    site: Bench, kind: Kind, delay_s: float, gripper: LiteGrip, got: list[bool]
) -> Iterator[None]:
    """Call `cancel` of a gripper after a while, from another thread or task."""
    if isinstance(kind, Threads):

        def cancel() -> None:
            site.run(delay_s)
            got.append(gripper.cancel())

        thread = site.turns.threading.Thread(target=cancel)
        thread.start()
        yield
        thread.join()
        return
    real = cast("aio.LiteGrip", cast("Any", gripper)._real)

    async def cancel_soon() -> None:
        await asyncio.sleep(delay_s)
        got.append(await real.cancel())

    task = kind.loop.create_task(cancel_soon())
    yield
    kind.run(asyncio.wait_for(task, 5.0))


@pytest.mark.parametrize("delay_s", [0.0, 0.005, 0.3])
def test_who_waits_for_the_motion_gets_the_error_and_the_jaws_hold(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind, delay_s: float
) -> None:
    got: list[bool] = []
    with beside(site, kind, delay_s, enabled, got):
        with pytest.raises(CancelledError, match="cancelled by") as caught:
            enabled.open()
        assert caught.value.reason == "cancelled"
    assert got == [True]
    assert mode(daemon) == "holding"
    assert daemon.methods().count("job.cancel") == 1
    assert enabled.close().ok, "nothing is latched"


@pytest.mark.parametrize("delay_s", [0.0, 0.3])
def test_a_signal_handler_cancels_what_its_own_thread_waits_for(
    site: Bench, daemon: Heard, delay_s: float
) -> None:
    got: list[bool] = []
    with LiteGrip() as gripper:
        gripper.enable()
        site.after(delay_s, lambda: got.append(gripper.cancel()))
        began_s = site.now_s
        with pytest.raises(CancelledError):
            gripper.open()
        assert site.now_s - began_s == pytest.approx(delay_s, abs=0.03)
        assert got == [True]
        assert mode(daemon) == "holding"
        assert gripper.close().ok


def test_a_grasp_that_holds_is_cancelled_and_holds_on(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    got: list[bool] = []
    with beside(site, kind, 4.0, enabled, got), pytest.raises(CancelledError):
        enabled.grasp(force_n=10.0)
    kind.pause(1.0)
    assert daemon.state.is_grasped
    assert daemon.closing_torque_nm == pytest.approx(1.0, abs=0.1)


def test_nothing_of_its_own_is_no_error_and_others_go_on(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    assert enabled.cancel() is False
    kind.ask(enabled, "motion.close", wait=False)
    with kind.gripper() as other:
        assert other.cancel() is False
        assert mode(daemon) == "moving"
    assert enabled.cancel() is True
    assert mode(daemon) == "holding"


def test_a_stream_is_told_and_may_begin_anew(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(50.0)
        kind.pause(0.05)
        stream.set_target(50.0)
        assert enabled.cancel() is True
        kind.pause(0.02)
        with pytest.raises(CancelledError, match="stream was cancelled") as caught:
            stream.set_target(40.0)
        assert caught.value.reason == "cancelled"
        assert mode(daemon) == "holding"
        stream.set_target(40.0)
        assert mode(daemon) == "moving"


def test_a_stream_that_ended_long_before_is_not_told(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(50.0)
        kind.pause(1.0)
        assert enabled.cancel() is False
        stream.set_target(50.0)


def test_what_was_begun_in_the_background_ends(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    taught = enabled.record(0.5)
    enabled.play_start(taught, loop=True, align=True)
    kind.pause(0.2)
    assert enabled.cancel() is True
    assert enabled.trajectory_status()["active"] is False


def test_without_a_connection_it_says_so(kind: Kind) -> None:
    with pytest.raises(ConnectError):
        kind.gripper().cancel()
