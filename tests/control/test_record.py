"""Recording trajectories: by hand with slack jaws, and beside motions of others."""

import json
from itertools import pairwise

import pytest

from litegripd.control.events import JobBook
from litegripd.model.calibration import NOMINAL
from litegripd.model.motor import Feedback, MotorPhase, MotorView
from litegripd.motor import codec
from litegripd.trajectories.capture import Capture
from litegripd.trajectories.values import read
from tests.control.recordings import recording, taken
from tests.control.states import is_slack
from tests.trajectories import fetched
from tests.world import PERIOD_S, World, ready

RESOLUTION_RAD = 25.0 / 65535


def teach(world: World) -> None:
    """Push the jaws open and closed by hand."""
    sign = world.gripper.parameters.close_sign
    for torque_nm, duration_s in ((-0.26, 0.3), (0.0, 0.2), (0.27, 0.3), (0.0, 0.3)):
        world.gripper.push(sign * torque_nm)
        world.run(duration_s)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_motion_that_a_hand_teaches_is_recorded_as_it_was(mount: str) -> None:
    world, client = recording(World(mount))
    sign = world.gripper.parameters.close_sign
    truth: list[tuple[float, float]] = []
    for torque_nm in (-0.26, 0.0, 0.27, 0.0):
        world.gripper.push(sign * torque_nm)
        truth += world.track(0.3, lambda: (world.now_s, world.gripper.position_rad))
    samples = taken(client)
    assert len(samples) == pytest.approx(120, abs=2)
    by_time = {round(at_s / PERIOD_S): position_rad for at_s, position_rad in truth}
    first = min(by_time, key=lambda tick: abs(by_time[tick] - samples[0][2]))
    geometry = world.geometry
    offsets = range(first - 3, first + 4)  # at which tick the first one was measured

    def error(offset: int) -> float:
        pairs = [(s, by_time.get(offset + round(s[0] / PERIOD_S))) for s in samples]
        return max(abs(s[2] - true_rad) for s, true_rad in pairs if true_rad is not None)

    assert min(map(error, offsets)) <= 2 * RESOLUTION_RAD + 1e-3
    travelled = max(s[1] for s in samples) - min(s[1] for s in samples)
    assert travelled > 0.1
    for _, openness, position_rad, *_ in samples:
        assert openness == geometry.openness(position_rad)


def test_the_file_says_what_it_was_taught_on() -> None:
    world, client = recording(World("reverse"), rate_hz=50)
    world.run(0.5)
    answer = client.result("trajectory.record_stop", name="pick")
    assert (answer["name"], answer["recording"]) == ("pick", None)
    assert answer["path"].endswith("/trajectories/pick.lgt")
    header, _ = read(memoryview(fetched(client, name="pick")))
    geometry = world.geometry
    assert (header.sample_hz, header.mount, header.can_id) == (50.0, "reverse", 8)
    limits = (header.closed_rad, header.open_rad, header.rad_to_mm)
    assert limits == (geometry.closed_rad, geometry.open_rad, geometry.rad_to_mm)
    assert header.created_s == 1e9  # the helper's clock
    assert answer["samples"] == header.samples
    assert answer["missed"] == 0


def test_the_jaws_are_slack_all_the_while_and_then_hold_where_they_are() -> None:
    world, client = recording()
    world.run(2 * PERIOD_S)
    since_s = world.now_s
    teach(world)
    for _, command in world.commands_since(since_s):
        assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0
        assert abs(command.torque_nm) < 0.003
    here_mm = world.gripper.opening_mm
    client.result("trajectory.record_stop")
    world.run(0.3)
    assert world.state.mode == "holding"
    assert not is_slack(world)
    assert world.gripper.opening_mm == pytest.approx(here_mm, abs=0.2)


@pytest.mark.parametrize("rate_hz", [200, 150, 100, 60, 33.3, 10, 1])
def test_there_is_one_sample_for_each_due_time(rate_hz: float) -> None:
    world, client = recording(rate_hz=rate_hz, zero_gravity=False)
    world.run(4.0 + PERIOD_S)
    status = client.result("trajectory.status")
    assert status["missed"] == 0
    assert status["rate_hz"] == rate_hz
    samples = taken(client)
    assert len(samples) == pytest.approx(4.0 * rate_hz, abs=2)
    for number, sample in enumerate(samples):
        assert abs(sample[0] - number / rate_hz) <= 0.501 * PERIOD_S
    assert status["loop_hz"] == pytest.approx(rate_hz, rel=0.02)


@pytest.mark.parametrize("first", [-0.5, -0.25, 0.0, 0.1, 0.25, 0.4, 0.5, 0.6, 0.75])
@pytest.mark.parametrize("jitter", [0.0, 0.01, 0.05])
def test_ticks_that_are_early_and_late_make_no_misses(first: float, jitter: float) -> None:
    """Whatever the phase is that the first measurement gives."""
    offsets = [first, *([jitter, -jitter] * 250)]
    capture = Capture(NOMINAL[0], 200.0, 10_000, PERIOD_S, 1, -1e-9)
    for tick in range(400):
        at_s = PERIOD_S * (tick + 1 + offsets[tick])
        view = MotorView(MotorPhase.ENABLED, Feedback(1, -0.5, 0.0, 0.0, 30, 30, at_s))
        capture.step(PERIOD_S * (tick + 2), view, capture.geometry, None, JobBook())
    assert capture.missed == 0
    assert capture.samples >= 398


def test_no_measurement_is_taken_twice_or_as_if_it_were_newer() -> None:
    """Lost answers leave gaps in the times; what comes late is no new measurement."""
    world, client = recording(rate_hz=200, zero_gravity=False)
    world.run(0.2)
    lost = iter([True, False, False, True, True] + [False] * 1000)
    world.lose_from_motor = lambda _frame: next(lost)
    world.run(0.3)
    status = client.result("trajectory.status")
    assert (status["active"], status["missed"]) == (True, 3)
    samples = taken(client)
    times = [sample[0] for sample in samples]
    gaps = [round((later - earlier) / PERIOD_S) for earlier, later in pairwise(times)]
    assert sorted(gaps, reverse=True)[:3] == [3, 2, 1]
    assert min(gaps) == 1


def test_a_loop_that_died_is_never_a_good_recording() -> None:
    world, client = recording(zero_gravity=False)
    world.run(0.5)
    world.lose_from_motor = lambda _frame: True
    world.run(0.3)
    status = client.result("trajectory.status")
    assert status["active"] is False
    assert status["error"]
    answer = client.call("trajectory.record_stop")
    assert answer["error"]["data"]["reason"] == "recording_failed"
    assert answer["error"]["data"]["samples"] == status["samples"]
    assert status["samples"] == pytest.approx(50, abs=3)
    world.lose_from_motor = lambda _frame: False
    partial = client.result("trajectory.record_stop", allow_partial=True)
    assert partial["samples"] == status["samples"]
    assert partial["error"] == status["error"]


def test_it_ends_when_it_is_full() -> None:
    world, client = recording(rate_hz=100, max_samples=50)
    number = client.send("job.wait", job=client.result("trajectory.status")["job"])
    result = client.wait(number, 1.0)["result"]["result"]
    assert (result["ok"], result["outcome"], result["samples"]) == (True, "full", 50)
    world.run(1.0)
    assert world.state.mode == "holding"
    status = client.result("trajectory.status")
    assert (status["active"], status["samples"], status["error"]) == (False, 50, None)
    samples = taken(client)
    assert len(samples) == 50
    assert samples[-1][0] == pytest.approx(0.49)


def test_what_was_missed_does_not_make_it_longer() -> None:
    world, client = recording(rate_hz=200, zero_gravity=False, max_samples=100)
    world.run(0.1)
    lost = iter([True] + [False] * 1000)
    world.lose_from_motor = lambda _frame: next(lost)
    world.run(1.0)
    answer = client.result("trajectory.record_stop")
    assert (answer["samples"], answer["missed"]) == (99, 1)
    assert answer["duration_s"] == pytest.approx(99 * PERIOD_S)


def test_a_long_one_comes_whole_over_many_pieces() -> None:
    world, client = recording(rate_hz=200, zero_gravity=False)
    world.gripper.push(0.1)
    world.run(13.0)
    samples = taken(client)
    assert len(samples) == pytest.approx(2600, abs=3)
    assert len({sample[0] for sample in samples}) == len(samples)


def test_others_drive_while_it_watches() -> None:
    world, client = recording(zero_gravity=False)
    assert client.result("trajectory.status")["zero_gravity"] is False
    assert client.result("trajectory.status")["job"] is None
    other = world.client()
    other.result("motion.move", opening_mm=72)
    other.result("motion.close")
    samples = taken(client)
    assert max(sample[1] for sample in samples) == pytest.approx(
        72 / NOMINAL[0].travel_mm, abs=0.02
    )
    assert min(sample[1] for sample in samples) < 0.02
    assert world.state.mode == "holding"


def test_one_that_is_ended_at_once_has_the_present_measurement() -> None:
    world, client = recording()
    assert client.result("trajectory.record_stop")["samples"] == 1
    assert world.controller.jobs.running is None


def test_an_empty_one_must_be_wanted() -> None:
    """The motor's answers are lost: nothing is measured that is new enough."""
    world, client = ready()
    world.lose_from_motor = lambda _frame: True
    world.run(2 * PERIOD_S)
    client.result("trajectory.record_start", zero_gravity=False)
    world.tick()
    assert client.refusal("trajectory.record_stop") == "recording_failed"
    assert world.controller.jobs.running is None
    assert client.result("trajectory.record_stop", allow_empty=True)["samples"] == 0


def test_there_is_nothing_to_stop_before_it_has_begun_or_when_it_was_taken() -> None:
    world, client = ready()
    assert client.refusal("trajectory.record_stop") == "recording_failed"
    client.result("trajectory.record_start")
    world.run(0.2)
    client.result("trajectory.record_stop")
    assert client.refusal("trajectory.record_stop") == "recording_failed"
    status = client.result("trajectory.status")
    assert (status["active"], status["kind"], status["error"]) == (False, "record", None)
    assert status["samples"] > 15


def test_progress_and_state_tell_of_it() -> None:
    world, client = recording(max_samples=1000)
    world.run(0.5)
    assert world.state.job is not None
    assert (world.state.job.kind, world.state.job.phase) == ("record", "record")
    progress = world.controller.progress()
    assert progress is not None
    assert progress.total_steps == 1000
    assert progress.step == client.result("trajectory.status")["samples"]


def test_no_frame_enables_or_disables_the_motor_on_its_behalf() -> None:
    world, client = recording()
    sent = len(world.sent)
    world.run(0.2)
    client.result("trajectory.record_stop")
    world.run(0.2)
    specials = {codec.ENABLE, codec.DISABLE}
    assert not specials.intersection(frame.frame.data for frame in world.sent[sent:])
    assert json.dumps(client.result("trajectory.status"))
