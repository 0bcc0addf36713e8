"""What a lost client leaves behind, by what it asked for and by what runs."""

import pytest

from litegripd.model.motor import MotorPhase, Status
from litegripd.model.state import JobState
from litegripd.motor import codec
from tests.control.states import (
    LEVELS,
    is_slack,
)
from tests.world import Client, World, ready


def check_left(world: World, on_lost: str) -> None:
    world.run(0.1)
    if on_lost == "disable":
        assert world.gripper.motor.status == Status.DISABLED
        assert world.in_phase(MotorPhase.DISABLED)
    else:
        assert world.gripper.motor.status == Status.ENABLED
        assert is_slack(world) == (on_lost == "relax")


@pytest.mark.parametrize("on_lost", LEVELS)
class TestLostHolder:
    def holder(self, on_lost: str) -> tuple[World, Client]:
        world = World().start()
        client = world.client()
        client.result("lease.acquire", on_lost=on_lost)
        assert client.result("motor.enable")["ok"]
        return world, client

    def test_an_idle_one(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        client.leave()
        check_left(world, on_lost)

    def test_one_that_moves(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        client.send("motion.open")
        world.run(0.4)
        here_rad = world.gripper.position_rad
        client.leave()
        check_left(world, on_lost)
        jobs = list(world.controller.jobs)
        assert jobs[-1].state is JobState.CANCELLED
        assert jobs[-1].error is not None
        assert jobs[-1].error.reason == "client_lost"
        assert world.gripper.position_rad == pytest.approx(here_rad, abs=0.1)

    def test_one_whose_motion_outlives_it(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        client.send("motion.open", wait=False)
        world.run(0.4)
        client.leave()
        world.client().leave()  # one that has nothing to lose changes nothing
        world.run(0.4)
        assert world.state.mode == "moving"
        world.run_until(lambda: world.controller.jobs.running is None)
        job = list(world.controller.jobs)[-1]
        assert job.state is JobState.DONE
        check_left(world, on_lost)

    def test_one_whose_motion_outlives_it_and_is_stopped(self, on_lost: str) -> None:
        """The stop decides what the jaws do: the client's choice would drop what they hold."""
        world, client = self.holder(on_lost)
        client.send("motion.open", wait=False)
        world.run(0.4)
        client.leave()
        world.client().result("stop", level="hold")
        check_left(world, "hold")

    def test_one_whose_motion_outlives_it_and_whom_another_follows(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        client.send("motion.open", speed_mm_s=10, wait=False)
        world.run(0.4)
        other = world.client()
        other.result("lease.take", why="it is my turn")
        client.leave()
        job = list(world.controller.jobs)[-1]
        other.result("job.cancel", job=job.number)
        other.result("motion.move", opening_mm=20)
        check_left(world, "hold")

    @pytest.mark.parametrize("jaws", LEVELS)
    def test_one_whose_motion_outlives_it_until_another_takes_the_gripper(
        self, on_lost: str, jaws: str
    ) -> None:
        """The taker says what the jaws do, not the client that is gone."""
        world, client = self.holder(on_lost)
        client.send("motion.open", speed_mm_s=10, wait=False)
        world.run(0.4)
        client.leave()
        world.run(0.1)
        taken = world.client().result("lease.take", why="it is my turn", jaws=jaws)
        assert taken["jaws"] == jaws
        check_left(world, jaws)

    @pytest.mark.parametrize("waits", [True, False])
    @pytest.mark.parametrize("runs_on", [True, False])
    def test_what_a_lost_one_has_queued_never_runs(
        self, on_lost: str, waits: bool, runs_on: bool
    ) -> None:
        world, client = self.holder(on_lost)
        client.send("motion.open", wait=not runs_on)
        client.send("motion.close", if_busy="queue", wait=waits)
        client.leave()
        world.run_until(lambda: world.controller.jobs.running is None)
        check_left(world, on_lost)
        queued = list(world.controller.jobs)[-1]
        assert (queued.kind, queued.state) == ("close", JobState.CANCELLED)
        assert queued.error is not None
        assert queued.error.reason == "client_lost"

    def test_one_that_gave_the_lease_back_leaves_everything_as_it_is(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        client.result("lease.release")
        client.leave()
        check_left(world, "hold")

    def test_somebody_else_than_the_holder(self, on_lost: str) -> None:
        world, client = self.holder(on_lost)
        other = world.client()
        assert other.refusal("motion.open") == "lease_held"
        other.leave()
        check_left(world, "hold")
        client.result("lease.release")
        mover = world.client()
        mover.send("motion.close")
        world.run(0.3)
        mover.leave()
        check_left(world, "hold")

    def test_one_that_is_lost_while_it_enables(self, on_lost: str) -> None:
        world = World().start()
        client = world.client()
        client.result("lease.acquire", on_lost=on_lost)
        world.lose_to_motor = lambda frame: frame.data == codec.ENABLE
        client.send("motor.enable", retries=20)
        world.run(0.1)
        client.leave()
        world.lose_to_motor = lambda _frame: False
        world.run(1.0)
        assert world.gripper.motor.status == Status.DISABLED


def test_what_is_queued_without_a_lease_outlives_who_does_not_wait_for_it() -> None:
    """A script may ask for two motions, and end."""
    world, client = ready()
    client.send("motion.open", wait=False)
    client.send("motion.move", opening_mm=20, if_busy="queue", wait=False)
    client.leave()
    world.run_until(
        lambda: world.controller.jobs.running is None and not world.controller.jobs.queue
    )
    assert [job.state for job in world.controller.jobs][-2:] == [JobState.DONE] * 2
    assert world.state.opening_mm == pytest.approx(20.0, abs=0.5)


def test_what_is_queued_under_a_lease_that_was_given_back_runs() -> None:
    world, client = ready()
    client.result("lease.acquire", on_lost="relax")
    client.send("motion.open", wait=False)
    client.send("motion.move", opening_mm=20, if_busy="queue", wait=False)
    client.result("lease.release")
    client.leave()
    world.run_until(
        lambda: world.controller.jobs.running is None and not world.controller.jobs.queue
    )
    assert world.state.opening_mm == pytest.approx(20.0, abs=0.5)
    check_left(world, "hold")


def test_a_holder_may_change_its_mind() -> None:
    world = World().start()
    client = world.client()
    client.result("lease.acquire", on_lost="disable")
    assert client.result("motor.enable")["ok"]
    first = client.result("lease.get")["owner"]
    client.result("lease.acquire", on_lost="hold")
    assert client.result("lease.get")["owner"] == {**first, "on_lost": "hold"}
    client.leave()
    world.run(0.5)
    assert world.state.mode == "holding"


def test_who_never_had_the_lease_leaves_the_jaws_holding() -> None:
    world, client = ready()
    client.leave()
    check_left(world, "hold")


def test_one_that_has_nothing_to_lose_is_not_reported() -> None:
    world = World()
    world.enabled()
    other = world.client()
    while world.service.take_events():
        pass
    other.leave()
    world.run(0.1)
    assert not [event for event in world.service.take_events() if event.kind == "client_lost"]
