"""The losers' side of every rule on who may: what they are answered, and that they move nothing.

Each scene lets somebody lose (a lease, a race, a stop, a connection, a turn, a name), and then try.
"""

from collections.abc import Callable
from typing import Any

import pytest

from litegripd.rpc.sessions import Role
from tests.rpc.test_lease import MOVING
from tests.world import Client, World, found_world, reason_of

HALF_OPEN_MM = 50.0


class Scene:
    """A world in which jaws hold at half their travel: one client drives, another one looks on."""

    def __init__(self, *, uid: int = 1000, role: Role = "operator", **options: Any) -> None:
        self.world = World()
        self.first = self.world.enabled()
        self.first.session.role = "operator"
        self.first.result("motion.move", opening_mm=HALF_OPEN_MM)
        if options:
            self.token = str(self.first.result("lease.acquire", **options)["lease"])
        self.second = self.world.client(uid=uid, role=role)

    def nothing_of(self, act: Callable[[], Any]) -> Any:
        """Let somebody act, and check that nothing has come of it; return what the act returned."""
        world, controller = self.world, self.world.controller
        world.run(0.1)
        jobs, idle, phase = list(controller.jobs), controller.idle, world.phase
        calibration, opening_mm = controller.calibrated.calibration, world.state.opening_mm
        answer = act()
        world.run(0.5)
        assert [job.number for job in controller.jobs] == [job.number for job in jobs]
        assert controller.idle is idle
        assert controller.calibrated.calibration is calibration
        assert world.phase is phase
        assert opening_mm is not None
        assert world.state.opening_mm == pytest.approx(opening_mm, abs=0.2)
        return answer

    def error(self, client: Client, method: str, **params: Any) -> dict[str, Any]:
        """Let a client ask for what it is refused, and check that nothing has come of it."""
        answer = self.nothing_of(lambda: client.call(method, **params))
        assert "error" in answer, answer
        error: dict[str, Any] = answer["error"]
        return error

    def refusal(self, client: Client, method: str, **params: Any) -> str:
        """Let a client ask for what it is refused; return why, once nothing has come of it."""
        return str(self.error(client, method, **params)["data"]["reason"])


def wish_of(leased: bool) -> dict[str, Any]:
    """Return what makes a scene with a lease, or one without."""
    return {"on_lost": "hold"} if leased else {}


def holding(**options: Any) -> Scene:
    """Return a scene whose jaws hold an object by 8 N."""
    scene = Scene(**options)
    scene.world.gripper.put_object(width_mm=30.0)
    assert scene.first.result("motion.grasp", force_n=8, until="verdict")["ok"]
    scene.world.run(1.0)
    return scene


# A lease


def by_take(scene: Scene) -> None:
    scene.second.result("lease.take", why="it hangs")


def by_take_and_release(scene: Scene) -> None:
    """Take it as `litegripctl lease take` does."""
    by_take(scene)
    scene.second.result("lease.release")


def by_silence(scene: Scene) -> None:
    scene.world.run(0.2)


WAYS = {
    "taken": (by_take, "taken"),
    "taken and given back": (by_take_and_release, "taken"),
    "silent": (by_silence, "expired"),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("method", MOVING)
def test_who_has_lost_the_lease_moves_nothing_until_it_asks_again(method: str, way: str) -> None:
    lose, cause = WAYS[way]
    scene = Scene(ttl_s=0.1, on_lost="hold")
    lose(scene)
    error = scene.error(scene.first, method, **MOVING[method])
    data = error["data"]
    assert (data["reason"], data["cause"], data["retryable"]) == ("lease_lost", cause, False)
    assert data["hint"] == "lease.acquire"
    if cause == "taken":
        taker = scene.second.session.peer
        assert data["by"] == {"pid": taker.pid, "uid": taker.uid, "program": taker.program}
        assert data["why"] == "it hangs"
        assert "it hangs" in error["message"]
        assert f"pid {taker.pid}, uid {taker.uid}" in error["message"]


@pytest.mark.parametrize("way", WAYS)
def test_who_has_lost_the_lease_is_told_unasked_what_became_of_the_jaws(way: str) -> None:
    lose, cause = WAYS[way]
    scene = Scene(ttl_s=0.1, on_lost="disable")
    lose(scene)
    (loss,) = scene.first.told("lease.lost")
    left = "hold" if cause == "taken" else "disable"
    assert (loss["cause"], loss["on_lost"]) == (cause, left)
    if cause == "taken":
        assert (loss["why"], loss["by"]["pid"]) == ("it hangs", scene.second.session.peer.pid)
    scene.second.leave()
    scene.world.run(0.1)
    assert scene.world.state.enabled is (left == "hold")
    assert scene.first.refusal("motion.open", lease=scene.token) == "lease_lost"
    assert not scene.first.result("lease.get")["mine"]  # nothing is retaken by itself


def test_asking_again_ends_it_and_a_refusal_does_not() -> None:
    scene = Scene(purpose="sorting")
    by_take(scene)
    assert scene.first.refusal("lease.acquire") == "lease_held"
    assert scene.first.refusal("motion.open") == "lease_lost"
    scene.second.result("lease.release")
    assert scene.first.refusal("motion.open") == "lease_lost"
    scene.first.result("lease.acquire")
    scene.first.result("lease.release")
    assert scene.first.result("motion.open")["ok"]


def test_a_loss_is_one_connections_and_the_same_program_may_open_another() -> None:
    scene = Scene(purpose="sorting")
    by_take_and_release(scene)
    another = scene.world.client(pid=scene.first.session.peer.pid)
    assert another.result("motion.open")["ok"]
    assert scene.first.refusal("motion.close") == "lease_lost"


def test_whose_turn_has_come_again_has_lost_nothing_any_more() -> None:
    scene = Scene(purpose="sorting")
    by_take(scene)
    number = scene.first.send("lease.acquire", wait_s=10)
    assert scene.first.refusal("motion.open") == "lease_lost"
    scene.second.result("lease.release")
    scene.world.run_until(lambda: scene.first.has_answer(number))
    assert scene.first.result("motion.open")["ok"]


@pytest.mark.parametrize("jaws", [None, "hold", "relax", "disable"])
@pytest.mark.parametrize("on_lost", ["hold", "relax", "disable"])
def test_a_take_over_holds_what_is_held_unless_the_taker_says_otherwise(
    on_lost: str, jaws: str | None
) -> None:
    scene = Scene(on_lost=on_lost)
    world = scene.world
    world.take_log()
    wanted = {} if jaws is None else {"jaws": jaws}
    answer = scene.second.result("lease.take", why="mine", **wanted)
    left = jaws or "hold"
    assert answer["jaws"] == left
    assert answer["taken_from"]["pid"] == scene.first.session.peer.pid
    assert answer["ended_job"] is None
    world.run(0.2)
    mode = {"hold": "holding", "relax": "relaxed", "disable": "disabled"}[left]
    assert world.state.mode == mode
    words = {"hold": "keep their hold", "relax": "go slack", "disable": "are disabled"}[left]
    log = [event.message for event in world.service.take_events()]
    assert f"the gripper was taken over: the jaws {words}" in log


def test_a_take_over_keeps_the_force_on_an_object() -> None:
    scene = holding(on_lost="disable")
    opening_mm = scene.world.state.opening_mm
    scene.second.result("lease.take", why="mine")
    scene.second.result("lease.release")
    scene.world.run(1.0)
    state = scene.world.state
    assert state.is_grasped
    assert state.force_set_n == 8
    assert state.force_n == pytest.approx(8, abs=2)
    assert state.opening_mm == pytest.approx(opening_mm, abs=0.2)


@pytest.mark.parametrize("detach", [False, True])
@pytest.mark.parametrize("leased", [False, True])
def test_whose_motion_runs_loses_it_to_who_takes_the_gripper(leased: bool, detach: bool) -> None:
    scene = Scene(**wish_of(leased))
    number = scene.first.send("motion.open", speed_mm_s=10, detach=detach)
    scene.world.run(0.5)
    job = scene.world.controller.jobs.running
    assert job is not None
    answer = scene.second.result("lease.take", why="my turn")
    assert answer["ended_job"] == job.number
    assert scene.world.controller.jobs.running is None
    opening_mm = scene.world.state.opening_mm
    scene.world.run(0.5)
    assert scene.world.state.opening_mm == pytest.approx(opening_mm, abs=1.0)
    data = scene.first.answered(number)["error"]["data"]
    assert (data["reason"], data["cause"], data["why"]) == ("lease_lost", "taken", "my turn")
    assert data["by"]["pid"] == scene.second.session.peer.pid
    assert scene.second.result("motion.close")["ok"]


@pytest.mark.parametrize("leased", [False, True])
@pytest.mark.parametrize("gives_back", [False, True])
def test_what_others_have_queued_never_begins_after_a_take_over(
    gives_back: bool, leased: bool
) -> None:
    """Also where the taker gives the gripper back at once, as `litegripctl lease take` does."""
    scene = Scene(**wish_of(leased))
    scene.first.send("motion.open", speed_mm_s=10, wait=False)
    number = scene.first.send("motion.close", if_busy="queue", detach=True)
    scene.world.run(0.2)
    scene.second.send("lease.take", why="my turn")
    if gives_back:
        scene.second.send("lease.release")
    opening_mm = scene.world.state.opening_mm
    scene.world.run(0.5)
    assert scene.world.state.opening_mm == pytest.approx(opening_mm, abs=1.0)
    assert scene.world.controller.jobs.running is None
    error = scene.first.answered(number)["error"]["data"]
    assert (error["reason"], error["cause"], error["why"]) == ("lease_lost", "taken", "my turn")


@pytest.mark.parametrize("take", [by_take, by_take_and_release])
@pytest.mark.parametrize("leased", [False, True])
def test_whose_motion_was_taken_is_told_once_unasked_and_moves_nothing_until_it_asks(
    leased: bool, take: Callable[[Scene], None]
) -> None:
    """Also where it had no lease, and waits for nothing."""
    scene = Scene(**wish_of(leased))
    job = scene.first.result("motion.open", speed_mm_s=10, wait=False)["job"]
    scene.world.run(0.2)
    take(scene)
    (loss,) = scene.first.told("lease.lost")
    loser, taker = scene.first.session.peer, scene.second.session.peer
    assert (loss["client"], loss["pid"]) == (scene.first.session.identity, loser.pid)
    assert (loss["cause"], loss["why"], loss["on_lost"]) == ("taken", "it hangs", "hold")
    assert loss["by"] == {"pid": taker.pid, "uid": taker.uid, "program": taker.program}
    assert scene.second.told("lease.lost") == []
    scene.world.run(0.1)
    error = scene.error(scene.first, "motion.close")
    what = "the lease of this connection is lost" if leased else "the gripper is lost to"
    by = f"{taker.program} (pid {taker.pid}, uid {taker.uid}): it hangs"
    assert error["message"].startswith(what)
    assert f": it was taken over by {by}; nothing moves for it until" in error["message"]
    assert (error["data"]["reason"], error["data"]["by"]) == ("lease_lost", loss["by"])
    ended = scene.first.result("job.get", job=job)
    assert ended["error"]["message"] == f"the gripper was taken over by {by}"
    assert scene.second.result("motion.move", opening_mm=30)["ok"]
    if take is by_take:
        scene.second.result("lease.release")
    scene.first.result("lease.acquire")
    scene.first.result("lease.release")
    assert scene.first.result("motion.open")["ok"]


@pytest.mark.parametrize("take", [by_take, by_take_and_release])
def test_a_stream_that_was_taken_does_not_begin_anew(take: Callable[[Scene], None]) -> None:
    scene = Scene()

    def stream() -> None:
        for opening_mm in range(20, 40):
            scene.first.notify("stream.set", opening_mm=opening_mm)
            scene.world.run(0.02)

    stream()
    take(scene)
    scene.world.run(0.5)
    scene.nothing_of(stream)
    (refused,) = scene.first.told("stream.refused")
    assert (refused["data"]["reason"], refused["data"]["why"]) == ("lease_lost", "it hangs")
    assert refused["data"]["by"]["pid"] == scene.second.session.peer.pid


def test_each_whose_queued_motion_was_taken_is_told_too() -> None:
    scene = Scene()
    third, taker = scene.world.client(), scene.world.client()
    scene.first.result("motion.open", wait=False)
    for client in (scene.second, third, third):
        client.result("motion.close", wait=False, if_busy="queue")
    taker.result("lease.take", why="it hangs")
    taker.result("lease.release")
    for client in (scene.first, scene.second, third):
        assert [loss["client"] for loss in client.told("lease.lost")] == [client.session.identity]
        assert scene.refusal(client, "motion.hold") == "lease_lost"


def test_who_moves_under_the_lease_of_another_is_told_of_its_loss() -> None:
    scene = Scene(purpose="sorting")
    helper = scene.world.client()
    helper.send("motion.open", lease=scene.token, wait=False)
    by_take_and_release(scene)
    for client in (scene.first, helper):
        assert [loss["client"] for loss in client.told("lease.lost")] == [client.session.identity]
        assert scene.refusal(client, "motion.hold") == "lease_lost"


def test_who_moves_nothing_or_disables_has_nothing_to_lose_without_a_lease() -> None:
    scene = Scene()
    number = scene.first.send("motor.disable")
    by_take_and_release(scene)
    assert scene.first.wait(number)["result"]["ok"]
    assert scene.world.client().result("motor.enable")["ok"]
    by_take_and_release(scene)
    assert scene.first.told("lease.lost") == []
    assert scene.first.result("motion.open")["ok"]


def test_nothing_is_kept_of_a_client_that_its_motion_has_outlived() -> None:
    scene = Scene()
    scene.first.result("motion.open", speed_mm_s=10, wait=False)
    scene.first.leave()
    assert scene.second.result("lease.take", why="it hangs")["ended_job"] is not None
    assert scene.world.controller.lease._losses == {}


@pytest.mark.parametrize("leased", [False, True])
def test_an_operator_takes_nothing_from_another_user(leased: bool) -> None:
    scene = Scene(uid=1001, **wish_of(leased))
    number = scene.first.send("motion.open", speed_mm_s=10)
    scene.world.run(0.2)
    scene.second.refused(
        "lease.take",
        "not_permitted",
        f"pid {scene.first.session.peer.pid}, uid 1000",
        why="my turn",
    )
    assert not scene.first.has_answer(number)
    scene.second.session.role = "admin"
    scene.second.result("lease.take", why="maintenance")
    scene.world.tick()
    assert scene.first.has_answer(number)


@pytest.mark.parametrize("leased", [False, True])
def test_a_disabling_that_has_not_begun_is_not_broken_off_by_a_take_over(leased: bool) -> None:
    scene = Scene(**wish_of(leased))
    number = scene.first.send("motor.disable")
    assert scene.second.result("lease.take", why="my turn")["ended_job"] is None
    assert scene.first.wait(number)["result"]["ok"]
    assert scene.world.gripper.motor.status == 0


# A token: a name for the lease


def test_what_a_stranger_can_read_shows_it_no_token() -> None:
    scene = Scene(uid=1001, purpose="sorting")
    seen = [scene.second.call(method) for method in ("hello", "lease.get", "clients.list")]
    scene.second.result("events.subscribe")
    assert scene.token not in str(seen)
    assert not any(scene.token in str(note) for note in scene.second.notifications)
    number = scene.second.result("lease.get")["owner"]["number"]
    guesses = [f"0:{number}", str(number), scene.token[:-1], scene.token.swapcase()]
    methods = ("motion.open", "motor.disable", "lease.release", "lease.renew", "lease.resume")
    for guess in guesses:
        for method in methods:
            assert scene.refusal(scene.second, method, lease=guess) == "lease_lost"
    assert scene.first.result("lease.get")["mine"]


def test_each_grant_has_a_secret_of_its_own() -> None:
    scene = Scene(purpose="sorting")
    again = scene.first.result("lease.acquire", purpose="sorting more")["lease"]
    assert again == scene.token  # the same lease
    taken = scene.second.result("lease.take", why="a test")["lease"]
    scene.second.result("lease.release")
    fresh = scene.first.result("lease.acquire")["lease"]
    assert len({scene.token, taken, fresh}) == 3
    assert all(len(token) >= 20 for token in (scene.token, taken, fresh))
    for old in (scene.token, taken):
        assert scene.refusal(scene.second, "motion.open", lease=old) == "lease_lost"


def test_the_log_names_who_acted_under_the_lease_of_another() -> None:
    scene = Scene(purpose="sorting")
    helper = scene.world.client(uid=1001, role="operator")
    scene.world.take_log()
    helper.result("motion.open", lease=scene.token)
    helper.result("lease.release", lease=scene.token)
    log = [event.message for event in scene.world.service.take_events()]
    peer, holder = helper.session.peer, scene.first.session.peer
    who = f"{peer.program} (pid {peer.pid}, uid 1001)"
    assert f"job 3: open by {who}" in log
    of = f"in the place of {holder.program} (pid {holder.pid}, uid 1000)"
    assert f"lease 1 given back by {who}, {of}" in log


def test_a_release_that_is_refused_changes_nothing() -> None:
    scene = Scene(purpose="sorting")
    helper = scene.world.client()
    number = helper.send("motion.open", speed_mm_s=10, lease=scene.token)
    scene.world.run(0.2)
    scene.world.take_log()
    assert scene.second.refusal("lease.release") == "lease_held"
    log = [event.message for event in scene.world.service.take_events()]
    assert not [text for text in log if "given back" in text]
    scene.first.leave()  # the motion runs under its lease
    scene.world.run(0.1)
    assert reason_of(helper.answered(number)) == "client_lost"


# A race


@pytest.mark.parametrize("if_busy", ["reject", "replace"])
def test_a_motion_that_comes_second_leaves_the_first_alone(if_busy: str) -> None:
    scene = Scene()
    number = scene.first.send("motion.open")
    scene.world.run(0.1)
    running = scene.world.controller.jobs.running
    error = scene.second.call("motion.close", if_busy=if_busy)["error"]["data"]
    assert running is not None
    assert (error["reason"], error["job"]) == ("busy", running.number)
    assert error["owner"]["pid"] == scene.first.session.peer.pid
    assert scene.first.wait(number)["result"]["outcome"] == "pressed_home"


@pytest.mark.parametrize(
    ("method", "params", "reason"),
    [
        ("motion.move", {"opening_mm": 500}, "out_of_limits"),
        ("motion.open", {"config": {"speed_mm_s": 10_000}}, "invalid_params"),
        ("motion.move", {"opening_mm": 20, "openness": 0.1}, "invalid_params"),
        ("trajectory.play", {"name": "../x"}, "invalid_params"),
    ],
)
def test_a_replacement_that_is_refused_leaves_the_running_motion(
    method: str, params: dict[str, Any], reason: str
) -> None:
    scene = Scene()
    number = scene.first.send("motion.open", speed_mm_s=20)
    scene.world.run(0.3)
    assert scene.first.refusal(method, if_busy="replace", **params) == reason
    assert not scene.first.has_answer(number)
    assert scene.first.wait(number)["result"]["outcome"] == "pressed_home"


def test_a_replacement_before_the_first_tick_of_a_motion_does_not_crush_what_is_held() -> None:
    scene = holding()
    first = scene.first.send("motion.open")
    result = scene.first.result("motion.close", if_busy="replace")
    assert result["outcome"] == "blocked"
    assert scene.first.answers[first]["error"]["data"]["reason"] == "replaced"
    assert scene.world.state.is_grasped


# A stop


def test_what_a_stop_has_broken_off_says_so_and_nothing_follows_it() -> None:
    scene = Scene()
    running = scene.first.send("motion.open", speed_mm_s=10)
    queued = scene.first.send("motion.close", if_busy="queue")
    scene.world.run(0.1)
    scene.second.result("stop", why="a hand")
    scene.world.run(0.1)
    for number in (running, queued):
        assert reason_of(scene.first.answered(number)) == "stopped"
    for method in ("motor.enable", "motion.open", "motion.hold", "motion.zero_gravity"):
        error = scene.error(scene.first, method)
        assert error["data"]["reason"] == "stopped"
        assert "a hand" in error["message"]


@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
def test_who_clears_is_told_which_stop_was_latched(level: str) -> None:
    _, client = found_world()
    assert client.result("stop.clear")["cleared"] is None
    client.result("stop", level=level)
    assert client.result("stop.clear")["cleared"] == level
    assert client.result("stop.clear")["cleared"] is None


def test_who_has_stopped_clears_though_another_has_the_lease() -> None:
    scene = Scene(uid=1001, purpose="sorting")
    scene.second.result("stop", why="a hand")
    same_user = scene.world.client(uid=1001, role="operator")
    same_user.result("stop.clear")
    assert scene.world.state.stop is None
    assert scene.first.result("motion.open")["ok"]


@pytest.mark.parametrize("who", ["holder", "admin"])
def test_the_holder_and_an_admin_clear_what_another_has_stopped(who: str) -> None:
    scene = Scene(uid=1001, purpose="sorting")
    scene.second.result("stop")
    clearing = scene.first if who == "holder" else scene.world.client(uid=1002, role="admin")
    clearing.result("stop.clear")
    assert scene.world.state.stop is None


def test_anybody_else_is_told_who_may_clear() -> None:
    scene = Scene(uid=1001, purpose="sorting")
    for _ in range(2):
        scene.second.result("stop")
    third = scene.world.client(uid=1002, role="operator")
    error = scene.error(third, "stop.clear")
    assert error["data"]["reason"] == "lease_held"
    assert error["data"]["may_clear_uids"] == [1001]
    holder, stopper = scene.first.session.peer, scene.second.session.peer
    assert error["data"]["owner"]["pid"] == holder.pid
    assert f"the stop, by {stopper.program} (pid {stopper.pid}), may" in error["message"]
    assert f"{holder.program} (pid {holder.pid}), who has the lease" in error["message"]
    assert error["message"].count("uid 1001, who stopped") == 1
    assert "admin" in error["message"]
    assert scene.world.state.stop is not None


def test_a_stop_that_was_raised_is_for_who_raised_it_or_stopped_since() -> None:
    scene = Scene(uid=1001, purpose="sorting")
    third, fourth = (scene.world.client(uid=uid, role="operator") for uid in (1002, 1003))
    scene.second.result("stop")
    third.result("stop", level="disable")
    scene.world.run(0.5)
    assert scene.second.refusal("stop.clear") == "lease_held"
    fourth.result("stop")
    fourth.result("stop.clear")
    assert scene.world.state.stop is None


def test_who_has_lost_the_lease_is_not_told_that_nobody_has_it_who_may_clear() -> None:
    scene = Scene(ttl_s=0.1)
    by_silence(scene)
    stopper = scene.world.client(uid=1001)
    stopper.result("stop")
    error = scene.error(scene.first, "stop.clear")
    assert error["data"]["reason"] == "lease_lost"
    assert "nobody" not in error["message"]
    assert "uid 1001, who stopped" in error["message"]
    assert "(lease.acquire)" in error["message"]
    scene.first.result("lease.acquire")
    scene.first.result("stop.clear")


def test_an_observer_clears_only_what_nobody_else_has_stopped() -> None:
    scene = Scene(uid=1001, role="observer")
    for _ in range(2):
        scene.second.result("stop")
    scene.second.result("stop.clear")
    assert scene.world.state.stop is None
    assert scene.refusal(scene.second, "stop.clear") == "not_permitted"
    scene.first.result("stop")
    assert scene.refusal(scene.second, "stop.clear") == "not_permitted"
    scene.second.result("stop")
    assert scene.refusal(scene.second, "stop.clear") == "not_permitted"
    assert scene.world.state.stop is not None


def test_who_has_lost_the_lease_still_stops_and_clears_its_own_stop() -> None:
    scene = Scene(uid=1001, role="admin", purpose="sorting")
    by_take(scene)
    scene.first.result("stop")
    scene.first.result("stop.clear")
    assert scene.first.refusal("motion.open") == "lease_lost"


# A connection


@pytest.mark.parametrize("leased", [False, True])
@pytest.mark.parametrize("method", [*MOVING, "lease.acquire", "lease.take", "stop.clear"])
def test_who_has_inherited_a_connection_may_not_do_what_its_opener_might(
    method: str, leased: bool
) -> None:
    scene = Scene(**wish_of(leased))
    scene.world.service.process_ended(scene.first.session, scene.world.now_s)
    assert scene.world.controller.lease.holder is None
    params = MOVING.get(method, {"why": "mine"} if method == "lease.take" else {})
    error = scene.error(scene.first, method, **params)
    assert error["data"]["reason"] == "client_lost"
    assert f"pid {scene.first.session.peer.pid}" in error["message"]
    assert scene.world.controller.lease.holder is None
    scene.first.result("state.get")
    scene.first.result("stop")


def test_who_waits_on_an_inherited_connection_gets_no_lease() -> None:
    scene = Scene(purpose="sorting")
    scene.second.send("lease.acquire", wait_s=10)
    scene.world.service.process_ended(scene.second.session, scene.world.now_s)
    scene.first.result("lease.release")
    scene.world.run(0.1)
    assert scene.world.controller.lease.holder is None


# A turn


def test_who_has_asked_twice_is_answered_twice_and_not_told_to_wait_for_itself() -> None:
    scene = Scene(purpose="sorting")
    numbers = [scene.second.send("lease.acquire", wait_s=1) for _ in range(2)]
    scene.first.result("lease.release")
    scene.world.run(0.1)
    assert all(scene.second.has_answer(number) for number in numbers)
    first, second = (scene.second.answers[number]["result"]["lease"] for number in numbers)
    assert first == second
    scene.second.result("lease.release")
    scene.world.run(2.0)
    assert scene.world.controller.lease.holder is None


def test_who_takes_what_it_waits_for_has_it() -> None:
    scene = Scene(purpose="sorting")
    number = scene.second.send("lease.acquire", wait_s=1, on_lost="relax")
    scene.second.result("lease.take", why="it hangs", on_lost="disable")
    scene.world.run(0.1)
    assert "result" in scene.second.answered(number)
    assert scene.second.result("lease.get")["owner"]["on_lost"] == "disable"


@pytest.mark.parametrize("if_busy", ["reject", "replace", "queue"])
def test_who_asks_between_two_motions_does_not_pass_the_one_that_is_next(if_busy: str) -> None:
    """The answer to the first comes a tick before the second begins."""
    scene = Scene()
    number = scene.first.send("motion.move", opening_mm=60)
    scene.first.send("motion.move", opening_mm=20, if_busy="queue", wait=False)
    scene.world.run_until(lambda: scene.first.has_answer(number))
    assert scene.world.controller.jobs.running is None
    (queued,) = scene.world.controller.jobs.queue
    last = scene.first.send("motion.move", opening_mm=70, if_busy=if_busy)
    taker = scene.second.call("lease.acquire")["error"]["data"]
    assert (taker["reason"], taker["job"]) == ("busy", queued.job.number)
    scene.world.run_until(lambda: not queued.job.is_running)
    assert scene.first.has_answer(last) == (if_busy != "queue")
    assert scene.world.state.opening_mm == pytest.approx(20, abs=1.0)
    if if_busy == "queue":
        scene.world.run_until(lambda: scene.first.has_answer(last))
        assert scene.world.state.opening_mm == pytest.approx(70, abs=1.0)
    else:
        error = scene.first.answers[last]["error"]
        assert error["data"]["job"] == queued.job.number
        assert "is about to begin" in error["message"]


def test_whose_turn_comes_when_the_gripper_is_anothers_does_not_move() -> None:
    scene = Scene()
    scene.first.send("motion.open", wait=False)
    number = scene.second.send("motion.close", if_busy="queue")
    third = scene.world.client()
    third.result("lease.take", why="my turn")
    scene.nothing_of(lambda: None)
    assert reason_of(scene.second.answered(number)) == "lease_lost"


# A name


def test_a_key_of_another_program_is_no_answer() -> None:
    scene = Scene()
    first = scene.first.result("motion.move", opening_mm=20, key="pick 1")
    scene.first.result("motion.move", opening_mm=80)
    second = scene.second.result("motion.move", opening_mm=20, key="pick 1")
    assert second["job"] != first["job"]
    assert scene.world.state.opening_mm == pytest.approx(20, abs=1.0)
    again = scene.world.client(pid=scene.first.session.peer.pid)
    scene.nothing_of(lambda: again.result("motion.move", opening_mm=20, key="pick 1"))
    assert again.result("motion.move", opening_mm=20, key="pick 1")["job"] == first["job"]


def test_programs_without_a_number_share_no_key() -> None:
    """Those of another pid namespace: only their connections tell them apart."""
    scene = Scene()
    object.__setattr__(scene.first.session.peer, "pid", 0)
    object.__setattr__(scene.second.session.peer, "pid", 0)
    first = scene.first.result("motion.move", opening_mm=20, key="pick 1")
    assert scene.first.result("motion.move", opening_mm=20, key="pick 1")["job"] == first["job"]
    assert scene.second.result("motion.move", opening_mm=20, key="pick 1")["job"] != first["job"]


def test_a_key_of_another_motion_is_refused() -> None:
    scene = Scene()
    scene.first.result("motion.move", opening_mm=20, key="pick 1")
    error = scene.error(scene.first, "motion.open", key="pick 1")
    assert error["data"]["reason"] == "invalid_params"
