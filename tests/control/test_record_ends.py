"""How recordings end and what keeps them from beginning."""

import json
from itertools import pairwise

import pytest

from litegripd.handover import state as handover
from litegripd.trajectories.capture import Capture
from litegripd.trajectories.store import Limits
from tests.control.recordings import recording, taken
from tests.trajectories import fetched, lgt, send
from tests.world import PERIOD_S, World


@pytest.mark.parametrize("end", ["cancel", "stop", "leave", "fault", "relax"])
def test_broken_off_by_hand_it_is_no_good_recording(end: str) -> None:
    world, client = recording()
    world.run(0.5)
    watcher = world.client()
    job = world.running
    if end == "cancel":
        client.result("job.cancel", job=job.number)
    elif end in ("stop", "relax"):
        watcher.result("stop", level="hold" if end == "stop" else "relax")
    elif end == "leave":
        client.leave()
    else:
        world.gripper.set_supply(40.0)
        world.run(0.05)
    world.run(0.3)
    assert not job.is_running
    assert world.state.mode == {"fault": "fault", "relax": "relaxed"}.get(end, "holding")
    if end in ("stop", "relax"):
        watcher.result("stop.clear")
    status = watcher.result("trajectory.status")
    assert status["active"] is False
    assert status["error"]
    assert watcher.refusal("trajectory.record_stop") == "recording_failed"
    assert watcher.result("trajectory.record_stop", allow_partial=True)["samples"] > 40


def test_the_status_tells_what_is_not_kept_until_it_is() -> None:
    """Whoever comes later may keep it: a replay, which is the latest then, does not hide it."""
    world, client = recording()
    world.run(0.5)
    assert client.result("trajectory.status")["unkept"] is None  # it is under way
    client.leave()
    world.run(0.1)
    other = world.client()
    status = other.result("trajectory.status")
    part = {name: status[name] for name in ("samples", "duration_s", "error")}
    assert part["samples"] > 40
    assert status["unkept"] == part
    world.run(0.5)
    other.result("lease.take", ttl_s=60.0, why="to replay")
    send(other, lgt([(0.0, 0.5), (1.0, 0.5)]), name="pose")
    other.result("trajectory.play", name="pose")
    status = other.result("trajectory.status")
    assert (status["kind"], status["unkept"]) == ("play", part)
    world.run(3.0)
    other.result("trajectory.record_stop", name="kept", allow_partial=True)
    assert other.result("trajectory.status")["unkept"] is None


def test_of_one_without_a_sample_there_is_no_part_to_take() -> None:
    world = World()
    client = world.enabled()
    world.lose_from_motor = lambda _frame: True
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.3)
    error = client.call("trajectory.record_stop")["error"]
    assert error["data"]["samples"] == 0
    assert "allow_partial" not in error["message"]
    error = client.call("trajectory.record_stop", allow_partial=True)["error"]
    assert error["message"] == "the recording has no samples"


def test_stopping_in_the_tick_of_its_end_does_not_make_it_good() -> None:
    """The job has ended, but no tick has passed in which the recording could notice."""
    world, client = recording()
    world.run(0.5)
    job = world.running
    client.send("job.cancel", job=job.number)
    number = client.send("trajectory.record_stop")
    world.tick()
    assert client.has_answer(number)
    assert client.answers[number]["error"]["data"]["reason"] == "recording_failed"


@pytest.mark.parametrize("slack", [True, False])
def test_a_detached_one_goes_on_without_its_client(slack: bool) -> None:
    world, client = recording(zero_gravity=slack, detach=True)
    world.run(0.2)
    client.leave()
    world.run(0.2)
    other = world.client()
    assert other.result("trajectory.status")["active"]
    assert other.result("trajectory.record_stop")["samples"] > 35


def test_a_recording_beside_others_ends_with_its_client() -> None:
    world, client = recording(zero_gravity=False)
    world.run(0.2)
    client.leave()
    world.run(0.1)
    status = world.client().result("trajectory.status")
    assert status["active"] is False
    assert "went away" in status["error"]


def test_another_calibration_breaks_it_off() -> None:
    world, client = recording(zero_gravity=False)
    world.run(0.2)
    content = {"zero_position_rad": 0.1, "max_position_rad": -1.4, "rad_to_mm": 57.0}
    client.result("calibration.load", content=content)
    world.run(0.1)
    assert "calibration" in client.result("trajectory.status")["error"]
    assert client.refusal("trajectory.record_stop") == "recording_failed"


def test_it_needs_the_lease_only_where_the_jaws_go_slack() -> None:
    world = World()
    world.enabled().result("lease.acquire")
    other = world.client()
    assert other.refusal("trajectory.record_start") == "lease_held"
    other.result("trajectory.record_start", zero_gravity=False)
    other.result("trajectory.record_stop", allow_empty=True)


def test_more_samples_than_measurements_are_refused() -> None:
    client = World().enabled()
    answer = client.call("trajectory.record_start", rate_hz=250)
    assert answer["error"]["data"]["reason"] == "out_of_limits"
    assert answer["error"]["data"]["limit"] == 200


def test_a_disk_that_fails_loses_no_recording() -> None:
    world, client = recording()
    world.run(0.5)
    world.disk.error = "no space left on the device"
    answer = client.call("trajectory.record_stop", name="pick")
    assert answer["error"]["data"]["reason"] == "not_saved"
    assert "no space left" in answer["error"]["message"]
    assert world.state.mode == "holding"
    world.disk.error = None
    assert client.result("trajectory.record_stop", name="pick")["samples"] > 45
    assert [one["name"] for one in client.result("trajectory.list")["trajectories"]] == ["pick"]


@pytest.mark.parametrize("way", ["once there is room", "without a name", "by another user"])
def test_what_has_no_room_under_its_name_is_not_lost(way: str) -> None:
    world = World()
    world.disk.limit(Limits(1))
    client = world.client()
    send(client, lgt([(0.0, 0.5)]), name="full")
    recording(world)
    world.run(0.5)
    answer = client.call("trajectory.record_stop", name="pick")
    assert answer["error"]["data"]["reason"] == "trajectories_full"
    assert answer["error"]["data"]["usage"]["named"] == 1
    assert "trajectory.record_stop" in answer["error"]["data"]["hint"]
    assert world.state.mode == "holding"
    client.leave()
    other = world.client(uid=1001 if way == "by another user" else 1000)
    if way == "without a name":
        assert len(taken(other)) > 45
        return
    if way == "once there is room":
        assert other.refusal("trajectory.record_stop", name="pick") == "trajectories_full"
        other.result("trajectory.delete", name="full")
    assert other.result("trajectory.record_stop", name="pick")["samples"] > 45
    listed = {one["name"]: one["uid"] for one in other.result("trajectory.list")["trajectories"]}
    assert listed["pick"] == (1001 if way == "by another user" else 1000)


def test_while_it_is_taken_to_the_disk_nothing_interferes() -> None:
    world, client = recording()
    world.run(0.5)
    number = client.send("trajectory.record_stop")
    assert not client.has_answer(number)
    assert client.refusal("trajectory.record_stop") == "trajectory_busy"
    assert "result" in client.wait(number)


def test_only_the_latest_recording_is_kept() -> None:
    world, client = recording()
    names = []
    for _ in range(2):
        world.run(0.2)
        names.append(client.result("trajectory.record_stop")["name"])
        client.result("trajectory.record_start")
    assert client.refusal("trajectory.get", name=names[0]) == "unknown_trajectory"
    assert fetched(client, name=names[1])


def test_a_name_that_cannot_be_leaves_the_recording_running() -> None:
    world, client = recording()
    world.run(0.2)
    assert client.refusal("trajectory.record_stop", name="../x") == "invalid_params"
    assert client.result("trajectory.status")["active"]


def test_late_ticks_do_not_bend_the_times() -> None:
    """A tick that comes three periods late measures later, and says so."""
    world, client = recording(rate_hz=200, zero_gravity=False)
    world.run(0.2)
    world.now_s += 3 * PERIOD_S
    world.gripper.advance(world.now_s)
    world.run(0.2)
    times = [sample[0] for sample in taken(client)]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert max(gaps) == pytest.approx(4 * PERIOD_S)
    assert sum(gaps) == pytest.approx(0.4 + 3 * PERIOD_S, abs=3 * PERIOD_S)


def test_a_motion_ends_it_no_more_than_it_ends_a_motion() -> None:
    _, client = recording()
    assert client.refusal("motion.open") == "busy"
    assert client.result("trajectory.status")["active"]


def test_what_a_restart_would_lose_refuses_it() -> None:
    world, client = recording(zero_gravity=False)
    world.run(0.3)
    for _ in ("under way", "over but not kept"):
        refusal = handover.why_not_restartable(world.machine)
        assert refusal is not None
        assert refusal.reason == "trajectory_busy"
        capture = world.controller.capture
        assert isinstance(capture, Capture)
        capture.finish()
    client.result("trajectory.record_stop", name="pick")
    assert handover.why_not_restartable(world.machine) is None
    client.result("trajectory.record_start", zero_gravity=False)
    world.lose_from_motor = lambda _frame: True
    world.run(0.3)
    world.lose_from_motor = lambda _frame: False
    world.run_until(lambda: handover.why_not_restartable(world.machine) is None, 2.0)


def test_the_results_of_recordings_and_replays_are_carried_over_a_restart() -> None:
    world, client = recording()
    world.run(0.3)
    client.result("trajectory.record_stop", name="pick")
    client.result("trajectory.play", name="pick")
    plain = json.loads(json.dumps(handover.export_history(world.machine, world.service)))
    other = World()
    handover.adopt_history(other.machine, other.service, plain)
    successor = other.controller
    assert [(job.kind, job.result) for job in successor.jobs] == [
        (job.kind, job.result) for job in world.controller.jobs
    ]
    assert [job.kind for job in successor.jobs] == ["enable", "record", "play"]
