"""Ten scripts as users of the SDK write them run unchanged, by the alias `litegrip`."""

import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from litegrip_client import as_sdk
from tests.drop_in import Daemon, Site
from tests.sdk_compat.trajectories import push, teach

SCRIPTS = Path(__file__).resolve().parent / "scripts"


@pytest.fixture(autouse=True)
def _the_alias(monkeypatch: pytest.MonkeyPatch, site: Site) -> Iterator[None]:
    """Let `import litegrip` find the client, and give scripts the site's time."""
    clock = SimpleNamespace(
        time=lambda: site.now_s,
        monotonic=lambda: site.now_s,
        sleep=site.run,
    )
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    as_sdk.install()
    monkeypatch.setitem(sys.modules, "time", clock)
    yield
    for name in [name for name in sys.modules if name.partition(".")[0] == as_sdk.NAME]:
        del sys.modules[name]


@pytest.fixture
def daemon(site: Site) -> Daemon:
    return site.add(Daemon())


def nothing(_site: Site, _daemon: Daemon) -> None:
    """Let the script run by itself."""


def an_object(_site: Site, daemon: Daemon) -> None:
    daemon.gripper.put_object(width_mm=30.0)


def a_hand(site: Site, daemon: Daemon) -> None:
    push(site, daemon, (1.0, 0.4), (3.0, -0.4), (6.0, 0.0))


def a_fault(site: Site, daemon: Daemon) -> None:
    site.when(
        lambda: daemon.state.mode == "moving" and daemon.gripper.opening_mm < 50.0,
        lambda: daemon.gripper.latch_fault(0xE),
    )


CASES: dict[str, tuple[Callable[[Site, Daemon], None], list[str]]] = {
    "pick_loop": (an_object, ["0 True True", "1 True True", "2 True True"]),
    "wait_for_ready": (nothing, ["enabled True", "at 20"]),
    "manual_calibration": (a_hand, ["travel 1.7 86"]),
    "poll_loop": (nothing, ["  40.0 mm ", "rows "]),
    "zero_gravity": (nothing, ["holding True"]),
    "stiff_moves": (nothing, ["done 26"]),
    "recorder": (teach, ["refused: TrajectoryRecorder", "samples 200 2", "frames True"]),
    "udp_follower": (nothing, ["True ", " 3"]),
    "config_objects": (nothing, ["normal 10.0", "1.0"]),
    "error_codes": (
        a_fault,
        ["not enabled", "value: ParameterError", "fault: OVERLOAD overload", "cleared True True"],
    ),
}


def test_there_are_ten() -> None:
    assert {path.stem for path in SCRIPTS.glob("*.py")} == set(CASES)
    assert len(CASES) == 10


@pytest.mark.parametrize("name", CASES)
def test_a_script_runs_as_it_stands(
    site: Site, daemon: Daemon, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    before, printed = CASES[name]
    before(site, daemon)
    runpy.run_path(str(SCRIPTS / f"{name}.py"), run_name="__main__")
    shown = capsys.readouterr().out
    for words in printed:
        assert words in shown
    assert "missed" not in shown
    assert "failed" not in shown
    site.run(0.2)
    assert not daemon.is_energised  # the end of a script disables, as in the SDK


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "litegrip_client.as_sdk", *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=SCRIPTS.parents[2],
    )


def test_the_command_runs_a_script_with_its_arguments(tmp_path: Path) -> None:
    script = tmp_path / "mine.py"
    script.write_text(
        "import sys, litegrip, beside\n"
        "from litegrip.motion import MotionConfig\n"
        "from litegrip import *\n"
        "print(__name__, sys.argv[1:], LiteGrip is litegrip.LiteGrip, beside.HERE)\n"
        "print(MotionConfig())\n"
    )
    (tmp_path / "beside.py").write_text("HERE = 7\n")
    done = run(str(script), "--speed", "3")
    assert done.stdout.startswith("__main__ ['--speed', '3'] True 7\nMotionConfig(")
    assert (done.returncode, done.stderr) == (0, "")


def test_the_command_says_how_it_is_used(tmp_path: Path) -> None:
    for arguments in ((), ("--help",), (str(tmp_path / "none.py"),)):
        done = run(*arguments)
        assert done.returncode == 1
        assert "usage: python -m litegrip_client.as_sdk SCRIPT" in done.stderr


def test_a_name_that_the_sdk_has_not_is_missed_as_of_any_module() -> None:
    import litegrip  # noqa: PLC0415

    with pytest.raises(ImportError, match="nothing_like_it"):
        from litegrip import nothing_like_it  # noqa: F401, PLC0415
    assert not hasattr(litegrip, "nothing_like_it")
    assert litegrip.__version__
