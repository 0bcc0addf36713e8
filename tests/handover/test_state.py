"""A successor goes on where the daemon before it was: the motor cannot tell one from the other."""

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegripd.app.build import build_service
from litegripd.app.machine import Machine
from litegripd.control.controller import Controller
from litegripd.control.heat import HeatModel
from litegripd.control.holds import Grip, Hold, Slack
from litegripd.handover import state as handover
from litegripd.model.gripper import GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MotorPhase
from litegripd.model.plain import PlainError, carried_by, is_stateful, undeclared
from litegripd.motor.exchange import Plausibility
from litegripd.motor.motor import Motor
from litegripd.rpc.service import RpcService
from litegripd.sim.plant import SimulatorParameters
from litegripd.trajectories.requests import Trajectories
from tests.control.exchange import exchange, exported
from tests.world import PERIOD_S, Client, FixedFacts, World

Scene = Callable[[str], World]
SLICES = tuple(f"litegripd.{name}." for name in ("teleop", "trajectories", "recorder", "handover"))
Course = list[tuple[tuple[str, dict[str, Any]], int]]


def gripping(mount: str, **params: Any) -> tuple[World, Client]:
    """Make a world that holds an object."""
    world = World(mount)
    world.gripper.put_object(width_mm=40.0)
    client = world.enabled()
    result = client.result("motion.grasp", force_n=8, until="verdict", **params)
    assert result["outcome"] == "object_held"
    return world, client


def hold(mount: str) -> World:
    world = World(mount)
    world.enabled().result("motion.move", opening_mm=50, speed_mm_s=100)
    return world


def grip(mount: str) -> World:
    return gripping(mount)[0]


def settled_grip(mount: str) -> World:
    world = grip(mount)
    world.run(1.0)
    return world


def stiff_grip(mount: str) -> World:
    world, _ = gripping(mount, hold_by="gains", config={"hold_interval": 0.3})
    world.run(0.1)
    return world


def rising_force(mount: str) -> World:
    world, client = gripping(mount)
    client.result("motion.set_force", force_n=25, config={"force_rate_n_s": 10})
    world.run(0.2)
    return world


def lowered_force(mount: str) -> World:
    """The force goes below its value, on its way to it."""
    world, client = gripping(mount)
    client.result("motion.set_force", force_n=2)
    world.run(0.1)
    return world


def is_searching(world: World) -> bool:
    """True if the jaws are on their way to an object that gave way: it may feel nothing."""
    return world.controller.grip is not None and world.controller.grip.clamp_n[0] == 0.0


def searching(mount: str) -> World:
    world = settled_grip(mount)
    world.gripper.give_way(1.5)
    world.run_until(lambda: is_searching(world), 0.1)
    return world


def recovering(mount: str) -> World:
    world = searching(mount)
    world.run_until(lambda: not is_searching(world), 0.2)
    return world


def squeeze(mount: str) -> World:
    world = World(mount)
    world.enabled().result("motion.set_force", force_n=6)
    world.run(0.05)
    return world


def slack(mount: str) -> World:
    world = World(mount)
    client = world.enabled()
    number = client.send("motion.zero_gravity")
    world.run(0.2)
    client.result("stop", level="relax", why="a test")
    world.run(0.1)
    assert client.has_answer(number)
    return world


def stopped(mount: str) -> World:
    world, client = gripping(mount)
    client.result("stop", level="hold", why="a test")
    world.run(0.1)
    return world


def just_stopped(mount: str) -> World:
    world, client = gripping(mount)
    client.send("stop", level="hold", why="a test")
    return world


def disabled(mount: str) -> World:
    return World(mount).start()


def fault(mount: str) -> World:
    world = World(mount)
    world.enabled()
    world.gripper.set_supply(40.0)
    world.run(0.1)
    return world


def another_zero(mount: str) -> World:
    world = World(mount)
    world.enabled().result("motor.set_zero")
    return world


def calibrated(mount: str) -> World:
    world = World(mount)
    assert world.enabled().result("calibration.zero")["ok"]
    return world


def hot(mount: str) -> World:
    world, client = gripping(mount)
    client.result("motion.set_force", force_n=30)
    guard = world.controller.output.heat
    world.run(3.0)
    guard.allowance_nm = 2.0
    return world


SCENES: tuple[Scene, ...] = (
    hold,
    grip,
    settled_grip,
    stiff_grip,
    rising_force,
    lowered_force,
    searching,
    recovering,
    squeeze,
    slack,
    stopped,
    just_stopped,
    disabled,
    fault,
    another_zero,
    calibrated,
    hot,
)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
@pytest.mark.parametrize("scene", SCENES)
def test_the_frames_are_the_same_with_and_without_a_restart(scene: Scene, mount: str) -> None:
    undisturbed, restarted = scene(mount), scene(mount)
    before_rad = restarted.gripper.position_rad
    exchange(restarted)
    for world in (undisturbed, restarted):
        world.sent.clear()
        world.run(1.0)
    assert restarted.sent == undisturbed.sent
    assert restarted.gripper.position_rad == undisturbed.gripper.position_rad
    assert restarted.state == undisturbed.state
    if scene in (hold, settled_grip, stopped, disabled):
        assert restarted.gripper.position_rad == pytest.approx(before_rad, abs=2e-3)


@pytest.mark.parametrize("scene", SCENES)
def test_a_successor_hands_over_what_it_was_handed(scene: Scene) -> None:
    world = scene("normal")
    assert exchange(world) == exported(world)
    early = exported(world)["state"]
    world.run(0.2)
    assert exchange(world, early) == exported(world)
    assert exchange(world, exported(world)["state"]) == exported(world)


def test_no_period_passes_without_a_command_and_the_motor_stays_enabled() -> None:
    world = settled_grip("normal")
    since_s = world.now_s
    for _ in range(20):
        exchange(world)
        world.tick()
        assert world.phase is MotorPhase.ENABLED
        assert isinstance(world.controller.idle, Grip)
    commands = world.commands_since(since_s + PERIOD_S / 2)
    assert len(commands) == 20
    assert {command.torque_nm for _, command in commands} == {commands[0][1].torque_nm}
    assert world.longest_gap_s(since_s) < 1.5 * PERIOD_S


def test_an_object_that_is_lost_after_the_restart_is_noticed() -> None:
    world = settled_grip("normal")
    exchange(world)
    world.run(0.1)
    world.gripper.remove_object()
    world.run_until(lambda: not isinstance(world.controller.idle, Grip))
    assert world.state.mode == "holding"


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_search_goes_on_after_the_restart(mount: str) -> None:
    world = searching(mount)
    exchange(world)
    assert is_searching(world)
    events = world.client()
    events.result("events.subscribe")
    world.run(0.5)
    events.read()
    told = [n["params"] for n in events.notifications if n["method"] == "event"]
    moved = [event["data"]["moved_mm"] for event in told if event["kind"] == "object_moved"]
    assert moved == [pytest.approx(1.5, abs=0.2)]
    assert world.state.is_grasped
    assert world.gripper.clamp_nm == pytest.approx(0.8, abs=0.25)


def test_slack_jaws_stay_slack() -> None:
    world = slack("normal")
    exchange(world)
    world.run(0.1)
    assert isinstance(world.controller.idle, Slack)


def test_a_stop_stays_latched_and_what_was_sent_before_it_stays_void() -> None:
    world = stopped("normal")
    generation = world.controller.stop_latch.generation
    exchange(world)
    client = world.client()
    assert client.refusal("motion.open") == "stopped"
    client.result("stop.clear")
    assert client.refusal("motion.open", stop_generation=generation - 1) == "sent_before_stop"
    assert client.refusal("motion.open", sent_s=world.now_s - 5.0) == "sent_before_stop"
    assert client.result("motion.open", stop_generation=generation)["ok"]


def test_a_lease_lapses_without_what_was_wished_for_its_loss_and_is_resumed_by_its_token() -> None:
    world, client = gripping("normal")
    token = client.result("lease.acquire", on_lost="disable", purpose="sorting")["lease"]
    exchange(world)
    world.run(0.5)
    assert world.state.enabled
    successor = world.client()
    assert successor.result("lease.get")["owner"] is None
    resumed = successor.result("lease.resume", lease=token)
    assert resumed["lease"] != token
    assert successor.result("lease.get")["owner"]["purpose"] == "sorting"
    assert world.client().refusal("motion.open") == "lease_held"


def test_jobs_and_their_numbers_go_on_and_a_key_names_the_same_motion() -> None:
    world = World()
    client = world.enabled()
    client.result("motion.move", opening_mm=50, speed_mm_s=100, key="once")
    kept = client.result("job.list")["jobs"]
    exchange(world)
    successor = world.client(pid=client.session.peer.pid)
    assert successor.result("job.list")["jobs"] == kept
    assert successor.result("motion.move", opening_mm=50, key="once")["ok"]  # makes no job 3
    successor.result("motion.hold")
    assert [job["job"] for job in successor.result("job.list")["jobs"]] == [1, 2, 3]
    assert successor.session.identity == client.session.identity + 1


@pytest.mark.parametrize(
    ("method", "params"),
    [("motion.open", {"speed_mm_s": 20}), ("motion.grasp", {"force_n": 5}), ("motor.disable", {})],
)
def test_nothing_is_handed_over_while_a_motion_runs(method: str, params: dict[str, Any]) -> None:
    world = World()
    client = world.enabled()
    client.send(method, **params)
    refusal = handover.why_not_restartable(world.machine)
    assert refusal is not None
    assert refusal.reason == "busy"
    assert "job 2" in refusal.message


def test_nothing_is_handed_over_while_another_motion_waits_or_the_motor_is_not_settled() -> None:
    world = World()
    assert handover.why_not_restartable(world.machine) is not None, "it is still looked for"
    client = world.enabled()
    world.lose_from_motor = lambda _frame: True
    world.run(0.1)
    silent = handover.why_not_restartable(world.machine)
    assert silent is not None, "it does not answer"
    assert silent.reason == "motor_silent"
    assert "restart without the hold" in str(silent.data["hint"])
    world.lose_from_motor = lambda _frame: False
    world.run_until(lambda: world.machine.motor.is_verifying)
    reading = handover.why_not_restartable(world.machine)
    assert reading is not None, "its registers are read again"
    assert reading.reason == "busy"
    assert "registers are being read" in reading.message
    world.run_until(lambda: handover.why_not_restartable(world.machine) is None)
    client.send("stop", level="disable")
    assert handover.why_not_restartable(world.machine) is not None, "it is about to be disabled"


def paths(plain: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """List the ways to all that is inside."""
    items = plain.items() if isinstance(plain, dict) else enumerate(plain)
    found = []
    for key, value in items:
        found.append((*path, key))
        if isinstance(value, dict | list) and key not in ("data", "content"):
            found += paths(value, (*path, key))
    return found


def successor_of(plain: Any) -> None:
    machine = Machine(GripperId(), None, MotionConfig(), PERIOD_S)
    service = build_service(machine.controller, FixedFacts(), PERIOD_S)
    handover.adopt(machine, service, plain["state"])
    handover.adopt_history(machine, service, plain["history"])


def test_what_is_missing_or_of_a_wrong_type_is_refused_wherever_it_is() -> None:
    whole = exported(stopped("normal"))
    successor_of(whole)
    free = {"registers", "ends"}  # of any size, with any keys
    accepted = []
    for path in (path for path in paths(whole) if len(path) > 1):
        holder = damaged = copy.deepcopy(whole)
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = {"odd": ["thing"]}
        try:
            successor_of(damaged)
        except PlainError:
            pass
        else:
            accepted.append(path)
        if isinstance(holder, dict) and not free & set(path):
            del holder[path[-1]]
            with pytest.raises(PlainError):
                successor_of(damaged)
    assert not [path for path in accepted if path[-1] not in ("data", "content", "value")]


@pytest.mark.parametrize("found", [0, handover.FORMAT + 1, None, str(handover.FORMAT)])
def test_another_format_is_refused(found: Any) -> None:
    whole = exported(disabled("normal"))
    whole["state"]["format"] = found
    with pytest.raises(PlainError, match="format"):
        successor_of(whole)


def test_another_motor_or_a_phase_on_its_way_is_refused() -> None:
    whole = exported(disabled("normal"))
    damaged = copy.deepcopy(whole)
    damaged["state"]["motor"]["_identification"]["identity"]["can_id"] = 9
    with pytest.raises(PlainError, match="another id"):
        successor_of(damaged)
    for phase in ("LOOKING", "ARMING", "LOST", "DISABLING"):
        whole["state"]["motor"]["_phase"] = phase
        with pytest.raises(PlainError, match="no phase"):
            successor_of(whole)


def test_the_first_position_that_a_successor_hears_is_judged_by_the_last_one_before() -> None:
    world = hold("normal")
    world.run(0.5)
    before_mm = world.gripper.opening_mm
    exchange(world)
    world.falsify_position(0.5)
    for _ in range(40):
        world.tick()
        assert world.gripper.opening_mm == pytest.approx(before_mm, abs=0.1)
    assert world.in_phase(MotorPhase.ENABLED)


def test_no_recording_gets_the_name_of_one_before() -> None:
    world = hold("normal")
    client = world.client()
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.2)
    first = client.result("trajectory.record_stop")["name"]
    exchange(world)
    client = world.client()
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.2)
    assert client.result("trajectory.record_stop")["name"] != first


def carried(source: object) -> Iterator[object]:
    """Yield an object and all that is handed over with it."""
    yield source
    owner: type = type(source)
    for name, kind in carried_by(owner).items():
        if is_stateful(kind):
            yield from carried(getattr(source, name))


def of_slices(source: object) -> Iterator[object]:
    """Yield an object of a slice, and all such objects that it keeps."""
    yield source
    for value in vars(source).values():
        if type(value).__module__.startswith(SLICES):
            yield from of_slices(value)


@pytest.mark.parametrize("scene", [hold, grip])
def test_every_attribute_is_carried_or_said_not_to_be(scene: Scene) -> None:
    world = scene("normal")
    assert isinstance(world.controller.idle, Hold | Grip)
    groups = [group for feature in world.service._features for group in feature.groups]
    objects = [
        *carried(world.machine.motor),
        *carried(world.controller),
        *carried(world.service),
        *(found for group in groups for found in of_slices(group)),
    ]
    if isinstance(world.controller.idle, Grip):
        objects += carried(world.controller.idle)
    classes = {type(source) for source in objects}
    assert {Motor, Plausibility, Controller, HeatModel, RpcService, Trajectories} <= classes
    undecided = {
        f"{type(source).__name__}.{name}" for source in objects for name in undeclared(source)
    }
    assert not undecided, "declare each as Carried[...], or in NOT_CARRIED (model/plain.py)"


def test_an_attribute_that_nobody_has_thought_of_is_a_defect_that_is_told() -> None:
    world = disabled("normal")
    world.controller.output.new_thing = 1  # type: ignore[attr-defined]
    with pytest.raises(PlainError, match="new_thing"):
        exported(world)


REQUESTS = st.sampled_from(
    [
        ("motion.hold", {}),
        ("motion.move", {"opening_mm": 60, "speed_mm_s": 139}),
        ("motion.grasp", {"until": "verdict", "force_n": 4}),
        ("motion.grasp", {"until": "verdict", "hold_by": "gains"}),
        ("motion.set_force", {"force_n": 12}),
        ("motion.zero_gravity", {}),
        ("stop", {"level": "hold"}),
        ("stop", {"level": "relax"}),
        ("stop.clear", {}),
        ("motor.enable", {}),
        ("lease.acquire", {"ttl_s": 5}),
        ("config.set", {"config": {"force_n": 7}, "keep": True}),
        ("calibration.load", {"template": "normal"}),
    ]
)


def after(course: Course, ticks: int) -> World:
    """Let a client do something, and then stop it."""
    world = World(parameters=replace(SimulatorParameters(), initial_opening_mm=90.0))
    world.gripper.put_object(width_mm=40.0)
    client = world.enabled()
    for (method, params), wait in course:
        client.send(method, **params)
        world.run(wait * PERIOD_S)
    world.run(ticks * PERIOD_S)
    client.send("stop", level="hold")
    world.run_until(lambda: handover.why_not_restartable(world.machine) is None)
    return world


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(REQUESTS, st.integers(0, 120)), max_size=6), st.integers(0, 9))
def test_after_any_course_a_restart_changes_no_frame(course: Course, ticks: int) -> None:
    undisturbed, restarted = worlds = (after(course, ticks), after(course, ticks))
    early = exported(restarted)["state"]
    for world in worlds:
        world.run(PERIOD_S)
        world.client().result("stop.clear")
        world.client().result("motor.disable")
        world.run_until(lambda: handover.why_not_restartable(world.machine) is None)  # noqa: B023
    assert exchange(restarted, early) == exported(restarted)
    for world in worlds:
        world.sent.clear()
        world.run(0.3)
    assert restarted.sent == undisturbed.sent


def test_who_is_left_to_a_successor_says_nothing_of_jaws_that_it_has_no_more() -> None:
    """The connections end with it; what a lease wanted for that is not done, nor told."""
    world, client = gripping("normal")
    client.result("lease.acquire", on_lost="disable")
    world.take_log()
    world.controller.leave_to_successor()
    refused = client.call("motion.open")["error"]
    assert refused["data"]["reason"] == "shutting_down"
    assert refused["data"]["followed"]
    assert "held on" in refused["message"]
    client.leave()
    assert {event.kind for event in world.take_log()} == {"refused"}


def test_who_waits_behind_the_end_of_a_block_is_told_that_the_successor_holds_on() -> None:
    world, client = gripping("normal")
    world.controller.shut_down()
    refused = client.call("motion.open")["error"]
    assert "what was held falls" in refused["message"]
    assert "followed" not in refused["data"]
