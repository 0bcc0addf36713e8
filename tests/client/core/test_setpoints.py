"""Streams of set-points, and the frames of the vendor's SDK, at the real daemon."""

import asyncio
import math
import os
from itertools import pairwise
from typing import Any

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    ConnectError,
    LeaseError,
    LiteGrip,
    SetpointStream,
    StoppedError,
    aio,
)
from litegrip_client.values.checks import RANGES
from litegripd.app.build import METHODS
from tests.client.rig import Asked, Asyncio, Bench, Heard, Kind


def sent(daemon: Heard) -> list[Asked]:
    return [request for request in daemon.requests if request.method == "stream.set"]


def answered(daemon: Heard) -> list[bool]:
    """Tell of which targets the client waited for the answer."""
    return [request.identity is not None for request in sent(daemon)]


def until_refused(kind: Kind, stream: SetpointStream, opening_mm: float) -> CommandError:
    """Send until the refusal of one that was sent before is raised."""
    with pytest.raises(CommandError) as caught:  # noqa: PT012 - the refusal comes some time
        for _ in range(20):
            stream.set_target(opening_mm)
            kind.pause(0.01)
    return caught.value


def test_the_first_target_is_answered_and_the_others_are_not(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    began_s = site.now_s
    with enabled.stream(speed_mm_s=40, torque_nm=0.5) as stream:
        stream.set_target(opening_mm=20)
        stream.set_target(position_rad=-0.5)
        stream.set_target(openness=0.25, torque_nm=0.3, kp=90, kd=1.5)
        kind.pause(0.05)
        assert daemon.state.mode == "moving"
    common = {"valid_s": 0.2, "speed_mm_s": 40.0, "torque_nm": 0.5}
    assert [one.plain for one in sent(daemon)] == [
        {"opening_mm": 20.0, **common},
        {"position_rad": -0.5, **common},
        {"openness": 0.25, **common, "torque_nm": 0.3, "kp": 90.0, "kd": 1.5},
    ]
    assert answered(daemon) == [True, False, False]
    for request in sent(daemon):
        assert request.params["stop_generation"] == daemon.state.stop_generation
        assert 0.0 <= request.params["sent_s"] - began_s < 0.05


@pytest.mark.parametrize(
    "target", [{}, {"opening_mm": 1.0, "openness": 0.5}, {"openness": float("nan")}]
)
def test_a_set_point_has_exactly_one_target(
    daemon: Heard, enabled: LiteGrip, target: dict[str, float]
) -> None:
    with enabled.stream() as stream, pytest.raises(CommandError, match=r"exactly one|finite"):
        stream.set_target(**target)
    assert sent(daemon) == []


def test_a_motion_beside_a_stream_of_the_same_program_is_told_so(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(20.0)
        with pytest.raises(BusyError, match="it ends by itself soon after its last") as caught:
            enabled.goto(30.0)
        stream.close()  # as it is told
        enabled.goto(30.0)
    how = f"to end it at once, cancel it ({kind.awaits}stream.close())"
    assert caught.value.message.endswith(how)
    assert f"(pid {os.getpid()}, this very program), is running: " in caught.value.message
    assert str(caught.value.hint).endswith(how)


def test_that_is_told_in_the_words_of_a_program_that_has_its_own(daemon: Heard, kind: Kind) -> None:
    def ros(method: str | None, _parameter: str | None, _asked: str | None) -> str | None:
        return "~/cancel" if method == "job.cancel" else None

    with kind.gripper(voice=ros) as gripper:
        gripper.enable()
        with gripper.stream() as stream:
            stream.set_target(20.0)
            with pytest.raises(BusyError, match=r"this very program\), .* cancel it \(~/cancel\)$"):
                gripper.goto(30.0)


def test_leaving_ends_the_stream_at_once(daemon: Heard, enabled: LiteGrip) -> None:
    with enabled.stream() as stream:
        stream.set_target(20.0)
    assert daemon.methods()[-1] == "job.cancel"
    assert daemon.state.mode == "holding"
    stream.close()
    assert daemon.methods().count("job.cancel") == 1


def test_a_stream_that_ended_by_itself_is_not_cancelled(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream(valid_s=0.1) as stream:
        stream.set_target(20.0)
        kind.pause(0.3)
    with enabled.stream():
        pass
    assert "job.cancel" not in daemon.methods()


def test_after_a_pause_the_answer_is_awaited_again(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream(valid_s=0.2) as stream:
        for pause_s in (0.09, 0.11, 0.0):
            stream.set_target(20.0)
            kind.pause(pause_s)
    assert answered(daemon) == [True, False, True]
    stream = enabled.stream()
    stream.set_target(10.0)
    enabled.disconnect()
    enabled.connect()  # a new connection, of which no stream is known
    enabled.enable()
    stream.set_target(10.0)
    assert answered(daemon)[-2:] == [True, True]


def test_a_stream_follows_at_the_speed_of_the_tunables(daemon: Heard, enabled: LiteGrip) -> None:
    enabled.motion_config.speed_mm_s = 80.0
    enabled.motion_config.force_n = 5.0
    for stream in (enabled.stream(), enabled.stream(speed_mm_s=20.0)):
        with stream:
            stream.set_target(20.0)
    enabled.send_mit_frame(-0.6, 100.0, 2.0)
    assert [one.params["speed_mm_s"] for one in sent(daemon)] == [80.0, 20.0, 80.0]
    assert all("config" not in one.params for one in sent(daemon))


def test_a_speed_of_the_tunables_that_is_refused_is_named_as_theirs(enabled: LiteGrip) -> None:
    enabled.motion_config.speed_mm_s = 500.0
    with enabled.stream() as stream, pytest.raises(CommandError) as caught:
        stream.set_target(20.0)
    assert caught.value.message.startswith("motion_config: speed_mm_s is 500, it must be")
    assert str(caught.value).endswith(": del gripper.motion_config.speed_mm_s")
    with pytest.raises(CommandError) as caught:
        enabled.stream(speed_mm_s=600.0)
    assert caught.value.message.startswith("speed_mm_s is 600, it must be")


def test_a_first_target_that_is_refused_raises_at_once(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    kind.ask(enabled, "motion.close", wait=False)
    with enabled.stream() as stream, pytest.raises(BusyError):
        stream.set_target(20.0)
    assert "job.cancel" not in daemon.methods()


def test_a_refusal_of_a_later_one_is_raised_and_the_next_is_answered_again(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        error = until_refused(kind, stream, 500.0)
        assert (error.reason, len(error.data["limit"])) == ("out_of_limits", 2)
        assert error.message.startswith("of an earlier target: opening_mm is 500")
        stream.set_target(10.0)
    is_answered = answered(daemon)
    assert (is_answered[0], is_answered[-1], any(is_answered[1:-1])) == (True, True, False)


@pytest.mark.parametrize("pause_s", [0.0, 0.02, 0.1, 0.3])
def test_a_refusal_is_raised_by_the_next_call_however_late_that_is(
    daemon: Heard, enabled: LiteGrip, kind: Kind, pause_s: float
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        stream.set_target(500.0)
        kind.pause(0.01 + pause_s)
        with pytest.raises(CommandError, match="of an earlier target: opening_mm is 500"):
            stream.set_target(10.0)
        stream.set_target(11.0)


@pytest.mark.parametrize("pause_s", [0.0, 0.1, 0.5])
def test_a_refusal_that_no_call_has_raised_is_raised_at_the_end(
    daemon: Heard, enabled: LiteGrip, kind: Kind, pause_s: float
) -> None:
    def burst() -> None:
        with enabled.stream() as stream:
            stream.set_target(60.0)
            stream.set_target(500.0)
            kind.pause(pause_s)

    with pytest.raises(CommandError, match="of an earlier target: opening_mm is 500"):
        burst()
    assert daemon.state.mode == "holding"
    with enabled.stream() as stream:
        stream.set_target(60.0)


def test_a_stream_ends_at_once_after_a_refusal_too(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    modes: list[str] = []
    for pause_s in (0.0, 0.6):  # the refusal is raised by a later call, or at once
        with enabled.stream(valid_s=1.0) as stream:
            stream.set_target(80.0 if pause_s else 10.0)
            kind.pause(pause_s)
            assert "opening_mm is 500" in until_refused(kind, stream, 500.0).message
            modes.append(daemon.state.mode)
        modes.append(daemon.state.mode)
    assert modes == ["moving", "holding"] * 2


def test_a_refusal_of_an_older_daemon_has_its_reason_beside_its_data(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        refusal = {"message": "no", "reason": "busy", "data": {}}
        daemon.streams[0].say("stream.refused", refusal)
        assert isinstance(until_refused(kind, stream, 10.0), BusyError)


def test_a_target_that_came_too_late_raises_nothing_and_the_next_is_answered(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream(valid_s=0.1) as stream:
        stream.set_target(30.0)
        daemon.late["stream.set"] = 0.15  # on a busy machine
        stream.set_target(31.0)
        kind.pause(0.04)
        del daemon.late["stream.set"]
        stream.set_target(32.0)
        kind.pause(0.04)
        stream.set_target(33.0)
        kind.pause(0.04)
        stream.set_target(34.0)
        kind.pause(0.04)  # the late one has come
        stream.set_target(35.0)
    assert answered(daemon) == [True, False, False, False, False, True]


def test_after_a_stop_what_is_sent_next_knows_of_it(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        daemon.client().result("stop")
        assert isinstance(until_refused(kind, stream, 10.0), StoppedError)
        with pytest.raises(StoppedError):
            stream.set_target(10.0)
    assert sent(daemon)[-1].params["stop_generation"] == daemon.state.stop_generation


@pytest.mark.parametrize("given_back", [False, True])
def test_a_take_over_reaches_a_streaming_program_that_has_no_lease(
    daemon: Heard, gripper: LiteGrip, kind: Kind, given_back: bool
) -> None:
    """It does not stream on against the taker, and may ask for the gripper again."""
    assert daemon.client(uid=1000).result("motor.enable")["ok"]
    taker = daemon.client(pid=4711, uid=1000)
    with gripper.stream() as stream:
        stream.set_target(10.0)
        taker.result("lease.take", why="a hand in the jaws")
        if given_back:
            taker.result("lease.release")
        told = until_refused(kind, stream, 10.0)
        with pytest.raises(LeaseError) as caught:
            stream.set_target(10.0)
    for error in (told, caught.value):
        assert isinstance(error, LeaseError)
        assert error.reason == "lease_lost"
        assert (error.data["by"]["pid"], error.data["why"]) == (4711, "a hand in the jaws")
        assert "(pid 4711, uid 1000): a hand in the jaws" in error.message
        assert "gripper.lease()" in str(error)
    if not given_back:
        taker.result("lease.release")
    with gripper.lease(), gripper.stream() as stream:
        stream.set_target(10.0)
        assert daemon.state.mode == "moving"


@pytest.mark.parametrize("is_cleared", [False, True])
def test_a_stop_reaches_the_streaming_program_with_all_that_is_known_of_it(
    daemon: Heard, enabled: LiteGrip, kind: Kind, is_cleared: bool
) -> None:
    watcher = daemon.client(pid=4711, uid=1000)
    with enabled.stream() as stream:
        stream.set_target(10.0)
        watcher.result("stop", level="relax", why="a hand in the jaws")
        if is_cleared:
            watcher.result("stop.clear")
        told = until_refused(kind, stream, 10.0)
        if not is_cleared:
            with pytest.raises(StoppedError) as caught:
                stream.set_target(10.0)
    for error in (told,) if is_cleared else (told, caught.value):
        assert isinstance(error, StoppedError)
        assert error.data["level"] == "relax"
        assert error.data["why"] == "a hand in the jaws"
        assert error.owner == {"pid": 4711, "uid": 1000, "program": "program4711"}
        for part in ("(relax)", "program4711 (pid 4711)", "a hand in the jaws"):
            assert part in error.message


@pytest.mark.parametrize("pause_s", [0.01, 0.1])
def test_a_stop_of_another_is_told_as_the_end_of_the_stream(
    daemon: Heard, enabled: LiteGrip, kind: Kind, pause_s: float
) -> None:
    """What matters is first, and no old target is to be sent again."""
    watcher = daemon.client(pid=4711, uid=1000)
    ended = "the stream was broken off: a stop (hold) by program4711 (pid 4711): hand"
    stream = enabled.stream(valid_s=0.2)
    stream.set_target(10.0)
    kind.pause(pause_s)
    watcher.result("stop", why="hand")
    told = until_refused(kind, stream, 10.0)
    assert told.text == f"{ended}\nwhen it is safe: {kind.awaits}gripper.clear_stop()"
    enabled.clear_stop()
    enabled.enable()
    stream.set_target(10.0)
    watcher.result("stop", why="hand")
    watcher.result("stop.clear")
    told = until_refused(kind, stream, 10.0)
    assert told.text == (f"{ended}\nthat stop is cleared: when it is safe, send the next target")
    stream.set_target(11.0)
    assert daemon.state.mode == "moving"


def test_a_loss_is_not_told_as_one_of_a_target(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        daemon.client(pid=4711).result("lease.take", why="my turn")
        told = until_refused(kind, stream, 10.0)
    assert told.message.startswith("the stream was broken off: the lease of this connection is")


def test_a_stop_of_the_daemons_own_has_no_owner(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as stream:
        stream.set_target(10.0)
        daemon.controller.stop("hold", None, None, daemon.now_s)
        told = until_refused(kind, stream, 10.0)
    assert told.owner is None
    assert (told.data["level"], told.data["why"]) == ("hold", None)
    assert "by the daemon" in told.message


def test_a_stream_to_a_daemon_that_is_gone_raises(daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper(disable_on_disconnect=False)
    gripper.connect()
    gripper.enable()
    stream = gripper.stream()
    stream.set_target(10.0)
    daemon.hang_up()
    with pytest.raises(ConnectError):
        until_refused(kind, stream, 10.0)
    stream.close()


def test_a_stream_that_has_ended_takes_no_target(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with enabled.stream() as left:
        left.set_target(20.0)
    closed = enabled.stream()  # without a block: until `close`
    closed.set_target(20.0)
    kind.pause(0.5)
    closed.set_target(30.0)
    closed.close()
    closed.close()
    count = len(sent(daemon))
    for stream in (left, closed):
        with pytest.raises(ConnectError, match="its block has ended, or it was closed") as caught:
            stream.set_target(40.0)
        assert caught.value.reason == "not_connected"
        assert str(caught.value).endswith("\nbegin a new one: gripper.stream()")
    assert len(sent(daemon)) == count
    assert daemon.state.mode == "holding"


def test_a_task_that_only_sends_leaves_others_their_turn(daemon: Heard, tasks: Asyncio) -> None:
    async def keep_sending(stream: aio.SetpointStream) -> None:
        while True:
            await stream.set_target(10.0)

    async def main() -> None:
        async with aio.LiteGrip() as gripper, gripper.stream() as stream:
            await gripper.enable()
            sending = asyncio.create_task(keep_sending(stream))
            for _ in range(10):
                assert (await gripper.get_state()).enabled
            await gripper.software_stop()
            with pytest.raises(StoppedError):
                await sending

    tasks.run(main())


def test_two_streams_of_a_gripper_do_not_mix(daemon: Heard, enabled: LiteGrip) -> None:
    with enabled.stream() as first, enabled.stream(torque_nm=0.5) as second:
        for opening_mm in (50.0, 51.0):
            first.set_target(opening_mm)
            second.set_target(opening_mm + 4.0)
    wished = [(one.params["opening_mm"], one.params.get("torque_nm")) for one in sent(daemon)]
    assert wished == [(50.0, None), (54.0, 0.5), (51.0, None), (55.0, 0.5)]
    assert answered(daemon) == [True, True, False, False]


# Frames, as the vendor's SDK sends them


def test_a_frame_becomes_a_set_point_and_one_without_kp_a_torque(
    daemon: Heard, enabled: LiteGrip
) -> None:
    assert enabled.send_mit_frame(-0.6, 100.0, 2.0) is True
    assert enabled.send_mit_frame(q=-0.5, kp=150.0, kd=2.5, dq=1.0, tau=0.0)
    assert enabled.send_mit_frame(0.0, 0.0, 2.0, tau=1.5)
    assert enabled.send_mit_frame(0.0, 0.0, 0.0)
    assert [one.plain for one in sent(daemon)] == [
        {"position_rad": -0.6, "kp": 100.0, "kd": 2.0, "valid_s": 0.2},
        {"position_rad": -0.5, "kp": 150.0, "kd": 2.5, "valid_s": 0.2},
        {"push_nm": 1.5, "valid_s": 0.2},
        {"push_nm": 0.0, "valid_s": 0.2},
    ]
    assert answered(daemon) == [True, False, False, False]


@pytest.mark.parametrize(
    ("arguments", "asks", "instead"),
    [
        ({"kp": 100.0, "kd": 2.0, "tau": -0.1}, "kp and tau asks for a torque", "grasp"),
        ({"kp": 0.0, "kd": 2.0, "dq": 2.0}, "kp = 0, kd and dq asks for a speed", "move_at_speed"),
        ({"kp": 0.0, "kd": 2.0, "dq": 2.0, "tau": 1.0}, "asks for a speed", "move_at_speed"),
    ],
)
def test_a_frame_that_is_no_set_point_is_rejected_with_what_to_use(
    daemon: Heard, gripper: LiteGrip, arguments: dict[str, float], asks: str, instead: str
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


def test_a_frame_that_was_refused_keeps_no_hold_from_coming(
    daemon: Heard, enabled: LiteGrip
) -> None:
    enabled.send_mit_frame(-0.6, 100.0, 2.0)
    enabled.send_mit_frame(-50.0, 100.0, 2.0)
    enabled.hold()
    assert (daemon.state.mode, daemon.methods()[-1]) == ("holding", "motion.hold")


@pytest.mark.parametrize(
    "motion",
    ["hold", "zero_gravity", "record_start"],
)
def test_a_motion_after_frames_does_not_have_to_wait_for_them(
    daemon: Heard, enabled: LiteGrip, motion: str
) -> None:
    for _ in range(2):
        enabled.send_mit_frame(-0.5, 100.0, 2.0)
        getattr(enabled, motion)()
        if motion == "record_start":
            enabled.record_stop(allow_empty=True)
    ends = [after for before, after in pairwise(daemon.methods()) if before == "stream.set"]
    assert ends == ["job.cancel", "job.cancel"]
    cancelled: list[Any] = daemon.asked("job.cancel")
    assert cancelled[0] != cancelled[1]


@pytest.mark.parametrize("valid_s", [0.0, -1.0, 0.019, 2.1, float("nan"), "0.2"])
def test_how_long_a_target_counts_is_refused_where_it_is_said(
    daemon: Heard, enabled: LiteGrip, valid_s: float
) -> None:
    with pytest.raises(CommandError, match=r"valid_s is .*, it must be ") as caught:
        enabled.stream(valid_s)
    assert caught.value.data["parameter"] == "valid_s"
    assert not daemon.asked("stream.set")


@pytest.mark.parametrize("valid_s", [0.02, 2.0])
def test_the_ends_of_that_range_are_the_daemons(
    daemon: Heard, enabled: LiteGrip, valid_s: float
) -> None:
    with enabled.stream(valid_s) as stream:
        stream.set_target(30.0)
    assert [one.params["valid_s"] for one in sent(daemon)] == [valid_s]
    words = "valid_s is 2.1, it must be 0.02 to 2"
    daemon.client().refused("stream.set", "invalid_params", words, opening_mm=30.0, valid_s=2.1)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"speed_mm_s": 1000}, "speed_mm_s is 1000, it must be 0.1 to 150 mm/s"),
        ({"torque_nm": 10.0}, "torque_nm is 10, it must be 0.1 to 3 N·m"),
        ({"torque_nm": "1"}, "torque_nm is '1', it must be a number"),
    ],
)
def test_a_limit_of_a_stream_is_refused_where_it_is_said(
    enabled: LiteGrip, given: dict[str, Any], told: str
) -> None:
    with pytest.raises(CommandError, match=f"^{told}$") as caught:
        enabled.stream(**given)
    assert caught.value.data["parameter"] in given


def test_what_a_stream_refuses_itself_is_what_the_daemon_refuses() -> None:
    (method,) = (one for one in METHODS if one.name == "stream.set")
    ranges = {one.name: (one.minimum, one.maximum) for one in method.params}
    for name in ("valid_s", "speed_mm_s", "torque_nm"):
        assert RANGES[name][:2] == ranges[name]


@pytest.mark.parametrize("name", ["send", "move"])
def test_a_name_that_others_have_for_it_leads_to_the_call(enabled: LiteGrip, name: str) -> None:
    with enabled.stream() as stream:
        with pytest.raises(AttributeError, match=rf"{name}'; use set_target\(opening_mm\)$"):
            getattr(stream, name)
        with pytest.raises(AttributeError, match="did you mean 'set_target'"):
            stream.set_targt  # type: ignore[attr-defined]  # noqa: B018 - it is the test


def test_a_target_that_is_none_or_two_is_told_what_was_given(enabled: LiteGrip) -> None:
    with enabled.stream() as stream:
        with pytest.raises(CommandError, match=r"exactly one of opening_mm, .*; given: none"):
            stream.set_target(None)
        with pytest.raises(CommandError, match="; given: opening_mm and openness"):
            stream.set_target(30.0, openness=0.5)
