"""The store of trajectories: names, pieces, files that are wrong, disks that fail."""

import base64
import json
import math
import os
import select
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.values.trajectory_format import MAX_BYTES
from litegripd.io.helper.atomic_file import FileSystem
from litegripd.io.helper.child import MAX_PACKET_BYTES, start_here
from litegripd.model.calibration import NOMINAL
from litegripd.trajectories.store import Limits, TrajectoryStore
from litegripd.trajectories.values import MAX_NAME, PIECE_BYTES
from tests.trajectories import HEADER_BYTES, lgt, pieces, sampled, swing

DEADLINE_MS = 30_000
TAUGHT = lgt(sampled(swing(), 3.0))
LONG = lgt(sampled(swing(), 30.0))
UID = 1000

RECORDED: dict[str, Any] = {
    "sample_hz": 100,
    "closed_rad": 0.1,
    "open_rad": -1.5,
    "rad_to_mm": NOMINAL[0].rad_to_mm,
    "can_id": 8,
    "mount": "normal",
}


class Rig:
    """A store in a directory of its own, spoken to as over a packet."""

    def __init__(
        self,
        directory: Path,
        file_system: FileSystem | None = None,
        limits: Limits = Limits(),  # noqa: B008 - frozen
    ) -> None:
        self.directory = directory
        self.limits = limits
        system = file_system or FileSystem()
        self.store = TrajectoryStore(lambda: directory, system, lambda: 1.7e9, limits)

    def do(self, which: str, /, **parameters: Any) -> dict[str, Any]:
        operation = self.store.operations()[f"trajectory.{which}"]
        packed = json.dumps(operation(json.loads(json.dumps({"uid": UID, **parameters}))))
        assert len(packed) < MAX_PACKET_BYTES - 100
        answer: dict[str, Any] = json.loads(packed)
        return answer

    def refusal(self, which: str, /, **parameters: Any) -> str:
        answer = self.do(which, **parameters)
        assert "refused" in answer, answer
        assert answer["refused"]["message"]
        reason: str = answer["refused"]["reason"]
        return reason

    def put(
        self, content: bytes, name: str | None = None, key: str = "tmp/1", uid: int = UID
    ) -> dict[str, Any]:
        answer: dict[str, Any] = {}
        for piece in pieces(content, key=key, name=name, header=None, uid=uid):
            answer = self.do("put", **piece)
            if "refused" in answer:
                break
        return answer

    def read(self, name: str, file_format: str = "lgt", length: int = 8192) -> bytes:
        whole, total = b"", 1
        while len(whole) < total:
            piece = self.do("read", name=name, offset=len(whole), length=length, format=file_format)
            total = piece["total"]
            whole += base64.b64decode(piece["data"])
        return whole

    def names(self) -> list[str]:
        return [one["name"] for one in self.do("list", after=None)["trajectories"]]

    def files(self) -> list[str]:
        """Return the names of all files but those that say whose the others are."""
        return [name for name in self.all_files() if not name.endswith(".uid")]

    def all_files(self) -> list[str]:
        return sorted(os.listdir(self.directory)) if self.directory.exists() else []  # noqa: PTH208


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path / "state" / "trajectories")


@pytest.mark.parametrize("content", [TAUGHT, LONG, lgt([]), lgt([(0.0, 0.5)])])
@pytest.mark.parametrize("length", [1000, 8192])
def test_what_was_put_comes_back_to_the_bit(rig: Rig, content: bytes, length: int) -> None:
    answer = rig.put(content, "pick")
    assert (answer["complete"], answer["received"]) == (True, len(content))
    assert rig.read("pick", length=length) == content
    assert (rig.directory / "pick.lgt").read_bytes() == content
    assert rig.files() == ["pick.lgt"]


def test_without_a_name_it_is_kept_until_it_is_dropped(rig: Rig) -> None:
    assert rig.put(TAUGHT)["path"] is None
    assert rig.read("tmp/1") == TAUGHT
    assert rig.all_files() == []
    rig.do("drop", names=["tmp/1", "never there"])
    assert rig.refusal("open", name="tmp/1") == "unknown_trajectory"


def test_of_one_that_is_half_there_nothing_can_be_had(rig: Rig) -> None:
    first, second, *_ = pieces(LONG, key="tmp/k", name="pick", header=None)
    assert rig.do("put", **first) == {"received": 8192, "complete": False}
    assert rig.names() == []
    assert rig.refusal("open", name="tmp/k") == "unknown_trajectory"
    rig.do("drop", names=["tmp/k"])
    assert rig.refusal("put", **second) == "out_of_limits"
    assert rig.all_files() == []


@pytest.mark.parametrize("wrong", ["later", "again", "longer", "other total", "no base64", "empty"])
def test_a_wrong_piece_is_refused_and_ends_the_whole(rig: Rig, wrong: str) -> None:
    first, second, third, *_ = pieces(LONG, key="tmp/k", name="pick", header=None)
    rig.do("put", **first)
    too_long = base64.b64encode(b"x" * len(LONG)).decode()
    bad = {
        "later": third,
        "again": {**first, "offset": 4096},
        "longer": {**second, "data": too_long},
        "other total": {**second, "total": 9000},
        "no base64": {**second, "data": "a*b="},
        "empty": {**second, "data": ""},
    }[wrong]
    assert rig.refusal("put", **bad) == "out_of_limits"
    assert rig.refusal("put", **second) == "out_of_limits"
    assert rig.put(LONG, "pick", "k")["complete"]  # from the beginning it goes


def test_what_does_not_have_its_sum_is_refused(rig: Rig) -> None:
    for piece in pieces(TAUGHT, key="tmp/k", name="pick", header=None):
        damaged = {**piece, "sha256": "0" * 64}
        answer = rig.do("put", **damaged)
    assert answer["refused"]["reason"] == "trajectory_unreadable"
    assert "SHA-256" in answer["refused"]["message"]
    assert rig.all_files() == []


@pytest.mark.parametrize(
    "content", [TAUGHT[:-1], b"nonsense", TAUGHT + b"\0", lgt([(0.0, 2.0)]), lgt([], version=3)]
)
def test_what_is_no_trajectory_is_refused_and_leaves_what_was_there(
    rig: Rig, content: bytes
) -> None:
    rig.put(TAUGHT, "pick")
    answer = rig.put(content, "pick")
    assert answer["refused"]["reason"] == "trajectory_unreadable"
    assert rig.read("pick") == TAUGHT
    assert "refused" in rig.put(content, None, "k")
    assert rig.refusal("open", name="tmp/k") == "unknown_trajectory"


def test_a_recording_gets_its_header_here(rig: Rig) -> None:
    for piece in pieces(TAUGHT[HEADER_BYTES:], key="tmp/r", name=None, header=RECORDED):
        answer = rig.do("put", **{**piece, "sha256": None})
    assert (answer["samples"], answer["created_s"], answer["mount"]) == (301, 1.7e9, "normal")
    expected = lgt(sampled(swing(), 3.0), closed_rad=0.1, open_rad=-1.5)
    assert rig.read("tmp/r") == expected


def test_an_empty_recording_is_made_of_one_empty_piece(rig: Rig) -> None:
    empty = {"offset": 0, "total": 0, "sha256": None, "data": "", "name": "none"}
    answer = rig.do("put", key="tmp/r", header=RECORDED, **empty)
    assert (answer["samples"], answer["total"]) == (0, HEADER_BYTES)


def test_csv_has_a_head_and_a_line_a_sample(rig: Rig) -> None:
    rig.put(TAUGHT, "pick")
    text = rig.read("pick", "csv").decode()
    lines = text.splitlines()
    assert lines[0] == "t_s,openness,position_rad,velocity_rad_s,torque_nm"
    assert len(lines) == 302
    values = [tuple(map(float, line.split(","))) for line in lines[1:]]
    assert [value[:2] for value in values] == sampled(swing(), 3.0)
    rig.put(LONG, "pick")  # another content is another text
    assert len(rig.read("pick", "csv").splitlines()) == 3002


def test_samples_come_in_pieces_of_what_was_opened(rig: Rig) -> None:
    rig.put(LONG, "pick")
    facts = rig.do("open", name="pick")
    assert facts["samples"] == 3001
    got = b""
    while len(got) < 3001 * 40:
        answer = rig.do("samples", name="pick", sha256=facts["sha256"], offset=len(got))
        got += base64.b64decode(answer["data"])
        assert len(got) % PIECE_BYTES == 0 or len(got) == 3001 * 40
    assert got == LONG[HEADER_BYTES:]
    rig.put(TAUGHT, "pick")
    reason = rig.refusal("samples", name="pick", sha256=facts["sha256"], offset=0)
    assert reason == "trajectory_unreadable"


def test_a_piece_beyond_the_end_is_refused(rig: Rig) -> None:
    rig.put(TAUGHT, "pick")
    wanted = {"name": "pick", "length": 10, "format": "lgt"}
    assert rig.do("read", offset=len(TAUGHT), **wanted)["data"] == ""
    assert rig.refusal("read", offset=len(TAUGHT) + 1, **wanted) == "out_of_limits"


@pytest.mark.parametrize("name", ["../pick", "/etc/passwd", "a/b", "", ".pick", "x" * 65])
def test_no_name_leads_out_of_the_directory(rig: Rig, name: str) -> None:
    rig.put(TAUGHT, "pick")
    assert rig.put(TAUGHT, name)["refused"]["reason"] == "out_of_limits"
    assert rig.refusal("open", name=name) == "out_of_limits"
    assert rig.refusal("delete", name=name) == "out_of_limits"
    assert rig.files() == ["pick.lgt"]


def test_the_longest_name_fits(rig: Rig) -> None:
    for name in ("x" * MAX_NAME, "ü" * MAX_NAME, "😀" * 50):
        assert rig.put(TAUGHT, name)["complete"]
        assert rig.read(name) == TAUGHT


def test_a_deleted_one_is_gone(rig: Rig) -> None:
    rig.put(TAUGHT, "pick")
    rig.read("pick")
    assert rig.do("delete", name="pick") == {"name": "pick", "deleted": True}
    assert rig.all_files() == []
    assert rig.refusal("open", name="pick") == "unknown_trajectory"
    assert rig.refusal("delete", name="pick") == "unknown_trajectory"


def test_the_list_tells_what_there_is_and_what_is_wrong_with_it(rig: Rig) -> None:
    usage = {"uid": UID, "named": 0, "bytes": 0, "most_named": 500, "most_bytes": 500_000_000}
    assert rig.do("list", after=None) == {"trajectories": [], "more": False, "usage": usage}
    rig.put(TAUGHT, "b")
    rig.put(lgt([], mount=b"reverse\0"), "a")
    (rig.directory / "cut.lgt").write_bytes(TAUGHT[:-1])
    (rig.directory / "empty.lgt").write_bytes(b"")
    (rig.directory / "folder.lgt").mkdir()
    (rig.directory / "notes.txt").write_text("mine")
    (rig.directory / ".hidden.lgt").write_bytes(TAUGHT)
    listed = {one["name"]: one for one in rig.do("list", after=None)["trajectories"]}
    assert list(listed) == ["a", "b", "cut", "empty", "folder"]
    assert (listed["b"]["samples"], listed["b"]["bytes"]) == (301, len(TAUGHT))
    assert (listed["b"]["sample_hz"], listed["b"]["mount"]) == (100.0, "normal")
    assert (listed["a"]["duration_s"], listed["b"]["duration_s"]) == (0.0, pytest.approx(3.0))
    assert (listed["a"]["mount"], listed["a"]["error"]) == ("reverse", None)
    for wrong in ("cut", "empty", "folder"):
        assert listed[wrong]["error"]


def test_the_length_in_the_list_is_the_last_samples_time_since_the_first(rig: Rig) -> None:
    rig.put(lgt([(1.0, 0.5), (1.01, 0.5), (2.99, 0.5)]), "gap")
    (rig.directory / "back.lgt").write_bytes(lgt([(1.0, 0.5), (0.5, 0.5)]))
    (rig.directory / "nan.lgt").write_bytes(lgt([(1.0, 0.5), (math.nan, 0.5)]))
    listed = {one["name"]: one for one in rig.do("list", after=None)["trajectories"]}
    assert listed["gap"]["duration_s"] == pytest.approx(1.99)
    assert listed["back"]["duration_s"] is listed["nan"]["duration_s"] is None


def test_a_long_list_comes_in_parts(rig: Rig) -> None:
    rig.put(TAUGHT, "000")
    content = (rig.directory / "000.lgt").read_bytes()
    names = [f"{number:03d}" + "ü" * 61 for number in range(200)]
    for name in names:
        (rig.directory / f"{name}.lgt").write_bytes(content)
    got: list[str] = []
    more = True
    while more:
        answer = rig.do("list", after=got[-1] if got else None)
        got += [one["name"] for one in answer["trajectories"]]
        more = answer["more"]
    assert got == ["000", *names]


def make_large(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)


def make_link(path: Path) -> None:
    target = path.parent.parent / "secret.lgt"
    target.write_bytes(TAUGHT)
    path.symlink_to(target)


@pytest.mark.parametrize(
    "make",
    [
        make_link,
        os.mkfifo,
        lambda path: path.mkdir(),
        lambda path: path.write_bytes(b"LGRTRJ01"),
        make_large,
    ],
    ids=["link", "pipe", "directory", "cut off", "too large"],
)
def test_what_is_no_usable_file_is_refused_without_waiting(
    rig: Rig, make: Callable[[Path], object]
) -> None:
    rig.directory.mkdir(parents=True)
    make(rig.directory / "odd.lgt")
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    assert rig.refusal("open", name="odd") == "trajectory_unreadable"
    assert rig.do("list", after=None)["trajectories"][0]["error"]
    assert len(list(Path("/proc/self/fd").iterdir())) == descriptors


class FullDisk(FileSystem):
    def write(self, descriptor: int, content: memoryview) -> int:
        raise OSError(28, "No space left on device")


def test_a_full_disk_keeps_what_was_there(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    rig.put(TAUGHT, "pick")
    full = Rig(tmp_path, FullDisk())
    answer = full.put(LONG, "pick")
    assert answer["refused"]["reason"] == "not_saved"
    assert "No space left" in answer["refused"]["message"]
    assert full.read("pick") == TAUGHT
    assert full.files() == ["pick.lgt"]


def test_a_file_that_changes_is_judged_anew(rig: Rig) -> None:
    rig.put(TAUGHT, "pick")
    assert rig.do("open", name="pick")["samples"] == 301
    (rig.directory / "pick.lgt").write_bytes(LONG)
    assert rig.do("open", name="pick")["samples"] == 3001
    (rig.directory / "pick.lgt").write_bytes(TAUGHT[:-5])
    assert rig.refusal("open", name="pick") == "trajectory_unreadable"


def test_the_helper_process_does_all_this(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    child = start_here("litegripd.app.helper_main")

    def ask(which: str, /, **parameters: Any) -> dict[str, Any]:
        packet = json.dumps([1, f"trajectory.{which}", parameters]).encode()
        assert child.send(packet)
        assert select.select([child.socket], [], [], DEADLINE_MS / 1000)[0]
        answer = child.receive()
        assert answer is not None
        assert answer[4:5] == b"r", answer
        value: dict[str, Any] = json.loads(answer[5:])
        return value

    try:
        for piece in pieces(LONG, key="tmp/k", name="pick", header=None, uid=UID):
            last = ask("put", **piece)
        assert last["path"] == str(tmp_path / "trajectories" / "pick.lgt")
        facts = ask("open", name="pick")
        wanted = {"name": "pick", "sha256": facts["sha256"], "offset": 0}
        assert len(base64.b64decode(ask("samples", **wanted)["data"])) == PIECE_BYTES
        large = base64.b64encode(b"\0" * PIECE_BYTES).decode()
        recorded = {"key": "tmp/r", "offset": 0, "total": 2 * PIECE_BYTES, "sha256": None}
        assert ask("put", data=large, name=None, header={}, **recorded)["received"] == PIECE_BYTES
        assert ask("put", data="*", key="tmp/k", offset=0, total=1, name=None, sha256="")["refused"]
    finally:
        child.close()
