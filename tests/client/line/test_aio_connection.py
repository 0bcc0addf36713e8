import asyncio
import math
import socket
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.aio import LiteGrip
from litegrip_client.aio.gripper import Connection
from litegrip_client.values import calibration_files as files
from litegrip_client.values.errors import CommandError, ConnectError
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import CALIBRATION, CONTENT, DEADLINE_S, STATE, FakeDaemon, Request


@asynccontextmanager
async def opened(daemon: FakeDaemon, timeout_s: float = DEADLINE_S) -> AsyncIterator[Connection]:
    connection = await Connection.open(daemon.path, timeout_s)
    try:
        yield connection
    finally:
        await connection.close()


def test_many_tasks_each_get_their_own_answers(daemon: FakeDaemon) -> None:
    async def ask(connection: Connection, number: int) -> None:
        for turn in range(5):
            params = {"number": number, "turn": turn}
            assert await connection.call("echo", params) == params

    async def main() -> None:
        async with opened(daemon) as connection:
            await asyncio.gather(*(ask(connection, number) for number in range(50)))

    daemon.handlers["echo"] = lambda request: request.params
    run(main())


def test_answers_in_the_other_order_reach_who_asked(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with opened(daemon) as connection:
            first = asyncio.create_task(connection.call("first"))
            (one,) = await arrived(daemon, "first")
            second = asyncio.create_task(connection.call("second"))
            (two,) = await arrived(daemon, "second")
            two.reply({"n": 2})
            assert await second == {"n": 2}
            assert not first.done()
            one.reply({"n": 1})
            assert await first == {"n": 1}

    run(main())


def test_a_cancelled_call_leaves_the_connection_usable(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with opened(daemon) as connection:
            task = asyncio.create_task(connection.call("wait", timeout_s=math.inf))
            (request,) = await arrived(daemon, "wait")
            await cancel(task)
            request.reply({"late": True})
            assert await connection.call("state.get") == STATE

    run(main())


def test_the_end_of_the_connection_fails_all_who_wait_and_who_comes_later(
    daemon: FakeDaemon,
) -> None:
    async def main() -> None:
        async with opened(daemon) as connection:
            tasks = [asyncio.create_task(connection.call("wait")) for _ in range(5)]
            requests = await arrived(daemon, "wait", 5)
            before = connection.closed
            requests[0].hang_up()
            results = await asyncio.gather(*tasks, return_exceptions=True)
            assert [type(one) for one in results] == [ConnectError] * 5
            assert len({id(one) for one in results}) == 5
            assert (before, connection.closed) == (False, True)
            with pytest.raises(ConnectError, match="ended the connection"):
                await connection.call("state.get")

    run(main())


def test_closing_fails_who_waits(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with opened(daemon) as connection:
            task = asyncio.create_task(connection.call("wait", timeout_s=math.inf))
            await arrived(daemon, "wait")
            await connection.close()
            with pytest.raises(ConnectError, match="was closed"):
                await task
            with pytest.raises(ConnectError, match="was closed"):
                await connection.call("state.get")

    run(main())


def part(request: Request) -> None:
    error = {"code": -32003, "message": "read faster", "data": {"reason": "backlog_full"}}
    request.send({"jsonrpc": "2.0", "id": None, "error": error})
    request.hang_up()


def test_the_reason_is_also_read_when_sending_fails_first(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with opened(daemon) as connection:
            daemon.requests.clear()
            task = asyncio.create_task(connection.call("part"))
            await asyncio.sleep(
                0
            )  # it sends, and what comes is not looked for before the next turn
            daemon.wait_for("part")
            gone.wait(DEADLINE_S)
            with pytest.raises(ConnectError, match="read faster"):
                await asyncio.gather(task, connection.call("state.get"))

    def leave(request: Request) -> None:
        part(request)
        gone.set()

    gone = threading.Event()
    daemon.handlers["part"] = leave
    run(main())


# A daemon that does not accept, or read


def test_a_daemon_whose_queue_is_full_is_tried_again(tmp_path: Path) -> None:
    path = str(tmp_path / "full.sock")
    with socket.socket(socket.AF_UNIX) as listener, socket.socket(socket.AF_UNIX) as first:
        listener.bind(path)
        listener.listen(0)
        first.connect(path)

        async def main() -> None:
            with pytest.raises(BlockingIOError):
                await Connection.open(path, 0.03)
            opening = asyncio.create_task(Connection.open(path, DEADLINE_S))
            while not opening.done():
                listener.accept()[0].close()
                await asyncio.wait([opening], timeout=0.1)
            await (await opening).close()

        run(main())


def flood(daemon: FakeDaemon) -> threading.Event:
    """Have the daemon read nothing behind `hold` until the event is set."""
    going_on = threading.Event()

    def hold(request: Request) -> Any:
        going_on.wait(DEADLINE_S)
        return {"held": True}

    daemon.handlers["hold"] = hold
    return going_on


async def send(connection: Connection) -> None:
    """Send more than the socket and asyncio keep."""
    for _ in range(100):
        await connection.notify_guarded("note", {"text": "x" * 16_000})


def test_a_daemon_that_does_not_read_is_an_error(daemon: FakeDaemon) -> None:
    going_on = flood(daemon)

    async def main() -> None:
        async with opened(daemon, 0.05) as connection:
            holding = asyncio.create_task(connection.call("hold", timeout_s=math.inf))
            await arrived(daemon, "hold")
            with pytest.raises(ConnectError, match="does not read its requests") as caught:
                await send(connection)
            assert caught.value.reason == "no_answer"
            going_on.set()
            assert await holding == {"held": True}

    run(main())


def test_a_daemon_that_reads_again_gets_all(daemon: FakeDaemon) -> None:
    going_on = flood(daemon)

    async def main() -> None:
        async with opened(daemon) as connection:
            holding = asyncio.create_task(connection.call("hold"))
            await arrived(daemon, "hold")
            sending = asyncio.create_task(send(connection))
            while not connection._stream.is_full:
                await asyncio.sleep(0)
            going_on.set()
            await asyncio.gather(holding, sending)
            assert await connection.call("state.get") == STATE

    run(main())
    assert daemon.methods().count("note") == 100


# Event loops


def test_another_event_loop_may_only_close(daemon: FakeDaemon) -> None:
    async def elsewhere(gripper: LiteGrip) -> None:
        with pytest.raises(CommandError, match="another event loop") as caught:
            await gripper.get_state()
        assert caught.value.reason == "wrong_loop"
        await gripper.disconnect()

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            waiting = asyncio.create_task(gripper.goto(20.0))
            await arrived(daemon, "motion.move")
            await asyncio.to_thread(asyncio.run, elsewhere(gripper))
            with pytest.raises(ConnectError, match="was closed"):
                await waiting

    run(main())


@pytest.mark.filterwarnings("ignore:unclosed transport:ResourceWarning")
def test_a_gripper_that_was_left_open_connects_anew_in_the_next_loop(daemon: FakeDaemon) -> None:
    gripper = LiteGrip(socket_path=daemon.path)
    run(gripper.connect())
    assert not gripper.is_connected

    async def main() -> float | None:
        async with gripper:
            return (await gripper.get_state()).openness

    assert run(main()) == 0.5
    assert daemon.methods() == ["hello", "hello", "state.get"]


def test_files_do_not_hold_up_other_tasks(
    daemon: FakeDaemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    going_on = threading.Event()

    def read(_path: Path) -> dict[str, Any]:
        assert going_on.wait(DEADLINE_S)
        return CONTENT

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            loading = asyncio.create_task(gripper.load_calibration(tmp_path / "c.json"))
            assert (await gripper.get_state()).mode == "holding"
            going_on.set()
            assert await loading is True

    monkeypatch.setattr(files, "read", read)
    loaded = {**CALIBRATION, "loaded": True, "factory": False, "skipped": []}
    daemon.handlers["calibration.load"] = lambda request: loaded
    run(main())
