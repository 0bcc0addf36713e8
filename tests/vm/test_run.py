"""What `tests/vm/run` would boot for a scene; no machine is booted here."""

import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.vm import adapters, debian, knocking, socketcan, systemd

RUN = Path(__file__).with_name("run")
SOCKETCAN = "bash tests/vm/socketcan.sh"
SYSTEMD, ADAPTERS, KNOCKING, DEBIAN = (
    f"bash tests/vm/installed.sh {suite}" for suite in ("systemd", "adapters", "knocking", "debian")
)


def run(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run it with a machine that only prints what it is to run, and without wheels."""
    return subprocess.run(
        [str(RUN), *arguments],
        env={**os.environ, "PYTHON": "true", "RUN_IN_VM": "echo", **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def booted(done: "subprocess.CompletedProcess[str]") -> list[str]:
    """Return what each machine was to run."""
    return [f"bash {line.partition(' bash ')[2]}" for line in done.stdout.splitlines()]


@pytest.mark.parametrize(
    ("suite", "scenes", "boots"),
    [
        ("socketcan", socketcan.SCENES, [SOCKETCAN]),
        ("systemd", systemd.FIRST, [f"{SYSTEMD} 1"]),
        ("systemd", systemd.SECOND, [f"{SYSTEMD} 1", f"{SYSTEMD} 2"]),
        ("adapters", adapters.FIRST, [f"{ADAPTERS} 1"]),
        ("knocking", knocking.SCENES, [f"{KNOCKING} 1"]),
        ("adapters", adapters.SECOND, [f"{ADAPTERS} 1", f"{ADAPTERS} 2"]),
    ],
)
def test_each_scene_is_found_in_its_suite(
    suite: str, scenes: Sequence[Callable[[], None]], boots: list[str]
) -> None:
    names = [scene.__name__ for scene in scenes]
    done = run(suite, *names)
    assert (done.returncode, done.stderr) == (0, "")
    assert booted(done) == [" ".join([boot, *names]) for boot in boots]


def test_the_packages_may_have_been_built_before(tmp_path: Path) -> None:
    (tmp_path / "litegripd_0.1.0-1_all.deb").touch()
    names = [scene.__name__ for scene in debian.SCENES]
    done = run("debian", *names, PACKAGES=str(tmp_path))
    assert (done.returncode, done.stderr) == (0, "")
    assert booted(done) == [" ".join([f"{DEBIAN} 1", *names])]


def test_packages_for_another_release_are_not_tried() -> None:
    done = run("debian", VM_RELEASE="no-such-release")
    assert (done.returncode, done.stdout) == (0, "")
    assert "debian was not run" in done.stderr


def test_a_scene_alone_finds_its_suite() -> None:
    assert booted(run("restart_while_holding")) == [f"{SOCKETCAN} restart_while_holding"]
    assert booted(run("killed")) == [f"{SYSTEMD} 1 killed"]


@pytest.mark.parametrize(
    ("arguments", "missing"),
    [
        (("no_such_scene",), "no_such_scene"),
        (("vcan_works", "no_such_scene"), "no_such_scene"),
        (("check_motions",), "check_motions"),
        (("socketcan", "killed"), "killed"),
        (("systemd", "killed", "vcan_works"), "vcan_works"),
    ],
)
def test_what_no_suite_has_is_an_error(arguments: tuple[str, ...], missing: str) -> None:
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"no scene is named {missing};" in done.stderr
