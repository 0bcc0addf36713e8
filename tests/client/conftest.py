import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import LiteGrip, Trajectory
from litegrip_client.ctl.main import main
from tests.client.fake_daemon import FakeDaemon
from tests.client.helpers import Ctl
from tests.client.rig import Asyncio, Bench, Heard, Kind, Threads, a_bench, run_ctl


@pytest.fixture(autouse=True)
def _no_daemon_of_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LITEGRIPD_SOCKET", raising=False)
    monkeypatch.delenv("LITEGRIP_CHANNEL", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "xdg"))


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a home without calibrations, so that those of this machine do not matter."""
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    path = tmp_path / "home"
    path.mkdir()
    monkeypatch.setenv("HOME", str(path))
    return path


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    with FakeDaemon(tmp_path / "can0.sock") as daemon:
        yield daemon


@pytest.fixture(params=[Threads, Asyncio], ids=["threads", "asyncio"])
def kind(request: pytest.FixtureRequest, site: Bench | None) -> Iterator[Kind]:
    kind: Kind = request.param(site)
    yield kind
    kind.close()


@pytest.fixture
def tasks(site: Bench | None) -> Iterator[Asyncio]:
    """Return a program whose tasks go on beside each other."""
    kind = Asyncio(site)
    yield kind
    kind.close()


@pytest.fixture
def gripper(daemon: FakeDaemon) -> Iterator[LiteGrip]:
    with LiteGrip(socket_path=daemon.path) as gripper:
        yield gripper


@pytest.fixture
def ctl(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Ctl:
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)

    def run(*arguments: str) -> tuple[int, str, str]:
        code = main(list(arguments))
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def site(home: Path) -> Iterator[Bench]:
    """Return a machine in virtual time."""
    with a_bench(home) as site:
        yield site


@pytest.fixture
def heard(site: Bench) -> Iterator[Heard]:
    """Return the daemon of a calibrated gripper there, on can0; the motor is disabled."""
    daemon = Heard()
    site.add(daemon)
    yield daemon
    assert all(stream.hung_up for stream in daemon.streams), "a connection is left open"


@pytest.fixture
def litegripctl(capsys: pytest.CaptureFixture[str]) -> Ctl:
    return run_ctl(capsys)


@pytest.fixture
def on_a_terminal(litegripctl: Ctl) -> Ctl:
    """Return litegripctl with its standard output at a terminal."""

    def run(*arguments: str) -> tuple[int, str, str]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sys.stdout.isatty", lambda: True)
            return litegripctl(*arguments)

    return run


@pytest.fixture
def hide(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str], None]:
    """Return what takes a library away, and the module of the client that has imported it."""

    def hide(library: str, user: str) -> None:
        class Absent:
            def find_spec(self, name: str, *_more: object) -> None:
                if name.partition(".")[0] == library:
                    raise ModuleNotFoundError(f"No module named {library!r}", name=library)

        for name in list(sys.modules):
            if name.partition(".")[0] == library or name.startswith(user):
                monkeypatch.delitem(sys.modules, name)
        package, _, module = user.rpartition(".")
        monkeypatch.delattr(sys.modules[package], module, raising=False)
        monkeypatch.setattr(sys, "meta_path", [Absent(), *sys.meta_path])

    return hide


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Trajectory]:
    """Return the trajectories that are drawn from now on."""
    pytest.importorskip("matplotlib")
    from litegrip_client.ctl.plot import drawing  # noqa: PLC0415 - needs the extra

    trajectories: list[Trajectory] = []
    draw = drawing.draw_trajectory

    def noting(trajectory: Trajectory, name: str) -> Any:
        trajectories.append(trajectory)
        return draw(trajectory, name)

    monkeypatch.setattr(drawing, "draw_trajectory", noting)
    return trajectories
