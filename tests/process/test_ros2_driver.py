"""The driver of the node for ROS 2, without ROS: goals, set-points, and a daemon that is gone."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import GripperState, LiteGripError
from litegrip_ros2.diagnosis import Diagnosis, Level
from litegrip_ros2.driver import Driver, Goal, Settings
from litegrip_ros2.joints import Scale, Target
from litegrip_ros2.orders import Ending, Outcome
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, configured


class Heard:
    """What the driver has told, with the event loop's turn in between."""

    def __init__(self) -> None:
        self.states: list[GripperState] = []
        self.diagnoses: list[Diagnosis] = []
        self.said: list[str] = []
        self._news = asyncio.Event()

    def on_state(self, state: GripperState, scale: Scale | None) -> None:
        assert scale is not None
        self.states.append(state)
        self._news.set()

    def on_diagnosis(self, what: Diagnosis) -> None:
        self.diagnoses.append(what)
        self._news.set()

    def inform(self, text: str) -> None:
        self.said.append(text)

    warn = inform

    async def until(self, condition: Callable[[], object]) -> None:
        async def look() -> None:
            while not condition():
                self._news.clear()
                await self._news.wait()

        await asyncio.wait_for(look(), DEADLINE_S)

    async def newer(self) -> GripperState:
        count = len(self.states)
        await self.until(lambda: len(self.states) > count)
        return self.states[-1]


Play = Callable[[Driver, Heard], Awaitable[None]]


def play(running: DaemonProcess, *plays: Play) -> None:
    """Run a driver at a daemon, and then what is played with it."""
    with running.connect() as client:
        channel = client.result("hello", client="test")["channel"]

    async def main() -> None:
        heard = Heard()
        settings = Settings(channel, str(running.socket_path), disable_on_disconnect=False)
        driver = Driver(settings, heard)
        task = asyncio.create_task(driver.run())
        try:
            for one in plays:
                await one(driver, heard)
        finally:
            task.cancel()
            await asyncio.wait([task])

    asyncio.run(main())


def begin(driver: Driver, target: Target) -> tuple[Goal, Coroutine[Any, Any, Outcome]]:
    goal = Goal(target)
    driver.accept(goal)
    return goal, driver.go(goal)


async def has_enabled(driver: Driver, heard: Heard) -> None:
    await heard.newer()
    assert await driver.enable() == "enabled"


def test_the_newest_goal_counts_and_a_cancelled_one_holds(simulated: DaemonProcess) -> None:
    async def goals(driver: Driver, heard: Heard) -> None:
        _, slow = begin(driver, Target(20.0, 5.0))
        older = asyncio.create_task(slow)
        await heard.until(lambda: heard.states[-1].job is not None)
        _, never = begin(driver, Target(10.0))  # is replaced before it has begun
        _, newer = begin(driver, Target(40.0))
        ends = await asyncio.gather(older, never, newer)
        assert [one.ending for one in ends] == [
            Ending.ABORTED,
            Ending.ABORTED,
            Ending.SUCCEEDED,
        ]
        assert [one.reason for one in ends[:2]] == ["replaced", "replaced"]
        assert (await heard.newer()).opening_mm == pytest.approx(40.0, abs=1.0)

        goal, way = begin(driver, Target(10.0, 5.0))
        running = asyncio.create_task(way)
        await heard.until(lambda: heard.states[-1].job is not None)
        driver.cancel(goal)
        assert (await running).ending is Ending.CANCELED
        await heard.until(lambda: heard.states[-1].job is None)
        assert heard.states[-1].mode == "holding"
        assert heard.states[-1].opening_mm == pytest.approx(40.0, abs=5.0)

    play(simulated, has_enabled, goals)


def test_a_goal_can_be_cancelled_at_any_moment(simulated: DaemonProcess) -> None:
    async def cancel(driver: Driver, heard: Heard) -> None:
        for turns in range(8):  # of the event loop, since it has begun
            goal, way = begin(driver, Target(10.0, 1.0))
            running = asyncio.create_task(way)
            for _ in range(turns):
                await asyncio.sleep(0)
            driver.cancel(goal)
            assert (await running).ending is Ending.CANCELED, turns
        assert (await heard.newer()).opening_mm == pytest.approx(60.0, abs=1.0)

    play(simulated, has_enabled, cancel)


def test_disabling_gives_the_lease_back(simulated: DaemonProcess) -> None:
    async def disable(driver: Driver, heard: Heard) -> None:
        assert await driver.disable() == "disabled"
        with simulated.connect() as other:
            assert other.result("lease.get")["owner"] is None
            other.result("lease.acquire", purpose="sorting")
            with pytest.raises(LiteGripError, match="sorting"):
                await driver.enable()
        assert not any("trying again" in text for text in heard.said)

    play(simulated, has_enabled, disable)


def test_a_set_point_is_followed_but_not_beside_a_goal(simulated: DaemonProcess) -> None:
    async def lead(driver: Driver, heard: Heard) -> None:
        while (await heard.newer()).opening_mm > 41.0:  # type: ignore[operator]
            driver.follow(Target(40.0))
        _, way = begin(driver, Target(50.0))
        running = asyncio.create_task(way)
        await heard.until(lambda: heard.states[-1].job is not None)
        driver.follow(Target(20.0))
        outcome = await running
        assert outcome.reached_goal
        assert any("count for nothing" in text for text in heard.said)

    play(simulated, has_enabled, lead)


@pytest.mark.local_only("a daemon is ended and started again")
def test_what_was_asked_of_a_daemon_that_is_gone_is_not_done_by_the_next_one(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        heard = Heard()
        driver = Driver(Settings("gone", str(tmp_path / "rpc.sock")), heard)
        task = asyncio.create_task(driver.run())
        with pytest.raises(LiteGripError, match="no daemon"):
            await driver.enable()
        with configured(tmp_path, "gone"):
            await has_enabled(driver, heard)
            _, way = begin(driver, Target(10.0, 5.0))
            running = asyncio.create_task(way)
            await heard.until(lambda: heard.states[-1].job is not None)
        assert (await running).ending is Ending.ABORTED
        await heard.until(lambda: heard.diagnoses[-1].level is Level.ERROR)
        driver.follow(Target(20.0))
        _, way = begin(driver, Target(20.0))
        assert (await way).reason == "no_daemon"
        with configured(tmp_path, "gone"):
            await heard.until(lambda: heard.diagnoses[-1].level is Level.OK)
            assert (await heard.newer()).enabled is False
            assert await driver.enable() == "enabled"
            for _ in range(10):
                state = await heard.newer()
            assert state.job is None
            assert state.opening_mm == pytest.approx(60.0, abs=1.0)
            assert not any("joint_commands" in text for text in heard.said)
            task.cancel()
            await asyncio.wait([task])

    asyncio.run(main())
