"""What waits for the helper takes effect only while its sender still may: lease, stops, the end."""

from collections.abc import Callable

import pytest

from litegripd.app.build import load_at_start
from litegripd.model.state import HelperTask, TaskResult
from tests.world import Client, World, found_world, reason_of

Meanwhile = Callable[[World, Client], None]


def other_takes_the_lease(world: World, _client: Client) -> None:
    other = world.client()
    number = other.send("lease.take", why="it hangs")
    assert "result" in other.answered(number)


def other_had_the_lease(world: World, client: Client) -> None:
    other = world.client()
    for method, params in (("lease.take", {"why": "it hangs"}), ("lease.release", {})):
        number = other.send(method, **params)
        assert "result" in other.answered(number), other.answers[number]


def somebody_stops(world: World, _client: Client) -> None:
    world.client().send("stop")


def stopped_and_cleared(world: World, _client: Client) -> None:
    other = world.client()
    other.send("stop")
    assert other.has_answer(other.send("stop.clear"))


def the_daemon_ends(world: World, _client: Client) -> None:
    world.controller.shut_down()


@pytest.mark.parametrize(
    ("meanwhile", "reason"),
    [
        (other_takes_the_lease, "lease_lost"),
        (other_had_the_lease, "lease_lost"),
        (somebody_stops, "sent_before_stop"),
        (stopped_and_cleared, "sent_before_stop"),
        (the_daemon_ends, "shutting_down"),
    ],
)
def test_a_calibration_found_too_late_is_not_taken(meanwhile: Meanwhile, reason: str) -> None:
    world, client = found_world()
    client.result("lease.acquire")
    before = client.result("calibration.get")
    number = client.send("calibration.load", template="reverse")
    meanwhile(world, client)
    assert reason_of(client.wait(number)) == reason
    assert client.result("calibration.get") == before


def test_without_a_lease_it_is_not_taken_once_somebody_has_one() -> None:
    world, client = found_world()
    number = client.send("calibration.load", template="reverse")
    other = world.client()
    assert other.has_answer(other.send("lease.acquire"))
    assert reason_of(client.wait(number)) == "lease_held"
    assert client.result("calibration.get")["mount"] == "normal"


@pytest.mark.parametrize("has_left", [False, True])
def test_who_is_gone_has_nothing_loaded(has_left: bool) -> None:
    world = World()
    client, other = world.start().client(), world.client()
    client.send("calibration.load", template="reverse")
    if has_left:
        client.leave()
    world.run(1.0)
    assert other.result("calibration.get")["mount"] == ("normal" if has_left else "reverse")


def test_nothing_in_between_lets_it_be_taken() -> None:
    _, client = found_world()
    client.result("lease.acquire")
    assert client.result("calibration.load", template="reverse")["mount"] == "reverse"


def test_defaults_that_could_not_be_saved_are_as_before() -> None:
    world, client = found_world()
    before = client.result("config.get")
    world.disk.error = "the disk is full"
    answer = client.call("config.set", config={"force_n": 7.5}, keep=True)
    assert answer["error"]["data"]["reason"] == "not_saved"
    assert client.result("config.get") == before
    world.disk.error = None
    after = client.result("config.set", config={"force_n": 7.5}, keep=True)
    assert (after["kept"], after["config"]["force_n"]) == (True, 7.5)
    assert client.result("config.get") == after


def test_defaults_are_not_changed_while_others_are_being_saved() -> None:
    world, client = found_world()
    number = client.send("config.set", config={"force_n": 7.5}, keep=True)
    other = client.send("config.set", config={"force_n": 9.0})
    data = client.answered(other)["error"]["data"]
    assert (data["reason"], data["retryable"]) == ("too_many_requests", True)
    world.run_until(lambda: client.has_answer(number))
    assert client.result("config.get")["config"]["force_n"] == 7.5
    assert client.result("config.set", config={"force_n": 9.0})["config"]["force_n"] == 9.0


def starting() -> tuple[World, Client, Callable[[], HelperTask]]:
    """Return a daemon that has asked for its calibration, and what gives that helper task up."""
    world = World(calibrated=False)
    world.disk.silent = True
    found: list[HelperTask] = []
    load_at_start(world.controller, lambda: None)
    found += [task for task in world.controller.tasks if task.operation == "calibration.load"]
    client = world.start().client()
    world.disk.silent = False
    return world, client, lambda: found[0]


def test_until_the_calibration_is_read_motions_are_told_to_try_again() -> None:
    world, client, coming = starting()
    assert client.result("motor.enable")["ok"]
    error = client.call("motion.open")["error"]
    assert (error["data"]["reason"], error["data"]["retryable"]) == ("starting", True)
    assert "still reading the calibration" in error["message"]
    coming().on_result(world.disk.do(coming()))
    assert client.result("motion.open")["ok"]


@pytest.mark.parametrize(
    ("result", "reason"),
    [
        (TaskResult({"calibration": None, "skipped": [], "path": None}), "not_calibrated"),
        (TaskResult(error="the disk is on fire"), "calibration_unreadable"),
    ],
)
def test_without_a_calibration_it_is_said_once_that_is_known(
    result: TaskResult, reason: str
) -> None:
    _world, client, coming = starting()
    assert client.result("motor.enable")["ok"]
    coming().on_result(result)
    assert client.refusal("motion.open") == reason


def test_what_a_client_loads_meanwhile_stays() -> None:
    world, client, coming = starting()
    assert client.result("calibration.load", template="reverse")["mount"] == "reverse"
    coming().on_result(world.disk.do(coming()))
    assert client.result("calibration.get")["mount"] == "reverse"
