"""Requests, waiting for motions, jobs seen from other connections, stops and defects."""

from itertools import pairwise
from typing import Any

import pytest

from litegripd.app.build import METHODS
from litegripd.model.calibration import NOMINAL
from litegripd.model.errors import ERRORS
from litegripd.model.state import Restarted
from litegripd.rpc.reports import MAX_PER_SESSION
from tests.rpc.raw import answered
from tests.trajectories import lgt, pieces
from tests.world import PERIOD_S, Client, World

PARAMS: dict[str, dict[str, Any]] = {
    "teleop.start": {"mode": "slave", "link": "client"},
    "teleop.receive": {"topic": "litearm/v4/gripA/gripper_teleop", "payload": "00"},
    "hello": {"client": "a test"},
    "state.subscribe": {"hz": 50, "fields": ["position_rad", "enabled"]},
    "state.unsubscribe": {"subscription": 1},
    "events.subscribe": {"kinds": ["stop", "job_ended"]},
    "events.unsubscribe": {"subscription": 2},
    "lease.acquire": {"purpose": "a test", "ttl_s": 60, "on_lost": "relax", "wait_s": 1},
    "lease.take": {"why": "a test"},
    "motor.enable": {"retries": 3},
    "motion.open": {"speed_mm_s": 60, "config": {"settle_s": 0.1}},
    "motion.grasp": {"force_n": 10, "hold_s": 0.2, "hold_by": "gains"},
    "motion.move": {"opening_mm": 60, "duration_s": 1.5},
    "motion.set_force": {"force_n": 2},
    "stream.set": {"openness": 0.5, "valid_s": 0.05, "torque_nm": 0.5},
    "calibration.load": {"template": "normal"},
    "motor.read_register": {"register": "PMAX"},
    "config.set": {"config": {"force_n": 5}, "keep": True},
    "daemon.restart": {"hold_through_restart": True},
    "stop": {"level": "hold", "why": "a test"},
    "job.get": {"job": 1},
    "job.wait": {"job": 1},
    "job.cancel": {"job": 1},
    "trajectory.record_start": {"zero_gravity": False, "rate_hz": 50},
    "trajectory.record_stop": {"name": "taught"},
    "trajectory.play": {"name": "taught", "loop": True, "wait": False},
    "trajectory.control": {"action": "speed", "speed": 0.5},
    "trajectory.get": {"name": "taught", "format": "csv"},
    "trajectory.put": pieces(lgt([(0.0, 0.5)]))[0],
    "trajectory.delete": {"name": "taught"},
}


def test_every_method_answers_with_a_result() -> None:
    world = World().start()
    world.restart = lambda told: told(Restarted(4711, 0.005))
    client = world.client()
    client.result("motor.enable")
    for method in METHODS:
        if method.name == "trajectory.record_start":
            client.result("calibration.load", template="normal")
        if method.name.startswith(("motion.", "calibration.", "trajectory.record_start")):
            client.result("motor.enable")
        if method.name == "calibration.manual":
            for step in ("begin", "cancel"):
                client.result(method.name, step=step)
            continue
        if method.name == "teleop.start":  # motor.set_zero has made the calibration void
            client.result("motor.disable")  # ends the replay
            client.result("calibration.load", template="normal")
            client.result("motor.enable")
        if method.name == "motor.scan":  # for a motor that is off
            client.result("motor.disable")
        if method.name == "lease.renew":
            client.result("lease.acquire")
        if method.name == "lease.resume":
            resume(world, client)
            continue
        client.result(method.name, **PARAMS.get(method.name, {}))
        world.run(0.1)  # a stream ends by itself


def resume(world: World, client: Client) -> None:
    """Lose a lease with its connection, and get it again over another one."""
    client.result("lease.release")
    gone = world.client()
    token = gone.result("lease.acquire")["lease"]
    gone.leave()
    back = world.client()
    assert back.result("lease.resume", lease=token)["number"] > 0
    back.result("lease.release")


def test_state_get_tells_the_present_state() -> None:
    world = World()
    client = world.enabled()
    state = client.result("state.get")
    assert (state["enabled"], state["mode"], state["bus"], state["stale"]) == (
        True,
        "holding",
        "up",
        False,
    )
    assert state["position_rad"] == pytest.approx(world.gripper.position_rad, abs=0.01)
    world.run(0.1)
    assert client.result("state.get")["seq"] >= state["seq"] + 20


def test_reads_overtake_a_motion_of_the_same_connection() -> None:
    world = World()
    client = world.enabled()
    motion = client.send("motion.open")
    client.result("state.get")
    assert motion not in client.answers
    world.run_until(lambda: answered(client, motion))
    assert client.answers[motion]["result"]["ok"]


def test_a_motion_that_is_not_waited_for_outlives_its_connection() -> None:
    world = World()
    first = world.enabled()
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
    world = World()
    client = world.enabled()
    motion = client.send("motion.open", progress=True)
    client.session.congested = True
    world.run_until(lambda: answered(client, motion))
    assert not client.notifications


def test_progress_without_waiting_is_refused() -> None:
    world = World()
    client = world.enabled()
    assert client.refusal("motion.open", wait=False, progress=True) == "invalid_params"
    assert world.state.mode == "holding"


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
    first.read()
    assert first.answers[motion]["error"]["data"]["reason"] == "cancelled"
    assert world.state.mode == "holding"


def test_a_result_is_kept_with_the_state_in_which_it_came() -> None:
    world = World()
    first = world.enabled()
    result = first.result("motion.open")
    first.result("motion.close")
    job = world.client().result("job.get", job=result["job"])
    assert job["result"] == result
    assert job["result"]["state"]["opening_mm"] == pytest.approx(NOMINAL[0].travel_mm, abs=2)


def test_the_latest_64_jobs_are_kept() -> None:
    world = World()
    client = world.enabled()
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
        client.read()
    assert all("result" in client.answers[number] for client, number in holds)


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
    answered = [a for a in client.answers.values() if a.get("result", {}).get("kind") == "open"]
    assert len(answered) == MAX_PER_SESSION + 1
    assert client.result("job.wait", job=number.job)["state"] == "cancelled"


@pytest.mark.parametrize("mark", ["sent_s", "stop_generation"])
@pytest.mark.parametrize("method", ["motion.open", "motion.hold", "motor.enable"])
def test_a_motion_that_was_sent_before_a_stop_never_runs(method: str, mark: str) -> None:
    world = World()
    client = world.enabled()
    generation = client.result("hello")["stop_generation"]
    sent_s = world.now_s
    world.run(0.1)
    stopped = world.client().result("stop")
    assert stopped["generation"] == generation + 1
    world.client().result("stop.clear")
    value = sent_s if mark == "sent_s" else generation
    assert client.refusal(method, **{mark: value}) == "sent_before_stop"
    fresh = world.now_s if mark == "sent_s" else stopped["generation"]
    assert "result" in client.call(method, **{mark: fresh})


def test_reads_and_disable_do_not_mind_when_they_were_sent() -> None:
    world = World()
    client = world.enabled()
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
    mover.read()
    assert mover.answers[motion]["error"]["data"]["reason"] == "stopped"
    assert mover.refusal("motion.close") == "stopped"
    assert mover.refusal("motor.enable") == "stopped"
    assert stopper.result("stop", level="hold")["level"] == "relax"
    assert mover.result("stop.clear")["state"]["stop"] is None
    assert mover.result("motion.close")["ok"]


def test_refusals_say_who_and_what_helps() -> None:
    world = World().start()
    client, other = world.client(), world.client()
    assert client.refusal("motion.open") == "not_enabled"
    client.result("motor.enable")
    client.send("motion.open")
    error = other.call("motion.close")["error"]
    assert error["data"]["reason"] == "busy"
    assert error["data"]["owner"]["pid"] == client.session.peer.pid
    world.run_until(lambda: world.state.job is None)
    error = client.call("motion.open", speed_mm_s=1)["error"]
    assert error["data"]["reason"] == "out_of_limits"
    assert error["data"]["limit"] > error["data"]["requested"]


def test_without_a_calibration_no_motion_is_guessed() -> None:
    world = World(calibrated=False)
    client = world.enabled()
    assert client.refusal("motion.open") == "not_calibrated"


def test_a_silent_motor_refuses_with_its_reason() -> None:
    world = World()
    world.lose_to_motor = lambda _frame: True
    world.run(1.0)
    client = world.client()
    assert client.refusal("motor.enable") == "motor_silent"
    assert client.refusal("motion.open") == "motor_silent"
    assert client.result("state.get")["stale"]


def test_the_reasons_that_clients_can_meet_here_are_all_in_the_table() -> None:
    met: set[str] = set()
    world = World()
    client = world.enabled()
    client.result("stop")
    calls: list[tuple[Client, str, dict[str, Any]]] = [
        (client, "motion.open", {}),
        (client, "motion.open", {"stop_generation": 0}),
        (client, "job.get", {"job": 99}),
        (client, "nothing", {}),
        (client, "stop", {"level": 1}),
    ]
    for who, method, params in calls:
        met.add(who.refusal(method, **params))
    assert met == {"stopped", "sent_before_stop", "unknown_job", "unknown_method", "invalid_params"}
    assert met <= ERRORS.keys()


def test_hello_tells_the_time_by_the_daemons_clock() -> None:
    world = World().start()
    client = world.client()
    earlier_s = client.call("hello")["result"]["monotonic_s"]
    world.run(1.5)
    assert client.call("hello")["result"]["monotonic_s"] - earlier_s == pytest.approx(1.5, abs=0.1)
