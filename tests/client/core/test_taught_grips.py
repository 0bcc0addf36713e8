"""Grips of trajectories on the client's side: files, copies to and from the daemon, pictures."""

import base64
import hashlib
import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CommandError, TaughtGrip, Trajectory, list_trajectories
from litegrip_client.ctl.commands.trajectories import played_text, recorded_text
from litegrip_client.ctl.plot.drawing import draw_trajectory, png
from litegrip_client.values.errors import TrajectoryFormatError
from tests.client.rig import Ctl, Heard, run_ctl
from tests.client.taught import BESIDE, CONTENT, GRIPS, TAUGHT, with_grips
from tests.trajectories import fetched, lgt, send

PNG = b"\x89PNG\r\n\x1a\n"
PLAYED = {"job": 4, "ok": True, "outcome": "completed", "loops": 1, "largest_lag_mm": 1.25}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine"
    path.mkdir()
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    return path


@pytest.fixture
def ctl(folder: Path, capsys: pytest.CaptureFixture[str]) -> Ctl:
    return run_ctl(capsys)


# Files


def test_grips_lie_beside_the_file_which_stays_the_vendors(folder: Path) -> None:
    TAUGHT.save("pick")
    assert (folder / "pick.lgt").read_bytes() == CONTENT
    assert sorted(path.name for path in folder.iterdir()) == ["pick.grip.json", "pick.lgt"]
    assert Trajectory.load("pick") == TAUGHT
    assert Trajectory.load("pick").grips == GRIPS
    (file,) = list_trajectories()
    assert (file.grips, file.grip_problem) == (2, None)
    assert str(file) == "pick: 2.99 s, 300 samples, mount normal, 2 grips"
    assert "2 grips" in repr(TAUGHT)
    assert repr(replace(TAUGHT, grips=TAUGHT.grips[:1])).endswith(", 1 grip>")


def test_a_path_that_is_used_as_written_has_them_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "x.bin"
    TAUGHT.save(str(path))
    assert (tmp_path / "sub" / "x.bin.grip.json").read_bytes() == BESIDE
    assert Trajectory.load(path).grips == GRIPS


def test_one_that_is_saved_without_grips_leaves_no_old_ones(folder: Path) -> None:
    TAUGHT.save("pick")
    replace(TAUGHT, grips=()).save("pick")
    assert [path.name for path in folder.iterdir()] == ["pick.lgt"]
    assert Trajectory.load("pick").grips == ()


@pytest.mark.parametrize(
    ("content", "beside", "why"),
    [
        (lgt([(0.0, 0.1), (9.0, 0.2)]), BESIDE, "another .lgt file"),
        (CONTENT, BESIDE[:-20], "not valid JSON"),
        (CONTENT, b"[" * 100_000, "not valid JSON"),
        (CONTENT, b"\xff", "not UTF-8"),
        (CONTENT, b" " * 200_000, "at most 131072"),
        (CONTENT, b"[]", "no file of grips"),
    ],
)
def test_grips_that_cannot_be_used_are_none_with_a_warning(
    folder: Path, caplog: pytest.LogCaptureFixture, content: bytes, beside: bytes, why: str
) -> None:
    (folder / "pick.lgt").write_bytes(content)
    (folder / "pick.grip.json").write_bytes(beside)
    with caplog.at_level(logging.WARNING, "litegrip_client"):
        assert Trajectory.load("pick").grips == ()
    assert f"{folder}/pick.grip.json are left out" in caplog.text
    assert why in caplog.text
    (file,) = list_trajectories()
    assert (file.error, file.grips) == (None, 0)
    assert why in (file.grip_problem or "")


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"force_n": 0.0}, "force_n is 0.0"),
        ({"force_n": 40.5}, "at most 40"),
        ({"force_n": float("nan")}, r"grips\.0\.force_n is NaN"),
        ({"force_n": True}, "force_n is True"),
        ({"force_n": 10**400}, r"grips\.0\.force_n is 1000"),
        ({"openness": 1.5}, "openness"),
        ({"width_mm": -0.1}, "width_mm"),
        ({"start_s": 0.1}, "one after the other"),
        ({"end_s": 0.1}, "one after the other"),
        ({"end_s": "1"}, "end_s is '1'"),
        ({"source": ""}, "printable ASCII"),
        ({"source": "x" * 81}, "printable ASCII"),
        ({"source": "é"}, "printable ASCII"),
        ({"source": None}, "printable ASCII"),
        ({"more": 1}, "is no object with"),
    ],
)
def test_each_field_is_checked(changes: dict[str, Any], why: str) -> None:
    plain = json.loads(BESIDE)
    plain["grips"][0] |= changes
    content = json.dumps(plain).encode()
    with pytest.raises(TrajectoryFormatError, match=why):
        TAUGHT.with_grips(CONTENT, content)


@pytest.mark.parametrize(
    ("grips", "why"),
    [
        ((GRIPS[1], GRIPS[0]), "grip 1: closing_s is 0.25, before 2.99"),
        ((replace(GRIPS[0], closing_s=-0.1),), "grip 0: closing_s is -0.1, before 0.0"),
        ((replace(GRIPS[1], end_s=3.0),), "grip 0: end_s is 3.0, after 2.99"),
        ((TaughtGrip(0, 0, 0, 0, 0, 1, "x"),) * 201, "201 grips, at most 200"),
        (("grip",), "no TaughtGrip"),
    ],
)
def test_grips_follow_each_other_within_the_samples(grips: Any, why: str) -> None:
    with pytest.raises(CommandError, match=why):
        with_grips(*grips)


# litegripctl


def test_play_asks_for_the_force_and_sends_the_grips_where_they_are_wanted(
    daemon: Heard, ctl: Ctl
) -> None:
    daemon.instead["trajectory.play"] = PLAYED
    TAUGHT.save("pick")
    beside = []
    for source in (("pick",), ("--local", "pick")):
        for force in ((), ("--force", "path"), ("--force", "replay")):
            assert ctl("play", *source, *force)[0] == 0
            beside.append([put.get("grip_bytes", 0) for put in daemon.asked("trajectory.put")])
    forces = [asked.get("force") for asked in daemon.asked("trajectory.play")]
    assert forces == [None, None, "replay"] * 2
    assert beside[2] == []
    assert [max(puts) for puts in beside[3:]] == [0, 0, len(BESIDE)]
    assert ctl("play", "pick", "--force", "10")[0] == 2


def test_put_and_get_carry_both(daemon: Heard, ctl: Ctl, folder: Path) -> None:
    TAUGHT.save("pick")
    assert ctl("trajectories", "put", "pick") == (0, "kept as pick, 300 samples\n", "")
    assert fetched(daemon.client(), name="pick") == CONTENT
    assert fetched(daemon.client(), name="pick", format="grip") == BESIDE
    assert ctl("trajectories", "get", "pick", "-o", "copy")[0] == 0
    assert (folder / "copy.grip.json").read_bytes() == BESIDE
    assert Trajectory.load("copy") == TAUGHT


def test_what_goes_with_another_file_is_left_out_and_said(
    daemon: Heard, ctl: Ctl, folder: Path
) -> None:
    other = lgt([(0.0, 0.5), (1.0, 0.5)])
    (folder / "pick.lgt").write_bytes(other)
    (folder / "pick.grip.json").write_bytes(BESIDE)
    said = "the grips are left out: it belongs to another .lgt file, which has been replaced\n"
    assert ctl("trajectories", "put", "pick") == (0, "kept as pick, 2 samples\n", said)
    assert fetched(daemon.client(), name="pick", format="grip") == b""
    sent = {"total": len(BESIDE), "data": base64.b64encode(BESIDE).decode(), "offset": 0}
    daemon.instead["trajectory.get"] = lambda request: (
        {**sent, "sha256": hashlib.sha256(BESIDE).hexdigest()}
        if request.params.get("format") == "grip"
        else None
    )
    code, _shown, error = ctl("trajectories", "get", "pick", "--overwrite")
    assert (code, error) == (0, said)
    assert not (folder / "pick.grip.json").exists()


def test_the_list_shows_that_a_grip_is_kept(daemon: Heard, ctl: Ctl, folder: Path) -> None:
    TAUGHT.save("pick")
    (folder / "wave.lgt").write_bytes(CONTENT)
    for name in ("pick", "wave"):
        ctl("trajectories", "put", name)
    _code, shown, _error = ctl("trajectories")
    assert [line.split()[7] for line in shown.splitlines()[1:3]] == ["2", "-"]
    (folder / "wave.grip.json").write_bytes(b"odd")
    code, shown, _error = ctl("--socket", "/nowhere", "trajectories", "--local")
    lines = shown.splitlines()
    assert [code, *(line.split()[7] for line in lines[1:3])] == [0, "2", "-"]
    assert lines[3].startswith("wave: its grips are NOT usable: not valid JSON")


def test_what_was_recorded_and_played_tells_of_grips() -> None:
    assert ", 1 grip, kept as pick" in recorded_text(
        {"name": "pick", "samples": 3, "grips": 1}, str
    )
    data = {**PLAYED, "grips": 2, "width_mm": 44.0, "width_difference_mm": -4.0}
    assert played_text(data, str).endswith(
        "; 2 grips, the last one 44.0 mm wide, at most -4.0 mm to taught"
    )


# Plot


def test_plot_draws_the_grips_of_the_daemon(daemon: Heard, ctl: Ctl) -> None:
    send(daemon.client(), CONTENT + BESIDE, name="pick", grip_bytes=len(BESIDE))
    assert ctl("plot", "pick") == (0, "drawn in pick.png\n", "")
    assert Path("pick.png").read_bytes() == png(draw_trajectory(TAUGHT, "pick"))


def test_the_last_seconds_begin_within_a_grip(ctl: Ctl, drawn: list[Trajectory]) -> None:
    TAUGHT.save("pick")
    assert ctl("plot", "--local", "--last", "0.5", "pick")[0] == 0
    (grip,) = drawn[0].grips
    assert grip.start_s == pytest.approx(2.49)
    assert grip.end_s == 2.99
    assert Path("pick.png").read_bytes().startswith(PNG)
