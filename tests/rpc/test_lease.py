"""The lease over the wire: who may move, who waits, how it is lost, and what that does."""

from typing import Any

import pytest

from litegripd.control.authority import MOST_WAITING, Lease, LeaseOptions
from litegripd.model.state import JobState, Owner
from litegripd.rpc.sessions import Role
from tests.world import Client, World, enabled_world, found_world, reason_of


def pair(**options: Any) -> tuple[World, Client, Client, str]:
    """Return a world, the holder of its lease, another client, and the token."""
    world, holder = enabled_world()
    token = str(holder.result("lease.acquire", **options)["lease"])
    return world, holder, world.client(), token


MOVING: dict[str, dict[str, Any]] = {
    "motor.enable": {},
    "motor.disable": {},
    "motion.open": {},
    "motion.close": {},
    "motion.grasp": {},
    "motion.move": {"opening_mm": 50},
    "motion.hold": {},
    "motion.zero_gravity": {},
    "motion.set_force": {"force_n": 5},
    "stream.set": {"opening_mm": 50},
    "calibration.load": {"template": "reverse"},
    "calibration.save": {},
    "calibration.zero": {},
    "calibration.manual": {"step": "begin"},
    "motor.set_zero": {},
    "trajectory.record_start": {},
    "trajectory.play": {"name": "pick"},
    "trajectory.control": {"action": "pause"},
}


@pytest.mark.parametrize("method", MOVING)
def test_whatever_moves_or_redefines_is_for_the_holder_alone(method: str) -> None:
    world, _, other, _ = pair(purpose="sorting")
    before = world.controller.calibrated.calibration
    data = other.refused(method, "lease_held", **MOVING[method])
    assert data["owner"]["purpose"] == "sorting"
    assert data["owner"]["pid"] == 101
    assert data["hint"] == "wait for it (lease.acquire with wait_s), or take it over (lease.take)"
    world.run(0.1)
    assert world.controller.jobs.running is None
    assert world.controller.calibrated.calibration is before
    assert world.state.enabled


def test_reads_and_the_stop_need_no_lease() -> None:
    world, _, other, _ = pair()
    for method in ("state.get", "health", "job.list", "calibration.get", "config.get", "lease.get"):
        other.result(method)
    other.result("stop")
    assert world.state.stop is not None


def test_a_free_gripper_needs_no_lease_for_a_single_motion() -> None:
    world, client = enabled_world()
    client.send("motion.open")
    world.run(0.2)
    other = world.client()
    assert other.refusal("lease.acquire") == "busy"  # for as long as it runs
    world.run_until(lambda: world.controller.jobs.running is None)
    other.result("lease.acquire")
    assert client.refusal("motion.open") == "lease_held"


def test_release_lets_others_in_and_leaves_the_motion() -> None:
    world, holder, other, token = pair()
    number = holder.send("motion.open")
    world.run(0.3)
    assert holder.result("lease.release", lease=token) == {"released": True}
    assert holder.wait(number)["result"]["ok"]
    other.result("lease.acquire")
    assert holder.refusal("lease.release") == "lease_held"
    assert holder.refusal("lease.release", lease=token) == "lease_lost"
    assert other.result("lease.get")["mine"]


def test_waiting_is_first_come_first_served() -> None:
    world, holder, first, _ = pair()
    second = world.client()
    numbers = [client.send("lease.acquire", wait_s=30) for client in (first, second)]
    assert first.call("lease.get")["result"]["waiting"] == 2
    third = world.client()
    holder.result("lease.release")
    error = third.call("lease.acquire")["error"]["data"]
    assert (error["reason"], error["waiting"]) == ("lease_held", 2)  # it may not pass them
    world.run(0.02)
    assert first.has_answer(numbers[0])
    assert not second.has_answer(numbers[1])
    first.leave()
    world.run(0.02)
    assert second.answered(numbers[1])["result"]["number"] == 3


def test_waiting_ends_in_time_and_with_the_connection() -> None:
    world, holder, other, _ = pair(purpose="sorting")
    for wait_s in (0.0, 0.5):
        began_s = world.now_s
        data = other.refused("lease.acquire", "lease_held", "sorting", wait_s=wait_s)
        assert world.now_s - began_s == pytest.approx(wait_s, abs=0.02)
        owner = data["owner"]
        assert (owner["pid"], owner["purpose"]) == (holder.session.peer.pid, "sorting")
    gone = world.client()
    gone.send("lease.acquire", wait_s=30)
    gone.leave()
    holder.result("lease.release")
    world.run(0.1)
    assert world.controller.lease.holder is None


def test_who_waits_gets_it_only_when_no_motion_runs() -> None:
    world, holder, other, _ = pair()
    holder.send("motion.open", wait=False)
    number = other.send("lease.acquire", wait_s=30)
    world.run(0.3)
    holder.leave()
    world.run(0.2)
    assert world.controller.jobs.running is not None  # detached: it goes on
    assert not other.has_answer(number)
    world.run_until(lambda: other.has_answer(number))
    assert world.controller.jobs.running is None


@pytest.mark.parametrize("on_lost", ["hold", "relax", "disable"])
def test_a_holder_that_hangs_loses_it(on_lost: str) -> None:
    world, holder, other, _ = pair(ttl_s=1.0, on_lost=on_lost)
    number = holder.send("motion.close", speed_mm_s=15)
    for _ in range(4):
        world.run(0.5)
        holder.result("lease.renew")
    assert not holder.has_answer(number)
    world.run(0.95)
    assert not holder.has_answer(number)
    world.run(0.1)
    error = holder.answered(number)["error"]["data"]
    assert (error["reason"], error["cause"]) == ("lease_lost", "expired")
    assert holder.told("lease.lost")[0]["cause"] == "expired"
    world.run(0.1)
    assert world.state.enabled is (on_lost != "disable")
    assert (world.state.mode == "relaxed") is (on_lost == "relax")
    other.result("lease.acquire")


def test_every_request_of_the_holder_renews_it() -> None:
    world, holder, other, _ = pair(ttl_s=0.5)
    for _ in range(5):
        world.run(0.4)
        holder.result("state.get")
        other.result("state.get")
    assert other.refusal("motion.open") == "lease_held"


@pytest.mark.parametrize("how", ["connection", "expired"])
def test_a_detached_motion_outlives_its_lease(how: str) -> None:
    world, holder, other, _ = pair(**({"ttl_s": 0.1} if how == "expired" else {}))
    number = int(holder.result("motion.open", wait=False)["job"])
    if how == "connection":
        holder.leave()
    world.run(0.2)
    assert world.controller.lease.holder is None
    world.run_until(lambda: world.controller.jobs.running is None)
    assert other.result("job.get", job=number)["state"] == "done"


def test_the_token_lets_another_connection_of_the_holder_move() -> None:
    world, holder, other, token = pair()
    number = other.send("motion.open", lease=token)
    world.run(0.2)
    job = world.controller.jobs.running
    assert job is not None
    assert job.owner.client == other.session.identity
    assert world.controller.lease.holder is not None
    assert job.grant == world.controller.lease.holder.number
    holder.leave()
    world.run(0.01)
    error = other.answered(number)["error"]
    assert error["data"]["reason"] == "client_lost"
    assert error["message"] == "the client under whose lease it ran went away"


def test_after_a_reconnect_the_old_token_works_if_nobody_has_had_it_since() -> None:
    world, holder, other, token = pair(on_lost="hold")
    assert other.refusal("lease.resume", lease=token) == "lease_held"  # it is not lost
    own = holder.call("lease.resume", lease=token)["error"]["message"]
    assert own == "the lease of this token is not lost: this connection has it"
    holder.leave()
    back = world.client()
    fresh = back.result("lease.resume", lease=token)["lease"]
    assert fresh != token
    assert back.result("motion.hold", lease=fresh)
    assert back.refusal("lease.resume", lease=token) == "lease_lost"
    back.leave()
    other.result("lease.acquire")
    other.result("lease.release")
    late = world.client()
    assert late.refusal("lease.resume", lease=fresh) == "lease_lost"


@pytest.mark.parametrize("token", ["", "1", "0:1", "0", "null", "é", "9" * 40, "x" * 43])
def test_what_is_no_token_of_this_daemon_neither_moves_nor_resumes(token: str) -> None:
    holder = World().enabled()
    assert holder.refusal("motion.open", lease=token) == "lease_lost"  # nobody has had a lease
    own = holder.result("lease.acquire")["lease"]
    assert holder.refusal("motion.open", lease=token) == "lease_lost"
    holder.leave()
    other = holder.world.client()
    assert other.refusal("lease.resume", lease=token) == "lease_lost"
    assert holder.world.controller.lease.holder is None
    other.result("lease.resume", lease=own)


def test_only_a_holder_renews() -> None:
    _, holder, other, _ = pair()
    assert not other.result("lease.get")["mine"]
    assert other.refusal("lease.renew") == "lease_held"
    holder.result("lease.release")
    assert holder.refusal("lease.renew") == "lease_lost"


def test_who_waits_gets_the_lease_with_options_of_its_own() -> None:
    world, holder, other, _ = pair(purpose="sorting", ttl_s=5.0, on_lost="disable")
    number = other.send("lease.acquire", wait_s=30)
    holder.result("lease.release")
    world.run_until(lambda: other.has_answer(number))
    owner = other.result("lease.get")["owner"]
    assert (owner["purpose"], owner["ttl_s"], owner["on_lost"]) == (None, None, "hold")


def test_who_has_waited_in_vain_is_told_how_long_and_not_to_do_the_same() -> None:
    _, holder, other, _ = pair(purpose="sorting")
    pid = holder.session.peer.pid
    answered = other.wait(other.send("lease.acquire", wait_s=2))["error"]
    assert answered["message"] == (
        f"program{pid} (pid {pid}) still has the gripper for sorting after 2 s of waiting:"
        " wait longer (lease.acquire with wait_s), or take it over (lease.take)"
    )
    assert answered["data"]["hint"].startswith("wait longer (")
    assert answered["data"]["owner"]["pid"] == pid
    assert (
        "has the gripper for sorting: wait for it ("
        in other.call("lease.acquire")["error"]["message"]
    )


def test_a_gripper_that_another_still_moves_was_not_free_in_so_many_seconds() -> None:
    world, holder, other, _ = pair()
    holder.send("motion.close", speed_mm_s=5)
    world.run(0.1)
    holder.result("lease.release")
    message = other.wait(other.send("lease.acquire", wait_s=1.5))["error"]["message"]
    assert message == "the gripper was not free within 1.5 s: wait longer, or try again"


def test_a_motion_is_replaced_by_who_shows_the_token_that_it_runs_under() -> None:
    world, holder, other, token = pair()
    first = holder.send("motion.open", speed_mm_s=10, lease=token)
    world.run(0.2)
    assert other.refusal("motion.close", if_busy="replace") == "lease_held"
    second = other.send("motion.close", if_busy="replace", lease=token)
    world.run_until(lambda: other.has_answer(second))
    assert reason_of(holder.answered(first)) == "replaced"
    who = other.result("events.subscribe", kinds=["job_started"])["events"][-1]["data"]
    who_text = f"program{who['pid']} (pid {who['pid']})"
    said = holder.answers[first]["error"]["message"]
    assert said == f"{who_text} began another motion in its place: close"
    assert other.answers[second]["result"]["outcome"] == "pressed_home"


def test_so_many_may_wait() -> None:
    lease, refusals = Lease(), []
    for client in range(MOST_WAITING + 1):
        owner = Owner(client, 100 + client, 1000, "p")
        refusals.append(lease.wait(owner, LeaseOptions(), 0.0, 10.0, lambda _answer: None))
    assert refusals[:-1] == [None] * MOST_WAITING
    assert refusals[-1] is not None
    assert refusals[-1].reason == "too_many_requests"


def test_a_lease_is_not_resumed_while_anothers_motion_runs() -> None:
    world, holder, other, token = pair(on_lost="hold")
    holder.leave()
    number = other.send("motion.open", speed_mm_s=20)
    world.run(0.1)
    back = world.client()
    error = back.call("lease.resume", lease=token)["error"]["data"]
    assert (error["reason"], error["owner"]["pid"]) == ("busy", other.session.peer.pid)
    assert "result" in other.wait(number)
    back.result("lease.resume", lease=token)


def test_a_lease_is_resumed_again_and_again_while_its_own_motion_runs_on() -> None:
    world, holder, _, token = pair(on_lost="relax")
    job = holder.result("motion.open", speed_mm_s=20, wait=False)["job"]
    for _ in range(3):
        holder.leave()
        world.run(0.1)
        holder = world.client()
        token = str(holder.result("lease.resume", lease=token)["lease"])
    assert holder.call("job.wait", job=job)["result"]["state"] == "done"
    world.run(0.1)
    assert world.state.mode == "holding"


@pytest.mark.parametrize(
    ("role", "allowed", "refused"),
    [
        ("observer", ["state.get", "stop", "lease.get"], ["motor.enable", "lease.acquire"]),
        ("operator", ["motor.enable", "motion.hold"], ["config.set"]),
        ("admin", ["motor.enable", "config.set"], []),
    ],
)
def test_roles_say_who_may_do_what(role: Role, allowed: list[str], refused: list[str]) -> None:
    _, client = found_world()
    client.session.role = role
    params: dict[str, dict[str, Any]] = {"config.set": {"config": {}}}
    for method in allowed:
        client.result(method, **params.get(method, {}))
    for method in refused:
        data = client.refused(method, "not_permitted", role, **params.get(method, {}))
        assert data["role"] == role
        assert data["needs"] in ("operator", "admin")


def test_the_same_key_is_the_same_job() -> None:
    world, client = enabled_world()
    first = client.send("motion.open", key="run-7")
    world.run(0.3)
    back = world.client(pid=client.session.peer.pid)
    second = back.send("motion.open", key="run-7")
    world.run_until(lambda: client.has_answer(first))
    assert back.wait(second)["result"]["job"] == client.answers[first]["result"]["job"]
    assert back.result("motion.open", key="run-7")["job"] == 2  # also when it is over
    error = back.call("motion.close", key="run-7")["error"]["data"]
    assert (error["reason"], error["parameter"], error["job"]) == ("invalid_params", "key", 2)
    assert back.result("motion.close", key="run-8")["job"] == 3


def test_a_replacement_ends_the_callers_own_motion_without_a_step() -> None:
    world, client = enabled_world()
    client.result("motion.close")
    first = client.send("motion.open")
    world.run(0.8)
    other = world.client()
    assert other.refusal("motion.close", if_busy="replace") == "busy"
    before = world.commands_since(world.now_s)[-1][1].position_rad
    second = client.send("motion.close", if_busy="replace")
    world.run(0.01)
    after = world.commands_since(world.now_s)[-1][1].position_rad
    assert abs(after - before) < 0.06  # of 1.6 rad: no more than the lead over the jaws
    assert reason_of(client.answered(first)) == "replaced"
    assert client.wait(second)["result"]["outcome"] == "pressed_home"


def test_a_queued_motion_runs_when_its_turn_comes() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    first = client.send("motion.open")
    second = other.send("motion.close", if_busy="queue")
    third = client.send("motion.move", opening_mm=30, if_busy="queue", wait=False)
    queued = client.result("job.list")["jobs"]
    assert [job["state"] for job in queued[1:]] == ["running", "queued", "queued"]
    world.run_until(lambda: other.has_answer(second))
    assert client.has_answer(first)
    assert other.answers[second]["result"]["outcome"] == "pressed_home"
    job = client.answers[third]["result"]["job"]
    done = client.call("job.wait", job=job)["result"]
    assert (done["state"], done["result"]["outcome"]) == ("done", "reached")


@pytest.mark.parametrize("how", ["stop", "cancel", "leave"])
def test_a_queued_motion_may_never_run(how: str) -> None:
    world = World()
    client, other = world.enabled(), world.client()
    client.send("motion.open", wait=False)
    number = other.send("motion.close", if_busy="queue")
    job = list(world.controller.jobs)[-1]
    if how == "stop":
        client.result("stop")
    elif how == "cancel":
        client.result("job.cancel", job=job.number)
    else:
        other.leave()
    world.run(0.1)
    assert job.state is JobState.CANCELLED
    ends = [event.data for event in world.take_log() if event.kind == "job_ended"]
    assert (job.number, "cancelled") in [(end["job"], end["state"]) for end in ends]
    if how != "leave":
        assert other.has_answer(number)
    world.run_until(lambda: world.controller.jobs.running is None)
    world.run(0.2)
    assert world.controller.jobs.running is None


def test_a_queued_motion_that_is_refused_by_then_says_why() -> None:
    _, client = enabled_world()
    client.send("motion.open", wait=False)
    number = client.send("motion.move", opening_mm=500, if_busy="queue")
    assert reason_of(client.wait(number)) == "out_of_limits"


def test_the_queue_is_bounded() -> None:
    client = World().enabled()
    client.send("motion.open", wait=False)
    for _ in range(8):
        client.send("motion.open", wait=False, if_busy="queue")
    assert client.refusal("motion.open", wait=False, if_busy="queue") == "too_many_requests"


def test_what_a_holder_does_not_name_anew_stays_as_it_was() -> None:
    world, holder, _, _ = pair(purpose="sorting", ttl_s=30, on_lost="relax")
    world.take_log()
    holder.result("lease.acquire", on_lost="disable")
    owner = holder.result("lease.get")["owner"]
    assert (owner["purpose"], owner["ttl_s"], owner["on_lost"]) == ("sorting", 30, "disable")
    assert not [event for event in world.service.take_events() if event.kind == "lease"]
