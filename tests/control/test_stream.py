"""Streams of set-points: the latest wins, and each has an end."""

from itertools import pairwise
from typing import Any

import pytest

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.sim.plant import MOUNTS
from tests.control.states import at_opening
from tests.world import PERIOD_S, Client, World

MM_RAD, TRAVEL_MM = NOMINAL[0].rad_to_mm, NOMINAL[0].travel_mm
CODE_RAD = 25.0 / 65535


def follow(world: World, client: Client, duration_s: float, **params: Any) -> None:
    """Keep a stream up by a set-point every 50 ms."""
    for _ in range(round(duration_s / 0.05)):
        client.notify("stream.set", **params)
        world.run(0.05)


def refusals(client: Client) -> list[str]:
    return [params["data"]["reason"] for params in client.told("stream.refused")]


@pytest.mark.parametrize("mount", MOUNTS)
def test_the_jaws_follow_the_latest_set_point(mount: str) -> None:
    world, client = at_opening(60.0, mount)
    follow(world, client, 0.3, opening_mm=20.0)
    assert world.gripper.opening_mm < 52.0
    client.notify("stream.set", opening_mm=10.0)
    client.notify("stream.set", opening_mm=80.0)  # before the other has had a tick
    world.run(0.05)
    follow(world, client, 1.5, opening_mm=80.0)
    assert world.gripper.opening_mm == pytest.approx(80.0, abs=0.5)
    assert [job.kind for job in world.controller.jobs].count("stream") == 1
    assert refusals(client) == []


@pytest.mark.parametrize("name", ["opening_mm", "openness", "position_rad"])
def test_a_set_point_is_given_in_any_quantity(name: str) -> None:
    world, client = at_opening()
    geometry = world.geometry
    value = {"opening_mm": 75.0, "openness": 75.0 / geometry.travel_mm}.get(
        name, geometry.closed_rad - geometry.to_rad(75.0)
    )
    follow(world, client, 0.8, **{name: value})
    assert world.gripper.opening_mm == pytest.approx(75.0, abs=0.5)


def test_with_an_id_it_is_answered_by_the_streams_job() -> None:
    world, client = at_opening()
    first = client.result("stream.set", opening_mm=50.0)
    world.run(0.1)
    second = client.result("stream.set", opening_mm=55.0)
    assert first == second
    assert world.controller.jobs.running is not None
    assert world.controller.jobs.running.number == first["job"]
    answer = client.call("job.wait", **first)["result"]
    assert (answer["kind"], answer["state"]) == ("stream", "done")
    assert answer["result"]["set_points"] == 2


@pytest.mark.parametrize("valid_s", [0.02, 0.2, 1.0])
def test_it_expires_into_a_hold_without_a_jump(valid_s: float) -> None:
    world, client = at_opening(20.0)
    client.notify("stream.set", opening_mm=80.0, valid_s=valid_s)
    began_s = world.now_s
    world.tick()
    commands = []
    while world.controller.jobs.running is not None:
        world.tick()
        commands.append(world.commands_since(world.now_s)[-1][1])
    assert world.now_s - began_s == pytest.approx(valid_s, abs=2 * PERIOD_S)
    moved_rad = FASTEST_MM_S / MM_RAD * PERIOD_S
    commands += world.track(0.3, lambda: world.commands_since(world.now_s)[-1][1])
    assert all(
        abs(later.position_rad - earlier.position_rad) <= moved_rad + CODE_RAD
        for earlier, later in pairwise(commands)
    )
    assert world.state.mode == "holding"
    held_rad = {command.position_rad for command in commands[-60:]}
    assert len(held_rad) == 1
    assert abs(world.gripper.velocity_rad_s) < 0.01
    assert world.longest_gap_s(began_s) == pytest.approx(PERIOD_S)


def test_a_stream_begins_anew_after_it_has_expired() -> None:
    world, client = at_opening()
    follow(world, client, 0.2, opening_mm=85.0)
    world.run(0.5)
    follow(world, client, 1.2, opening_mm=30.0)
    assert world.gripper.opening_mm == pytest.approx(30.0, abs=1.0)
    assert [job.kind for job in world.controller.jobs].count("stream") == 2


@pytest.mark.parametrize("speed", [5.0, 50.0, 130.0])
@pytest.mark.parametrize("every_s", [PERIOD_S, 0.1])
def test_the_jaws_are_no_faster_than_their_speed(speed: float, every_s: float) -> None:
    """A step of the speed makes them overshoot it for some 30 ms, but not farther than that."""
    world, client = at_opening(5.0)
    ticks = round(every_s / PERIOD_S)
    opening_mm = [world.gripper.opening_mm]
    for tick in range(120):
        if tick % ticks == 0:
            client.notify("stream.set", opening_mm=85.0, speed_mm_s=speed)
        world.tick()
        opening_mm.append(world.gripper.opening_mm)
    commanded = [command.position_rad for _, command in world.commands_since(world.now_s - 0.59)]
    steps_rad = [abs(later - earlier) for earlier, later in pairwise(commanded)]
    assert max(steps_rad) <= speed / MM_RAD * PERIOD_S + CODE_RAD
    window = round(0.1 / PERIOD_S)
    in_windows_mm = [
        later - earlier for earlier, later in zip(opening_mm, opening_mm[window:], strict=False)
    ]
    assert max(in_windows_mm) <= speed * 0.1 * 1.1
    assert opening_mm[-1] - opening_mm[0] == pytest.approx(speed * 120 * PERIOD_S, rel=0.15)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("torque_nm", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("speed", [30.0, 50.0, 120.0])
def test_it_presses_on_what_it_meets_with_no_more_than_its_clamp(
    mount: str, torque_nm: float, speed: float
) -> None:
    world, client = at_opening(60.0, mount)
    world.gripper.put_object(width_mm=40.0)
    pressed_nm = []
    for _ in range(60):
        client.notify("stream.set", opening_mm=5.0, speed_mm_s=speed, torque_nm=torque_nm)
        pressed_nm += world.track(0.025, lambda: world.torque_nm)
    assert max(pressed_nm) <= 1.3 * torque_nm
    assert pressed_nm[-1] == pytest.approx(torque_nm, rel=0.1)
    assert world.gripper.opening_mm == pytest.approx(40.0, abs=2.0)
    world.run(1.0)
    assert world.state.mode == "holding"  # and presses on as it did last
    assert world.torque_nm <= 1.3 * torque_nm


def test_a_stream_may_press_less_from_one_set_point_to_the_next() -> None:
    world, client = at_opening()
    world.gripper.put_object(width_mm=40.0)
    follow(world, client, 1.0, opening_mm=5.0, torque_nm=2.0)
    follow(world, client, 0.5, opening_mm=5.0, torque_nm=0.5)
    assert world.torque_nm <= 0.65


def test_a_refused_notification_is_told_once_per_change_of_reason() -> None:
    world, client = at_opening()
    for _ in range(5):
        client.notify("stream.set", opening_mm=500.0)
        world.run(0.02)
    assert refusals(client) == ["out_of_limits"]
    for _ in range(3):
        client.notify("stream.set", opening_mm="far")
        client.notify("stream.set")
    assert refusals(client) == ["out_of_limits", "invalid_params"]
    client.notify("stream.set", opening_mm=50.0)
    client.notify("stream.set", opening_mm=500.0)
    assert refusals(client) == ["out_of_limits", "invalid_params", "out_of_limits"]
    client.read()
    assert client.answers.keys() <= {1}  # only motor.enable had an id


def test_with_an_id_every_refusal_is_an_answer() -> None:
    world, client = at_opening()
    for _ in range(3):
        assert client.refusal("stream.set", opening_mm=500.0) == "out_of_limits"
    assert client.refusal("stream.set", opening_mm=50.0, speed_mm_s=151.0) == "invalid_params"
    assert client.refusal("stream.set", opening_mm=50.0, torque_nm=4.0) == "invalid_params"
    assert client.refusal("stream.set", opening_mm=50.0, valid_s=0.01) == "invalid_params"
    assert client.refusal("stream.set", opening_mm=50.0, openness=0.5) == "invalid_params"
    assert refusals(client) == []
    assert world.controller.jobs.running is None


def test_a_bad_set_point_does_not_end_the_stream() -> None:
    world, client = at_opening()
    client.notify("stream.set", opening_mm=85.0, valid_s=0.5)
    world.run(0.1)
    client.notify("stream.set", opening_mm=500.0)
    world.run(0.1)
    assert world.state.mode == "moving"
    assert world.gripper.opening_mm > 64.0


def test_another_clients_stream_is_refused_as_busy() -> None:
    world, client = at_opening()
    other = world.client()
    follow(world, client, 0.1, opening_mm=80.0)
    for _ in range(5):
        other.notify("stream.set", opening_mm=10.0)
        client.notify("stream.set", opening_mm=80.0)
        world.run(0.05)
    assert refusals(other) == ["busy"]
    assert other.refusal("stream.set", opening_mm=10.0) == "busy"
    assert other.refusal("motion.open") == "busy"
    assert world.gripper.opening_mm > 70.0
    world.run(0.5)  # the first one's has expired
    other.notify("stream.set", opening_mm=10.0)
    world.run(0.1)
    assert world.state.job is not None
    assert world.state.job.pid == other.session.peer.pid


@pytest.mark.parametrize("spoil", ["other motion", "other client's motion"])
def test_a_stream_does_not_interrupt_a_motion(spoil: str) -> None:
    world, client = at_opening()
    mover = client if spoil == "other motion" else world.client()
    number = mover.send("motion.open")
    world.run(0.1)
    client.notify("stream.set", opening_mm=10.0)
    assert refusals(client) == ["busy"]
    assert mover.wait(number)["result"]["ok"]


@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
def test_a_stop_ends_a_stream_and_what_was_sent_before_it_never_runs(level: str) -> None:
    world, client = at_opening()
    follow(world, client, 0.2, opening_mm=85.0, speed_mm_s=50.0)
    sent_s = world.now_s
    world.run(0.02)
    world.client().send("stop", level=level)
    world.run(0.1)
    here_mm = world.gripper.opening_mm
    assert world.controller.jobs.running is None
    for _ in range(5):
        client.notify("stream.set", opening_mm=85.0, speed_mm_s=50.0)
        world.run(0.02)
    assert refusals(client) == ["stopped"]
    client.result("stop.clear")
    if level == "disable":
        client.result("motor.enable")
    for _ in range(5):
        client.notify("stream.set", opening_mm=85.0, speed_mm_s=50.0, sent_s=sent_s)
        client.notify("stream.set", opening_mm=85.0, speed_mm_s=50.0, stop_generation=0)
        world.run(0.02)
    assert refusals(client) == ["stopped", "sent_before_stop"]
    assert world.controller.jobs.running is None
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.5)
    client.notify("stream.set", opening_mm=85.0, speed_mm_s=50.0, sent_s=world.now_s)
    world.run(0.1)
    assert world.gripper.opening_mm > here_mm + 2.0


@pytest.mark.parametrize("end", ["leave", "cancel"])
def test_a_stream_without_its_client_ends_in_a_hold(end: str) -> None:
    world, client = at_opening()
    follow(world, client, 0.2, opening_mm=85.0, valid_s=2.0)
    running = world.running
    if end == "leave":
        client.leave()
    else:
        world.client().result("job.cancel", job=running.number)
    here_mm = world.gripper.opening_mm
    world.run(1.0)
    assert world.state.mode == "holding"
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=1.5)


@pytest.mark.parametrize("opening_mm", [0.0, TRAVEL_MM])
def test_the_ends_of_the_travel_are_set_points_too(opening_mm: float) -> None:
    world, client = at_opening()
    follow(world, client, 2.5, openness=opening_mm / TRAVEL_MM)
    assert world.gripper.opening_mm == pytest.approx(opening_mm, abs=1.5)
    assert world.torque_nm <= 1.3
