"""The client's own ways of a whole daemon: stops beside a motion, and states in batches."""

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import LiteGrip, StoppedError, aio
from tests.process.daemon_process import DaemonProcess

OPENING = {"speed_mm_s": 15.0}  # takes many seconds


def of(daemon: DaemonProcess) -> dict[str, Any]:
    """Return what `LiteGrip` needs to find a daemon."""
    with daemon.connect() as client:
        client.enabled().result("motion.close")
        client.result("motor.disable")
        channel = client.result("hello")["channel"]
    return {"channel": channel, "socket_path": str(daemon.socket_path)}


def ended(errors: list[BaseException]) -> None:
    """Check that the motion ended by the stop, and by nothing else."""
    (error,) = errors
    assert isinstance(error, StoppedError)
    assert error.reason == "stopped"


def test_a_thread_stops_a_motion_and_what_comes_behind_is_refused(simulated: DaemonProcess) -> None:
    with LiteGrip(**of(simulated)) as gripper:
        gripper.enable()
        before = gripper.get_state().stop_generation
        errors: list[BaseException] = []
        is_moving = threading.Event()

        def move() -> None:
            try:
                gripper.open(**OPENING, progress=lambda _report: is_moving.set())
            except BaseException as error:  # noqa: BLE001 - looked at below
                errors.append(error)

        mover = threading.Thread(target=move)
        mover.start()
        assert is_moving.wait(30.0)
        state = gripper.software_stop(why="a hand")
        mover.join(30.0)
        ended(errors)
        assert state.stop is not None
        # The name that the kernel knows, not the one said in `hello`: so it went by that socket.
        by = simulated.remote_as or Path("/proc/self/comm").read_text(encoding="utf-8").strip()
        latched = {name: state.stop[name] for name in ("level", "by", "why", "repeats")}
        assert latched == {"level": "hold", "by": by, "why": "a hand", "repeats": 0}
        assert state.stop_generation == before + 1
        again = gripper.software_stop()
        assert again.stop is not None
        assert (again.stop["repeats"], again.stop_generation) == (1, before + 2)
        with pytest.raises(StoppedError) as caught:
            gripper.open()
        assert caught.value.reason == "stopped"  # and not one that was sent before it
        gripper.clear_stop()
        assert gripper.hold().mode == "holding"


def test_a_task_stops_a_motion(simulated: DaemonProcess) -> None:
    async def main() -> None:
        async with aio.LiteGrip(**of(simulated)) as gripper:
            await gripper.enable()
            is_moving = asyncio.Event()
            motion = gripper.open(**OPENING, progress=lambda _report: is_moving.set())
            moving = asyncio.create_task(motion)
            await asyncio.wait_for(is_moving.wait(), 30.0)
            state = await gripper.software_stop("relax")
            assert state.stop is not None
            assert state.stop["level"] == "relax"
            (error,) = await asyncio.gather(moving, return_exceptions=True)
            assert isinstance(error, StoppedError)
            await gripper.clear_stop()

    asyncio.run(main())


def test_who_does_not_know_of_a_stop_clears_it_only_after_a_look(simulated: DaemonProcess) -> None:
    place = of(simulated)
    with LiteGrip(**place) as knowing, LiteGrip(**place) as unaware:
        knowing.software_stop("disable", why="a hand")
        with pytest.raises(StoppedError) as caught:
            unaware.clear_stop()
        assert caught.value.reason == "sent_before_stop"
        state = unaware.get_state()
        assert state.stop is not None
        assert state.stop["why"] == "a hand"
        assert unaware.clear_stop().stop is None


def test_states_in_batches_are_those_of_consecutive_ticks(simulated: DaemonProcess) -> None:
    place = of(simulated)
    with LiteGrip(**place) as gripper, gripper.states(200, batch=10) as states:
        got = [next(states) for _ in range(41)][1:]
        assert {one.mode for one in got} == {"disabled"}
        # A busy machine may lose ticks; what comes is in order all the same.
        assert [one.seq for one in got] == sorted({one.seq for one in got})

    async def main() -> list[dict[str, Any]]:
        async with (
            aio.LiteGrip(**place) as gripper,
            gripper.states(200, ["position_rad", "seq"], batch=50) as states,
        ):
            return [await states.__anext__() for _ in range(51)][1:]

    rows = asyncio.run(main())
    assert {tuple(row) for row in rows} == {("position_rad", "seq")}
    assert [row["seq"] for row in rows] == sorted({row["seq"] for row in rows})
