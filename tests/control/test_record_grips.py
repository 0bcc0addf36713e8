"""What a recording knows of grips: who commanded them, where, when, with which force."""

import hashlib
import sys
from collections.abc import Callable

import pytest

from litegrip_client.values.trajectory_format import MOST_GRIPS, grips_of
from litegripd.control.events import JobBook
from litegripd.control.holds import Grip, GripSettings
from litegripd.model.calibration import NOMINAL
from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310
from litegripd.model.motion_config import MotionConfig
from litegripd.model.state import Owner
from litegripd.trajectories.capture import GripNotes
from tests.control.grips import beside, both, gripper, grips, picked, recording, taught
from tests.control.replays import TRAVEL_MM
from tests.trajectories import fetched, points_of, send


def test_a_grip_is_noted_with_its_contact_its_force_and_who_commanded_it() -> None:
    _, client, name = picked(36.0, 8.0)
    (grip,) = grips(client, name=name)
    assert grip["force_n"] == 8.0
    assert grip["width_mm"] == pytest.approx(36.0, abs=0.7)
    assert grip["openness"] == pytest.approx(36.0 / TRAVEL_MM, abs=0.02)
    assert grip["source"] == "motion.grasp by program101"
    assert grip["closing_s"] == pytest.approx(0.2, abs=0.05)
    samples = points_of(fetched(client, name=name))
    standing = [t for t, openness, *_ in samples if openness < 36.7 / TRAVEL_MM]
    assert grip["start_s"] == pytest.approx(standing[0] + 0.11, abs=0.06)
    assert grip["end_s"] - grip["start_s"] == pytest.approx(1.0, abs=0.05)


def test_the_file_beside_names_the_trajectory_it_belongs_to() -> None:
    _, client, name = picked()
    digest = hashlib.sha256(fetched(client, name=name)).hexdigest()
    content = beside(client, name=name)
    assert (content["format"], content["version"]) == ("litegrip-grips", 1)
    assert content["lgt_sha256"] == digest


def test_one_that_is_kept_under_a_name_has_its_grips_with_it() -> None:
    world, client = recording()
    world.run(0.3)
    answer = client.result("trajectory.record_stop", name="pick")
    assert (answer["grips"], answer["grip_problem"], answer["grips_left_out"]) == (1, None, 0)
    (row,) = client.result("trajectory.list")["trajectories"]
    assert (row["name"], row["grips"], row["grip_problem"]) == ("pick", 1, None)
    (grip,) = grips(client, name="pick")
    samples = points_of(fetched(client, name="pick"))
    assert grip["end_s"] == samples[-1][0]  # it was still held


def test_one_that_is_held_already_begins_with_the_recording() -> None:
    world, client = gripper()
    world.gripper.put_object(width_mm=36.0)
    client.result("motion.grasp", until="verdict", force_n=6)
    world.run(0.5)
    other = world.client()
    other.result("trajectory.record_start", zero_gravity=False)
    world.run(0.5)
    client.result("motion.move", opening_mm=58)
    (grip,) = taught(other)
    assert (grip["closing_s"], grip["start_s"], grip["force_n"]) == (0.0, 0.0, 6.0)
    assert grip["end_s"] == pytest.approx(0.5, abs=0.03)
    assert grip["source"] == "motion.grasp by program101"


def test_one_that_a_replay_has_left_is_its() -> None:
    world, client, name = picked(release=False)
    content, grip_bytes = both(client, name=name)
    client.result("motion.move", opening_mm=72)
    send(client, content, name="pick", grip_bytes=grip_bytes)
    other = world.client()
    assert other.result("trajectory.play", name="pick", force="replay")["ok"]
    client.result("trajectory.record_start", zero_gravity=False)
    world.run(0.3)
    (grip,) = taught(client)
    assert grip["source"] == "trajectory.play by program102"


def test_a_force_that_is_changed_makes_another_grip_without_a_gap() -> None:
    world, client = recording(force_n=6)
    world.run(0.5)
    client.result("motion.set_force", force_n=12)
    world.run(0.5)
    one, two = taught(client)
    assert (one["force_n"], two["force_n"]) == (6.0, 12.0)
    assert one["end_s"] == two["closing_s"] == two["start_s"]
    assert two["source"] == "motion.set_force by program101"


def test_a_grip_that_is_lost_ends_there() -> None:
    world, client = recording()
    world.run(0.5)
    world.gripper.remove_object()
    world.run(1.0)
    (grip,) = taught(client)
    assert grip["end_s"] - grip["start_s"] == pytest.approx(0.5, abs=0.1)


def test_of_a_hand_nothing_is_claimed_whatever_it_pushes_on() -> None:
    """Slack jaws that stand still may be pushed onto something, or just not be pushed."""
    world, client = gripper()
    world.gripper.put_object(width_mm=36.0)
    client.result("trajectory.record_start")
    world.gripper.push(0.8)
    world.run(2.0)
    assert world.gripper.opening_mm < 37.0
    answer = client.result("trajectory.record_stop")
    assert answer["grips"] == 0
    assert fetched(client, name=answer["name"], format="grip") == b""


def test_a_way_by_hand_and_a_grip_by_command_are_one_recording() -> None:
    """As the documentation says how a grip is taught with a force."""
    world, client = gripper()
    world.gripper.put_object(width_mm=29.0)
    client.result("trajectory.record_start", zero_gravity=False)
    client.result("motion.zero_gravity")
    sign = world.gripper.parameters.close_sign
    world.gripper.push(0.3 * sign)
    world.run_until(lambda: world.gripper.opening_mm < 51.0)
    world.gripper.push(0.0)
    world.run(0.3)
    client.result("motion.grasp", until="verdict", force_n=8)
    world.run(0.5)
    client.result("motion.move", opening_mm=65)
    content, grip_bytes = both(client, name=client.result("trajectory.record_stop")["name"])
    other, others_client = gripper("reverse", 80.0)
    other.gripper.put_object(width_mm=35.0, stiffness_nm_rad=80.0)
    send(others_client, content, name="pick", grip_bytes=grip_bytes)
    # The hand was faster than a replay may be.
    params = {"name": "pick", "force": "replay", "speed": 0.5}
    result = others_client.result("trajectory.play", **params)
    assert (result["ok"], result["grips"]) == (True, 1)
    assert result["width_difference_mm"] == pytest.approx(6.0, abs=1.4)


def test_a_squeeze_that_has_met_nothing_is_no_grip() -> None:
    world, client = gripper()
    client.result("trajectory.record_start", zero_gravity=False)
    client.result("motion.set_force", force_n=5)
    world.run(0.3)
    assert client.result("trajectory.record_stop")["grips"] == 0


def calls_of(do: Callable[[], object]) -> int:
    """Count the Python functions that are called: a measure of work that no machine changes."""
    calls, before = 0, sys.getprofile()

    def note(_frame: object, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(note)
    try:
        do()
    finally:
        sys.setprofile(before)
    return calls


def test_more_grips_than_are_kept_are_counted() -> None:
    geometry, jobs, notes = NOMINAL[0], JobBook(), GripNotes()
    owner = Owner(1, 2, 3, "pick\x07place " + "é" * 200)
    settings = GripSettings.of(geometry, MotionConfig(), 50.0, "torque")
    for number in range(MOST_GRIPS + 5):
        job = jobs.add("grasp", owner, False, 10.0 + number)
        jobs.begin(job, 10.0 + number)
        grip = Grip(settings, 5.0, 0.0, DM4310, watched=True)
        notes.see(number + 0.4, 10.0, -0.5, grip, jobs)
        notes.see(number + 0.8, 10.0, -0.5, None, jobs)
        jobs.end(job, Refusal("cancelled", "done"), 10.8 + number)
    noted = grips_of(notes.plain(geometry, 1e3))
    assert (len(noted), notes.left_out) == (MOST_GRIPS, 5)
    assert noted[7].closing_s == 7.0
    assert noted[7].source.startswith("motion.grasp by pick?place ???")
    assert [grip["end_s"] for grip in notes.plain(geometry, 1.5)] == [0.8, 1.5]
    assert calls_of(lambda: notes.plain(geometry, 1e3)) < 10 * MOST_GRIPS
