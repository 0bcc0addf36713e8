"""Replays of grips that are ended or refused: cancels, stops, lost clients, damaged files."""

import pytest

from litegripd.sim.plant import SimulatorParameters
from tests.control.grips import FORCE_CODE_N, gripper, in_phase, on_another, started
from tests.control.replays import reason_of
from tests.trajectories import fetched, lgt, sampled, swing, uploaded
from tests.world import PERIOD_S


def test_a_cancel_in_the_grip_keeps_the_hold() -> None:
    world, client = on_another(36.0)
    number = started(world, client)
    world.run(0.5)
    client.result("job.cancel", job=client.result("trajectory.status")["job"])
    assert reason_of(client, number) == "cancelled"
    since_s = world.now_s
    world.run(1.0)
    assert world.state.is_grasped
    assert 10.0 * world.squeeze_nm == pytest.approx(8.0, abs=FORCE_CODE_N)
    assert world.longest_gap_s(since_s) < 2 * PERIOD_S


def test_a_cancel_on_the_way_to_the_contact_holds_there() -> None:
    world, client = on_another(36.0)
    number = started(world, client, "approach")
    world.run(0.4)
    client.result("job.cancel", job=client.result("trajectory.status")["job"])
    assert reason_of(client, number) == "cancelled"
    here_mm = world.gripper.opening_mm
    assert here_mm < 85.0
    world.run(1.0)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=1.0)
    assert (world.state.mode, world.state.is_grasped) == ("holding", False)


@pytest.mark.parametrize("phase", ["align", "play", "approach", "hold", "settle"])
@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
def test_a_stop_ends_every_phase(phase: str, level: str) -> None:
    world, client = on_another(36.0)
    client.result("motion.move", opening_mm=58)
    number = client.send("trajectory.play", name="pick", force="replay")
    world.run_until(lambda: in_phase(world, phase))
    if phase == "hold":
        world.run(0.1)  # the force is on its way
    before_n = 10.0 * world.squeeze_nm
    world.client().result("stop", level=level)
    assert reason_of(client, number) == "stopped"
    world.run(0.3)
    kept_n = 10.0 * SimulatorParameters().breakaway_nm  # what friction keeps of a hold
    assert 10.0 * world.squeeze_nm < max(before_n, 0.0) + kept_n
    mode = {"hold": "holding", "relax": "relaxed", "disable": "disabled"}[level]
    assert world.state.mode == mode
    assert world.state.is_grasped is (phase == "hold" and level == "hold")


@pytest.mark.parametrize("phase", ["approach", "hold"])
def test_a_lost_client_ends_it_as_its_lease_says(phase: str) -> None:
    world, client = on_another(36.0)
    client.result("lease.acquire", on_lost="relax")
    started(world, client, phase, detach=False)
    client.leave()
    world.run(0.1)
    assert world.controller.jobs.running is None
    assert world.state.mode == "relaxed"


def test_without_grips_there_is_nothing_to_repeat() -> None:
    _, client = gripper()
    name = uploaded(client, sampled(swing(), 2.0))
    answer = client.call("trajectory.play", name=name, force="replay")
    data = answer["error"]["data"]
    assert (data["reason"], data["field"]) == ("out_of_limits", "force")
    assert client.result("trajectory.play", name=name)["ok"]


@pytest.mark.parametrize(
    "damage", [b"", b"[]", b"{", b'{"format": "litegrip-grips"}', b"\xff\xfe", b"[" * 100_000]
)
def test_grips_that_cannot_be_read_keep_nobody_from_the_path(damage: bytes) -> None:
    world, client = on_another(None)
    (world.disk.trajectories() / "pick.grip.json").write_bytes(damage)
    answer = client.call("trajectory.play", name="pick", force="replay")
    assert answer["error"]["data"]["reason"] == "trajectory_unreadable"
    assert "pick.grip.json" in answer["error"]["message"]
    assert client.result("trajectory.play", name="pick")["ok"]


def test_the_grips_of_a_replaced_trajectory_are_not_done() -> None:
    """The vendor's SDK may write the file, and knows nothing of what lies beside it."""
    world, client = on_another(36.0)
    (world.disk.trajectories() / "pick.lgt").write_bytes(lgt(sampled(swing(0.7), 2.0)))
    answer = client.call("trajectory.play", name="pick", force="replay")
    assert answer["error"]["data"]["reason"] == "trajectory_unreadable"
    assert "another .lgt" in answer["error"]["message"]
    (row,) = client.result("trajectory.list")["trajectories"]
    assert (row["error"], row["grips"]) == (None, 0)
    assert "another .lgt" in row["grip_problem"]
    assert client.refusal("trajectory.get", name="pick", format="grip") == "trajectory_unreadable"
    assert fetched(client, name="pick") == lgt(sampled(swing(0.7), 2.0))


def test_a_grasp_speed_that_stalls_by_itself_is_refused_as_for_a_grasp() -> None:
    _, client = on_another(36.0)
    config = {"grasp_speed_mm_s": 0.5}
    assert client.refusal("motion.grasp", config=config) == "out_of_limits"
    params = {"name": "pick", "config": config}
    assert client.refusal("trajectory.play", force="replay", **params) == "out_of_limits"
