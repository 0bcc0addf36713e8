"""`LiteGrip.stop`: by the socket that the daemon names for stops, else as any other request."""

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CommandError, ConnectError, GripperState, LiteGrip, StoppedError, aio
from litegrip_client.core.stop import is_taken_as_meant
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon, Request
from tests.client.rig import Asyncio, Kind
from tests.process.daemon_process import line_of, spawn

GENERATION = 9  # of the first stop; HELLO knows of 3
LATCHED = STATE | {"seq": 8, "stop": {"level": "relax", "repeats": 0}, "stop_generation": 9}

ANOTHER_DAEMON = """
import socket, sys
listener = socket.socket(socket.AF_UNIX); listener.bind(sys.argv[1]); listener.listen()
print("on", flush=True)
connected = listener.accept()[0]
print(connected.recv(4096).decode() or "nothing", flush=True)
"""


def name_stop_socket(daemon: FakeDaemon, path: Any) -> None:
    """Let the daemon know it, and take stops as any other request."""
    stopped = {"level": "relax", "generation": GENERATION, "state": LATCHED}
    daemon.handlers["hello"] = lambda request: HELLO | {"stop_socket": path}
    daemon.handlers["state.get"] = lambda request: LATCHED
    daemon.handlers["stop"] = lambda request: stopped
    daemon.handlers["motion.hold"] = lambda request: {"state": STATE}


@pytest.fixture
def stops(tmp_path: Path, daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    """Serve the stop socket that the daemon names."""
    with FakeDaemon(tmp_path / "stops") as stops:
        name_stop_socket(daemon, stops.path)
        stops.handlers = {"stop": lambda request: {"level": "relax", "generation": GENERATION}}
        yield stops


@pytest.fixture
def site() -> None:
    """Time is the real one, and so are sockets."""


def stop(kind: Kind, daemon: FakeDaemon, *arguments: Any) -> GripperState:
    """Stop, and send a motion behind it, which must know of the stop."""
    with kind.gripper(None, socket_path=daemon.path) as gripper:
        state = gripper.software_stop(*arguments)
        gripper.hold()
    assert daemon.requests[-1].params["stop_generation"] == GENERATION
    assert ((state.stop or {})["level"], state.stop_generation) == ("relax", GENERATION)
    return state


def refuse_as_stopped(request: Request) -> None:
    request.fail("stopped", -32021, stop_generation=GENERATION)


def test_a_stop_goes_by_the_socket_for_stops_and_what_follows_knows_of_it(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind
) -> None:
    stop(kind, daemon, "relax", "a hand")
    (request,) = stops.requests
    assert (request.method, request.params) == ("stop", {"level": "relax", "why": "a hand"})
    assert daemon.methods() == ["hello", "state.get", "motion.hold"]


BY_A_REQUEST = ["hello", "stop", "motion.hold"]


@pytest.mark.parametrize("path", ["nowhere", "nobody listens", None, 7, "x" * 200])
def test_where_no_socket_can_be_reached_the_stop_is_a_request(
    daemon: FakeDaemon, tmp_path: Path, kind: Kind, path: Any
) -> None:
    (tmp_path / "nobody listens").touch()
    is_one = path in ("nowhere", "nobody listens")
    name_stop_socket(daemon, str(tmp_path / path) if is_one else path)
    stop(kind, daemon, "relax")
    assert daemon.methods() == BY_A_REQUEST
    assert daemon.requests[1].params == {"level": "relax"}


@pytest.mark.skipif(os.getuid() == 0, reason="root may connect to everything")
def test_where_that_socket_may_not_be_used_the_stop_is_a_request(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind
) -> None:
    Path(stops.path).chmod(0)
    stop(kind, daemon, "relax")
    assert (daemon.methods(), stops.methods()) == (BY_A_REQUEST, [])


def give_way(request: Request) -> None:
    error = {"code": -32030, "message": "no room", "data": {"reason": "too_many_connections"}}
    request.send({"jsonrpc": "2.0", "id": None, "error": error})
    request.hang_up()


@pytest.mark.parametrize(
    "answer", [give_way, Request.hang_up, lambda request: request.send_bytes(b"?\n")]
)
def test_a_stop_that_was_not_confirmed_is_given_again_as_a_request(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind, answer: Callable[[Request], None]
) -> None:
    stops.handlers["stop"] = answer
    stop(kind, daemon, "relax")
    assert daemon.methods() == BY_A_REQUEST


def test_the_daemon_of_another_gripper_at_that_path_is_not_stopped_for_this_one(
    daemon: FakeDaemon, tmp_path: Path, kind: Kind
) -> None:
    path = str(tmp_path / "another")
    name_stop_socket(daemon, path)
    with spawn(ANOTHER_DAEMON, path) as another:
        assert line_of(another) == "on"
        stop(kind, daemon)
        assert daemon.methods() == BY_A_REQUEST
        assert line_of(another) == "nothing"


@pytest.mark.parametrize("is_known", [True, False], ids=["after a call that failed", "at once"])
def test_after_a_restart_a_stop_connects_by_itself_and_nothing_else_does(
    tmp_path: Path, kind: Kind, is_known: bool
) -> None:
    path = tmp_path / "restarted"
    first = FakeDaemon(path)
    with kind.gripper(None, socket_path=first.path) as gripper:
        first.close()
        path.unlink()
        if is_known:
            with pytest.raises(ConnectError):
                gripper.get_state()
        with pytest.raises(
            ConnectError, match="is not confirmed, cut the motor's power: no daemon"
        ):
            gripper.software_stop()
        with FakeDaemon(path) as second:
            name_stop_socket(second, None)
            state = gripper.software_stop("relax")
            assert (state.stop or {})["level"] == "relax"
            assert second.methods() == ["hello", "stop", "state.get"]
            with pytest.raises(ConnectError):
                gripper.hold()
            assert second.methods() == ["hello", "stop", "state.get"]


def test_a_stop_needs_no_connection(daemon: FakeDaemon, kind: Kind) -> None:
    name_stop_socket(daemon, None)
    gripper = kind.gripper(None, socket_path=daemon.path)
    assert (gripper.software_stop("relax").stop or {})["level"] == "relax"
    with pytest.raises(ConnectError, match="not connected") as caught:
        gripper.hold()
    block = "async with" if kind.awaits else "with"
    hint = f"call {kind.awaits}gripper.connect() first, or use '{block} LiteGrip(...) as gripper:'"
    assert caught.value.hint == hint
    assert daemon.methods() == ["hello", "stop", "state.get"]


@pytest.mark.parametrize("level", ["slack", 5, None, ["hold"]])
def test_a_level_that_is_none_stops_with_hold_before_that_is_said(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind, level: Any
) -> None:
    with pytest.raises(CommandError, match="it must be 'hold' or 'relax' or 'disable'; the"):
        stop(kind, daemon, level)
    assert [(one.method, one.params) for one in stops.requests] == [("stop", {"level": "hold"})]
    assert "stop" not in daemon.methods()


@pytest.mark.parametrize(
    ("why", "is_taken"),
    [(None, True), ("", True), ("x" * 900, True), ("x" * 1000, False), ("\u2028" * 200, False)],
)
def test_a_reason_too_long_for_a_line_of_that_socket_is_told_by_a_request(
    why: str | None, is_taken: bool
) -> None:
    params = {"level": "disable"} | ({} if why is None else {"why": why})
    assert is_taken_as_meant(params) == is_taken


def test_a_stop_whose_state_does_not_come_says_that_it_is_in_force(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind
) -> None:
    with kind.gripper(None, socket_path=daemon.path) as gripper:
        daemon.handlers["state.get"] = lambda request: request.hang_up()
        with pytest.raises(
            ConnectError, match=r"^stopped \(relax\), but no state came: the daemon"
        ):
            gripper.software_stop("relax")
        assert not gripper.is_connected
        assert (gripper.software_stop("relax").stop or {})["level"] == "relax"  # by itself
    assert (stops.methods(), daemon.methods().count("stop")) == (["stop"], 1)


def test_a_stop_by_which_the_connection_ends_has_its_state_by_another_one(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind
) -> None:
    """As where it ends a block that another thread or task is in."""

    def end(request: Request) -> None:
        daemon.handlers["state.get"] = lambda _request: LATCHED
        request.hang_up()

    with kind.gripper(None, socket_path=daemon.path) as gripper:
        daemon.handlers["state.get"] = end
        assert gripper.software_stop("relax").stop_generation == GENERATION
        assert not gripper.is_connected
    assert stops.methods() == ["stop"]
    assert daemon.methods().count("stop") == 0


def test_one_stops_the_motion_that_another_thread_or_task_waits_for(
    daemon: FakeDaemon, stops: FakeDaemon, kind: Kind
) -> None:
    with kind.gripper(None, socket_path=daemon.path) as gripper:
        moving = kind.begin(gripper, "open")
        (motion,) = kind.arrived(daemon, "motion.open")
        assert gripper.software_stop("relax").stop_generation == GENERATION
        refuse_as_stopped(motion)
        with pytest.raises(StoppedError):
            moving()
        daemon.handlers["motion.open"] = refuse_as_stopped
        with pytest.raises(StoppedError):
            gripper.open()
    assert daemon.wait_for("motion.open", 2)[1].params["stop_generation"] == GENERATION
    assert stops.methods() == ["stop"]
    assert "stop" not in daemon.methods()


@pytest.mark.parametrize("named", [True, False])
def test_a_signal_handler_stops_the_motion_that_its_thread_waits_for(
    daemon: FakeDaemon, stops: FakeDaemon, named: bool
) -> None:
    main = threading.main_thread().ident or 0
    told: list[int] = []
    if not named:
        name_stop_socket(daemon, None)

    def on_signal(number: int, frame: object) -> None:
        told.append(gripper.software_stop().stop_generation)
        refuse_as_stopped(daemon.wait_for("motion.open")[0])

    before = signal.signal(signal.SIGUSR1, on_signal)
    try:
        daemon.handlers["motion.open"] = lambda request: signal.pthread_kill(main, signal.SIGUSR1)
        with LiteGrip(socket_path=daemon.path) as gripper:
            with pytest.raises(StoppedError):
                gripper.open()
            gripper.hold()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert told == [GENERATION]
    assert stops.methods() == ["stop"] * named
    assert daemon.methods().count("stop") == (not named)
    assert daemon.wait_for("motion.hold")[0].params["stop_generation"] == GENERATION


@pytest.mark.parametrize(
    "error",
    [TimeoutError("my limit"), ValueError("x"), OSError(5, "x"), ConnectionResetError("x")],
    ids=lambda error: type(error).__name__,
)
def test_what_a_signal_handler_raises_ends_the_motion_and_not_the_connection(
    daemon: FakeDaemon, error: Exception
) -> None:
    """As `signal.alarm` for a time limit: a socket might have raised the same."""
    main = threading.main_thread().ident or 0

    def on_signal(number: int, frame: object) -> None:
        raise error

    def interrupt(request: Request) -> None:
        request.send({"jsonrpc": "2.0", "method": "progress", "params": {"job": 3}})
        signal.pthread_kill(main, signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, on_signal)
    try:
        daemon.handlers |= {
            "motion.open": interrupt,
            "events.subscribe": lambda request: signal.pthread_kill(main, signal.SIGUSR1),
            "job.list": lambda request: {"jobs": []},
            "job.cancel": lambda request: {"job": 3, "state": "cancelled"},
        }
        with LiteGrip(socket_path=daemon.path) as gripper:
            for act in (gripper.open, gripper.events):
                with pytest.raises(type(error)) as caught:
                    act()
                assert caught.value is error
                assert gripper.is_connected
            assert gripper.get_state().seq == STATE["seq"]
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert {"job.list", "job.cancel"} & set(daemon.methods())


def test_a_stop_whose_task_is_cancelled_at_once_is_given_all_the_same(
    daemon: FakeDaemon, stops: FakeDaemon, tasks: Asyncio
) -> None:
    async def main() -> None:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            stopping = asyncio.create_task(gripper.software_stop())
            await asyncio.sleep(0)
            stopping.cancel()
            await asyncio.wait([stopping])
            assert stopping.cancelled()
            assert stops.methods() == ["stop"]
            await gripper.hold()

    tasks.run(main())
    assert daemon.requests[-1].params["stop_generation"] == GENERATION


def test_another_event_loop_stops_but_gets_no_state(
    daemon: FakeDaemon, stops: FakeDaemon, tasks: Asyncio
) -> None:
    gripper = aio.LiteGrip(socket_path=daemon.path)

    async def stop_there() -> None:
        with pytest.raises(CommandError, match=r"stopped \(relax\), but no state") as caught:
            await gripper.software_stop()
        assert caught.value.reason == "wrong_loop"

    async def main() -> None:
        async with gripper:
            await asyncio.to_thread(asyncio.run, stop_there())

    tasks.run(main())
    assert stops.methods() == ["stop"]
