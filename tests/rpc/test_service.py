"""Requests, waiting for motions, jobs seen from other connections, stops and defects."""

from itertools import pairwise

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.rpc.reports import MAX_PER_SESSION
from tests.world import PERIOD_S, World, enabled_world, reason_of


def test_state_get_tells_the_present_state() -> None:
    world, client = enabled_world()
    state = client.result("state.get")
    seen = (state["enabled"], state["mode"], state["bus"], state["stale"])
    assert seen == (True, "holding", "up", False)
    assert state["position_rad"] == pytest.approx(world.gripper.position_rad, abs=0.01)
    world.run(0.1)
    assert client.result("state.get")["seq"] >= state["seq"] + 20


def test_reads_overtake_a_motion_of_the_same_connection() -> None:
    _, client = enabled_world()
    motion = client.send("motion.open")
    client.result("state.get")
    assert motion not in client.answers
    assert client.wait(motion)["result"]["ok"]


def test_a_motion_that_is_not_waited_for_outlives_its_connection() -> None:
    world, first = enabled_world()
    job = first.result("motion.open", wait=False)["job"]
    first.leave()
    second = world.client()
    assert second.result("job.get", job=job)["state"] == "running"
    ended = second.result("job.wait", job=job)
    assert (ended["state"], ended["detached"], ended["result"]["ok"]) == ("done", True, True)


@pytest.mark.parametrize("wait", [True, False])
@pytest.mark.parametrize("detach", [True, False])
def test_a_lost_client_ends_its_motion_unless_it_is_detached(detach: bool, wait: bool) -> None:
    world = World()
    first, second = world.enabled(), world.client()
    first.send("motion.open", detach=detach, wait=wait)
    world.run(0.2)
    number = second.result("state.get")["job"]["job"]
    first.leave()
    job = second.result("job.wait", job=number)
    assert job["state"] == ("done" if detach else "cancelled")
    assert (job["error"] is None) == detach
    if not detach:
        assert job["error"]["data"]["reason"] == "client_lost"
        assert world.state.mode == "holding"


def test_progress_comes_at_most_20_times_a_second_with_the_id_of_the_request() -> None:
    world = World()
    client, silent = world.enabled(), world.client()
    client.session.name = "watcher"
    motion = client.send("motion.open", progress=True)
    times: list[float] = []

    def ended() -> bool:
        before = len(client.notifications)
        client.read()
        times.extend([world.now_s] * (len(client.notifications) - before))
        return motion in client.answers

    world.run_until(ended)
    assert len(times) > 10
    assert min(later - earlier for earlier, later in pairwise(times)) >= 0.05 - 1e-9
    for message in client.notifications:
        assert message["method"] == "job.progress"
        assert message["params"]["request"] == motion
        assert message["params"]["job"] == client.answers[motion]["result"]["job"]
    steps = [message["params"]["step"] for message in client.notifications]
    assert steps == sorted(steps)
    assert steps[-1] > steps[0]
    silent.read()
    assert not silent.notifications


def test_progress_is_not_queued_for_a_client_that_does_not_read() -> None:
    client = World().enabled()
    motion = client.send("motion.open", progress=True)
    client.session.congested = True
    client.wait(motion)
    assert not client.notifications


def test_progress_without_waiting_is_refused() -> None:
    client = World().enabled()
    assert client.refusal("motion.open", wait=False, progress=True) == "invalid_params"
    assert client.world.state.mode == "holding"


def test_a_job_is_seen_and_cancelled_from_another_connection() -> None:
    world = World()
    first, second = world.enabled(), world.client()
    motion = first.send("motion.open")
    world.run(0.3)
    (running,) = [j for j in second.result("job.list")["jobs"] if j["state"] == "running"]
    assert running["kind"] == "open"
    assert running["phase"] == "ramp"
    assert running["owner"]["program"] == first.session.name
    cancelled = second.result("job.cancel", job=running["job"])
    assert cancelled["state"] == "cancelled"
    world.tick()
    assert reason_of(first.answered(motion)) == "cancelled"
    assert world.state.mode == "holding"


def test_a_result_is_kept_with_the_state_in_which_it_came() -> None:
    world, first = enabled_world()
    result = first.result("motion.open")
    first.result("motion.close")
    job = world.client().result("job.get", job=result["job"])
    assert job["result"] == result
    assert job["result"]["state"]["opening_mm"] == pytest.approx(NOMINAL[0].travel_mm, abs=2)


def test_the_latest_64_jobs_are_kept() -> None:
    _, client = enabled_world()
    numbers = [client.result("motion.hold")["job"] for _ in range(70)]
    jobs = client.result("job.list")["jobs"]
    assert [job["job"] for job in jobs] == numbers[-64:]
    assert all(job["result"]["job"] == job["job"] for job in jobs)
    assert client.refusal("job.get", job=numbers[0]) == "unknown_job"
    assert client.refusal("job.wait", job=numbers[0]) == "unknown_job"
    assert client.refusal("job.cancel", job=numbers[-1] + 1) == "unknown_job"


def test_a_job_that_is_crowded_out_in_one_tick_is_still_answered() -> None:
    world = World()
    world.enabled()
    clients = [world.client() for _ in range(4)]
    holds = [(client, client.send("motion.hold")) for client in clients for _ in range(25)]
    world.tick()
    for client in clients:
        assert all("result" in client.answered(number) for client, number in holds)


def test_one_connection_has_a_limit_of_waiting_requests_that_binds_no_read_and_no_stop() -> None:
    world = World()
    world.enabled().send("motion.open")
    number = world.state.job
    assert number is not None
    client = world.client()
    for _ in range(MAX_PER_SESSION):
        client.send("job.wait", job=number.job)
    assert client.refusal("job.wait", job=number.job) == "too_many_requests"
    assert client.result("state.get")["mode"] == "moving"
    assert client.result("job.get", job=number.job)["state"] == "running"
    assert client.result("stop")["level"] == "hold"
    world.run(2 * PERIOD_S)
    client.read()
    told = [a for a in client.answers.values() if a.get("result", {}).get("kind") == "open"]
    assert len(told) == MAX_PER_SESSION + 1
    assert client.result("job.wait", job=number.job)["state"] == "cancelled"


@pytest.mark.parametrize("mark", ["sent_s", "stop_generation"])
@pytest.mark.parametrize("method", ["motion.open", "motion.hold", "motor.enable", "stop.clear"])
def test_what_was_sent_before_a_stop_is_void_though_the_stop_is_cleared(
    method: str, mark: str
) -> None:
    world, client = enabled_world()
    generation = client.result("hello")["stop_generation"]
    sent_s = world.now_s
    world.run(0.1)
    stopped = world.client().result("stop")
    assert stopped["generation"] == generation + 1
    if method != "stop.clear":
        world.client().result("stop.clear")
    value = sent_s if mark == "sent_s" else generation
    assert client.refusal(method, **{mark: value}) == "sent_before_stop"
    fresh = world.now_s if mark == "sent_s" else stopped["generation"]
    assert "result" in client.call(method, **{mark: fresh})


def test_reads_and_disable_do_not_mind_when_they_were_sent() -> None:
    _, client = enabled_world()
    client.result("stop")
    assert client.result("state.get", stop_generation=0, sent_s=1)["stop"]["level"] == "hold"
    assert client.result("motor.disable", stop_generation=0, sent_s=1)["ok"]


def test_a_stop_is_latched_and_told_to_everybody() -> None:
    world = World()
    mover, stopper = world.enabled(), world.client()
    motion = mover.send("motion.open")
    world.run(0.2)
    assert stopper.result("stop", level="relax", why="a hand")["state"]["stop"]["why"] == "a hand"
    world.tick()
    assert reason_of(mover.answered(motion)) == "stopped"
    assert mover.refusal("motion.close") == "stopped"
    assert mover.refusal("motor.enable") == "stopped"
    assert stopper.result("stop", level="hold")["level"] == "relax"
    assert mover.result("stop.clear")["state"]["stop"] is None
    assert mover.result("motion.close")["ok"]


def test_a_refusal_by_a_limit_names_it() -> None:
    client = World().start().client()
    assert client.refusal("motion.open") == "not_enabled"
    client.result("motor.enable")
    data = client.call("motion.open", speed_mm_s=1)["error"]["data"]
    assert data["reason"] == "out_of_limits"
    assert data["limit"] > data["requested"]


def test_without_a_calibration_no_motion_is_guessed() -> None:
    assert World(calibrated=False).enabled().refusal("motion.open") == "not_calibrated"


def test_a_silent_motor_refuses_with_its_reason() -> None:
    world = World()
    world.lose_to_motor = lambda _frame: True
    world.run(1.0)
    client = world.client()
    for method in ("motor.enable", "motion.open"):
        assert client.refusal(method) == "motor_silent"
    assert client.result("state.get")["stale"]


def test_hello_tells_the_time_by_the_daemons_clock() -> None:
    client = World().start().client()
    earlier_s = client.result("hello")["monotonic_s"]
    client.world.run(1.5)
    assert client.result("hello")["monotonic_s"] - earlier_s == pytest.approx(1.5, abs=0.1)
