"""Recording and replaying, for threads and for asyncio: what is asked, sent and fetched."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    ConnectError,
    LiteGrip,
    MoveProgress,
    ProtocolError,
    Trajectory,
    TrajectoryBusyError,
    aio,
)
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.fake_trajectories import CONTENT, PLAYED, FakeTrajectories
from tests.client.helpers import interrupt_main_thread
from tests.trajectories import PIECE_BYTES, lgt

TAUGHT = Trajectory.from_bytes(CONTENT)
END = {"allow_empty": True, "allow_partial": True}


@pytest.fixture
def there(daemon: FakeDaemon) -> FakeTrajectories:
    return FakeTrajectories(daemon)


Use = Callable[[aio.LiteGrip], Awaitable[Any]]


def on_asyncio(daemon: FakeDaemon, use: Use) -> Any:
    async def main() -> Any:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            return await use(gripper)

    return run(main())


def test_record_asks_for_its_samples_and_fetches_them_in_pieces(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    assert gripper.record(0.5, 200.0) == TAUGHT
    start = {"rate_hz": 200.0, "zero_gravity": True, "max_samples": 100}
    assert there.asked("record_start") == [start]
    assert there.asked("record_stop") == [{}]
    pieces = there.asked("get")
    assert pieces == [{"recording": 1, "offset": at} for at in (0, PIECE_BYTES)]


def test_record_on_asyncio_is_the_same(daemon: FakeDaemon, there: FakeTrajectories) -> None:
    async def use(gripper: aio.LiteGrip) -> Trajectory:
        return await gripper.record(0.5, 200.0, zero_gravity=False)

    assert on_asyncio(daemon, use) == TAUGHT
    start = {"rate_hz": 200.0, "zero_gravity": False, "max_samples": 100}
    assert there.asked("record_start") == [start]


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
    on_asyncio(daemon, use)


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


def test_play_sends_the_trajectory_once_and_asks_for_what_is_wanted(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    gripper.motion_config.speed_mm_s = 30.0
    result = gripper.play(TAUGHT, 0.5, 80, 1.5, align=False, repeat=3, torque_nm=1)
    assert (bool(result), result.outcome, result.loops) == (True, "completed", 1)
    assert (result.largest_lag_mm, result.final_cmd_rad, result.frames) == (1.25, 0.1, 200)
    assert gripper.play(TAUGHT)
    assert there.uploads == {1: CONTENT}
    first, second = there.asked("play")
    own = {"upload": 1, "progress": True, "config": {"speed_mm_s": 30.0}}
    figures = {"speed": 0.5, "kp": 80.0, "kd": 1.5, "torque_nm": 1.0}
    assert first == {**own, **figures, "align": False, "repeat": 3}
    assert second == {**own, "speed": 1.0, "align": True, "repeat": 1}


def test_uploads_do_not_pile_up(there: FakeTrajectories, gripper: LiteGrip) -> None:
    others = [Trajectory.from_bytes(lgt([(0.0, share / 10)])) for share in range(5)]
    for trajectory in others:
        gripper.play(trajectory)
    left = [number for number, content in there.uploads.items() if content]
    assert left == [4, 5]
    gripper.play(others[3])
    assert there.asked("play")[-1]["upload"] == 4


def test_a_new_connection_is_sent_it_anew(daemon: FakeDaemon, there: FakeTrajectories) -> None:
    gripper = LiteGrip(socket_path=daemon.path)
    for _ in range(2):
        with gripper:
            gripper.play(TAUGHT)
    assert len(there.uploads) == 2


def test_a_replay_that_something_blocks_is_false(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    daemon.handlers["trajectory.play"] = lambda r: {**PLAYED, "ok": False, "outcome": "blocked"}
    assert not gripper.play(TAUGHT)


def test_play_reports_its_progress(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    def play(request: Request) -> dict[str, Any]:
        request.progress(3, phase="play")
        return PLAYED

    daemon.handlers["trajectory.play"] = play
    seen: list[MoveProgress] = []
    gripper.play(TAUGHT, progress=seen.append)
    assert [(one.phase, one.i) for one in seen] == [("play", 3)]


@pytest.mark.parametrize("what", ["pick", CONTENT, None])
def test_only_a_trajectory_is_played(
    there: FakeTrajectories, gripper: LiteGrip, what: object
) -> None:
    for play in (gripper.play, gripper.play_start):
        with pytest.raises(CommandError, match="is no Trajectory"):
            play(what)  # type: ignore[arg-type]
    assert there.asked("play") == there.asked("put") == []


def test_a_trajectory_that_the_daemon_refuses_raises(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    daemon.handlers["trajectory.play"] = lambda r: r.fail("trajectory_busy", -32029, "busy")
    with pytest.raises(TrajectoryBusyError):
        gripper.play(TAUGHT)
    daemon.handlers["trajectory.put"] = lambda r: r.fail("trajectory_unreadable", -32016, "odd")
    with pytest.raises(CommandError, match="odd"):
        gripper.play(Trajectory.from_bytes(lgt([(0.0, 0.5)])))


def playing(job: int = 9, active: bool = True, error: str | None = None) -> dict[str, Any]:
    return {"active": active, "kind": "play", "job": job, "samples": 300, "error": error}


def test_a_background_replay_ends_with_its_connection(
    daemon: FakeDaemon, there: FakeTrajectories, gripper: LiteGrip
) -> None:
    daemon.handlers["trajectory.play"] = lambda request: {"job": 9}
    daemon.handlers["trajectory.status"] = lambda request: playing()
    assert gripper.play_start(TAUGHT, loop=True) == playing()
    own = {"upload": 1, "loop": True, "wait": False, "detach": False}
    assert there.asked("play") == [{**own, "speed": 1.0, "align": True}]


def test_play_stop_waits_for_the_end(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    answers = [playing(), playing(), playing(active=False, error="cancelled by python")]
    daemon.handlers["trajectory.status"] = lambda request: answers.pop(0)
    daemon.handlers["job.cancel"] = lambda request: {"job": 9, "state": "running"}
    assert gripper.play_stop() == playing(active=False)
    assert daemon.wait_for("job.cancel")[0].params["job"] == 9
    assert not answers


def test_play_stop_says_when_it_does_not_end_in_time(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["trajectory.status"] = lambda request: playing()
    daemon.handlers["job.cancel"] = lambda request: {"job": 9, "state": "running"}
    with pytest.raises(CommandError, match=r"job 9, has not ended within 0\.02 s"):
        gripper.play_stop(timeout=0.02)


def test_play_stop_leaves_alone_what_is_no_replay_or_another_one(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    recording = {**playing(), "kind": "record"}
    daemon.handlers["trajectory.status"] = lambda request: recording
    assert gripper.play_stop() == recording
    answers = [playing(), playing(job=10)]  # which somebody has begun since
    daemon.handlers["trajectory.status"] = lambda request: answers.pop(0)
    daemon.handlers["job.cancel"] = lambda request: {"job": 9, "state": "cancelled"}
    assert gripper.play_stop() == playing(job=10)
    assert len(daemon.wait_for("job.cancel")) == 1


def test_the_background_forms_on_asyncio(daemon: FakeDaemon, there: FakeTrajectories) -> None:
    async def use(gripper: aio.LiteGrip) -> None:
        assert (await gripper.record_start())["active"]
        assert await gripper.record_stop() == TAUGHT
        assert await gripper.play(TAUGHT)
        daemon.handlers["trajectory.play"] = lambda request: {"job": 9}
        answers = [playing(), playing(), playing(), playing(active=False, error="cancelled")]
        daemon.handlers["trajectory.status"] = lambda request: answers.pop(0)
        daemon.handlers["job.cancel"] = lambda request: {"job": 9}
        assert await gripper.play_start(TAUGHT) == playing()
        assert (await gripper.play_stop())["error"] is None

    on_asyncio(daemon, use)
    assert there.uploads == {1: CONTENT}
