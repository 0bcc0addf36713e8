"""What a lost client leaves behind, by what it asked for and by who moves."""

import pytest

from litegripd.model.jobs import JobState
from litegripd.model.motor import MotorPhase, Status
from litegripd.motor import codec
from tests.control.states import (
    LEVELS,
    is_slack,
)
from tests.world import Client, World


def check_left(world: World, on_lost: str) -> None:
    world.run(0.1)
    if on_lost == "disable":
        assert world.gripper.motor.status == Status.DISABLED
        assert world.in_phase(MotorPhase.DISABLED)
    else:
        assert world.gripper.motor.status == Status.ENABLED
        assert is_slack(world) == (on_lost == "relax")


@pytest.mark.parametrize("on_lost", LEVELS)
class TestLostClient:
    def keeper(self, on_lost: str) -> tuple[World, Client]:
        world = World().start()
        client = world.client()
        assert client.result("motor.enable", on_lost=on_lost)["ok"]
        return world, client

    def test_an_idle_keeper(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        client.leave()
        check_left(world, on_lost)

    def test_a_keeper_that_moves(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        client.send("motion.open")
        world.run(0.4)
        here_rad = world.gripper.position_rad
        client.leave()
        check_left(world, on_lost)
        jobs = list(world.engine.jobs)
        assert jobs[-1].state is JobState.CANCELLED
        assert jobs[-1].error is not None
        assert jobs[-1].error.reason == "client_lost"
        assert world.gripper.position_rad == pytest.approx(here_rad, abs=0.1)

    def test_a_keeper_whose_motion_outlives_it(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        client.send("motion.open", wait=False)
        world.run(0.4)
        client.leave()
        world.run(0.4)
        assert world.state.mode == "moving"
        world.run_until(lambda: world.engine.jobs.running is None)
        job = list(world.engine.jobs)[-1]
        assert job.state is JobState.DONE
        check_left(world, on_lost)

    def test_a_keeper_while_another_client_moves(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        other = world.client()
        number = other.send("motion.open")
        world.run(0.4)
        client.leave()
        world.run(0.4)
        assert world.state.mode == "moving"
        world.run_until(lambda: other.has_answer(number))
        assert other.answers[number]["result"]["ok"]
        check_left(world, on_lost)

    def test_somebody_else_than_the_keeper(self, on_lost: str) -> None:
        world, _ = self.keeper(on_lost)
        other = world.client()
        other.result("motion.open")
        other.leave()
        check_left(world, "hold")
        mover = world.client()
        mover.send("motion.close")
        world.run(0.3)
        mover.leave()
        check_left(world, "hold")

    def test_a_keeper_that_has_disabled_the_motor_is_none_any_more(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        client.result("motor.disable")
        other = world.client()
        other.result("motor.enable")
        client.leave()
        check_left(world, "hold")

    def test_a_new_keeper_takes_over_what_was_owed(self, on_lost: str) -> None:
        world, client = self.keeper(on_lost)
        other = world.client()
        number = other.send("motion.open", wait=False)
        world.run(0.1)
        client.leave()
        world.run_until(lambda: other.has_answer(number))
        world.run_until(lambda: world.engine.jobs.running is None)
        check_left(world, on_lost)
        other.result("motor.enable")
        check_left(world, "relax" if on_lost == "relax" else "hold")

    def test_a_client_that_is_lost_while_it_enables(self, on_lost: str) -> None:
        world = World().start()
        client = world.client()
        world.lose_to_motor = lambda frame: frame.data == codec.ENABLE
        client.send("motor.enable", on_lost=on_lost, retries=20)
        world.run(0.1)
        client.leave()
        world.lose_to_motor = lambda _frame: False
        world.run(1.0)
        assert world.gripper.motor.status == Status.DISABLED


def test_the_keeper_may_change_its_mind_and_nobody_else() -> None:
    world = World().start()
    keeper, other = world.client(), world.client()
    assert keeper.result("motor.enable", on_lost="disable")["ok"]
    assert other.result("motor.keep", on_lost="hold") == {"kept": False}
    assert keeper.result("motor.keep", on_lost="hold") == {"kept": True}
    keeper.leave()
    world.run(0.5)
    assert world.state.mode == "holding"
