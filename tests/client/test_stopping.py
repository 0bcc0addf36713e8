"""`LiteGrip.stop`: by the socket that the daemon names for stops, else as any other request."""

import asyncio
import os
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CommandError, ConnectError, LiteGrip, StoppedError, aio
from litegrip_client.core.stop import is_taken_as_meant
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon, Request
from tests.client.helpers import in_thread
from tests.process.daemon_process import line_of, spawn

LATCHED = {"seq": 8, "stop": {"level": "relax", "repeats": 0}, "stop_generation": 9}
GENERATION = 9  # of the first stop; HELLO knows of 3

ANOTHER_DAEMON = """
import socket, sys
listener = socket.socket(socket.AF_UNIX); listener.bind(sys.argv[1]); listener.listen()
print("on", flush=True)
connected = listener.accept()[0]
print(connected.recv(4096).decode() or "nothing", flush=True)
"""


@pytest.fixture
def stops(tmp_path: Path, daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    """Serve the stop socket that the daemon names."""
    with FakeDaemon(tmp_path / "stops") as stops:
        name_stop_socket(daemon, stops.path)
        stops.handlers = {"stop": lambda request: {"level": "relax", "generation": GENERATION}}
        yield stops


def name_stop_socket(daemon: FakeDaemon, path: str | None) -> None:
    """Let the daemon know it, and take stops as any other request."""
    daemon.handlers["hello"] = lambda request: HELLO | {"stop_socket": path}
    daemon.handlers["state.get"] = lambda request: STATE | LATCHED
    daemon.handlers["stop"] = lambda request: {
        "level": "relax",
        "generation": GENERATION,
        "state": STATE | LATCHED,
    }
    daemon.handlers["motion.hold"] = lambda request: {"state": STATE}


def stop_within_loop(path: str, *arguments: Any) -> Any:
    """Stop as `LiteGrip.stop`, on asyncio, and send a motion behind it."""

    async def main() -> Any:
        async with aio.LiteGrip(socket_path=path) as gripper:
            state = await gripper.software_stop(*arguments)
            await gripper.hold()
            return state

    return run(main())


def stop(path: str, *arguments: Any) -> Any:
    """Do the same with threads."""
    with LiteGrip(socket_path=path) as gripper:
        state = gripper.software_stop(*arguments)
        gripper.hold()
        return state


both = pytest.mark.parametrize("stopper", [stop, stop_within_loop], ids=["threads", "asyncio"])
Stopper = Callable[..., Any]


@both
def test_a_stop_goes_by_the_socket_for_stops_and_what_follows_knows_of_it(
    daemon: FakeDaemon, stops: FakeDaemon, stopper: Stopper
) -> None:
    state = stopper(daemon.path, "relax", "a hand")
    (request,) = stops.requests
    assert (request.method, request.params) == ("stop", {"level": "relax", "why": "a hand"})
    assert daemon.methods() == ["hello", "state.get", "motion.hold"]
    assert daemon.requests[-1].params["stop_generation"] == GENERATION
    assert (state.stop["level"], state.stop_generation) == ("relax", GENERATION)


def nowhere(path: Path) -> None:
    """Leave no file there."""


def not_listening(path: Path) -> None:
    path.touch()


def not_permitted(path: Path) -> None:
    if os.getuid() == 0:
        pytest.skip("root may connect to everything")
    path.chmod(0)


@both
@pytest.mark.parametrize("fault", [nowhere, not_listening, not_permitted])
def test_where_that_socket_cannot_be_reached_the_stop_is_a_request(
    daemon: FakeDaemon, tmp_path: Path, stopper: Stopper, fault: Callable[[Path], None]
) -> None:
    path = tmp_path / "stops"
    name_stop_socket(daemon, str(path))
    if fault is not_permitted:
        with FakeDaemon(path) as stops:
            fault(path)
            state = stopper(daemon.path, "relax")
            assert stops.methods() == []
    else:
        fault(path)
        state = stopper(daemon.path, "relax")
    assert daemon.methods() == ["hello", "stop", "motion.hold"]
    assert daemon.requests[1].params == {"level": "relax"}
    assert daemon.requests[-1].params["stop_generation"] == GENERATION
    assert (state.stop["level"], state.stop_generation) == ("relax", GENERATION)


@both
@pytest.mark.parametrize("path", [None, 7, "x" * 200])
def test_what_is_no_path_of_a_socket_is_not_used(
    daemon: FakeDaemon, stopper: Stopper, path: Any
) -> None:
    name_stop_socket(daemon, path)
    assert stopper(daemon.path).stop_generation == GENERATION
    assert daemon.methods() == ["hello", "stop", "motion.hold"]


def give_way(request: Request) -> None:
    error = {"code": -32030, "message": "no room", "data": {"reason": "too_many_connections"}}
    request.send({"jsonrpc": "2.0", "id": None, "error": error})
    request.hang_up()


@both
@pytest.mark.parametrize(
    "answer", [give_way, Request.hang_up, lambda request: request.send_bytes(b"?\n")]
)
def test_a_stop_that_was_not_confirmed_is_given_again_as_a_request(
    daemon: FakeDaemon, stops: FakeDaemon, stopper: Stopper, answer: Callable[[Request], None]
) -> None:
    stops.handlers["stop"] = answer
    assert stopper(daemon.path, "relax").stop["level"] == "relax"
    assert daemon.methods() == ["hello", "stop", "motion.hold"]


@both
def test_the_daemon_of_another_gripper_at_that_path_is_not_stopped_for_this_one(
    daemon: FakeDaemon, tmp_path: Path, stopper: Stopper
) -> None:
    path = tmp_path / "another"
    name_stop_socket(daemon, str(path))
    with spawn(ANOTHER_DAEMON, str(path)) as another:
        assert line_of(another) == "on"
        assert stopper(daemon.path).stop_generation == GENERATION
        assert daemon.methods() == ["hello", "stop", "motion.hold"]
        assert line_of(another) == "nothing"


@both
@pytest.mark.parametrize("level", ["slack", 5, None, ["hold"]])
def test_what_that_socket_would_take_for_something_else_is_a_request(
    daemon: FakeDaemon, stops: FakeDaemon, stopper: Stopper, level: Any
) -> None:
    daemon.handlers["stop"] = lambda request: request.fail("invalid_params", -32602)
    with pytest.raises(CommandError):
        stopper(daemon.path, level)
    assert stops.methods() == []
    assert daemon.methods() == ["hello", "stop"]


@pytest.mark.parametrize(
    ("why", "is_taken"),
    [(None, True), ("", True), ("x" * 900, True), ("x" * 1000, False), ("\u2028" * 200, False)],
)
def test_a_reason_too_long_for_a_line_of_that_socket_is_told_by_a_request(
    why: str | None, is_taken: bool
) -> None:
    params = {"level": "disable"} | ({} if why is None else {"why": why})
    assert is_taken_as_meant(params) == is_taken


def test_who_is_not_connected_is_told(daemon: FakeDaemon, stops: FakeDaemon) -> None:
    gripper = LiteGrip(socket_path=daemon.path)
    with pytest.raises(ConnectError) as caught:
        gripper.software_stop()
    assert caught.value.reason == "not_connected"
    assert stops.methods() == []


def test_a_stop_whose_state_does_not_come_says_that_it_is_in_force(
    daemon: FakeDaemon, stops: FakeDaemon
) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        daemon.handlers["state.get"] = lambda request: request.hang_up()
        with pytest.raises(
            ConnectError, match=r"^stopped \(relax\), but no state came: the daemon"
        ):
            gripper.software_stop("relax")
        assert not gripper.is_connected
        with pytest.raises(ConnectError, match=r"^stopped \(relax\)"):
            gripper.software_stop("relax")
    assert stops.methods() == ["stop", "stop"]


def test_a_thread_stops_the_motion_that_another_waits_for(
    daemon: FakeDaemon, stops: FakeDaemon
) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        moving = in_thread(gripper.open)
        (motion,) = daemon.wait_for("motion.open")
        assert gripper.software_stop("relax").stop_generation == GENERATION
        motion.fail("stopped", -32021, stop_generation=GENERATION)
        with pytest.raises(StoppedError):
            moving()
        daemon.handlers["motion.open"] = lambda request: request.fail(
            "stopped", -32021, stop_generation=GENERATION
        )
        with pytest.raises(StoppedError):
            gripper.open()
    assert daemon.wait_for("motion.open", 2)[1].params["stop_generation"] == GENERATION
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
        daemon.wait_for("motion.open")[0].fail("stopped", -32021, stop_generation=GENERATION)

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


def test_a_task_stops_the_motion_that_another_waits_for(
    daemon: FakeDaemon, stops: FakeDaemon
) -> None:
    async def main() -> None:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            moving = asyncio.create_task(gripper.open())
            (motion,) = await arrived(daemon, "motion.open")
            assert (await gripper.software_stop("relax")).stop_generation == GENERATION
            motion.fail("stopped", -32021, stop_generation=GENERATION)
            with pytest.raises(StoppedError):
                await moving

    run(main())
    assert stops.methods() == ["stop"]
    assert "stop" not in daemon.methods()


def test_a_stop_whose_task_is_cancelled_at_once_is_given_all_the_same(
    daemon: FakeDaemon, stops: FakeDaemon
) -> None:
    async def main() -> None:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            stopping = asyncio.create_task(gripper.software_stop())
            await asyncio.sleep(0)
            await cancel(stopping)
            assert stops.methods() == ["stop"]
            await gripper.hold()

    run(main())
    assert daemon.requests[-1].params["stop_generation"] == GENERATION


def test_another_event_loop_stops_but_gets_no_state(daemon: FakeDaemon, stops: FakeDaemon) -> None:
    gripper = aio.LiteGrip(socket_path=daemon.path)

    async def stop_there() -> None:
        with pytest.raises(CommandError, match=r"stopped \(relax\), but no state") as caught:
            await gripper.software_stop()
        assert caught.value.reason == "wrong_loop"

    async def main() -> None:
        async with gripper:
            await asyncio.to_thread(lambda: run(stop_there()))

    run(main())
    assert stops.methods() == ["stop"]
