"""Saving calibrations and motion settings: what is written, what is refused, how it comes back."""

import errno
import json
import select
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegripd.app.helper_main import OPERATIONS
from litegripd.io.helper.atomic_file import FileError
from litegripd.io.helper.child import MAX_PACKET_BYTES, Child, start_here
from litegripd.io.helper.files import (
    MAX_FILE_BYTES,
    find_calibration,
    load_motion,
    save_calibration,
    save_motion,
)
from litegripd.model.calibration import CalibrationError, from_plain
from tests.io.disk import Disk

DEADLINE_MS = 30_000
REVERSE: dict[str, object] = {
    "channel": "can9",
    "zero_position_rad": -1.4,
    "max_position_rad": 0.2,
    "rad_to_mm": 75.0,
    "note": ["für", {"mine": None}],
}


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A state directory that is not there yet, and an empty home."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    return tmp_path / "state"


def test_a_saved_calibration_is_the_one_that_is_found(state: Path) -> None:
    answer = save_calibration({"channel": "can0", "content": REVERSE})
    path = state / "can0_calibration.json"
    found = find_calibration("can0", None)
    assert found.calibration is not None
    assert found.calibration.saved_s == path.stat().st_mtime
    assert (answer["path"], answer["previous"]) == (str(path), None)
    assert answer["saved_s"] == pytest.approx(path.stat().st_mtime, abs=5.0)
    assert answer.keys() == {"path", "previous", "saved_s"}
    assert (found.path, found.skipped) == (path, ())
    assert found.calibration.geometry.mount == "reverse"
    assert found.calibration.content == {**REVERSE, "channel": "can0"}


def test_the_file_is_indented_json_that_ends_with_a_line(state: Path) -> None:
    save_calibration({"channel": "can0", "content": REVERSE})
    text = (state / "can0_calibration.json").read_text(encoding="ascii")
    assert text.startswith('{\n  "channel": "can0",\n  "zero_position_rad": -1.4,\n')
    assert text.endswith("\n}\n")


def test_the_calibration_before_is_kept(state: Path) -> None:
    previous = state / "can0_calibration.previous.json"
    for number in range(3):
        content = {**REVERSE, "number": number}
        answer = save_calibration({"channel": "can0", "content": content})
        assert answer["previous"] == (str(previous) if number else None)
    assert json.loads(previous.read_text(encoding="utf-8"))["number"] == 1
    assert sorted(entry.name for entry in state.iterdir()) == [
        "can0_calibration.json",
        "can0_calibration.previous.json",
    ]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({}, "zero_position_rad is missing"),
        ({**REVERSE, "rad_to_mm": 0.0}, "rad_to_mm"),
        ({**REVERSE, "max_position_rad": -1.4}, "equal"),
        ({**REVERSE, "kp": 1000}, "kp"),
        ([1, 2], "not an object"),
        (None, "not an object"),
    ],
)
def test_a_content_that_could_not_be_read_back_is_not_written(
    state: Path, content: object, reason: str
) -> None:
    save_calibration({"channel": "can0", "content": REVERSE})
    before = (state / "can0_calibration.json").read_bytes()
    with pytest.raises(CalibrationError, match=f"{state}.*{reason}"):
        save_calibration({"channel": "can0", "content": content})
    assert (state / "can0_calibration.json").read_bytes() == before
    assert len(list(state.iterdir())) == 1


def test_what_is_too_large_to_be_read_back_is_not_written(state: Path) -> None:
    path = state / "can0_calibration.json"
    save_calibration({"channel": "can0", "content": {**REVERSE, "note": ""}})
    room = MAX_FILE_BYTES - path.stat().st_size
    save_calibration({"channel": "can0", "content": {**REVERSE, "note": "x" * room}})
    assert path.stat().st_size == MAX_FILE_BYTES
    assert find_calibration("can0", None).path == path
    with pytest.raises(FileError, match=f"{path} is not written: 16385 bytes"):
        save_calibration({"channel": "can0", "content": {**REVERSE, "note": "x" * (room + 1)}})
    assert find_calibration("can0", None).path == path


@pytest.mark.parametrize(
    "channel", ["", ".", "..", ".can0", "../can0", "a/b", "/can0", "c" * 65, "can\0", "can\n"]
)
def test_a_channel_that_is_no_file_name_is_refused(tmp_path: Path, channel: str) -> None:
    for operation in (save_calibration, save_motion, load_motion):
        parameters = {"channel": channel, "content": REVERSE, "config": {}}
        with pytest.raises(ValueError, match="cannot be part of a file's name"):
            operation(parameters)
    with pytest.raises(ValueError, match="cannot be part of a file's name"):
        find_calibration(channel, None)
    assert list(tmp_path.iterdir()) == []


def test_the_longest_channel_is_taken(state: Path) -> None:
    save_calibration({"channel": "c" * 64, "content": REVERSE})
    save_calibration({"channel": "c" * 64, "content": REVERSE})
    assert len(list(state.iterdir())) == 2


def test_a_full_disk_is_told_with_the_files_name_and_the_old_file_stays(state: Path) -> None:
    path = state / "can0_calibration.json"
    for call in ("create", "write", "sync"):
        disk = Disk(most_bytes=100)
        for directory in [*reversed(state.parents), state]:
            disk.put_directory(directory)
        disk.put(path, b"old")
        trial = disk.copy()
        save_calibration({"channel": "can0", "content": REVERSE}, trial)
        disk.fail_at, disk.failure = trial.calls.index(call), errno.ENOSPC
        with pytest.raises(FileError, match=f"{path}: cannot be written: No space left on device"):
            save_calibration({"channel": "can0", "content": REVERSE}, disk)
        assert disk.files() == {path: b"old"}


def test_a_directory_in_place_of_a_file_is_told_with_its_name(state: Path) -> None:
    for kind in ("calibration", "motion"):
        (state / f"can0_{kind}.json").mkdir(parents=True)
    with pytest.raises(
        FileError, match=r"can0_calibration.json: cannot be written: Is a directory"
    ):
        save_calibration({"channel": "can0", "content": REVERSE})
    with pytest.raises(FileError, match=r"can0_motion.json: cannot be written: Is a directory"):
        save_motion({"channel": "can0", "config": {}})
    with pytest.raises(FileError, match=r"can0_motion.json: cannot be read: Is a directory"):
        load_motion({"channel": "can0"})


def test_motion_settings_come_back(state: Path) -> None:
    path = state / "can0_motion.json"
    assert load_motion({"channel": "can0"}) == {"config": None, "path": str(path)}
    config = {"speed_mm_s": 25.0, "stall_cycles": 7}
    assert save_motion({"channel": "can0", "config": config}) == {"path": str(path)}
    assert load_motion({"channel": "can0"}) == {"config": config, "path": str(path)}
    assert load_motion({"channel": "can1"})["config"] is None
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content == {"channel": "can0", "config": config}
    save_motion({"channel": "can0", "config": {}})
    assert load_motion({"channel": "can0"})["config"] == {}
    assert [entry.name for entry in state.iterdir()] == ["can0_motion.json"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "Expecting value"),
        (b'{"channel": "can0", "config": {"speed_mm_s": 25', "Expecting"),
        (b"\xff", "not UTF-8"),
        (b"[" * 10_000, "nested too deep|Expecting value"),
        (b"[]", "not a JSON object"),
        (b"{}", "not for channel can0"),
        (b'{"channel": "can1", "config": {}}', "not for channel can0"),
        (b'{"channel": "can0"}', "config is missing"),
        (b'{"channel": "can0", "config": [1]}', "config is missing or not an object"),
        (b'{"channel": "can0", "config": {"speed_mm_s": [1]}}', "speed_mm_s is neither"),
        (
            b'{"channel": "can0", "config": {"speed_mm_s": NaN}}',
            "config.speed_mm_s is NaN, it must be",
        ),
        (b" " * (MAX_FILE_BYTES + 1), "larger than"),
    ],
)
def test_a_motion_file_that_cannot_be_used_is_an_error_that_names_it(
    state: Path, text: bytes, reason: str
) -> None:
    state.mkdir()
    path = state / "can0_motion.json"
    path.write_bytes(text)
    with pytest.raises(FileError, match=f"{path}: .*{reason}"):
        load_motion({"channel": "can0"})
    assert path.read_bytes() == text


@pytest.mark.parametrize(
    "config", [None, [], "x", {"a": {}}, {"a": [1]}, {"a": float("nan")}, {"a": float("inf")}]
)
def test_motion_settings_that_could_not_be_read_back_are_not_written(
    state: Path, config: object
) -> None:
    with pytest.raises(ValueError, match=r"config|JSON"):
        save_motion({"channel": "can0", "config": config})
    assert not state.exists()


@pytest.fixture
def helper() -> Iterator[Child]:
    child = start_here("litegripd.app.helper_main")
    yield child
    child.close()


def answer_of(helper: Child) -> bytes:
    """Wait for a packet."""
    poll = select.poll()
    poll.register(helper.socket, select.POLLIN)
    assert poll.poll(DEADLINE_MS), "it does not answer"
    packet = helper.receive()
    assert packet is not None
    return packet


def ask(helper: Child, operation: str, **parameters: object) -> object:
    """Ask the real helper process; return its answer, or raise with its error."""
    assert helper.send(json.dumps([1, operation, parameters]).encode())
    packet = answer_of(helper)
    answer: object = json.loads(packet[5:])
    if packet[4:5] == b"e":
        raise RuntimeError(answer)
    return answer


def test_the_helper_saves_and_loads(helper: Child, state: Path) -> None:
    assert {"calibration.save", "motion.load", "motion.save"} <= set(OPERATIONS)
    path = str(state / "can0_calibration.json")
    saved = ask(helper, "calibration.save", channel="can0", content=REVERSE)
    assert isinstance(saved, dict)
    assert (saved["path"], saved["previous"]) == (path, None)
    loaded = ask(helper, "calibration.load", channel="can0", mount=None, configured=True)
    assert isinstance(loaded, dict)
    assert from_plain(loaded["calibration"]) == find_calibration("can0", None).calibration
    assert ask(helper, "motion.load", channel="can0") == {
        "config": None,
        "path": str(state / "can0_motion.json"),
    }
    ask(helper, "motion.save", channel="can0", config={"speed_mm_s": 9.0})
    motion = ask(helper, "motion.load", channel="can0")
    assert isinstance(motion, dict)
    assert motion["config"] == {"speed_mm_s": 9.0}


def test_an_error_of_the_helper_is_a_sentence_that_names_the_file(
    helper: Child, state: Path
) -> None:
    state.mkdir()
    (state / "can0_motion.json").write_bytes(b"{")
    with pytest.raises(RuntimeError, match=r"^/.*can0_motion.json: .*repair or remove it"):
        ask(helper, "motion.load", channel="can0")
    with pytest.raises(RuntimeError, match=r"^/.* is not written: rad_to_mm"):
        ask(helper, "calibration.save", channel="can0", content={**REVERSE, "rad_to_mm": -1})


def write_unescaped(path: Path, content: object) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")


@pytest.mark.parametrize("note", ["\x7f" * 12_000, [1e15] * 3_000])
def test_a_calibration_that_grows_on_its_way_is_refused(
    helper: Child, state: Path, note: object
) -> None:
    """Control characters take six times their length in a packet, short floats four times."""
    path = state / "can0_calibration.json"
    write_unescaped(path, {**REVERSE, "channel": "can0", "note": note})
    text = path.read_text(encoding="utf-8").replace("1000000000000000.0, ", "1e15,")
    path.write_text(text, encoding="utf-8")
    assert path.stat().st_size < MAX_FILE_BYTES
    with pytest.raises(RuntimeError, match="larger than 16384 bytes as ASCII JSON"):
        ask(helper, "calibration.load", channel="can0", mount=None, configured=True)


def test_the_reason_fits_into_a_packet_however_long_the_value(helper: Child, state: Path) -> None:
    content = {**REVERSE, "rad_to_mm": "\x7f" * 16_000}
    write_unescaped(state / "can0_calibration.json", content)
    with pytest.raises(RuntimeError, match=r"rad_to_mm is .*not a number.*repair or remove"):
        ask(helper, "calibration.load", channel="can0", mount=None, configured=True)


def test_an_answer_too_long_for_a_packet_is_an_error(helper: Child, state: Path) -> None:
    assert MAX_PACKET_BYTES < 6 * 16_000
    content = {"channel": "can0", "config": {"x": "\x7f" * 16_000}}
    write_unescaped(state / "can0_motion.json", content)
    with pytest.raises(RuntimeError, match=r"ValueError: the answer has \d+ bytes, too many"):
        ask(helper, "motion.load", channel="can0")


def test_an_error_too_long_for_a_packet_is_cut(helper: Child) -> None:
    assert helper.send(json.dumps([1, "x" * 60_000, {}]).encode())
    assert answer_of(helper)[4:] == b"e\"KeyError: '" + b"x" * 1989 + b'"'
