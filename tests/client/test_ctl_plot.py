"""`litegripctl plot`: what it draws where, and what it says when it cannot."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from litegrip_client import Trajectory
from litegripd.recorder.files import read as read_memory
from litegripd.recorder.files import to_mcap
from tests.client.fake_trajectories import CONTENT
from tests.client.helpers import Ctl
from tests.client.rig import Heard
from tests.trajectories import lgt
from tests.world import World

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where this side's trajectories are; files are named from the directory above."""
    path = tmp_path / "mine"
    path.mkdir()
    (path / "pick.lgt").write_bytes(CONTENT)
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    monkeypatch.chdir(tmp_path)
    return path


@pytest.fixture
def plot(litegripctl: Ctl) -> Ctl:
    """Return what runs `plot` without a daemon."""
    return lambda *words: litegripctl("--socket", "/nowhere", "plot", *words)


def dump_of(world: World) -> bytes:
    return to_mcap(read_memory(bytes(world.disk.memory)), "demand", "", 10**18)


def test_plot_of_a_name_is_the_daemons(heard: Heard, litegripctl: Ctl) -> None:
    Path("wave.lgt").write_bytes(lgt([(0.0, 0.2), (1.0, 0.8)]))
    assert litegripctl("trajectories", "put", "./wave.lgt")[0] == 0
    assert litegripctl("plot", "pick")[0] == 4
    assert litegripctl("plot", "wave") == (0, "drawn in wave.png\n", "")
    assert Path("wave.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ("words", "target"),
    [
        ("--local pick", "pick.png"),
        ("--local pick -o x.png", "x.png"),
        ("mine/pick.lgt", "mine/pick.png"),
        ("mine/pick.lgt --last 0.5", "mine/pick.png"),
        ("--local odd", "odd.png"),  # a pose, made at no time
        ("new.mcap", "new.png"),  # never calibrated, and never moved
    ],
)
def test_plot_draws_a_picture(plot: Ctl, folder: Path, words: str, target: str) -> None:
    (folder / "odd.lgt").write_bytes(lgt([(5.0, 0.5)], created_s=1e300, mount=bytes(8)))
    world = World(calibrated=False)
    world.tick()
    Path("new.mcap").write_bytes(dump_of(world))
    assert plot(*words.split()) == (0, f"drawn in {target}\n", "")
    assert Path(target).read_bytes().startswith(PNG)


def test_a_trajectory_is_known_by_its_content(plot: Ctl, drawn: list[Trajectory]) -> None:
    Path("wave").write_bytes(CONTENT)
    assert plot("--last", "0.5", "wave") == (0, "drawn in wave.png\n", "")
    assert len(drawn[0]) == 51


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("empty.lgt", lgt([]), "has no samples to draw"),
        ("cut.lgt", CONTENT[:-1], "12065 bytes, but 300 samples make 12066"),
        ("no.mcap", None, "cannot draw no.mcap: No such file or directory"),
        (
            "x.mcap",
            b"no trajectory",
            "cannot draw x.mcap: it is no whole MCAP file of the recorder",
        ),
        ("x.mcap", b"", "cannot draw x.mcap: "),
        ("x.mcap", "half", "cannot draw x.mcap: "),
    ],
)
def test_what_cannot_be_shown_says_why(
    plot: Ctl, name: str, content: bytes | str | None, why: str
) -> None:
    if isinstance(content, str):
        world = World()
        world.run(1.0)
        whole = dump_of(world)
        content = whole[: len(whole) // 2]
    if content is not None:
        Path(name).write_bytes(content)
    code, shown, error = plot(name)
    assert (code, shown) == (4, "")
    assert error.startswith("litegripctl: ")
    assert why in error
    assert not list(Path().glob("*.png"))


@pytest.mark.parametrize("missing", ["mcap", "matplotlib"])
@pytest.mark.parametrize("words", [["x.mcap"], ["--local", "pick"]])
def test_without_the_libraries_it_says_what_to_install(
    plot: Ctl, hide: Callable[[str, str], None], missing: str, words: list[str]
) -> None:
    hide(missing, "litegrip_client.ctl.plot")
    text = f"plot needs the library {missing}, which is not installed"
    code, shown, _ = plot(*words, "--json")
    assert (code, json.loads(shown)["error"]["message"]) == (4, text)
    hint = f"{sys.executable} -m pip install matplotlib mcap"
    assert plot(*words) == (4, "", f"litegripctl: {text}\n  {hint}\n")
