import json
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CALIB_TEMPLATES, BusyError, CommandError, HardwareError, LiteGrip
from tests.client.fake_daemon import CALIBRATION, CONTENT, FakeDaemon, Request

SOME = {**CALIBRATION, "loaded": True, "factory": False, "skipped": []}
NOTHING = {**SOME, "calibrated": False, "loaded": False, "skipped": ["f: for can0"]}


def loads(daemon: FakeDaemon) -> list[dict[str, Any]]:
    """Return what was to be loaded, without the guard that a stop makes it void."""
    asked = [dict(one.params) for one in daemon.requests if one.method == "calibration.load"]
    assert all(one.pop("stop_generation") == 3 and one.pop("sent_s") for one in asked)
    return asked


@pytest.fixture(autouse=True)
def _loading(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.load"] = lambda request: SOME
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION


# By name


def test_a_mount_is_loaded_on_every_connecting(daemon: FakeDaemon) -> None:
    gripper = LiteGrip("can0", mount="reverse", socket_path=daemon.path)
    for _ in range(2):
        with gripper:
            gripper.connect()
    assert daemon.methods() == ["hello", "calibration.load"] * 2
    assert loads(daemon) == [{"template": "reverse"}] * 2


def test_another_mount_needs_no_daemon_to_be_refused() -> None:
    with pytest.raises(CommandError, match="one of: normal, reverse"):
        LiteGrip("can1", mount="sideways")


def test_a_mount_that_cannot_be_loaded_leaves_no_connection(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.load"] = lambda request: request.fail("out_of_limits", -32011)
    gripper = LiteGrip(mount="normal", socket_path=daemon.path)
    with pytest.raises(CommandError):
        gripper.connect()
    assert not gripper.is_connected


@pytest.mark.parametrize("reason", ["busy", "lease_held", "not_permitted"])
def test_a_watcher_connects_with_a_mount_that_it_may_not_load_yet(
    daemon: FakeDaemon, caplog: pytest.LogCaptureFixture, reason: str
) -> None:
    code = {"busy": -32020, "lease_held": -32026, "not_permitted": -32027}[reason]
    default = daemon.handlers["calibration.load"]
    daemon.handlers["calibration.load"] = lambda request: request.fail(reason, code)
    gripper = LiteGrip(mount="reverse", socket_path=daemon.path)
    assert gripper.connect() is True
    assert "mount 'reverse' is not loaded yet" in caplog.text
    with pytest.raises(CommandError):
        gripper.enable()
    assert daemon.methods()[-1] == "calibration.load"  # nothing is enabled by another mount
    daemon.handlers["calibration.load"] = default
    assert gripper.enable()
    assert gripper.enable()
    assert loads(daemon) == [{"template": "reverse"}] * 3
    gripper.disconnect()


def test_the_four_ways_to_a_mount_are_one(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    assert gripper.load_template("reverse") is True
    assert gripper.load_calibration(template="reverse") is True
    assert gripper.load_calibration(CALIB_TEMPLATES["reverse"]) is True
    with LiteGrip(mount="reverse", socket_path=daemon.path):
        assert loads(daemon) == [{"template": "reverse"}] * 4


def test_an_unknown_template_asks_for_nothing(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    for load in (gripper.load_template, lambda name: gripper.load_calibration(template=name)):
        with pytest.raises(CommandError, match="one of: normal, reverse"):
            load("sideways")
    with pytest.raises(CommandError, match="not both"):
        gripper.load_calibration("c.json", "normal")
    assert loads(daemon) == []


def test_a_template_that_the_daemon_cannot_use_raises(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    daemon.handlers["calibration.load"] = lambda request: request.fail(
        "calibration_unreadable", -32013
    )
    with pytest.raises(CommandError):
        gripper.load_template("normal")


# By file


def test_a_file_is_read_here_and_its_content_sent(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path
) -> None:
    path = tmp_path / "c.json"
    path.write_text(json.dumps(CONTENT))
    assert gripper.load_calibration(path) is True
    assert gripper.load_calibration(str(path)) is True
    assert loads(daemon) == [{"content": CONTENT}] * 2


def test_a_file_that_cannot_be_read_raises(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path
) -> None:
    with pytest.raises(CommandError, match="No such file") as caught:
        gripper.load_calibration(tmp_path / "none.json")
    assert caught.value.reason == "calibration_unreadable"
    (tmp_path / "nan.json").write_text('{"rad_to_mm": NaN}')
    with pytest.raises(CommandError, match="rad_to_mm is NaN, it must be a finite number"):
        gripper.load_calibration(tmp_path / "nan.json")
    assert loads(daemon) == []


def test_the_environment_names_one_file_for_all_channels(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "c.json"
    path.write_text(json.dumps({**CONTENT, "channel": "can7"}))
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    assert gripper.load_calibration() is True
    monkeypatch.setenv("LITEGRIP_CALIB", CALIB_TEMPLATES["reverse"])
    assert gripper.load_calibration() is True
    monkeypatch.setenv("LITEGRIP_CALIB", str(tmp_path / "none.json"))
    with pytest.raises(CommandError, match="No such file"):
        gripper.load_calibration()
    assert loads(daemon) == [
        {"content": {**CONTENT, "channel": "can7"}},
        {"template": "reverse"},
    ]


# By nothing


def test_without_a_name_the_daemon_looks_first(
    daemon: FakeDaemon, gripper: LiteGrip, home: Path
) -> None:
    (home / ".litegrip").mkdir()
    (home / ".litegrip/can0_calibration.json").write_text(json.dumps(CONTENT))
    assert gripper.load_calibration() is True
    assert loads(daemon) == [{}]


def test_what_the_daemon_does_not_find_may_be_the_users(
    daemon: FakeDaemon, gripper: LiteGrip, home: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def load(request: Request) -> Any:
        content = request.params.get("content")
        if content is None:
            return NOTHING
        if content == {"note": "no geometry"}:
            return request.fail("calibration_unreadable", -32013, "rad_to_mm is missing")
        return SOME

    daemon.handlers["calibration.load"] = load
    assert gripper.load_calibration() is False
    assert "the daemon passed over: f: for can0" in caplog.text
    (home / ".litegrip").mkdir()
    (home / ".litegrip/litegrip_calibration.json").write_text(json.dumps(CONTENT))
    assert gripper.load_calibration() is True
    assert loads(daemon)[-1] == {"content": CONTENT}
    (home / ".litegrip/can0_calibration.json").write_text('{"note": "no geometry"}')
    with pytest.raises(CommandError, match="rad_to_mm is missing"):
        gripper.load_calibration()


def test_the_users_own_file_wins_over_the_factorys(
    daemon: FakeDaemon, gripper: LiteGrip, home: Path
) -> None:
    """The factory's is a normal mount; the user's may be a reverse one."""
    daemon.handlers["calibration.load"] = lambda request: {
        **SOME,
        "factory": "content" not in request.params,
    }
    assert gripper.load_calibration() is True
    assert loads(daemon) == [{}]
    (home / ".litegrip").mkdir()
    (home / ".litegrip/can0_calibration.json").write_text(json.dumps(CONTENT))
    assert gripper.load_calibration() is True
    assert loads(daemon)[1:] == [{}, {"content": CONTENT}]


def test_while_a_motion_runs_what_is_in_use_will_do(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["calibration.load"] = lambda request: request.fail("busy", -32020)
    assert gripper.load_calibration() is True
    daemon.handlers["calibration.get"] = lambda request: {**CALIBRATION, "calibrated": False}
    with pytest.raises(BusyError):
        gripper.load_calibration()


def test_what_has_nothing_to_do_with_the_file_is_raised(
    daemon: FakeDaemon, gripper: LiteGrip, home: Path
) -> None:
    (home / ".litegrip").mkdir()
    for name in ("can0_calibration.json", "litegrip_calibration.json"):
        (home / ".litegrip" / name).write_text(json.dumps(CONTENT))
    daemon.handlers["calibration.load"] = lambda request: (
        request.fail("busy", -32020) if "content" in request.params else NOTHING
    )
    with pytest.raises(BusyError):
        gripper.load_calibration()


# Saving


def test_without_a_path_the_daemon_saves(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["calibration.save"] = lambda request: {"path": "/d/can0.json", "previous": None}
    assert gripper.save_calibration() == "/d/can0.json"
    daemon.handlers["calibration.save"] = lambda request: request.fail("not_calibrated", -32010)
    with pytest.raises(CommandError):
        gripper.save_calibration()


def test_with_a_path_this_program_saves_what_is_in_use(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path
) -> None:
    path = tmp_path / "saved.json"
    assert gripper.save_calibration(path) == str(path)
    assert json.loads(path.read_text()) == CONTENT
    assert "calibration.save" not in daemon.methods()


def test_the_environment_says_where_to_save(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_CALIB", str(tmp_path / "pinned.json"))
    assert gripper.save_calibration() == str(tmp_path / "pinned.json")
    assert json.loads((tmp_path / "pinned.json").read_text()) == CONTENT


def test_without_a_calibration_there_is_nothing_to_save(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path
) -> None:
    daemon.handlers["calibration.get"] = lambda request: {**NOTHING, "content": {}}
    with pytest.raises(CommandError, match="no calibration") as caught:
        gripper.save_calibration(tmp_path / "c.json")
    assert caught.value.reason == "not_calibrated"
    assert not isinstance(caught.value, HardwareError)
    assert not (tmp_path / "c.json").exists()
