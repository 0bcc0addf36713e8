import asyncio
import json
import threading
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CALIB_TEMPLATES, CommandError, HardwareError
from litegrip_client import calibration_files as files
from litegrip_client.aio import LiteGrip
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


def loaded(daemon: FakeDaemon) -> list[dict[str, Any]]:
    """Return what was to be loaded, without what guards it."""
    asked = [one.params for one in daemon.requests if one.method == "calibration.load"]
    return [{key: one[key] for key in one if key in ("template", "content")} for one in asked]


def test_loading_by_every_way(daemon: FakeDaemon, tmp_path: Path, home: Path) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            assert await gripper.load_template("reverse") is True
            assert await gripper.load_calibration(template="reverse") is True
            assert await gripper.load_calibration(CALIB_TEMPLATES["reverse"]) is True
            assert await gripper.load_calibration(path) is True
            assert await gripper.load_calibration() is True
            with pytest.raises(CommandError, match="No such file"):
                await gripper.load_calibration(tmp_path / "none.json")
            daemon.handlers["calibration.load"] = lambda request: {
                **LOADED,
                "loaded": "content" in request.params,
            }
            assert await gripper.load_calibration() is False
            (home / ".litegrip").mkdir()
            (home / ".litegrip/can0_calibration.json").write_text(json.dumps(CONTENT))
            assert await gripper.load_calibration() is True

    path = tmp_path / "c.json"
    path.write_text(json.dumps(CONTENT))
    run(main())
    assert loaded(daemon) == [
        *[{"template": "reverse"}] * 3,
        *({"content": CONTENT}, {}, {}, {}, {"content": CONTENT}),
    ]


def test_saving_by_the_daemon_and_here(daemon: FakeDaemon, tmp_path: Path) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            assert await gripper.save_calibration() == "/d/can0.json"
            assert await gripper.save_calibration(path) == str(path)
            assert (await gripper.config()).rad_to_mm == 74.19

    path = tmp_path / "saved.json"
    run(main())
    assert json.loads(path.read_text()) == CONTENT


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


def test_measuring_and_saving_where_the_environment_says(
    daemon: FakeDaemon,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            data = await gripper.zero(mount="reverse")
            assert (data.rad_to_mm, data.mount) == (74.19, "normal")
            await gripper.calibrate(20, stall_cycles=4)
            daemon.handlers["calibration.zero"] = lambda request: {
                **ZERO,
                "ok": False,
                "outcome": "not_found",
                "message": "no stop",
            }
            with pytest.raises(HardwareError, match="no stop"):
                await gripper.zero()

    path = tmp_path / "pinned.json"
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    run(main())
    zero, calibrate = (one.params for one in daemon.wait_for("calibration.zero", 3)[:2])
    assert (zero["save"], zero["mount"]) == (True, "reverse")
    assert calibrate["save"] is False
    assert calibrate["config"] == {"calib_kp": 20.0, "calib_stall_cycles": 4}
    assert json.loads(path.read_text()) == CONTENT
    assert "travel 1.6175 rad" in capsys.readouterr().out


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
def test_a_calibration_by_hand(daemon: FakeDaemon) -> None:
    async def main() -> None:
        async with LiteGrip(socket_path=daemon.path) as gripper:
            async with gripper.manual_calibration() as manual:
                assert await manual.mark_closed() == 0.1
                assert await manual.mark_open() == -1.5
                assert (await manual.finish(save=False)).rad_to_mm == 74.19
            with pytest.raises(CommandError, match="no calibration by hand"):
                await manual.mark_open()

    run(main())
    assert steps(daemon) == ["begin", "closed", "open", "finish"]


@pytest.mark.usefixtures("_by_hand")
def test_a_calibration_by_hand_that_is_left_without_finish(daemon: FakeDaemon) -> None:
    async def break_off() -> None:
        async with (
            LiteGrip(socket_path=daemon.path) as gripper,
            gripper.manual_calibration() as manual,
        ):
            await manual.mark_closed()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(break_off())
    assert steps(daemon) == ["begin", "closed", "cancel"]


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
