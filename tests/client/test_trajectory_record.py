"""Recording, for threads and for asyncio: what is asked and fetched."""

import asyncio
from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    ConnectError,
    LiteGrip,
    ParameterError,
    ProtocolError,
    Trajectory,
    aio,
)
from tests.client.aio_helpers import arrived, cancel, with_gripper
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.fake_trajectories import END, TAUGHT, FakeTrajectories
from tests.client.helpers import interrupt_main_thread
from tests.trajectories import PIECE_BYTES


def test_record_asks_for_its_samples_and_fetches_them_in_pieces(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    assert gripper.record(0.5, 200.0) == TAUGHT
    start = {"rate_hz": 200.0, "zero_gravity": True, "max_samples": 100}
    assert there.asked("record_start") == [start]
    assert there.asked("record_stop") == [{}]
    pieces = there.asked("get")
    assert pieces == [{"name": "tmp/recording-1", "offset": at} for at in (0, PIECE_BYTES)]


def test_record_with_gripper_is_the_same(daemon: FakeDaemon, there: FakeTrajectories) -> None:
    async def use(gripper: aio.LiteGrip) -> Trajectory:
        return await gripper.record(0.5, 200.0, zero_gravity=False)

    assert with_gripper(daemon, use) == TAUGHT
    start = {"rate_hz": 200.0, "zero_gravity": False, "max_samples": 100}
    assert there.asked("record_start") == [start]


TOO_MUCH = {
    "max_samples": "1801 s at 200 Hz make 360200 samples: "
    "record for at most 1800 s, 360000 samples",
    "rate_hz": "rate_hz is too much",
}


@pytest.mark.parametrize(
    ("duration_s", "rate_hz"), [(0.0, 100.0), (-1.0, 100.0), (0.001, 100.0), (1.0, 0.0)]
)
def test_a_time_without_a_sample_is_refused_before_anything_is_slack(
    there: FakeTrajectories, gripper: LiteGrip, duration_s: float, rate_hz: float
) -> None:
    with pytest.raises(CommandError, match="make no sample"):
        gripper.record(duration_s, rate_hz)
    with pytest.raises(CommandError, match="must be a number"):
        gripper.record("long")  # type: ignore[arg-type]
    assert there.asked("record_start") == []


@pytest.mark.parametrize(("parameter", "told"), TOO_MUCH.items())
def test_a_time_with_too_many_samples_is_refused_in_seconds(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip, parameter: str, told: str
) -> None:
    daemon.handlers["trajectory.record_start"] = lambda request: request.fail(
        "invalid_params", -32602, f"{parameter} is too much", parameter=parameter
    )
    with pytest.raises(ParameterError) as caught:
        gripper.record(1801.0, 200.0)
    assert caught.value.message == told


@pytest.mark.parametrize(("missed", "is_fine"), [(0, True), (10, True), (11, False), (100, False)])
def test_a_recording_may_have_few_holes(
    there: FakeTrajectories, gripper: LiteGrip, missed: int, is_fine: bool
) -> None:
    there.missed = missed
    if is_fine:
        assert gripper.record(1.0) == TAUGHT
        return
    with pytest.raises(CommandError, match=f"{100 - missed} of 100 samples") as caught:
        gripper.record(1.0)
    assert caught.value.reason == "recording_failed"
    assert there.asked("record_stop") == []  # it is over, and nobody wants it


def test_a_recording_that_was_broken_off_raises_as_the_daemon_says(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    there.error = "a stop"
    with pytest.raises(CommandError, match="broken off: a stop") as caught:
        gripper.record(1.0)
    assert (caught.value.reason, caught.value.data["samples"]) == ("recording_failed", 7)
    assert there.asked("record_stop") == [{}]


def test_an_interrupt_ends_the_recording(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    def look(_request: Request) -> None:
        interrupt_main_thread()

    daemon.handlers["trajectory.status"] = look
    with pytest.raises(KeyboardInterrupt):
        gripper.record(10.0)
    assert there.asked("record_stop") == [END]


def test_an_interrupt_before_the_answer_takes_back_what_comes_of_it(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    begin = daemon.handlers["trajectory.record_start"]
    asked: list[Request] = []

    def start(request: Request) -> None:
        asked.append(request)
        interrupt_main_thread()

    daemon.handlers["trajectory.record_start"] = start
    with pytest.raises(KeyboardInterrupt):
        gripper.record_start()
    asked[0].reply(begin(asked[0]))
    assert gripper.get_state()
    daemon.wait_for("trajectory.record_stop")
    assert there.asked("record_stop") == [END]


def test_a_cancelled_task_ends_the_recording(daemon: FakeDaemon, there: FakeTrajectories) -> None:
    async def use(gripper: aio.LiteGrip) -> None:
        daemon.handlers["trajectory.status"] = lambda request: {
            **begun,
            "active": True,
            "samples": 1,
        }
        task = asyncio.create_task(gripper.record(60.0))
        await arrived(daemon, "trajectory.status", 2)
        await cancel(task)
        assert there.asked("record_stop") == [END]

    begun = {"kind": "record", "missed": 0, "error": None}
    with_gripper(daemon, use)


def test_a_daemon_that_goes_is_told_at_once(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    FakeTrajectories(daemon)
    daemon.handlers["trajectory.status"] = lambda request: request.hang_up()
    with pytest.raises(ConnectError):
        gripper.record(60.0)


def test_record_start_and_stop(there: FakeTrajectories, gripper: LiteGrip) -> None:
    status = gripper.record_start(50, zero_gravity=False, max_samples=20)
    assert (status["active"], status["kind"]) == (True, "record")
    assert gripper.trajectory_status()["samples"] == 10
    assert gripper.record_stop(allow_empty=True) == TAUGHT
    start = {"rate_hz": 50.0, "zero_gravity": False, "max_samples": 20}
    assert there.asked("record_start") == [start]
    assert there.asked("record_stop") == [{"allow_empty": True}]
    with pytest.raises(CommandError, match="whole number"):
        gripper.record_start(max_samples=1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("spoiled", ["bytes", "nothing", "replaced"])
def test_what_is_fetched_is_checked(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip, spoiled: str
) -> None:
    honest = daemon.handlers["trajectory.get"]

    def get(request: Request) -> dict[str, Any]:
        piece: dict[str, Any] = honest(request)
        if spoiled == "bytes":
            piece["data"] = "AAAA" + piece["data"][4:]
        elif spoiled == "nothing":
            piece["data"] = ""
        else:
            piece["sha256"] = f"{request.params['offset']:064x}"
        return piece

    daemon.handlers["trajectory.get"] = get
    kind, why = {
        "bytes": (ProtocolError, "has not the SHA-256"),
        "nothing": (ProtocolError, "sent nothing"),
        "replaced": (CommandError, "was replaced while it was being fetched"),
    }[spoiled]
    with pytest.raises(kind, match=why):
        gripper.record(1.0)
