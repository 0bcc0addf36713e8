"""A stop: in force with the next tick, latched, raised only, and cleared."""

import pytest

from litegripd.control.holds import Grip, Hold
from litegripd.io.loop import APART_SHARE
from litegripd.model.motor import Status
from litegripd.model.state import Event
from tests.control.states import (
    LEVELS,
    POWERED,
    STATES,
    in_state,
    is_slack,
    sends_disable,
)
from tests.world import PERIOD_S, World, ready


@pytest.mark.parametrize("after_s", [APART_SHARE * PERIOD_S, PERIOD_S], ids=["hastened", "usual"])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("level", LEVELS)
def test_a_stop_is_in_force_with_the_next_tick_and_latched(
    state: str, level: str, after_s: float
) -> None:
    world, client = in_state(state)
    before_rad = world.gripper.position_rad
    generation = world.controller.stop_latch.generation
    other = world.client()
    other.send("stop", level=level, why="test")
    world.tick_after(after_s)
    if state in POWERED:
        assert sends_disable(world) if level == "disable" else not sends_disable(world)
        assert level != "relax" or is_slack(world)
        if level == "hold":
            _, command = world.commands_since(world.now_s)[-1]
            assert abs(command.position_rad - world.gripper.position_rad) < 0.011
            assert abs(command.velocity_rad_s) < 0.01
    world.run(0.5)
    assert world.controller.jobs.running is None or world.controller.jobs.running.kind == "disable"
    assert world.state.stop is not None
    assert world.state.stop.level == level
    assert world.state.stop_generation == generation + 1
    if state in POWERED and level != "relax":
        assert abs(world.gripper.position_rad - before_rad) < 0.03
    for method in ("motor.enable", "motion.open", "motion.close", "motion.hold"):
        assert client.refusal(method) == "stopped"
    assert world.gripper.motor.status != Status.ENABLED or (state in POWERED and level != "disable")


def test_what_a_stop_broke_off_does_not_read_as_never_begun() -> None:
    world, client = ready()
    opening = client.send("motion.open")
    world.run(0.2)
    world.client().result("stop", why="a hand")
    error = client.wait(opening)["error"]
    job = error["data"]["job"]
    assert error["data"]["reason"] == "stopped"
    assert error["message"].startswith(f"job {job}, open, was broken off: a stop (hold) by ")
    assert client.call("motion.open")["error"]["message"].startswith("a stop (hold) by ")


@pytest.mark.parametrize("first", LEVELS)
@pytest.mark.parametrize("second", LEVELS)
def test_a_latched_stop_is_only_raised(first: str, second: str) -> None:
    world, client = ready()
    client.result("stop", level=first, why="one")
    answered = client.result("stop", level=second, why="two")
    highest = max((first, second), key=LEVELS.index)
    assert answered["level"] == highest
    assert answered["generation"] == 2
    world.run(0.1)
    assert world.state.stop is not None
    assert world.state.stop.level == highest
    assert world.state.enabled == (highest != "disable")
    if highest == "relax":
        assert is_slack(world)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("state", STATES)
def test_after_clearing_the_gripper_gets_back_to_work(state: str, level: str) -> None:
    world, client = in_state(state)
    client.result("stop", level=level)
    world.lose_to_motor = lambda _frame: False
    world.gripper.set_supply(24.0)
    client.result("stop.clear")
    world.run(0.3)
    assert client.result("motor.enable")["ok"]
    assert client.result("motion.open")["ok"]


def test_clearing_moves_nothing() -> None:
    world, client = ready()
    client.result("stop", level="relax")
    client.result("stop.clear")
    world.run(0.1)
    assert is_slack(world)
    assert world.state.mode == "relaxed"
    assert world.state.stop is None


def test_a_held_stop_asks_for_no_more_torque_than_there_is() -> None:
    world, client = in_state("pressing")
    before_nm = world.torque_nm
    client.send("stop")
    assert max(world.track(0.5, lambda: world.torque_nm)) <= before_nm + 0.05


def test_a_stop_that_is_asked_for_beside_an_idle_enable_keeps_the_hold() -> None:
    """Enabling what is enabled already ends with the next tick; a stop before it drops nothing."""
    world, client = ready()
    client.send("motor.enable")
    client.send("stop", level="hold")
    world.run(0.2)
    assert world.gripper.motor.status == Status.ENABLED
    assert not is_slack(world)


def test_requests_that_were_sent_before_a_stop_never_run() -> None:
    world, client = ready()
    generation = client.result("hello")["stop_generation"]
    client.result("stop")
    client.result("stop.clear")
    assert client.refusal("motion.open", stop_generation=generation) == "sent_before_stop"
    assert client.refusal("motion.open", sent_s=world.now_s - 0.1) == "sent_before_stop"
    assert client.refusal("motor.enable", sent_s=world.now_s - 0.1) == "sent_before_stop"
    assert client.result("motion.open", stop_generation=generation + 1, sent_s=world.now_s)["ok"]


@pytest.mark.parametrize("mark", ["stop_generation", "sent_s"])
def test_a_clear_that_was_sent_before_a_stop_does_not_clear_it(mark: str) -> None:
    world, client = ready()
    before = {"stop_generation": client.result("stop")["generation"], "sent_s": world.now_s}
    world.tick()
    world.controller.stop("disable", None, "a hand in the jaws", world.now_s)
    error = client.call("stop.clear", **{mark: before[mark]})["error"]
    generation = world.state.stop_generation
    assert error["data"] == {
        "reason": "sent_before_stop",
        "retryable": False,
        "stop_generation": generation,
        "level": "disable",
        "owner": None,
        "why": "a hand in the jaws",
    }
    how = {
        "stop_generation": "this client had not heard of it",
        "sent_s": "it came 0.005 s after this was sent",
    }
    assert error["message"] == (
        f"a stop (disable) by the daemon: a hand in the jaws; {how[mark]}, so this is not carried"
        " out: look at the state and, when it is safe, send it again, which then clears that, too"
    )
    stop = world.state.stop
    assert stop is not None
    assert stop.level == "disable"
    client.result("stop.clear", stop_generation=generation, sent_s=world.now_s)
    assert world.state.stop is None


def test_of_a_stop_that_is_cleared_by_now_this_is_said_first() -> None:
    world, client = ready()
    generation = client.result("hello")["stop_generation"]
    world.client().result("stop", why="a hand")
    world.client().result("stop.clear")
    told = client.call("motion.open", stop_generation=generation)["error"]["message"]
    assert told.partition("): ")[2] == (
        "a hand; it is cleared, but this client had not heard of it, so this is not carried out:"
        " look at the state and, when it is safe, send it again"
    )


def test_a_clear_that_does_not_say_when_it_was_sent_clears() -> None:
    world, client = ready()
    client.result("stop")
    world.client().result("stop")
    client.result("stop.clear")
    assert world.state.stop is None


def stop_events(world: World) -> list[Event]:
    """Return the events about stops since the last call."""
    found: list[Event] = []
    while events := world.service.take_events():
        found += events
    return [one for one in found if one.kind in ("stop", "stop_cleared")]


def test_a_flood_of_stops_is_one_event_until_the_stop_is_raised_and_is_told_when_cleared() -> None:
    world, client = ready()
    stop_events(world)
    for level in ("relax",) * 50 + ("hold",) * 50:
        client.result("stop", level=level)
    (event,) = stop_events(world)
    assert event.data == {"level": "relax"}
    assert (client.result("state.get")["stop"] or {})["repeats"] == 99
    client.result("stop", level="disable")
    (event,) = stop_events(world)
    assert event.data == {"level": "disable"}
    client.result("stop", level="disable")
    assert client.result("stop.clear")["generation"] == 102
    (event,) = stop_events(world)
    assert event.kind == "stop_cleared"
    assert event.data == {"repeats": 100}
    assert event.message.endswith("; 100 more came while it was latched")
    client.result("stop")
    assert client.result("stop.clear")["generation"] == 103
    first, second = stop_events(world)
    assert (first.kind, second.data) == ("stop", {"repeats": 0})
    assert "meanwhile" not in second.message


def test_a_repeated_stop_freezes_what_holds_by_force_again() -> None:
    world, client = ready()
    client.result("motion.close")
    client.result("motion.set_force", force_n=5)
    client.result("stop")
    idle = world.controller.idle
    assert isinstance(idle, Grip)
    idle.force_n = 50.0  # as if something had raised it behind the latch
    client.result("stop")
    assert idle.force_n == idle.applied_n < 50.0


@pytest.mark.parametrize("again", LEVELS)
def test_a_repeated_stop_goes_by_the_level_that_is_latched(again: str) -> None:
    world, client = ready()
    client.result("stop", level="relax")
    world.tick()
    world.controller.idle = Hold(world.gripper.position_rad, world.controller.gains)
    world.tick()
    assert not is_slack(world)
    client.result("stop", level=again)
    world.tick()
    assert sends_disable(world) if again == "disable" else is_slack(world)


def test_a_stop_makes_void_what_was_sent_before_it_however_often_it_is_repeated() -> None:
    world, client = ready()
    client.result("stop")
    between_s, known = world.now_s, client.result("state.get")["stop_generation"]
    world.tick()
    client.result("stop")
    client.result("stop.clear")
    assert client.refusal("motion.open", stop_generation=known) == "sent_before_stop"
    assert client.refusal("motion.open", sent_s=between_s) == "sent_before_stop"


def test_what_was_queued_never_begins_though_the_stop_is_cleared_in_the_same_tick() -> None:
    world = World()
    client, other = world.enabled(), world.client()
    client.send("motion.open", wait=False)
    number = client.send("motion.close", if_busy="queue")
    world.run(0.2)
    other.send("stop")
    other.send("stop.clear")
    assert world.controller.stop_latch.latched is None
    opening_mm = world.state.opening_mm
    world.run(0.5)
    assert world.controller.jobs.running is None
    assert world.state.opening_mm == pytest.approx(opening_mm, abs=1.0)
    assert client.has_answer(number)
    assert client.answers[number]["error"]["data"]["reason"] == "stopped"
