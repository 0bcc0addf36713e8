import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    LiteGrip,
    MoveProgress,
    MoveResult,
    StoppedError,
)
from tests.client.fake_daemon import HELLO, MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import interrupt_main_thread


@pytest.mark.parametrize("name", ["open", "close"])
def test_a_motion_carries_what_guards_it(daemon: FakeDaemon, gripper: LiteGrip, name: str) -> None:
    daemon.handlers[f"motion.{name}"] = lambda request: MOVE
    move: Callable[..., MoveResult] = getattr(gripper, name)
    assert move(25)
    params = dict(daemon.requests[-1].params)
    assert 0.0 <= time.monotonic() - params.pop("sent_s") < 60.0
    assert params == {"speed_mm_s": 25.0, "progress": True, "stop_generation": 3}
    assert getattr(gripper.actions, name)()
    assert "speed_mm_s" not in daemon.requests[-1].params


def test_progress_is_reported_as_the_sdk_does(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    def move(request: Request) -> Any:
        request.progress(1)
        request.progress(2)
        return MOVE

    daemon.handlers["motion.open"] = move
    seen: list[MoveProgress] = []
    assert gripper.open(progress=seen.append)
    assert [one.i for one in seen] == [1, 2]
    assert seen[0] == MoveProgress("travel", 1, 10, 0.1, 0.2, 0.3)
    assert gripper.open().outcome == "pressed"


def test_a_motion_that_is_blocked_is_false(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.close"] = lambda request: {**MOVE, "ok": False, "outcome": "blocked"}
    assert not gripper.close()


def job(number: int, state: str = "running", pid: int | None = None) -> dict[str, Any]:
    owner = {"pid": os.getpid() if pid is None else pid}
    return {"job": number, "kind": "open", "state": state, "owner": owner}


def test_an_interrupt_cancels_the_job_of_the_motion(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.open"] = lambda request: interrupt_main_thread()
    daemon.handlers["job.list"] = lambda request: {"jobs": [job(5, "done"), job(6)]}
    daemon.handlers["job.cancel"] = lambda request: job(6, "cancelled")
    with pytest.raises(KeyboardInterrupt):
        gripper.open()
    assert daemon.methods()[-2:] == ["job.list", "job.cancel"]
    assert daemon.requests[-1].params == {"job": 6}
    assert gripper.get_state().mode == "holding"


def test_an_interrupt_after_progress_needs_no_list(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.open"] = lambda request: request.progress(job=9)
    daemon.handlers["job.cancel"] = lambda request: job(9, "cancelled")

    def interrupt(progress: MoveProgress) -> None:
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        gripper.open(progress=interrupt)
    assert daemon.methods()[-1] == "job.cancel"
    assert daemon.requests[-1].params == {"job": 9}


def test_an_error_of_the_callback_cancels_the_motion_too(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    daemon.handlers["motion.open"] = lambda request: request.progress(job=9)
    daemon.handlers["job.cancel"] = lambda request: job(9, "cancelled")

    def fail(progress: MoveProgress) -> None:
        raise StoppedError("of the callback's own")

    with pytest.raises(StoppedError, match="of the callback"):
        gripper.open(progress=fail)
    assert daemon.requests[-1].params == {"job": 9}


def test_a_refused_motion_cancels_nothing(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.open"] = lambda request: request.fail("busy", -32020)
    with pytest.raises(CommandError):
        gripper.open()
    assert daemon.methods()[-1] == "motion.open"


def test_a_motion_refused_while_interrupted_cancels_nobody_elses(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    daemon.handlers["motion.open"] = lambda request: interrupt_main_thread()

    def refuse_then_list(request: Request) -> Any:
        daemon.wait_for("motion.open")[0].fail("busy", -32020)
        return {"jobs": [job(7)]}  # of another thread of this process

    daemon.handlers["job.list"] = refuse_then_list
    with pytest.raises(KeyboardInterrupt):
        gripper.open()
    assert daemon.methods()[-1] == "job.list"


def test_a_job_that_cannot_be_found_is_told(
    daemon: FakeDaemon, gripper: LiteGrip, caplog: pytest.LogCaptureFixture
) -> None:
    daemon.handlers["motion.open"] = lambda request: interrupt_main_thread()
    daemon.handlers["job.list"] = lambda request: {"jobs": [job(7, pid=1)]}
    with pytest.raises(KeyboardInterrupt):
        gripper.open()
    assert "could not be cancelled: job 7 runs, but not as a job of process" in caplog.text


# Stop and reading


def test_hold_stop_and_clear(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.hold"] = lambda request: {"state": STATE}
    daemon.handlers["stop"] = lambda request: {"level": "hold", "generation": 4, "state": STATE}
    daemon.handlers["stop.clear"] = lambda request: {"generation": 5, "state": STATE}
    assert gripper.hold().mode == "holding"
    assert daemon.requests[-1].params.keys() == {"sent_s", "stop_generation"}
    assert gripper.software_stop().mode == "holding"
    assert daemon.requests[-1].params == {"level": "hold"}
    gripper.software_stop("disable", why="smoke")
    assert daemon.requests[-1].params == {"level": "disable", "why": "smoke"}
    gripper.clear_stop()
    assert daemon.requests[-1].params.keys() == {"sent_s", "stop_generation"}
    assert daemon.requests[-1].params["stop_generation"] == 4
    gripper.hold()
    assert daemon.requests[-1].params["stop_generation"] == 5


def test_a_signal_handler_may_stop_while_its_thread_waits(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    main = threading.main_thread().ident or 0
    daemon.handlers["stop"] = lambda request: {"level": "hold", "generation": 4, "state": STATE}

    def stop(number: int, frame: object) -> None:
        gripper.software_stop()
        daemon.wait_for("motion.open")[0].fail("stopped", -32021)

    before = signal.signal(signal.SIGUSR1, stop)
    try:
        daemon.handlers["motion.open"] = lambda request: signal.pthread_kill(main, signal.SIGUSR1)
        with pytest.raises(StoppedError):
            gripper.open()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert gripper.is_connected


def test_reading(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["health"] = lambda request: {"verdict": "ok", "reasons": []}
    daemon.handlers["info.get"] = lambda request: {"version": "1"}
    daemon.handlers["job.list"] = lambda request: {"jobs": [job(1)]}
    assert gripper.get_state().status == "enabled"
    assert (gripper.mount, gripper.channel) == ("reverse", "can0")
    assert gripper.health() == {"verdict": "ok", "reasons": []}
    assert gripper.info() == {"version": "1"}
    assert gripper.jobs() == [job(1)]


def test_states_are_whole_or_only_the_fields(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["state.subscribe"] = lambda request: {"subscription": 1, "state": STATE}
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 1}
    with gripper.states(100) as states:
        assert next(states).opening_mm == 35.25
    with gripper.states(100, ["mode"]) as fields:
        assert next(fields) == {"mode": "holding"}


def test_the_socket_of_the_environment_is_used(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    with LiteGrip() as gripper:
        assert gripper.is_connected
    assert HELLO["channel"] == gripper.channel
