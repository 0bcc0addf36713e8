"""litegripctl record, play and trajectories: what they ask, what they tell."""

import json
import os
from pathlib import Path

import pytest

from litegrip_client import Trajectory
from litegrip_client.ctl.commands.trajectories import listed_text
from litegrip_client.ctl.main import main
from litegrip_client.ctl.render import progress
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.fake_trajectories import CONTENT, PLAYED, FakeTrajectories
from tests.client.helpers import Ctl, interrupt_main_thread
from tests.trajectories import lgt

SLACK = "The jaws are slack for 3 s: push them. Ctrl-C breaks it off and keeps nothing.\n"


@pytest.fixture
def there(daemon: FakeDaemon) -> FakeTrajectories:
    return FakeTrajectories(daemon)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine"
    path.mkdir()
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    return path


# record


def test_record_keeps_it_under_its_name(there: FakeTrajectories, ctl: Ctl) -> None:
    shown = "record: 300 samples in 2.99 s, kept as pick; replay it with: litegripctl play pick\n"
    assert ctl("record", "pick", "--seconds", "3") == (0, shown, SLACK)
    start = {"rate_hz": 100.0, "zero_gravity": True, "max_samples": 300}
    assert there.asked("record_start") == [start]
    assert there.asked("record_stop") == [{"name": "pick"}]
    assert there.kept == {"pick": CONTENT}


def test_record_may_only_watch(there: FakeTrajectories, ctl: Ctl) -> None:
    there.missed = 2
    arguments = ("--seconds", "1.5", "--rate", "50", "--no-zero-gravity")
    code, shown, error = ctl("record", "pick", *arguments)
    assert (code, error) == (0, "")
    assert ", 2 missed, kept as pick" in shown
    start = {"rate_hz": 50.0, "zero_gravity": False, "max_samples": 75}
    assert there.asked("record_start") == [start]


def test_record_replaces_nothing_unasked(there: FakeTrajectories, ctl: Ctl) -> None:
    there.kept = {"other": b"", "pick": b"old"}
    code, shown, error = ctl("record", "pick", "--seconds", "1")
    assert (code, shown) == (4, "")
    assert error == (
        "litegripctl: the daemon keeps a trajectory pick already\n"
        "  take another name, or replace it with: --overwrite\n"
    )
    assert there.asked("record_start") == []
    assert ctl("record", "pick", "--seconds", "1", "--overwrite")[0] == 0
    assert there.kept["pick"] == CONTENT


def test_what_cannot_be_a_name_is_refused_before_the_recording(
    there: FakeTrajectories, ctl: Ctl
) -> None:
    for more in ((), ("--overwrite",)):
        code, shown, error = ctl("record", "mine/pick", "--seconds", "3", *more)
        assert (code, shown) == (4, "")
        assert error.startswith("litegripctl: it cannot be a name: it is a path\n")
    assert there.asked("record_start") == []


def test_a_recording_that_did_not_fill_is_not_kept(there: FakeTrajectories, ctl: Ctl) -> None:
    there.missed = 100
    code, shown, error = ctl("record", "pick", "--seconds", "3")
    assert (code, shown) == (4, "")
    assert "the recording did not fill: 200 of 300 samples" in error
    assert there.kept == {}


def test_an_interrupted_recording_is_not_kept(
    daemon: FakeDaemon, there: FakeTrajectories, ctl: Ctl
) -> None:
    daemon.handlers["trajectory.status"] = lambda request: interrupt_main_thread()
    code, shown, error = ctl("record", "pick", "--seconds", "3")
    assert (code, shown) == (130, "")
    assert error == f"{SLACK}litegripctl: interrupted: nothing was kept, the jaws hold\n"
    assert there.asked("record_stop") == [{"allow_empty": True, "allow_partial": True}]
    assert there.kept == {}


USAGE = {"uid": 1000, "named": 2, "bytes": 1_530_000, "most_named": 2, "most_bytes": 50_000_000}


def test_a_recording_that_had_no_room_is_kept_later(there: FakeTrajectories, ctl: Ctl) -> None:
    there.full = True
    code, shown, error = ctl("record", "pick", "--seconds", "3")
    assert (code, shown) == (4, "")
    assert error == (
        f"{SLACK}litegripctl: there is no room\n"
        "  the recording stays until the next one begins; once there is room: litegripctl"
        " trajectories keep NAME\n"
    )
    assert there.asked("record_stop") == [{"name": "pick"}]  # and not once more, without a name
    there.full = False
    shown = "record: 300 samples in 2.99 s, kept as pick; replay it with: litegripctl play pick\n"
    assert ctl("trajectories", "keep", "pick") == (0, shown, "")
    assert there.kept == {"pick": CONTENT}
    code, _, error = ctl("trajectories", "keep", "pick")
    assert (code, "already" in error) == (4, True)
    assert ctl("trajectories", "keep", "pick", "--overwrite")[0] == 0


def test_a_recording_under_way_is_not_ended_by_keeping_it(
    daemon: FakeDaemon, there: FakeTrajectories, ctl: Ctl
) -> None:
    daemon.handlers["trajectory.status"] = lambda _request: {"active": True, "kind": "record"}
    code, _, error = ctl("trajectories", "keep", "pick")
    assert (code, "a recording is under way" in error) == (6, True)
    assert there.asked("record_stop") == []


def test_where_there_is_no_room_nothing_is_recorded(there: FakeTrajectories, ctl: Ctl) -> None:
    there.usage = USAGE
    code, shown, error = ctl("record", "more", "--seconds", "3")
    assert (code, shown) == (4, "")
    assert error == (
        "litegripctl: there is no room for another trajectory of uid 1000: 2 of 2 are there;"
        " nothing was recorded\n  make room: litegripctl trajectories delete NAME\n"
    )
    assert there.asked("record_start") == []
    there.kept = {"pick": CONTENT}
    assert ctl("record", "pick", "--seconds", "3", "--overwrite")[0] == 0


def test_a_list_shows_whose_they_are_and_how_much_room_there_is(
    there: FakeTrajectories, ctl: Ctl
) -> None:
    there.kept = {"other": CONTENT, "pick": CONTENT}
    there.usage = USAGE
    code, shown, _ = ctl("trajectories")
    head, other, pick, room = shown.splitlines()
    assert (code, head.split()[-1], other.split()[-1], pick.split()[-1]) == (0, "UID", "-", "1000")
    assert room == "of uid 1000, who asks: 2 of 2, 1.5 of 50 MB"
    code, shown, _ = ctl("--json", "trajectories")
    assert json.loads(shown)["usage"] == USAGE


def test_record_as_json(there: FakeTrajectories, ctl: Ctl) -> None:
    code, shown, _error = ctl("--json", "record", "pick", "--seconds", "3")
    assert code == 0
    assert json.loads(shown)["name"] == "pick"
    there.error = "a stop"
    code, shown, _error = ctl("--json", "record", "again", "--seconds", "3")
    assert code == 4
    assert json.loads(shown)["error"]["data"]["reason"] == "recording_failed"


def test_jaws_that_do_not_go_slack_are_not_said_to(daemon: FakeDaemon, ctl: Ctl) -> None:
    FakeTrajectories(daemon)
    daemon.handlers["trajectory.record_start"] = lambda request: request.fail(
        "not_enabled", -32010, "the motor is not enabled"
    )
    code, shown, error = ctl("record", "pick", "--seconds", "3")
    assert (code, shown) == (5, "")
    assert error == "litegripctl: the motor is not enabled\n  first: litegripctl enable\n"


def test_record_shows_a_bar_on_a_terminal(daemon: FakeDaemon) -> None:
    there = FakeTrajectories(daemon, looks=3)
    terminal = Terminal("--socket", daemon.path, "record", "pick", "--seconds", "0.2")
    terminal.expect("The jaws are slack for 0.2 s")
    terminal.expect("[............")
    terminal.expect("[############............]")
    code, shown = terminal.end()
    assert code == 0
    assert "record: 20 samples in 2.99 s, kept as pick" in shown
    assert there.kept == {"pick": CONTENT}


# play


@pytest.mark.parametrize(
    ("arguments", "params"),
    [
        ((), {"repeat": 1, "align": True}),
        (
            ("--repeat", "3", "--speed", "0.5", "--no-align"),
            {"repeat": 3, "speed": 0.5, "align": False},
        ),
    ],
)
def test_play_asks_for_a_replay(
    there: FakeTrajectories, ctl: Ctl, arguments: tuple[str, ...], params: dict[str, object]
) -> None:
    shown = "play: completed, 1 pass, at 35.25 mm, at most 1.2 mm behind\n"
    assert ctl("play", "pick", *arguments) == (0, shown, "")
    assert there.asked("play") == [{"name": "pick", "detach": True, "progress": True, **params}]


def test_play_that_is_blocked_is_not_ok(
    daemon: FakeDaemon, there: FakeTrajectories, ctl: Ctl
) -> None:
    blocked = {**PLAYED, "ok": False, "outcome": "blocked", "loops": 2}
    daemon.handlers["trajectory.play"] = lambda request: blocked
    code, shown, _error = ctl("play", "pick", "--repeat", "3")
    assert (code, shown[:34]) == (1, "play: NOT ok: blocked, 2 passes, a")


def test_play_local_sends_the_file_first(
    there: FakeTrajectories, ctl: Ctl, folder: Path, tmp_path: Path
) -> None:
    (folder / "pick.lgt").write_bytes(CONTENT)
    assert ctl("play", "--local", "pick")[0] == 0
    assert there.uploads == {"tmp/upload-1": CONTENT}
    assert there.asked("play")[0]["name"] == "tmp/upload-1"
    code, _shown, error = ctl("play", "--local", f"{tmp_path}/no.lgt")
    assert code == 4
    assert error == (
        f"litegripctl: there is no trajectory {tmp_path}/no.lgt\n  see: litegripctl trajectories\n"
    )


def test_an_interrupted_replay_is_cancelled(
    daemon: FakeDaemon, there: FakeTrajectories, ctl: Ctl
) -> None:
    def play(request: Request) -> None:
        request.progress(1, job=4, phase="play")
        interrupt_main_thread()

    daemon.handlers["trajectory.play"] = play
    daemon.handlers["job.list"] = lambda request: {
        "jobs": [{"job": 4, "state": "running", "owner": {"pid": os.getpid()}}]
    }
    daemon.handlers["job.cancel"] = lambda request: {"job": 4, "state": "cancelled"}
    code, _shown, error = ctl("play", "pick")
    assert code == 130
    assert "job 4 cancelled, the jaws hold" in error


def test_the_line_of_a_replay_tells_the_pass() -> None:
    data = {"step": 5, "total_steps": 10, "phase": "play", "opening_mm": 12.5, "loops": 2}
    assert progress(data) == "[############............]  12.50 mm  -- N·m  play, pass 3"


# trajectories


def test_the_list_is_a_table(there: FakeTrajectories, ctl: Ctl) -> None:
    there.kept = {"wave": CONTENT, "broken": b"odd", "pick": CONTENT}
    code, shown, error = ctl("trajectories")
    assert (code, error) == (0, "")
    lines = [line.split() for line in shown.splitlines()]
    assert lines[0] == ["NAME", "SAMPLES", "LENGTH", "RATE", "MOUNT", "GRIPS", "CREATED"]
    assert [line[:7] for line in lines[1:3]] == [
        [name, "300", "2.99", "s", "100", "Hz", "normal"] for name in ("pick", "wave")
    ]
    assert shown.splitlines()[3] == "broken: NOT usable: sample 1 is odd"
    code, shown, _error = ctl("trajectories", "list", "--json")
    assert [row["name"] for row in json.loads(shown)["trajectories"]] == ["broken", "pick", "wave"]


def test_the_list_of_this_side_needs_no_daemon(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "pick.lgt").write_bytes(CONTENT)
    (folder / "cut.lgt").write_bytes(CONTENT[:-1])
    for arguments in (["--local"], ["--local", "list"], ["list", "--local"]):
        assert main(["--socket", "/nowhere", "trajectories", *arguments]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert lines[1].split()[:4] == ["pick", "300", "2.99", "s"]
        assert lines[2].startswith("cut: NOT usable: 12065 bytes, but 300 samples make 12066")
    assert main(["--socket", "/nowhere", "--json", "trajectories", "--local"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["directory"] == str(folder)
    assert [row["name"] for row in data["trajectories"]] == ["cut", "pick"]
    assert main(["--socket", "/nowhere", "trajectories", "--local", "delete", "pick"]) == 2
    assert "--local does not go with delete" in capsys.readouterr().err


def test_a_date_that_is_none_is_not_shown() -> None:
    row = {"name": "x", "samples": 2, "sample_hz": 100.0, "created_s": 1e300, "mount": None}
    assert listed_text([row]).splitlines()[1].split()[2:] == [
        "--",
        "s",
        "100",
        "Hz",
        "-",
        "-",
        "--",
    ]


def test_the_length_in_the_list_is_that_of_the_samples_also_where_some_are_missing(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = {"name": "x", "samples": 193, "sample_hz": 100.0, "duration_s": 1.99, "mount": None}
    assert listed_text([row]).splitlines()[1].split()[1:4] == ["193", "1.99", "s"]
    (folder / "gap.lgt").write_bytes(lgt([(1.0, 0.5), (1.01, 0.5), (2.99, 0.5)]))
    (folder / "odd.lgt").write_bytes(lgt([(1.0, 0.5), (0.5, 0.5)]))
    assert main(["--socket", "/nowhere", "trajectories", "--local"]) == 0
    lines = [line.split()[:4] for line in capsys.readouterr().out.splitlines()[1:]]
    assert lines == [["gap", "3", "1.99", "s"], ["odd", "2", "--", "s"]]


def test_get_copies_one_to_this_side(there: FakeTrajectories, ctl: Ctl, folder: Path) -> None:
    there.kept = {"pick": CONTENT}
    path = folder / "pick.lgt"
    assert ctl("trajectories", "get", "pick") == (0, f"written to {path}\n", "")
    assert path.read_bytes() == CONTENT
    code, _shown, error = ctl("trajectories", "get", "pick")
    assert code == 4
    assert f"{path} exists already\n  take another name, or" in error
    assert ctl("trajectories", "get", "pick", "--overwrite")[0] == 0
    other = folder / "sub" / "x.bin"
    assert ctl("trajectories", "get", "pick", "-o", str(other))[0] == 0
    assert other.read_bytes() == CONTENT
    assert ctl("trajectories", "get", "pick", "-o", "mine")[0] == 0
    assert (folder / "mine.lgt").read_bytes() == CONTENT


def test_get_writes_nothing_that_could_not_be_loaded(
    there: FakeTrajectories, ctl: Ctl, folder: Path
) -> None:
    there.kept = {"pick": lgt([(0.0, 2.0)])}
    code, _shown, error = ctl("trajectories", "get", "pick")
    assert code == 4
    assert "openness is 2.0" in error
    assert not list(folder.iterdir())
    code, _shown, error = ctl("trajectories", "get", "other")
    assert (code, error) == (
        4,
        "litegripctl: no trajectory 'other'\n  see: litegripctl trajectories\n",
    )


def test_put_copies_one_to_the_daemon(
    there: FakeTrajectories, ctl: Ctl, folder: Path, tmp_path: Path
) -> None:
    Trajectory.from_bytes(CONTENT).save("pick")
    assert ctl("trajectories", "put", "pick") == (0, "kept as pick, 300 samples\n", "")
    code, _shown, error = ctl("trajectories", "put", "pick")
    assert code == 4
    assert "keeps a trajectory pick already" in error
    assert ctl("trajectories", "put", "pick", "--overwrite")[0] == 0
    assert ctl("trajectories", "put", f"{folder}/pick.lgt", "--as", "wave")[0] == 0
    assert there.kept == {"pick": CONTENT, "wave": CONTENT}
    assert ctl("trajectories", "put", f"{tmp_path}/no")[0] == 4


def test_delete_removes_one_of_the_daemons(there: FakeTrajectories, ctl: Ctl) -> None:
    there.kept = {"pick": CONTENT}
    assert ctl("trajectories", "delete", "pick") == (0, "deleted: pick\n", "")
    assert there.kept == {}


def test_export_shows_the_samples_as_csv(there: FakeTrajectories, ctl: Ctl, tmp_path: Path) -> None:
    there.kept = {"pick": CONTENT}
    csv = "t_s,openness\n0.0,0.5\n"
    assert ctl("trajectories", "export", "pick") == (0, csv, "")
    assert there.asked("get")[-1] == {"name": "pick", "format": "csv", "offset": 0}
    path = tmp_path / "pick.csv"
    assert ctl("trajectories", "export", "pick", "-o", str(path))[0] == 0
    assert path.read_text(encoding="utf-8") == csv
    assert ctl("trajectories", "export", "pick", "-o", str(path))[0] == 4
    _code, shown, _error = ctl("trajectories", "export", "pick", "--json")
    assert json.loads(shown) == {"name": "pick", "csv": csv}
