"""A connection of tasks: what is asyncio's own about sockets, event loops and files."""

import asyncio
import socket
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.aio import LiteGrip
from litegrip_client.aio.gripper import Connection
from litegrip_client.values import calibration_files as files
from litegrip_client.values.errors import CommandError, ConnectError
from tests.client.fake_daemon import CALIBRATION, CONTENT, DEADLINE_S, STATE, FakeDaemon, Request
from tests.client.rig import Asyncio


def test_the_reason_is_also_read_when_sending_fails_first(
    daemon: FakeDaemon, tasks: Asyncio
) -> None:
    def leave(request: Request) -> None:
        error = {"code": -32003, "message": "read faster", "data": {"reason": "backlog_full"}}
        request.send({"jsonrpc": "2.0", "id": None, "error": error})
        request.hang_up()
        gone.set()

    async def main() -> None:
        connection = await Connection.open(daemon.path, DEADLINE_S)
        task = asyncio.create_task(connection.call("part"))
        await asyncio.sleep(0)  # it sends, and what comes is not looked for before the next turn
        assert gone.wait(DEADLINE_S)
        with pytest.raises(ConnectError, match="read faster"):
            await asyncio.gather(task, connection.call("state.get"))
        await connection.close()

    gone = threading.Event()
    daemon.handlers["part"] = leave
    tasks.run(main())


def test_a_daemon_whose_queue_is_full_is_tried_again(tmp_path: Path, tasks: Asyncio) -> None:
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

        tasks.run(main())


def test_a_daemon_that_reads_again_gets_all(daemon: FakeDaemon, tasks: Asyncio) -> None:
    going_on = threading.Event()

    async def send(connection: Connection) -> None:
        """Send more than the socket and asyncio keep."""
        for _ in range(100):
            await connection.notify_guarded("note", {"text": "x" * 16_000})

    async def main() -> None:
        connection = await Connection.open(daemon.path, DEADLINE_S)
        holding = asyncio.create_task(connection.call("hold"))
        await asyncio.to_thread(daemon.wait_for, "hold")
        sending = asyncio.create_task(send(connection))
        while not connection._stream.is_full:
            await asyncio.sleep(0)
        going_on.set()
        await asyncio.gather(holding, sending)
        assert await connection.call("state.get") == STATE
        await connection.close()

    daemon.handlers["hold"] = lambda _request: {"held": going_on.wait(DEADLINE_S)}
    tasks.run(main())
    assert daemon.methods().count("note") == 100


# Event loops


def test_another_event_loop_may_only_close(daemon: FakeDaemon, tasks: Asyncio) -> None:
    async def elsewhere(gripper: LiteGrip, states: AsyncIterator[object]) -> None:
        with pytest.raises(CommandError, match="another event loop") as caught:
            await gripper.get_state()
        assert caught.value.reason == "wrong_loop"
        with pytest.raises(CommandError, match="another event loop"):
            await anext(states)
        await gripper.disconnect()

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            states = gripper.states()
            await anext(states)
            waiting = asyncio.create_task(gripper.goto(20.0))
            await asyncio.to_thread(daemon.wait_for, "motion.move")
            await asyncio.to_thread(asyncio.run, elsewhere(gripper, states))
            with pytest.raises(ConnectError, match="was closed"):
                await waiting

    daemon.handlers["state.subscribe"] = lambda _request: {"subscription": 5, "state": STATE}
    tasks.run(main())


@pytest.mark.filterwarnings("ignore:unclosed transport:ResourceWarning")
def test_a_gripper_that_was_left_open_connects_anew_in_the_next_loop(
    daemon: FakeDaemon, tasks: Asyncio
) -> None:
    gripper = LiteGrip(socket_path=daemon.path)
    asyncio.run(gripper.connect())
    assert not gripper.is_connected

    async def main() -> float | None:
        async with gripper:
            return (await gripper.get_state()).openness

    assert tasks.run(main()) == 0.5
    assert daemon.methods() == ["hello", "hello", "state.get"]


def test_files_do_not_hold_up_other_tasks(
    daemon: FakeDaemon, tasks: Asyncio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
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
    tasks.run(main())
