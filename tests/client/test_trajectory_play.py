"""Replaying, for threads and for asyncio: what is sent and asked."""

from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    LiteGrip,
    MoveProgress,
    Trajectory,
    TrajectoryBusyError,
    aio,
)
from tests.client.aio_helpers import with_gripper
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.fake_trajectories import CONTENT, PLAYED, TAUGHT, FakeTrajectories
from tests.trajectories import lgt


def test_play_sends_the_trajectory_once_and_asks_for_what_is_wanted(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    gripper.motion_config.speed_mm_s = 30.0
    result = gripper.play(TAUGHT, 0.5, 80, 1.5, align=False, repeat=3, torque_nm=1)
    assert (bool(result), result.outcome, result.loops) == (True, "completed", 1)
    assert (result.largest_lag_mm, result.final_cmd_rad, result.frames) == (1.25, 0.1, 200)
    assert gripper.play(TAUGHT)
    assert there.uploads == {"tmp/upload-1": CONTENT}
    first, second = there.asked("play")
    own = {"name": "tmp/upload-1", "progress": True, "config": {"speed_mm_s": 30.0}}
    figures = {"speed": 0.5, "kp": 80.0, "kd": 1.5, "torque_nm": 1.0}
    assert first == {**own, **figures, "align": False, "repeat": 3}
    assert second == {**own, "speed": 1.0, "align": True, "repeat": 1}


def test_uploads_do_not_pile_up(there: FakeTrajectories, gripper: LiteGrip) -> None:
    others = [Trajectory.from_bytes(lgt([(0.0, share / 10)])) for share in range(5)]
    for trajectory in others:
        gripper.play(trajectory)
    left = [name for name, content in there.uploads.items() if content]
    assert left == ["tmp/upload-4", "tmp/upload-5"]
    gripper.play(others[3])
    assert there.asked("play")[-1]["name"] == "tmp/upload-4"


def test_a_daemon_of_0_1_0_calls_it_by_its_number(
    there: FakeTrajectories, gripper: LiteGrip
) -> None:
    there.is_of_0_1_0 = True
    others = [Trajectory.from_bytes(lgt([(0.0, share / 10)])) for share in range(3)]
    for trajectory in others:
        gripper.play(trajectory)
    assert gripper.record(0.5, 200.0) == TAUGHT
    assert [asked["upload"] for asked in there.asked("play")] == [1, 2, 3]
    assert there.asked("delete") == [{"upload": 1}]
    assert {asked["recording"] for asked in there.asked("get")} == {1}


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
    own = {"name": "tmp/upload-1", "loop": True, "wait": False, "detach": False}
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


def test_the_background_forms_with_gripper(daemon: FakeDaemon, there: FakeTrajectories) -> None:
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

    with_gripper(daemon, use)
    assert there.uploads == {"tmp/upload-1": CONTENT}
