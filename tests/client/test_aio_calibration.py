import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.aio import LiteGrip
from litegrip_client.values import calibration_files as files
from tests.client.aio_helpers import arrived, cancel, run
from tests.client.fake_daemon import CALIBRATION, CONTENT, HELLO, ZERO, FakeDaemon

LOADED = {**CALIBRATION, "loaded": True, "factory": False, "skipped": []}


@pytest.fixture(autouse=True)
def _calibrated(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.load"] = lambda request: LOADED
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    daemon.handlers["calibration.save"] = lambda request: {"path": "/d/can0.json"}
    daemon.handlers["calibration.zero"] = lambda request: ZERO
    daemon.handlers["info.get"] = lambda request: HELLO


def test_files_do_not_hold_up_other_tasks(
    daemon: FakeDaemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    going_on = threading.Event()

    def read(path: Path) -> dict[str, Any]:
        assert going_on.wait(20.0)
        return CONTENT

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            loading = asyncio.create_task(gripper.load_calibration(tmp_path / "c.json"))
            assert (await gripper.get_state()).mode == "holding"
            going_on.set()
            assert await loading is True

    monkeypatch.setattr(files, "read", read)
    run(main())


@pytest.fixture
def _by_hand(daemon: FakeDaemon) -> None:
    answers = {
        "begin": {"job": 6},
        "closed": {"closed_rad": 0.1, "open_rad": None},
        "open": {"closed_rad": 0.1, "open_rad": -1.5},
        "finish": ZERO,
        "cancel": {"job": 6},
    }
    daemon.handlers["calibration.manual"] = lambda request: answers[request.params["step"]]


def steps(daemon: FakeDaemon) -> list[str]:
    return [one.params["step"] for one in daemon.requests if one.method == "calibration.manual"]


@pytest.mark.usefixtures("_by_hand")
def test_a_calibration_by_hand_that_was_cancelled_may_have_begun(daemon: FakeDaemon) -> None:
    answer = daemon.handlers["calibration.manual"]
    daemon.handlers["calibration.manual"] = lambda request: (
        None if request.params["step"] == "begin" else answer(request)
    )

    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            beginning = asyncio.create_task(gripper.manual_calibration().__aenter__())
            await arrived(daemon, "calibration.manual")
            await cancel(beginning)

    run(main())
    assert steps(daemon) == ["begin", "cancel"]
