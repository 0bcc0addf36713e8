"""How many named trajectories a user may have: counted by owner, refused in time, lost never."""

import errno
import json
import os
from pathlib import Path

import pytest

from litegripd.io.helper.atomic_file import FileSystem
from litegripd.trajectories.store import Limits
from tests.io.test_trajectory_store import LONG, TAUGHT, UID, Rig
from tests.trajectories import pieces

OTHER = 1001
ROOM = Limits(2, 2 * len(TAUGHT) + 100)


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path / "trajectories", limits=ROOM)


def usage(rig: Rig, uid: int = UID) -> tuple[int, int]:
    answer = rig.do("list", after=None, uid=uid)["usage"]
    assert (answer["uid"], answer["most_named"], answer["most_bytes"]) == (
        uid,
        rig.limits.most,
        rig.limits.most_bytes,
    )
    return answer["named"], answer["bytes"]


def owners(rig: Rig) -> dict[str, int | None]:
    return {one["name"]: one["uid"] for one in rig.do("list", after=None)["trajectories"]}


def refused(answer: dict[str, object]) -> tuple[str, str]:
    refusal = answer["refused"]
    assert isinstance(refusal, dict)
    assert refusal["data"]["usage"]["most_named"] == ROOM.most
    return refusal["reason"], refusal["message"]


def test_one_more_than_allowed_is_refused_and_nothing_is_lost(rig: Rig) -> None:
    rig.put(TAUGHT, "a")
    rig.put(TAUGHT, "b")
    reason, message = refused(rig.put(TAUGHT, "c"))
    assert reason == "trajectories_full"
    assert message == (
        "uid 1000 has 2 named trajectories, of 2 that [trajectories] most_per_user allows in the"
        " daemon's configuration: make room (trajectory.delete), or have an administrator raise it"
        " and restart the daemon"
    )
    assert rig.all_files() == ["a.lgt", "a.uid", "b.lgt", "b.uid"]
    assert rig.read("b") == TAUGHT
    rig.do("delete", name="a")
    assert rig.put(TAUGHT, "c")["complete"]
    assert usage(rig) == (2, 2 * len(TAUGHT))


def test_more_bytes_than_allowed_are_refused(rig: Rig) -> None:
    assert usage(rig) == (0, 0)
    rig.put(TAUGHT, "a")
    reason, message = refused(rig.put(LONG, "b"))
    assert reason == "trajectories_full"
    for part in (f"{len(LONG)} bytes", f"have {len(TAUGHT)}, of {ROOM.most_bytes}", "most_mb_per"):
        assert part in message
    assert rig.all_files() == ["a.lgt", "a.uid"]


def test_what_has_no_room_is_refused_with_its_first_piece(rig: Rig) -> None:
    first, *_ = pieces(LONG, key="tmp/k", name="a", header=None)
    assert refused(rig.do("put", **first))[0] == "trajectories_full"
    # Whoever names it only at the end is refused there.
    *before, last = pieces(LONG, key="tmp/k", name=None, header=None)
    for piece in before:
        assert not rig.do("put", **piece)["complete"]
    assert refused(rig.do("put", **{**last, "name": "a"}))[0] == "trajectories_full"
    assert rig.all_files() == []


def test_each_user_is_counted_alone(rig: Rig) -> None:
    rig.put(TAUGHT, "a")
    rig.put(TAUGHT, "b")
    rig.put(TAUGHT, "c", uid=OTHER)
    assert owners(rig) == {"a": UID, "b": UID, "c": OTHER}
    assert (usage(rig), usage(rig, OTHER)) == ((2, 2 * len(TAUGHT)), (1, len(TAUGHT)))
    assert refused(rig.put(TAUGHT, "d"))[0] == "trajectories_full"
    assert rig.put(TAUGHT, "d", uid=OTHER)["complete"]


def test_who_replaces_one_has_it_from_then_on(rig: Rig) -> None:
    for name in ("a", "b"):
        rig.put(TAUGHT, name)
    rig.put(TAUGHT, "c", uid=OTHER)
    assert refused(rig.put(TAUGHT, "c"))[0] == "trajectories_full"
    assert owners(rig)["c"] == OTHER
    rig.put(TAUGHT, "a", uid=OTHER)
    assert (usage(rig)[0], usage(rig, OTHER)[0]) == (1, 2)
    assert rig.put(TAUGHT, "d")["complete"]


def test_replacing_ones_own_by_what_is_no_larger_goes_even_above_a_lowered_limit(
    tmp_path: Path,
) -> None:
    rig = Rig(tmp_path / "trajectories")
    for name in ("a", "b", "c"):
        rig.put(TAUGHT, name)
    lowered = Rig(rig.directory, limits=Limits(1, 100))
    assert lowered.put(TAUGHT, "b")["complete"]
    assert "refused" in lowered.put(LONG, "b")
    assert "refused" in lowered.put(TAUGHT, "d")
    assert lowered.names() == ["a", "b", "c"]


def test_what_is_there_from_before_is_nobodys_and_counts_for_nobody(rig: Rig) -> None:
    rig.directory.mkdir(parents=True)
    for name in ("old", "older", "oldest"):
        (rig.directory / f"{name}.lgt").write_bytes(TAUGHT)
    assert owners(rig) == {"old": None, "older": None, "oldest": None}
    assert usage(rig) == (0, 0)
    assert rig.put(TAUGHT, "a")["complete"]
    assert rig.put(TAUGHT, "old")["complete"]
    assert owners(rig)["old"] == UID
    assert refused(rig.put(TAUGHT, "b"))[0] == "trajectories_full"


@pytest.mark.parametrize("text", ["", "root", "-1", "4294967295", "1" * 13, "1000\n1001", "\u0661"])
def test_an_owner_that_cannot_be_is_none(rig: Rig, text: str) -> None:
    rig.put(TAUGHT, "a")
    (rig.directory / "a.uid").write_text(text, encoding="utf-8")
    assert owners(rig) == {"a": None}
    (rig.directory / "a.uid").unlink()
    (rig.directory / "a.uid").symlink_to("/proc/self/loginuid")
    assert owners(rig) == {"a": None}
    (rig.directory / "a.uid").unlink()
    os.mkfifo(rig.directory / "a.uid")  # which nobody writes
    assert owners(rig) == {"a": None}
    assert rig.put(TAUGHT, "a")["complete"]
    assert owners(rig) == {"a": UID}


def test_uploads_without_a_name_are_not_counted(rig: Rig) -> None:
    for number in range(4):
        assert rig.put(TAUGHT, key=f"tmp/{number}")["complete"]
    assert usage(rig) == (0, 0)


class Fails(FileSystem):
    """Fails once it is to put something in the place of `name`."""

    name = ""

    def replace(self, source: Path, target: Path) -> None:
        if target.name == self.name:
            raise OSError(errno.ENOSPC, "No space left on device")
        super().replace(source, target)


@pytest.mark.parametrize("fails", ["a.lgt", "a.uid"])
@pytest.mark.parametrize("before", [None, UID, OTHER])
def test_a_disk_that_fails_leaves_the_owner_with_the_content(
    tmp_path: Path, fails: str, before: int | None
) -> None:
    disk = Fails()
    rig = Rig(tmp_path / "trajectories", disk)
    if before is not None:
        rig.put(TAUGHT, "a", uid=before)
    files = rig.all_files()
    disk.name = fails
    answer = rig.put(LONG, "a")
    if before == UID and fails == "a.uid":  # it says so already
        assert answer["complete"]
        return
    assert answer["refused"]["reason"] == "not_saved"
    assert owners(rig) == ({} if before is None else {"a": before})
    assert rig.all_files() == files
    if before is not None:
        assert rig.read("a") == TAUGHT


def test_the_limits_go_to_the_helper_process_as_its_arguments() -> None:
    assert Limits.of(Limits(7, 8).arguments()) == Limits(7, 8)
    assert Limits.of(()) == Limits()


def test_a_page_of_the_longest_names_still_fits_into_a_packet(tmp_path: Path) -> None:
    folder = tmp_path / "trajectories"
    rig = Rig(folder)
    rig.put(TAUGHT, "ü" * 60, uid=2**32 - 2)
    for kept in list(folder.iterdir()):
        for number in range(300):
            (folder / f"{kept.stem}{number}{kept.suffix}").write_bytes(kept.read_bytes())
    answer = rig.do("list", after=None)  # the rig looks at the size
    assert answer["more"]
    assert json.dumps(answer["usage"])
