"""What the store keeps beside trajectories: their grips, wrong files, a disk that fails."""

import base64
import errno
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import pytest

from litegripd.io.helper.atomic_file import FileSystem
from tests.io.test_trajectory_store import LONG, RECORDED, TAUGHT, Rig
from tests.trajectories import HEADER_BYTES, lgt, pieces, sampled, swing


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path / "state" / "trajectories")


GRIP = {
    "closing_s": 0.5, "start_s": 1.0, "end_s": 2.0, "openness": 0.5, "width_mm": 60.0,
    "force_n": 8.0, "source": "motion.grasp by demo",
}  # fmt: skip


def beside(content: bytes, *grips: dict[str, Any]) -> bytes:
    """Make the file of grips by its description."""
    digest = hashlib.sha256(content).hexdigest()
    head = {"format": "litegrip-grips", "version": 1, "lgt_sha256": digest}
    return json.dumps({**head, "grips": list(grips)}).encode()


def put_with(rig: Rig, content: bytes, grips: bytes, name: str | None = "pick") -> dict[str, Any]:
    answer: dict[str, Any] = {}
    for piece in pieces(
        content + grips, key="tmp/k", name=name, header=None, grip_bytes=len(grips)
    ):
        answer = rig.do("put", **piece)
        if "refused" in answer:
            break
    return answer


@pytest.mark.parametrize("content", [TAUGHT, LONG])
def test_grips_lie_beside_their_trajectory(rig: Rig, content: bytes) -> None:
    grips = beside(content, GRIP)
    answer = put_with(rig, content, grips)
    assert (answer["grips"], answer["grip_problem"], answer["total"]) == (1, None, len(content))
    assert rig.files() == ["pick.grip.json", "pick.lgt"]
    assert rig.read("pick") == content
    assert rig.read("pick", "grip") == grips
    (entry,) = rig.do("list", after=None)["trajectories"]
    assert (entry["grips"], entry["grip_problem"]) == (1, None)
    assert rig.do("open", name="pick")["grip_rows"] == [list({**GRIP, "source": "-"}.values())]


def test_without_a_name_they_are_kept_with_it(rig: Rig) -> None:
    put_with(rig, TAUGHT, beside(TAUGHT, GRIP), None)
    assert rig.read("tmp/k") == TAUGHT
    assert rig.read("tmp/k", "grip") == beside(TAUGHT, GRIP)
    rig.do("drop", names=["tmp/k"])
    assert rig.refusal("read", name="tmp/k", offset=0, length=9, format="grip") == (
        "unknown_trajectory"
    )


def test_their_times_count_from_the_first_sample_for_a_replay(rig: Rig) -> None:
    content = lgt(sampled(swing(), 3.0, first_s=100.0))
    times = {"closing_s": 100.5, "start_s": 101.0, "end_s": 102.0}
    put_with(rig, content, beside(content, {**GRIP, **times}))
    (row,) = rig.do("open", name="pick")["grip_rows"]
    assert row[:3] == [0.5, 1.0, 2.0]


@pytest.mark.parametrize("again", [TAUGHT, LONG])
def test_one_that_is_put_without_grips_leaves_no_old_ones(rig: Rig, again: bytes) -> None:
    put_with(rig, TAUGHT, beside(TAUGHT, GRIP))
    rig.put(again, "pick")
    assert rig.files() == ["pick.lgt"]
    assert rig.read("pick", "grip") == b""


def test_delete_removes_both(rig: Rig) -> None:
    put_with(rig, TAUGHT, beside(TAUGHT, GRIP))
    assert rig.do("delete", name="pick")["deleted"]
    assert rig.files() == []


@pytest.mark.parametrize(
    "grips",
    [
        beside(LONG, GRIP),
        beside(TAUGHT, {**GRIP, "end_s": 3.1}),
        beside(TAUGHT, {**GRIP, "closing_s": -0.1}),
        beside(TAUGHT, {**GRIP, "force_n": 41}),
        beside(TAUGHT, GRIP, GRIP),
        beside(TAUGHT, GRIP)[:-1],
        b"x",
    ],
)
def test_wrong_grips_are_refused_with_all_and_leave_what_was_there(rig: Rig, grips: bytes) -> None:
    put_with(rig, LONG, beside(LONG, GRIP))
    answer = put_with(rig, TAUGHT, grips)
    assert answer["refused"]["reason"] == "trajectory_unreadable"
    assert "grips" in answer["refused"]["message"]
    assert rig.read("pick") == LONG
    assert rig.read("pick", "grip") == beside(LONG, GRIP)


def test_more_grip_bytes_than_there_are_is_refused(rig: Rig) -> None:
    piece = pieces(lgt([]), key="tmp/k", name=None, header=None)[0]
    assert rig.refusal("put", **piece, grip_bytes=67) == "out_of_limits"


def test_those_of_a_file_that_was_replaced_are_a_problem_that_is_told(rig: Rig) -> None:
    put_with(rig, TAUGHT, beside(TAUGHT, GRIP))
    (rig.directory / "pick.lgt").write_bytes(LONG)
    assert rig.read("pick") == LONG
    opened = rig.do("open", name="pick")
    assert (opened["grips"], opened["grip_rows"]) == (0, [])
    assert "another .lgt" in opened["grip_problem"]
    (entry,) = rig.do("list", after=None)["trajectories"]
    assert (entry["error"], entry["grips"]) == (None, 0)
    assert "another .lgt" in entry["grip_problem"]


def test_no_link_and_no_pipe_is_read_as_grips(rig: Rig, tmp_path: Path) -> None:
    rig.put(TAUGHT, "pick")
    secret = tmp_path / "secret"
    secret.write_bytes(beside(TAUGHT, GRIP))
    (rig.directory / "pick.grip.json").symlink_to(secret)
    assert rig.do("open", name="pick")["grip_problem"]
    (rig.directory / "pick.grip.json").unlink()
    os.mkfifo(rig.directory / "pick.grip.json")
    assert "no regular file" in rig.do("open", name="pick")["grip_problem"]
    rig.put(TAUGHT, "pick")
    assert rig.files() == ["pick.lgt"]


def test_a_recording_brings_what_was_noted_and_the_file_is_made_here(rig: Rig) -> None:
    samples = TAUGHT[HEADER_BYTES:]
    noted = json.dumps([GRIP]).encode()
    common = {"key": "tmp/k", "name": "pick", "header": RECORDED, "grip_bytes": len(noted)}
    answer = rig.do("put", **{**pieces(samples + noted, **common)[0], "sha256": None,
                              "data": base64.b64encode(samples + noted).decode()})  # fmt: skip
    assert (answer["samples"], answer["grips"]) == (301, 1)
    content = json.loads(rig.read("pick", "grip"))
    assert content["lgt_sha256"] == answer["sha256"]
    assert content["grips"] == [GRIP]


def test_a_list_of_the_most_grips_fits_into_a_packet(rig: Rig) -> None:
    third, grips = 1 / 3, []
    for number in range(200):
        at_s = (number + third) / 70.0
        times = {"closing_s": at_s, "start_s": at_s, "end_s": at_s + third / 100.0}
        others = dict.fromkeys(("openness", "width_mm", "force_n"), third * 1e-300)
        grips.append({**GRIP, **times, **others, "source": '"' * 80})
    put_with(rig, LONG, beside(LONG, *grips))
    assert rig.do("open", name="pick")["grips"] == 200  # which Rig.do measures


class NoRoomForGrips(FileSystem):
    """A disk that is full when the grips' turn comes."""

    def create(self, path: Path) -> int:
        if ".grip.json" in path.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().create(path)


def test_a_disk_that_fails_between_the_two_leaves_no_grips_of_another_path(tmp_path: Path) -> None:
    put_with(Rig(tmp_path), TAUGHT, beside(TAUGHT, GRIP))
    rig = Rig(tmp_path, NoRoomForGrips())
    answer = put_with(rig, LONG, beside(LONG, GRIP))
    assert answer["refused"]["reason"] == "not_saved"
    assert rig.read("pick") == LONG
    opened = rig.do("open", name="pick")
    assert (opened["grips"], opened["grip_rows"]) == (0, [])
    assert "another .lgt" in opened["grip_problem"]
    assert rig.files() == ["pick.grip.json", "pick.lgt"]
