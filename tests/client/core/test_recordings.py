"""Recording at the real daemon: what is asked, fetched and checked, and how it is broken off."""

from functools import partial
from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    ConnectError,
    LiteGrip,
    ParameterError,
    ProtocolError,
    StoppedError,
    TrajectoryRecordingError,
)
from tests.client.rig import Asked, Bench, Heard, Kind, Refuse
from tests.trajectories import PIECE_BYTES

END = {"allow_empty": True, "allow_partial": True}


@pytest.mark.parametrize("zero_gravity", [True, False])
def test_record_asks_for_its_samples_and_fetches_them_in_pieces(
    site: Bench, daemon: Heard, enabled: LiteGrip, zero_gravity: bool
) -> None:
    site.after(0.1, lambda: modes.append(str(daemon.state.mode)))
    modes: list[str] = []
    taught = enabled.record(1.05, 200.0, zero_gravity)
    assert (len(taught), taught.sample_hz, taught.mount) == (210, 200.0, "normal")
    start = {"rate_hz": 200.0, "zero_gravity": zero_gravity, "max_samples": 210}
    assert daemon.asked("trajectory.record_start") == [start]
    assert daemon.asked("trajectory.record_stop") == [{}]
    pieces = daemon.asked("trajectory.get")
    assert pieces == [{"name": "tmp/recording-1", "offset": at} for at in (0, PIECE_BYTES)]
    assert modes == ["moving" if zero_gravity else "holding"]
    assert 8 < daemon.methods().count("trajectory.status") < 20


@pytest.mark.parametrize(
    ("duration_s", "rate_hz"), [(0.0, 100.0), (-1.0, 100.0), (0.001, 100.0), (1.0, 0.0)]
)
def test_a_time_without_a_sample_is_refused_before_anything_is_slack(
    daemon: Heard, gripper: LiteGrip, duration_s: float, rate_hz: float
) -> None:
    with pytest.raises(ParameterError, match="make no sample"):
        gripper.record(duration_s, rate_hz)
    with pytest.raises(CommandError, match="must be a number"):
        gripper.record("long")  # type: ignore[arg-type]
    with pytest.raises(CommandError, match="whole number"):
        gripper.record_start(max_samples=1.5)  # type: ignore[arg-type]
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    ("duration_s", "rate_hz", "told"),
    [
        (1801.0, 200.0, "1801 s at 200 Hz make 360200 samples: record for at most 1800 s"),
        (1.0, 1000.0, "rate_hz is 1000"),
    ],
)
def test_too_many_samples_are_refused_in_seconds(
    enabled: LiteGrip, duration_s: float, rate_hz: float, told: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        enabled.record(duration_s, rate_hz)
    assert caught.value.message.startswith(told)
    assert caught.value.data.get("parameter", "duration_s") == "duration_s"


@pytest.mark.parametrize(("missed", "is_fine"), [(0, True), (10, True), (11, False), (100, False)])
def test_a_recording_may_have_few_holes(
    daemon: Heard, enabled: LiteGrip, missed: int, is_fine: bool
) -> None:
    def status(_request: Asked) -> dict[str, Any]:
        seen = other.result("trajectory.status")
        holes = {} if seen["active"] else {"samples": 100 - missed, "missed": missed}
        return {**seen, **holes}

    other = daemon.client()
    daemon.instead["trajectory.status"] = status
    if is_fine:
        assert len(enabled.record(1.0)) == 100
        return
    with pytest.raises(CommandError, match=f"{100 - missed} of 100 samples") as caught:
        enabled.record(1.0)
    assert caught.value.reason == "recording_failed"
    assert daemon.asked("trajectory.record_stop") == []  # it is over, and nobody wants it


def test_a_recording_that_was_broken_off_raises_as_the_daemon_says(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    site.after(0.5, lambda: daemon.client().send("stop"))
    with pytest.raises(CommandError) as caught:
        enabled.record(1.0)
    assert caught.value.reason == "recording_failed"
    assert 40 < caught.value.data["samples"] < 60
    assert daemon.asked("trajectory.record_stop") == [{}]
    remedy = f"{kind.awaits}gripper.record_stop(allow_partial=True)"
    assert f"; {remedy} takes what there is" in str(caught.value)
    part = enabled.record_stop(allow_partial=True)
    assert len(part) == caught.value.data["samples"]
    last = daemon.asked("trajectory.record_stop")[-1]
    assert last == {"allow_empty": False, "allow_partial": True}


def test_an_interrupt_ends_the_recording(daemon: Heard, enabled: LiteGrip, kind: Kind) -> None:
    kind.interrupt(0.5)
    with pytest.raises(kind.interrupted):
        enabled.record(60.0)
    assert daemon.asked("trajectory.record_stop") == [END]
    assert daemon.state.mode == "holding"


def test_an_interrupt_before_the_answer_takes_back_what_comes_of_it(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    daemon.late["trajectory.record_start"] = 0.1
    kind.interrupt(0.05)
    with pytest.raises(kind.interrupted):
        enabled.record_start()
    kind.pause(0.1)
    enabled.get_state()
    assert daemon.asked("trajectory.record_stop") == [END]
    kind.pause(0.05)
    assert enabled.get_state().mode == "holding"


def test_a_daemon_that_goes_is_told_at_once(site: Bench, daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper(disable_on_disconnect=False)
    gripper.connect()
    gripper.enable()
    site.after(0.5, daemon.hang_up)
    with pytest.raises(ConnectError):
        gripper.record(60.0)


def test_record_start_and_stop(daemon: Heard, enabled: LiteGrip, kind: Kind) -> None:
    status = enabled.record_start(50, zero_gravity=False, max_samples=20)
    assert (status["active"], status["kind"]) == (True, "record")
    kind.pause(0.2)
    assert 8 <= enabled.trajectory_status()["samples"] <= 11
    taught = enabled.record_stop(allow_empty=True)
    assert 8 <= len(taught) <= 12
    start = {"rate_hz": 50.0, "zero_gravity": False, "max_samples": 20}
    assert daemon.asked("trajectory.record_start") == [start]
    assert daemon.asked("trajectory.record_stop") == [{"allow_empty": True}]


def test_what_is_fetched_is_checked(daemon: Heard, enabled: LiteGrip) -> None:
    def get(spoiled: str, request: Asked) -> dict[str, Any]:
        piece = other.result("trajectory.get", name="pick", offset=request.params["offset"])
        if spoiled == "bytes":
            piece["data"] = "AAAA" + piece["data"][4:]
        elif spoiled == "nothing":
            piece["data"] = ""
        else:
            piece["sha256"] = f"{request.params['offset']:064x}"
        return piece

    other = daemon.client()
    enabled.keep_trajectory("pick", enabled.record(1.05, 200.0))
    for spoiled, kind, why in (
        ("bytes", ProtocolError, "has not the SHA-256"),
        ("nothing", ProtocolError, "sent nothing"),
        ("replaced", CommandError, "was replaced while it was being fetched"),
    ):
        daemon.instead["trajectory.get"] = partial(get, spoiled)
        with pytest.raises(kind, match=why):
            enabled.fetch_trajectory("pick")


def test_what_is_kept_is_listed_fetched_and_deleted_by_its_name(
    daemon: Heard, enabled: LiteGrip
) -> None:
    taught = enabled.record(0.3)
    for name in ("wave", "pick"):
        assert enabled.keep_trajectory(name, taught)["name"] == name
    assert [row["name"] for row in enabled.kept_trajectories()] == ["pick", "wave"]
    assert enabled.fetch_trajectory("wave") == taught
    enabled.delete_trajectory("wave")
    with pytest.raises(CommandError) as caught:
        enabled.fetch_trajectory("wave")
    assert caught.value.reason == "unknown_trajectory"
    with pytest.raises(CommandError, match="is no Trajectory"):
        enabled.keep_trajectory("pick", "wave")  # type: ignore[arg-type]
    daemon.instead["trajectory.list"] = Refuse("busy", -32020)
    with pytest.raises(CommandError):
        enabled.kept_trajectories()


def test_the_stop_that_broke_a_recording_off_is_known_when_that_was_told(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    other = daemon.client(pid=77, uid=1000)
    site.after(0.3, lambda: other.result("stop", why="a hand"))
    with pytest.raises(TrajectoryRecordingError, match=r"a stop \(hold\) by program77"):
        enabled.record(3.0)
    other.result("stop.clear")
    assert enabled.goto(40.0).ok


def test_a_stop_that_nobody_has_told_of_is_cleared_before_anything_moves(
    daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.client(pid=77, uid=1000).result("stop", why="a hand")
    said = r"^a stop \(hold\) by program77 \(pid 77\): a hand; this client had not heard of it, so"
    with pytest.raises(StoppedError, match=said) as caught:
        enabled.goto(40.0)
    assert "clear it (gripper.clear_stop())" in str(caught.value).replace("await ", "")
    enabled.clear_stop()
    assert enabled.goto(40.0).ok
