"""litegripctl plot of trajectories."""

import sys
from pathlib import Path

import pytest

from litegrip_client import Trajectory
from litegrip_client.ctl.main import main
from tests.client.fake_daemon import FakeDaemon
from tests.client.fake_trajectories import CONTENT, FakeTrajectories
from tests.client.helpers import Ctl
from tests.trajectories import lgt

PNG = b"\x89PNG\r\n\x1a\n"
NOWHERE = ["--socket", "/nowhere"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine"
    path.mkdir()
    (path / "pick.lgt").write_bytes(CONTENT)
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    monkeypatch.chdir(tmp_path)
    return path


def test_plot_of_a_name_is_the_daemons(daemon: FakeDaemon, ctl: Ctl, folder: Path) -> None:
    there = FakeTrajectories(daemon)
    there.kept = {"wave": lgt([(0.0, 0.0), (1.0, 1.0)])}
    assert ctl("plot", "pick")[0] == 4
    assert ctl("plot", "wave") == (0, "drawn in wave.png\n", "")
    assert Path("wave.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ("arguments", "target"),
    [
        (["--local", "pick"], "pick.png"),
        (["--local", "pick", "-o", "x.png"], "x.png"),
        (["mine/pick.lgt"], "mine/pick.png"),
        (["mine/pick.lgt", "--last", "0.5"], "mine/pick.png"),
    ],
)
def test_plot_draws_a_picture(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], target: str
) -> None:
    assert main([*NOWHERE, "plot", *arguments]) == 0
    assert capsys.readouterr().out == f"drawn in {target}\n"
    assert Path(target).read_bytes().startswith(PNG)


def test_plot_draws_a_pose_and_what_was_made_at_no_time(folder: Path) -> None:
    (folder / "odd.lgt").write_bytes(lgt([(5.0, 0.5)], created_s=1e300, mount=bytes(8)))
    assert main([*NOWHERE, "plot", "--local", "odd"]) == 0
    assert Path("odd.png").read_bytes().startswith(PNG)


def test_a_trajectory_is_known_by_its_content(
    folder: Path, capsys: pytest.CaptureFixture[str], drawn: list[Trajectory]
) -> None:
    Path("wave").write_bytes(CONTENT)
    assert main([*NOWHERE, "plot", "--last", "0.5", "wave"]) == 0
    assert capsys.readouterr().out == "drawn in wave.png\n"
    assert len(drawn[0]) == 51


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("empty.lgt", lgt([]), "has no samples to draw"),
        ("cut.lgt", CONTENT[:-1], "12065 bytes, but 300 samples make 12066"),
        ("dump.mcap", b"no trajectory", "it is no whole MCAP file of the recorder"),
    ],
)
def test_what_cannot_be_shown_says_why(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, why: str
) -> None:
    Path(name).write_bytes(content)
    assert main([*NOWHERE, "plot", name]) != 0
    assert why in capsys.readouterr().err


def test_a_picture_without_the_library_says_what_to_install(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in list(sys.modules):
        if name.startswith(("litegrip_client.ctl.plot", "matplotlib")):
            monkeypatch.delitem(sys.modules, name)

    class Absent:
        def find_spec(self, name: str, *_more: object) -> None:
            if name.partition(".")[0] == "matplotlib":
                raise ModuleNotFoundError(f"No module named {name!r}", name="matplotlib")

    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    assert main([*NOWHERE, "plot", "--local", "pick"]) == 4
    error = capsys.readouterr().err
    assert "plot needs the library matplotlib" in error
    assert "-m pip install matplotlib mcap" in error
