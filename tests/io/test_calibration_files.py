"""The search for a calibration: its order, what it passes over, and where it must end."""

import json
import os
from pathlib import Path

import pytest

from litegripd.io.helper.files import (
    DATA,
    MAX_FILE_BYTES,
    Found,
    find_calibration,
    find_configured,
    load_operation,
    state_directory,
)
from litegripd.model.calibration import CalibrationError, from_plain
from tests.io.disk import ordinary_user

NORMAL = {"zero_position_rad": 0.1, "max_position_rad": -1.5, "rad_to_mm": 75.0}
REVERSE = {"zero_position_rad": -1.5, "max_position_rad": 0.1, "rad_to_mm": 75.0}


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    (tmp_path / "state").mkdir()
    (tmp_path / ".litegrip").mkdir()
    return tmp_path


def put(path: Path, **changes: object) -> Path:
    path.write_text(json.dumps(REVERSE | changes), encoding="utf-8")
    return path


def own(root: Path) -> list[Path]:
    """Return the files of can0 before the factory's, in the order of the search."""
    return [
        root / "state" / "can0_calibration.json",
        root / ".litegrip" / "can0_calibration.json",
        root / ".litegrip" / "litegrip_calibration.json",
    ]


def test_the_first_file_that_is_there_is_found(root: Path) -> None:
    assert find_calibration("can0", None).path == DATA / "factory.json"
    for path in reversed(own(root)):
        put(path, channel="can0")
        found = find_calibration("can0", None)
        assert (found.path, found.skipped) == (path, ())
        assert found.calibration is not None
        assert found.calibration.geometry.mount == "reverse"


def test_the_factory_file_is_for_one_channel_only() -> None:
    found = find_calibration("can1", None)
    assert (found.calibration, found.path) == (None, None)
    assert found.skipped == (f"{DATA / 'factory.json'}: it is for channel 'can0'",)


def test_a_file_that_names_another_channel_is_passed_over(root: Path) -> None:
    for path in own(root):
        put(path, channel="can5")
    found = find_calibration("can0", None)
    assert found.path == DATA / "factory.json"
    assert found.skipped == tuple(f"{path}: it is for channel 'can5'" for path in own(root))


@pytest.mark.parametrize("position", [0, 1, 2])
@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not valid JSON"),
        (json.dumps(REVERSE).encode()[:-1], "not valid JSON"),
        (bytes(200), "nothing but zeros"),
        (b"\xff\xfe", "UTF-16"),
        (b"{}", "zero_position_rad is missing"),
        (json.dumps(REVERSE | {"rad_to_mm": 0}).encode(), "rad_to_mm"),
        (b" " * (MAX_FILE_BYTES + 1), "larger than"),
        (b"[" * 30 + b"]" * 30, "object"),
        (b'{"a":' * 30 + b"1" + b"}" * 30, "nested more than 16 deep"),
    ],
)
def test_a_file_that_is_there_but_cannot_be_used_ends_the_search(
    root: Path, position: int, content: bytes, reason: str
) -> None:
    """Whatever comes after it could be for the other mount, above all the factory's file."""
    paths = own(root)
    paths[position].write_bytes(content)
    for later in paths[position + 1 :]:
        put(later, channel="can0")
    with pytest.raises(CalibrationError) as caught:
        find_calibration("can0", None)
    message = str(caught.value)
    assert message.startswith(f"{paths[position]}: ")
    assert reason in message
    assert "repair or remove this one" in message
    assert "[gripper] mount" in message
    assert "calibration before it" not in message


def test_the_previous_calibration_is_named_but_never_used_unasked(root: Path) -> None:
    path = own(root)[0]
    path.write_bytes(b"")
    previous = put(root / "state" / "can0_calibration.previous.json")
    with pytest.raises(CalibrationError, match=f"the calibration before it is {previous}"):
        find_calibration("can0", None)
    path.unlink()
    assert find_calibration("can0", None).path == DATA / "factory.json"


def test_a_directory_in_place_of_the_file_ends_the_search(root: Path) -> None:
    own(root)[0].mkdir()
    with pytest.raises(CalibrationError, match="cannot be read: Is a directory"):
        find_calibration("can0", None)


def test_a_file_that_may_not_be_read_ends_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    with ordinary_user() as home:
        monkeypatch.setenv("HOME", str(home))
        (home / ".litegrip").mkdir(0o000)  # nobody can tell whether it holds the channel's file
        with pytest.raises(CalibrationError, match=r"can0_calibration.json: .*Permission denied"):
            find_calibration("can0", None)
        (home / ".litegrip").chmod(0o700)
        put(home / ".litegrip" / "can0_calibration.json").chmod(0o000)
        with pytest.raises(CalibrationError, match=r"can0_calibration.json: .*Permission denied"):
            find_calibration("can0", None)


def test_a_file_in_place_of_a_directory_is_no_file_of_ours(root: Path) -> None:
    (root / ".litegrip").rmdir()
    (root / ".litegrip").write_bytes(b"")
    assert find_calibration("can0", None).path == DATA / "factory.json"


def test_a_file_of_a_gripper_that_never_was_calibrated_is_found_as_it_is(root: Path) -> None:
    path = put(own(root)[0], calibrated=False)
    found = find_calibration("can0", None)
    assert found.path == path
    assert found.calibration is not None
    assert not found.calibration.calibrated


def test_a_file_that_is_asked_for_is_the_only_one(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(own(root)[0])
    asked = root / "mine.json"
    monkeypatch.setenv("LITEGRIP_CALIB", "~/mine.json")
    for mount in (str(asked), None):
        with pytest.raises(CalibrationError, match=f"{asked}: there is no such file"):
            find_calibration("can0", mount)
    asked.write_text(json.dumps(NORMAL), encoding="utf-8")
    for mount in (str(asked), None):
        assert find_calibration("can0", mount).path == asked
    with pytest.raises(CalibrationError, match="neither a template"):
        find_calibration("can0", "mine.json")


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_template_brings_the_direction_only(root: Path, mount: str) -> None:
    put(own(root)[0], kp=50.0)
    found = find_calibration("can0", mount)
    assert found.calibration is not None
    assert found.calibration.geometry.mount == mount
    assert (found.calibration.content, found.calibration.kp_nm_rad) == ({}, None)
    assert found.calibration.nominal


def test_the_factorys_file_is_nominal_and_a_measured_one_is_not(root: Path) -> None:
    factory = find_calibration("can0", None).calibration
    put(own(root)[0])
    measured = find_calibration("can0", None).calibration
    assert factory is not None
    assert measured is not None
    assert (factory.nominal, measured.nominal) == (True, False)


def answered(channel: str, mount: str | None) -> Found:
    """Find as the daemon does: through JSON from the helper."""
    wanted = {"channel": channel, "mount": mount, "configured": False}
    answer = json.loads(json.dumps(load_operation(wanted)))
    calibration = from_plain(answer["calibration"]) if answer["calibration"] else None
    path = Path(answer["path"]) if answer["path"] else None
    return Found(calibration, path, tuple(answer["skipped"]))


@pytest.mark.parametrize("calibrated", [True, False])
def test_what_was_measured_wins_over_the_template_of_the_same_mount(
    root: Path, calibrated: bool
) -> None:
    """Also when it was declared useless since: the template would not fit either."""
    own_file = put(own(root)[0], calibrated=calibrated)
    found = find_configured("can0", "reverse")
    assert found.path == own_file
    assert found.calibration is not None
    assert found.calibration.calibrated is calibrated
    assert find_configured("can1", "reverse").path == DATA / "reverse.json"


def test_a_configured_mount_wins_over_a_file_of_the_other_one(root: Path) -> None:
    own_file = put(own(root)[0])
    found = find_configured("can0", "normal")
    assert found.path == DATA / "normal.json"
    assert len(found.skipped) == 1
    assert str(own_file) in found.skipped[0]
    put(own_file, channel="can3")
    assert find_configured("can0", "reverse").path == DATA / "reverse.json"


def test_an_own_file_that_cannot_be_read_is_not_passed_over(root: Path) -> None:
    own(root)[0].write_text("{", encoding="utf-8")
    with pytest.raises(CalibrationError, match="can0_calibration"):
        find_configured("can0", "reverse")


def test_without_a_configured_template_the_search_is_the_usual_one(root: Path) -> None:
    other = put(root / "mine.json")
    assert find_configured("can0", None) == find_calibration("can0", None)
    assert find_configured("can0", str(other)).path == other


def test_the_daemon_gets_what_the_helper_found_unknown_keys_included(root: Path) -> None:
    put(own(root)[2], channel="can3", note="others")
    put(own(root)[1], channel="can0", note={"mine": [1, None]}, kp=90, kd=1.5, can_id=9)
    for channel, mount in (("can0", None), ("can1", None), ("can1", "reverse")):
        assert answered(channel, mount) == find_calibration(channel, mount)
    calibration = answered("can0", None).calibration
    assert calibration is not None
    assert calibration.content["note"] == {"mine": [1, None]}
    assert (calibration.kp_nm_rad, calibration.content["can_id"]) == (90.0, 9)


def test_the_state_directory(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", f"{root / 'a'}:{root / 'b'}")
    assert state_directory() == root / "a"


@pytest.mark.parametrize("kind", ["fifo", "device", "directory"])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, kind: str) -> None:
    """A FIFO without a writer would be waited for without end."""
    path = tmp_path / "calibration.json"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    with pytest.raises(CalibrationError, match=r"not a regular file|Is a directory"):
        find_calibration("can0", str(path))
