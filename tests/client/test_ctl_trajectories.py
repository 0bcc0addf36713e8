"""litegripctl record, play and trajectories: what they ask, what they tell."""

import json
from pathlib import Path

import pytest

from litegrip_client.ctl.commands.trajectories import listed_text
from litegrip_client.ctl.main import main
from litegrip_client.ctl.render import progress
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import FakeDaemon
from tests.client.fake_trajectories import CONTENT, FakeTrajectories
from tests.client.helpers import Ctl
from tests.trajectories import lgt


@pytest.fixture
def there(daemon: FakeDaemon) -> FakeTrajectories:
    return FakeTrajectories(daemon)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine"
    path.mkdir()
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    return path


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


def test_the_line_of_a_replay_tells_the_pass() -> None:
    data = {"step": 5, "total_steps": 10, "phase": "play", "opening_mm": 12.5, "loops": 2}
    assert progress(data) == "[############............]  12.50 mm  -- N·m  play, pass 3"


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
