import math
import threading
import time
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    ConnectError,
    LiteGrip,
    ParameterError,
    SetpointStream,
    StoppedError,
)
from tests.client.fake_daemon import DEADLINE_S, MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import Clock, in_thread
from tests.geometry import SPAN_MM

pytestmark = pytest.mark.usefixtures("jobs")


def sent(daemon: FakeDaemon) -> list[Request]:
    return [request for request in daemon.requests if request.method == "stream.set"]


def keep_sending(stream: SetpointStream) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        stream.set_target(10.0)


def until_refused(stream: SetpointStream) -> CommandError:
    """Send until the refusal of one that was sent before is raised."""
    with pytest.raises(CommandError) as caught:
        keep_sending(stream)
    return caught.value


def test_the_first_target_is_answered_and_the_others_are_not(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    with gripper.stream(speed_mm_s=40, torque_nm=0.5) as stream:
        stream.set_target(opening_mm=20)
        stream.set_target(position_rad=-0.5)
        stream.set_target(openness=0.25, torque_nm=0.3)
        gripper.get_state()
    first, second, third = sent(daemon)
    assert (first.identity is None, second.identity, third.identity) == (False, None, None)
    assert "id" not in second.raw
    assert first.params["opening_mm"] == 20.0
    assert second.params["position_rad"] == -0.5
    assert (third.params["openness"], third.params["torque_nm"]) == (0.25, 0.3)
    for request in (first, second):
        limits = {name: request.params[name] for name in ("valid_s", "speed_mm_s", "torque_nm")}
        assert limits == {"valid_s": 0.2, "speed_mm_s": 40.0, "torque_nm": 0.5}
        assert request.params["stop_generation"] == 3
        assert 0.0 <= time.monotonic() - request.params["sent_s"] < 60.0


@pytest.mark.parametrize(
    "target", [{}, {"opening_mm": 1.0, "openness": 0.5}, {"openness": float("nan")}]
)
def test_a_set_point_has_exactly_one_target(
    daemon: FakeDaemon, gripper: LiteGrip, target: dict[str, float]
) -> None:
    with gripper.stream() as stream, pytest.raises(CommandError, match=r"exactly one|finite"):
        stream.set_target(**target)
    assert sent(daemon) == []


def test_leaving_ends_the_stream_at_once(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    with gripper.stream() as stream:
        stream.set_target(20.0)
    assert daemon.methods()[-1] == "job.cancel"
    assert daemon.requests[-1].params == {"job": 11}
    stream.close()
    assert daemon.methods().count("job.cancel") == 1


def test_a_stream_that_ended_by_itself_is_not_cancelled(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    with gripper.stream(valid_s=0.1) as stream:
        stream.set_target(20.0)
        clock.now_s += 0.3
    with gripper.stream():
        pass
    assert "job.cancel" not in daemon.methods()


def test_after_a_pause_the_answer_is_awaited_again(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock, jobs: list[int]
) -> None:
    with gripper.stream(valid_s=0.2) as stream:
        stream.set_target(20.0)
        clock.now_s += 0.09
        stream.set_target(21.0)
        clock.now_s += 0.11
        stream.set_target(22.0)
    assert jobs == [11, 12]
    assert daemon.requests[-1].params == {"job": 12}


def test_a_stream_follows_at_the_speed_of_the_tunables(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    gripper.motion_config.speed_mm_s = 80.0
    gripper.motion_config.force_n = 5.0
    for stream in (gripper.stream(), gripper.stream(speed_mm_s=20.0)):
        with stream:
            stream.set_target(20.0)
    gripper.send_mit_frame(-0.6, 100.0, 2.0)
    assert [one.params["speed_mm_s"] for one in sent(daemon)] == [80.0, 20.0, 80.0]
    assert all("config" not in one.params for one in sent(daemon))


def test_a_first_target_that_is_refused_raises_at_once(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    daemon.handlers["stream.set"] = lambda request: request.fail("busy", -32020)
    with gripper.stream() as stream, pytest.raises(BusyError):
        stream.set_target(20.0)
    assert "job.cancel" not in daemon.methods()


def refuse_notifications(daemon: FakeDaemon, refusal: dict[str, Any]) -> None:
    begin = daemon.handlers["stream.set"]

    def handle(request: Request) -> Any:
        if request.identity is None:
            request.notify("stream.refused", refusal)
        return begin(request)

    daemon.handlers["stream.set"] = handle


@pytest.mark.parametrize("inside", [True, False])
def test_a_refusal_of_a_later_one_is_raised_and_the_next_is_answered_again(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock, jobs: list[int], inside: bool
) -> None:
    reason = {"reason": "out_of_limits"}
    data = {"retryable": False, "limit": [0.0, SPAN_MM], **(reason if inside else {})}
    refusal = {"message": "too far", "data": data, **({} if inside else reason)}
    refuse_notifications(daemon, refusal)
    with gripper.stream() as stream:
        stream.set_target(10.0)
        error = until_refused(stream)
        assert (type(error), error.reason, error.message) == (
            ParameterError,
            "out_of_limits",
            "too far",
        )
        assert error.data["limit"] == [0.0, SPAN_MM]
        stream.set_target(10.0)
    assert jobs == [11, 12]


def test_a_target_that_came_too_late_raises_nothing_and_the_next_is_answered(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    data = {"reason": "set_point_expired", "retryable": False}
    refuse_notifications(daemon, {"message": "too late", "data": data})
    with gripper.stream() as stream:
        ends_s = time.monotonic() + DEADLINE_S
        while sum(request.identity is not None for request in sent(daemon)) < 3:
            stream.set_target(10.0)
            assert time.monotonic() < ends_s


def test_after_a_stop_what_is_sent_next_knows_of_it(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    refusal = {"reason": "stopped", "message": "no", "data": {"stop_generation": 8}}
    refuse_notifications(daemon, refusal)
    with gripper.stream() as stream:
        stream.set_target(10.0)
        assert isinstance(until_refused(stream), StoppedError)
        stream.set_target(10.0)
    assert sent(daemon)[-1].params["stop_generation"] == 8


def test_a_stream_to_a_daemon_that_is_gone_raises(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    stream = gripper.stream()
    stream.set_target(10.0)
    daemon.hang_up()
    with pytest.raises(ConnectError):
        keep_sending(stream)
    stream.close()


def test_another_thread_that_waits_reads_the_refusals(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    refuse_notifications(daemon, {"reason": "busy", "message": "no", "data": {}})
    reader = in_thread(lambda: gripper._session.connection.call("wait", timeout_s=DEADLINE_S))
    (waiting,) = daemon.wait_for("wait")
    with gripper.stream() as stream:
        stream.set_target(10.0)
        assert isinstance(until_refused(stream), BusyError)
    waiting.reply({"waited": True})
    assert reader() == {"waited": True}


def test_a_stream_begins_anew_on_a_new_connection(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock, jobs: list[int]
) -> None:
    stream = gripper.stream()
    stream.set_target(10.0)
    gripper.disconnect()
    gripper.connect()
    stream.set_target(10.0)
    assert jobs == [11, 12]


# Frames, as the vendor's SDK sends them


def frame(request: Request) -> dict[str, float]:
    """Return what a frame's request asks, without what guards it against stops."""
    names = ("position_rad", "kp", "kd", "valid_s", "torque_nm")
    return {name: request.params[name] for name in names if name in request.params}


def test_a_frame_becomes_a_set_point(daemon: FakeDaemon, gripper: LiteGrip, clock: Clock) -> None:
    assert gripper.send_mit_frame(-0.6, 100.0, 2.0) is True
    assert gripper.send_mit_frame(q=-0.5, kp=150.0, kd=2.5, dq=1.0, tau=0.0)
    first, second = daemon.wait_for("stream.set", 2)
    assert frame(first) == {"position_rad": -0.6, "kp": 100.0, "kd": 2.0, "valid_s": 0.2}
    assert frame(second) == {"position_rad": -0.5, "kp": 150.0, "kd": 2.5, "valid_s": 0.2}
    assert second.identity is None


@pytest.mark.parametrize(
    ("arguments", "asks", "instead"),
    [
        ({"kp": 0.0, "kd": 2.0, "tau": 1.5}, "tau asks for a torque", "set_force"),
        ({"kp": 100.0, "kd": 2.0, "tau": -0.1}, "tau asks for a torque", "grasp"),
        ({"kp": 0.0, "kd": 2.0, "dq": 2.0}, "kp = 0 asks for a speed", "move_at_speed"),
        ({"kp": 0.0, "kd": 0.0}, "kp = 0 asks for loose jaws", "zero_gravity"),
    ],
)
def test_a_frame_that_is_no_position_is_rejected_with_what_to_use(
    daemon: FakeDaemon, gripper: LiteGrip, arguments: dict[str, float], asks: str, instead: str
) -> None:
    with pytest.raises(CommandError, match=asks) as caught:
        gripper.send_mit_frame(0.0, **arguments)
    assert caught.value.reason == "unsupported"
    assert instead in str(caught.value)
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    "frame", [(0.0, -1.0, 2.0), (0.0, 100.0, -1.0), (0.0, math.nan, 2.0), (0.0, 9.0, 1.0, math.inf)]
)
def test_a_frame_with_impossible_figures_is_rejected(
    gripper: LiteGrip, frame: tuple[float, ...]
) -> None:
    with pytest.raises(CommandError, match=r"cannot be negative|finite") as caught:
        gripper.send_mit_frame(*frame)
    assert caught.value.reason == "invalid_params"


def test_a_motion_after_frames_does_not_have_to_wait_for_them(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    daemon.handlers["motion.close"] = lambda request: MOVE
    daemon.handlers["motion.hold"] = lambda request: {"state": STATE}
    gripper.send_mit_frame(0.0, 100.0, 2.0)
    gripper.close()
    gripper.close()
    gripper.send_mit_frame(0.0, 100.0, 2.0)
    gripper.hold()
    assert daemon.methods()[1:] == [
        *("stream.set", "job.cancel", "motion.close"),
        "motion.close",
        *("stream.set", "job.cancel", "motion.hold"),
    ]


def test_streams_of_two_threads_do_not_mix(
    daemon: FakeDaemon, gripper: LiteGrip, clock: Clock
) -> None:
    ready = threading.Barrier(2, timeout=DEADLINE_S)

    def follow(opening_mm: float) -> None:
        with gripper.stream() as stream:
            ready.wait()
            for _ in range(50):
                stream.set_target(opening_mm)

    others = [in_thread(lambda mm=mm: follow(mm)) for mm in (1.0, 2.0)]  # type: ignore[misc]
    for other in others:
        other()
    seen = [request.params["opening_mm"] for request in daemon.wait_for("stream.set", 100)]
    assert sorted(seen) == [1.0] * 50 + [2.0] * 50
