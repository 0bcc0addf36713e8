"""Replaying: what of a trajectory is sent and asked, with its grips, and how a replay is ended."""

import base64
import hashlib
import itertools
import os
from dataclasses import replace
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    Trajectory,
    TrajectoryBusyError,
    TrajectoryNotActiveError,
)
from tests.client.rig import Bench, Heard, Kind, Refuse
from tests.client.taught import BESIDE, CONTENT, GRIPS, TAUGHT
from tests.geometry import TRAVEL_MM
from tests.trajectories import PIECE_BYTES, lgt, sampled, swing

START = 60.0 / TRAVEL_MM
"""Where the jaws are."""
SWING = Trajectory.from_bytes(lgt(sampled(swing(START, 0.05), 2.1)))
POSES = [Trajectory.from_bytes(lgt([(0.0, START + share / 100)])) for share in range(5)]
PLAYED: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "completed",
    "loops": 1,
    "frames": 200,
    "largest_lag_mm": 1.25,
    "final_command_rad": 0.1,
}


def sent(daemon: Heard) -> bytes:
    """Return the contents that were sent, one after the other."""
    return b"".join(base64.b64decode(one["data"]) for one in daemon.asked("trajectory.put"))


def test_a_motion_beside_a_replay_of_the_same_program_is_told_what_ends_that(
    enabled: LiteGrip, kind: Kind
) -> None:
    enabled.play_start(SWING, loop=True)
    with pytest.raises(BusyError) as caught:
        enabled.goto(30.0)
    said = caught.value.message
    assert f"(pid {os.getpid()}, this very program), is running: wait for it" in said
    assert said.endswith(f"cancel it ({kind.awaits}gripper.play_stop()) or stop")
    enabled.play_stop()  # as it is told
    enabled.goto(30.0)


def test_play_sends_the_trajectory_once_and_asks_for_what_is_wanted(
    daemon: Heard, enabled: LiteGrip
) -> None:
    phases: list[str] = []
    enabled.motion_config.speed_mm_s = 30.0
    result = enabled.play(
        SWING, 2, 80, 1.5, align=False, repeat=2, torque_nm=1,
        progress=lambda progress: phases.append(progress.phase),
    )  # fmt: skip
    assert (bool(result), result.outcome, result.loops) == (True, "completed", 2)
    assert 0.0 < result.largest_lag_mm < 5.0
    assert result.final_cmd_rad == pytest.approx(daemon.gripper.position_rad, abs=0.1)
    assert result.frames > 400
    assert phases[-1] == "play"
    assert enabled.play(SWING, 2)
    assert [one["offset"] for one in daemon.asked("trajectory.put")] == [0, PIECE_BYTES]
    assert sent(daemon) == SWING.to_bytes()
    own = {"name": "tmp/upload-1", "progress": True, "config": {"speed_mm_s": 30.0}}
    figures = {"speed": 2.0, "kp": 80.0, "kd": 1.5, "torque_nm": 1.0}
    assert daemon.asked("trajectory.play") == [
        {**own, **figures, "align": False, "repeat": 2},
        {**own, "speed": 2.0, "align": True, "repeat": 1},
    ]


def test_uploads_do_not_pile_up_and_a_new_connection_is_sent_it_anew(
    daemon: Heard, enabled: LiteGrip
) -> None:
    for pose in (*POSES, POSES[3]):
        assert enabled.play(pose)
    names = [one["name"] for one in daemon.asked("trajectory.play")]
    assert names == [f"tmp/upload-{number}" for number in (1, 2, 3, 4, 5, 4)]
    deleted = [{"name": name} for name in names[:3]]
    assert daemon.asked("trajectory.delete") == deleted
    enabled.disconnect()
    enabled.connect()
    enabled.enable()
    assert enabled.play(POSES[4])
    assert sent(daemon) == b"".join(pose.to_bytes() for pose in (*POSES, POSES[4]))


def test_a_daemon_of_0_1_0_calls_it_by_its_number(daemon: Heard, gripper: LiteGrip) -> None:
    numbers = itertools.count(1)
    daemon.instead |= {
        "trajectory.put": lambda _request: {"complete": True, "upload": next(numbers)},
        "trajectory.play": {**PLAYED, "state": daemon.wire_state},
        "trajectory.delete": {"deleted": True},
        "trajectory.record_stop": {"recording": 1, "samples": 300},
        "trajectory.get": {
            "data": base64.b64encode(CONTENT).decode(),
            "total": len(CONTENT),
            "sha256": hashlib.sha256(CONTENT).hexdigest(),
        },
    }
    for pose in POSES[:3]:
        gripper.play(pose)
    assert gripper.record_stop() == Trajectory.from_bytes(CONTENT)
    assert [asked["upload"] for asked in daemon.asked("trajectory.play")] == [1, 2, 3]
    assert daemon.asked("trajectory.delete") == [{"upload": 1}]
    assert daemon.asked("trajectory.get") == [{"recording": 1, "offset": 0}]


@pytest.mark.parametrize(
    ("what", "hint"),
    [
        ("wave", "gripper.fetch_trajectory('wave'); one of your own: Trajectory.load('wave')"),
        ("./wave.lgt", "one of your own: Trajectory.load('./wave.lgt')"),
        (CONTENT, "gripper.fetch_trajectory(name); one of your own: Trajectory.load(name)"),
        (None, "gripper.fetch_trajectory(name); one of your own: Trajectory.load(name)"),
    ],
)
def test_only_a_trajectory_is_played(
    daemon: Heard, gripper: LiteGrip, what: Any, hint: str
) -> None:
    for play in (gripper.play, gripper.play_start):
        with pytest.raises(CommandError, match="is no Trajectory") as caught:
            play(what)
        assert (caught.value.hint or "").removeprefix("one that the daemon keeps: ") == hint
    assert daemon.methods() == ["hello"]


def test_a_trajectory_that_the_daemon_refuses_raises(daemon: Heard, enabled: LiteGrip) -> None:
    for wrong, speed in ((Trajectory(), 1.0), (SWING, 5.0), (SWING, 0.05)):
        with pytest.raises(CommandError):
            enabled.play(wrong, speed)
    enabled.record_start()
    with pytest.raises(TrajectoryBusyError):
        enabled.play(POSES[0])
    daemon.instead["trajectory.put"] = Refuse("trajectory_unreadable", -32016, "odd")
    with pytest.raises(CommandError, match="odd"):
        enabled.play(POSES[1])


# Grips


def test_play_sends_the_grips_and_asks_for_their_force(daemon: Heard, gripper: LiteGrip) -> None:
    figures = {"grips": 2, "width_mm": 44.0, "width_difference_mm": -4.0}
    daemon.instead["trajectory.play"] = {**PLAYED, **figures, "state": daemon.wire_state}
    result = gripper.play(TAUGHT, force="replay")
    assert (result.grips, result.width_mm, result.width_difference_mm) == (2, 44.0, -4.0)
    assert sent(daemon) == CONTENT + BESIDE
    gripper.play_start(TAUGHT, force="replay")
    gripper.play(replace(TAUGHT, grips=()))  # which is another one
    assert sent(daemon) == CONTENT + BESIDE + CONTENT
    forces = [asked.get("force") for asked in daemon.asked("trajectory.play")]
    assert forces == ["replay", "replay", None]


def test_what_is_kept_and_a_recording_come_with_their_grips(
    daemon: Heard, gripper: LiteGrip
) -> None:
    gripper.keep_trajectory("pick", TAUGHT)
    fetched = gripper.fetch_trajectory("pick")
    assert (fetched, fetched.grips) == (TAUGHT, GRIPS)
    for grips in (2, 0):
        daemon.instead["trajectory.record_stop"] = {"name": "pick", "samples": 300, "grips": grips}
        assert gripper.record_stop().grips == GRIPS[:grips]


# In the background


def playing(job: int = 9, active: bool = True, error: str | None = None) -> dict[str, Any]:
    return {"active": active, "kind": "play", "job": job, "samples": 300, "error": error}


def test_a_background_replay_ends_with_its_connection_or_by_play_stop(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    status = enabled.play_start(SWING, loop=True)
    assert (status["active"], status["kind"]) == (True, "play")
    asked = {"name": "tmp/upload-1", "speed": 1.0, "align": True, "loop": True}
    assert daemon.asked("trajectory.play") == [{**asked, "wait": False, "detach": False}]
    kind.pause(0.1)
    ended = enabled.play_stop()
    assert (ended["active"], ended["error"], ended["job"]) == (False, None, status["job"])
    assert daemon.asked("job.cancel") == [{"job": status["job"]}]


def test_what_needs_a_replay_names_the_call_that_begins_one(enabled: LiteGrip, kind: Kind) -> None:
    for control in (enabled.play_pause, enabled.play_resume, lambda: enabled.play_speed(1)):
        with pytest.raises(TrajectoryNotActiveError) as caught:
            control()
        assert caught.value.hint == f"{kind.awaits}gripper.play_start()"
        assert str(caught.value) == f"no replay is running: begin one ({caught.value.hint})"


def test_what_cannot_be_replayed_is_refused_where_it_is_begun(
    enabled: LiteGrip, kind: Kind
) -> None:
    fast = Trajectory.from_bytes(lgt([(0.0, START), (0.1, START - 0.4), (0.2, START)]))
    with pytest.raises(CommandError, match=r"^speed is 1, with which .* goes") as blocking:
        enabled.play(fast)
    with pytest.raises(CommandError) as caught:
        enabled.play_start(fast, loop=True)
    assert (str(caught.value), type(caught.value)) == (str(blocking.value), type(blocking.value))
    with pytest.raises(TrajectoryNotActiveError) as over:
        enabled.play_pause()
    assert over.value.message == f"no replay is running; the last one has ended: {blocking.value}"
    assert over.value.hint == f"{kind.awaits}gripper.play_start()"


def test_why_a_replay_has_ended_is_told_by_what_needs_one(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    assert enabled.play_start(SWING, loop=True)["phase"] == "play"
    daemon.client().result("stop", why="hand")
    kind.pause(0.1)
    daemon.client().result("stop.clear")
    enabled.get_state()
    ended = "no replay is running; the last one has ended: job .*, play, was broken off: a stop .*"
    for control in (enabled.play_pause, enabled.play_resume, lambda: enabled.play_speed(1)):
        with pytest.raises(TrajectoryNotActiveError, match=f"^{ended}: hand") as caught:
            control()
        assert str(caught.value).endswith(f"hand\nnext: {kind.awaits}gripper.play_start()")


def test_one_that_is_not_loaded_soon_is_not_waited_for(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.instead["trajectory.play"] = {"job": 9}
    daemon.instead["trajectory.status"] = {**playing(), "phase": "load"}
    began_s = site.now_s
    assert enabled.play_start(SWING)["phase"] == "load"
    assert site.now_s - began_s == pytest.approx(1.0, abs=0.1)


def test_play_stop_waits_for_the_end(daemon: Heard, gripper: LiteGrip) -> None:
    answers = [playing(), playing(), playing(active=False, error="cancelled by python")]
    daemon.instead["trajectory.status"] = lambda _request: answers.pop(0)
    daemon.instead["job.cancel"] = {"job": 9, "state": "running"}
    assert gripper.play_stop() == playing(active=False)
    assert daemon.asked("job.cancel") == [{"job": 9}]
    assert not answers


def test_play_stop_says_when_it_does_not_end_in_time(daemon: Heard, gripper: LiteGrip) -> None:
    daemon.instead["trajectory.status"] = playing()
    daemon.instead["job.cancel"] = {"job": 9, "state": "running"}
    with pytest.raises(CommandError, match=r"job 9, has not ended within 0\.02 s"):
        gripper.play_stop(timeout=0.02)


def test_play_stop_leaves_alone_what_is_no_replay_or_another_one(
    daemon: Heard, enabled: LiteGrip
) -> None:
    enabled.record_start()
    assert enabled.play_stop()["kind"] == "record"
    answers = [playing(), playing(job=10)]  # which somebody has begun since
    daemon.instead["trajectory.status"] = lambda _request: answers.pop(0)
    daemon.instead["job.cancel"] = {"job": 9, "state": "cancelled"}
    assert enabled.play_stop() == playing(job=10)
    assert daemon.asked("job.cancel") == [{"job": 9}]


def test_a_time_limit_below_0_is_refused_before_anything_is_sent(
    daemon: Heard, gripper: LiteGrip
) -> None:
    sent = len(daemon.requests)
    for stop in (gripper.play_stop, gripper.teleop_stop):
        with pytest.raises(CommandError, match=r"^timeout is -1, it must be 0 or more$"):
            stop(timeout=-1)
    assert len(daemon.requests) == sent
