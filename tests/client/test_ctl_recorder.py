"""`litegripctl plot`: what it draws, and what it says when it cannot."""

import json
import sys
from pathlib import Path

import pytest

from litegrip_client.ctl.plot.drawing import Happening, labels, read
from litegripd.recorder.files import read as read_memory
from litegripd.recorder.files import to_mcap
from tests.client.helpers import Ctl
from tests.world import World

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def content() -> bytes:
    world = World()
    client = world.enabled()
    client.result("motion.move", opening_mm=40)
    client.send("motion.open")
    world.run(0.3)
    world.gripper.set_supply(40.0)
    world.run(0.5)
    return to_mcap(read_memory(bytes(world.disk.memory)), "motor_fault", "", 10**18)


@pytest.mark.parametrize("arguments", [(), ("--last", "0.5"), ("--last", "500")])
def test_plot_draws_without_a_daemon(
    ctl: Ctl, tmp_path: Path, content: bytes, arguments: tuple[str, ...]
) -> None:
    path, picture = tmp_path / "x.mcap", tmp_path / "y.png"
    path.write_bytes(content)
    assert ctl("plot", str(path), "-o", str(picture), *arguments) == (
        0,
        f"drawn in {picture}\n",
        "",
    )
    assert picture.read_bytes().startswith(PNG)


def test_plot_draws_what_was_never_calibrated_and_never_moved(ctl: Ctl, tmp_path: Path) -> None:
    world = World(calibrated=False)
    world.tick()
    path = tmp_path / "x.mcap"
    path.write_bytes(to_mcap(read_memory(bytes(world.disk.memory)), "demand", "", 10**18))
    assert ctl("plot", str(path))[0] == 0
    assert (tmp_path / "x.png").read_bytes().startswith(PNG)


def test_what_is_drawn_is_what_was_recorded(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    dump = read(str(path))
    assert dump.about["cause"] == "motor_fault"
    opening = dump.column("opening_mm")
    assert opening[0] != opening[0]  # nothing was known in the first tick
    assert min(opening[100:]) == pytest.approx(40.0, abs=1.0)
    shown = [label.text for label in labels(dump.events, dump.ticks[-1]["monotonic_s"], -5.0)]
    assert any(text.startswith("open (job 3)") for text in shown)
    assert any(text.startswith("motor fault") for text in shown)


def test_an_object_that_moved_is_named_with_its_way_and_is_no_alarm() -> None:
    text = "the object gave way by 1.5 mm and is held again, at 48.5 mm"
    data = {"moved_mm": 1.49, "width_mm": 48.5}
    (label,) = labels([Happening(1.0, "object_moved", text, data)], 10.0, -10.0)
    assert (label.text, label.is_alarm) == ("object moved 1.5 mm", False)
    (other,) = labels([Happening(1.0, "object_moved", text, {})], 10.0, -10.0)
    assert other.text.startswith("the object gave way")


def test_labels_are_few_and_the_worst_gives_its_name() -> None:
    routine = [Happening(0.001 * n, "lease", "lease 1 taken", {}) for n in range(50)]
    fault = Happening(0.02, "motor", "motor: enabled -> fault", {"phase": "fault"})
    (label,) = labels([*routine, fault], 10.0, -10.0)
    assert (label.text, label.is_alarm) == ("motor fault  +1", True)
    many = [Happening(0.01 * n, "stop", f"stop {n}", {}) for n in range(1000)]
    assert len(labels(many, 10.0, -10.0)) < 50


@pytest.mark.parametrize("broken", [b"", b"no MCAP at all", "half"])
def test_a_file_that_is_no_dump_is_refused(
    ctl: Ctl, tmp_path: Path, content: bytes, broken: bytes | str
) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content[: len(content) // 2] if isinstance(broken, str) else broken)
    code, shown, error = ctl("plot", str(path))
    assert (code, shown) == (4, "")
    assert error.startswith(f"litegripctl: cannot draw {path}: ")
    assert not (tmp_path / "x.png").exists()


def test_a_file_that_is_not_there_is_named(ctl: Ctl, tmp_path: Path) -> None:
    code, _shown, error = ctl("plot", str(tmp_path / "no.mcap"))
    assert code == 4
    assert "no.mcap: No such file or directory" in error


@pytest.mark.parametrize("missing", ["mcap", "matplotlib"])
def test_without_the_libraries_it_says_what_to_install(
    ctl: Ctl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    for name in list(sys.modules):
        if name.startswith(("litegrip_client.ctl.plot", missing)):
            monkeypatch.delitem(sys.modules, name)

    class Absent:
        def find_spec(self, name: str, *_more: object) -> None:
            if name.partition(".")[0] == missing:
                raise ModuleNotFoundError(f"No module named {missing!r}", name=missing)

    monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])
    code, _shown, error = ctl("plot", str(tmp_path / "x.mcap"), "--json")
    assert code == 4
    text = f"plot needs the library {missing}, which is not installed"
    assert json.loads(_shown)["error"]["message"] == text
    code, _shown, error = ctl("plot", str(tmp_path / "x.mcap"))
    assert error == f"litegripctl: {text}\n  {sys.executable} -m pip install matplotlib mcap\n"
