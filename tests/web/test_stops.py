"""One gripper's stops: few on their way, none lost, and none waits for another gripper's daemon."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.values.errors import LiteGripError
from litegrip_web.gripper import Gripper
from litegrip_web.stops import Stops


class StopSocket:
    """Listens for stops at `folder`; it answers once it is `let`."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "rpc.sock"
        self.came: list[dict[str, Any]] = []
        self.answers = asyncio.Semaphore(0)
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> "StopSocket":
        path = str(self.path.with_name("rpc.stop.sock"))
        self._server = await asyncio.start_unix_server(self._serve, path)
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        request = json.loads(await reader.readline())
        self.came.append(request["params"])
        await self.answers.acquire()
        result = {"level": request["params"]["level"], "generation": len(self.came)}
        writer.write(json.dumps({"jsonrpc": "2.0", "id": 1, "result": result}).encode() + b"\n")
        writer.close()

    async def until(self, number: int) -> None:
        """Wait until so many stops have come."""
        while len(self.came) < number:
            await asyncio.sleep(0)


def test_many_askers_are_answered_by_the_next_stop(tmp_path: Path) -> None:
    async def play() -> None:
        async with StopSocket(tmp_path) as daemon:
            stops = Stops(Gripper("can0", str(daemon.path)))
            first = asyncio.ensure_future(stops.stop("hold", "one"))
            await daemon.until(1)
            others = [asyncio.ensure_future(stops.stop("hold", "many")) for _ in range(50)]
            daemon.answers.release()
            assert (await first)["generation"] == 1
            await daemon.until(2)
            daemon.answers.release()
            # What was asked for while the first was on its way may follow a clearing.
            assert {(await other)["generation"] for other in others} == {2}
            assert len(daemon.came) == 2

    asyncio.run(play())


def test_another_level_waits_for_none(tmp_path: Path) -> None:
    async def play() -> None:
        async with StopSocket(tmp_path) as daemon:
            stops = Stops(Gripper("can0", str(daemon.path)))
            hold = asyncio.ensure_future(stops.stop("hold", None))
            await daemon.until(1)
            disable = asyncio.ensure_future(stops.stop("disable", None))
            await daemon.until(2)
            daemon.answers.release()
            daemon.answers.release()
            assert {(await stop)["level"] for stop in (hold, disable)} == {"hold", "disable"}

    asyncio.run(play())


def test_an_asker_that_goes_has_stopped_all_the_same(tmp_path: Path) -> None:
    async def play() -> None:
        async with StopSocket(tmp_path) as daemon:
            stops = Stops(Gripper("can0", str(daemon.path)))
            asker = asyncio.ensure_future(stops.stop("hold", None))
            await asyncio.sleep(0)
            asker.cancel()
            await daemon.until(1)
            daemon.answers.release()

    asyncio.run(play())


def test_a_daemon_that_is_not_there_is_said(tmp_path: Path) -> None:
    async def play() -> None:
        with pytest.raises(LiteGripError, match="no daemon"):
            await Stops(Gripper("can0", str(tmp_path / "rpc.sock"))).stop("hold", None)

    asyncio.run(play())


def test_a_gripper_does_not_wait_for_another_ones_daemon(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("hung", "healthy")]
    for folder in folders:
        folder.mkdir()

    async def play() -> None:
        async with StopSocket(folders[0]) as hung, StopSocket(folders[1]) as healthy:
            first, second = (Stops(Gripper("can0", str(one.path))) for one in (hung, healthy))
            waiting = [
                asyncio.ensure_future(first.stop(level, None))
                for level in STOP_LEVELS
                for _ in range(50)
            ]
            await hung.until(len(STOP_LEVELS))
            healthy.answers.release()
            assert (await second.stop("hold", None))["generation"] == 1
            assert not any(one.done() for one in waiting)
            for _ in range(2 * len(STOP_LEVELS)):
                hung.answers.release()
            await asyncio.gather(*waiting)

    asyncio.run(play())
