"""The distributions that people can take one of: built, compared, and used by themselves."""

import os
import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest
import tomli
from packaging.requirements import Requirement

from docs.manual import PAGES
from tests.packaging.installed import has

ROOT = Path(__file__).parents[2]
VERSION = tomli.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
NAMES = ("litegrip_client", "litegrip_compat", "litegrip_fleet", "litegrip_web", "litegripd")
PACKAGES = {"litegrip_compat": ("litegrip_client/drop_in/", "litegrip")}
"""Where a distribution's package lies, if not beside the others, and its name."""
EPOCH = "1700000000"

pytestmark = [
    pytest.mark.timeout(300),
    pytest.mark.skipif(not has("build", "setuptools>=77", "shtab"), reason="needs what builds"),
]


def run(*command: str | Path, **variables: str) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, **variables}
    environment.pop("PYTHONPATH", None)
    return subprocess.run(
        [*map(str, command)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        cwd="/",
    )


def built(folder: Path, umask: str) -> Path:
    script = ROOT / "packaging/distributions.py"
    line = f'umask {umask}; exec "$0" "$@"'
    command = ("sh", "-c", line, sys.executable, script, "--no-isolation", folder)
    done = run(*command, SOURCE_DATE_EPOCH=EPOCH)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("distributions"), "022")


def wheel(folder: Path, name: str) -> zipfile.ZipFile:
    return zipfile.ZipFile(folder / f"{name}-{VERSION}-py3-none-any.whl")


def requirements(folder: Path, name: str) -> set[str]:
    text = wheel(folder, name).read(f"{name}-{VERSION}.dist-info/METADATA").decode()
    rows = [line.partition(": ")[2] for line in text.split("\n") if line.startswith("Requires-D")]
    return {row for row in rows if "extra ==" not in row}


def test_the_same_sources_make_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    again = built(tmp_path, "077")
    files = sorted(path.name for path in folder.iterdir())
    kinds = ("-py3-none-any.whl", ".tar.gz")
    assert files == sorted(f"{name}-{VERSION}{kind}" for name in NAMES for kind in kinds)
    for file in files:
        assert (folder / file).read_bytes() == (again / file).read_bytes(), file


def test_sources_without_git_have_a_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    script = runpy.run_path(str(ROOT / "packaging/distributions.py"))
    monkeypatch.setitem(script["epoch_s"].__globals__, "ROOT", tmp_path)
    (tmp_path / "pyproject.toml").touch()
    os.utime(tmp_path / "pyproject.toml", (int(EPOCH), int(EPOCH)))
    assert script["epoch_s"]() == int(EPOCH)


def test_each_module_is_in_one_wheel_and_each_file_of_the_client_in_both_of_its(
    folder: Path,
) -> None:
    for name in NAMES:
        place, package = PACKAGES.get(name, ("", name))
        tracked = run("git", "-C", ROOT, "ls-files", place + package).stdout.split()
        modules = {path.removeprefix(place) for path in tracked if path.endswith(".py")}
        inside = set(wheel(folder, name).namelist())
        assert {path for path in inside if path.endswith(".py")} == modules
    needed = {
        *(
            f"data/{kind}/{path.name}"
            for kind in ("etc", "systemd")
            for path in (ROOT / kind).iterdir()
        ),
        *(f"data/litegripctl.{shell}" for shell in ("bash", "zsh", "fish")),
        "data/normal.json",
        "data/reverse.json",
    }
    inside = set(wheel(folder, "litegrip_client").namelist())
    assert {f"litegrip_client/{path}" for path in needed} <= inside
    assert "litegripd/sim/scene.xml" in wheel(folder, "litegripd").namelist()
    with tarfile.open(folder / f"litegrip_client-{VERSION}.tar.gz") as sdist:
        members = {one.name for one in sdist.getmembers() if one.isfile()}
    assert {f"litegrip_client-{VERSION}/litegrip_client/{path}" for path in needed} <= members


MANUAL: dict[str, set[str]] = {
    "litegrip_client": {"man1/litegripctl.1"},
    "litegrip_compat": set(),
    "litegrip_fleet": {"man8/litegripd-fleet.8"},
    "litegrip_web": {"man8/litegripd-web.8"},
    "litegripd": {"man1/litegrip-sim.1", "man8/litegripd.8"},
}


def manual_of(wheel: zipfile.ZipFile) -> set[str]:
    return {path.partition("/share/man/")[2] for path in wheel.namelist() if "/share/man/" in path}


def test_each_page_of_the_manual_is_in_one_wheel(folder: Path) -> None:
    assert {name: manual_of(wheel(folder, name)) for name in NAMES} == MANUAL


def test_the_whole_project_has_the_manual_and_what_completes_commands(tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    for name in run("git", "-C", ROOT, "ls-files").stdout.split():
        if not name.startswith(("tests/", "bench/")) and (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tree / name, follow_symlinks=False)
    pip = (sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation")
    done = run(*pip, "--wheel-dir", tmp_path, tree)
    assert done.returncode == 0, done.stderr
    whole = wheel(tmp_path, "litegripd")
    assert manual_of(whole) == set().union(*MANUAL.values())
    for shell in ("bash", "zsh", "fish"):
        assert f"litegrip_client/data/litegripctl.{shell}" in whole.namelist()
    installed = whole.read(f"litegripd-{VERSION}.data/data/share/man/man8/litegripd.8").decode()
    assert installed == PAGES["litegripd.8"]()


def test_the_client_needs_nothing_and_the_others_need_it_in_their_version(folder: Path) -> None:
    assert requirements(folder, "litegrip_client") == set()
    for name in set(NAMES) - {"litegrip_client"}:
        assert f"litegrip-client=={VERSION}" in requirements(folder, name)
    taken = set().union(*(requirements(folder, name) for name in NAMES))
    project = tomli.loads((ROOT / "pyproject.toml").read_text())["project"]
    rows = {*project["dependencies"], *project["optional-dependencies"]["web"]}
    others = {Requirement(row) for row in taken if not row.startswith("litegrip")}
    assert {(one.name, one.specifier) for one in others} == {
        (one.name, one.specifier) for one in map(Requirement, rows)
    }


@pytest.mark.skipif(not has("twine"), reason="needs twine")
def test_an_index_would_take_them(folder: Path) -> None:
    done = run(sys.executable, "-m", "twine", "check", "--strict", *folder.iterdir())
    assert done.returncode == 0, done.stdout


def environment(folder: Path, place: Path, package: str) -> Path:
    """Make an environment with a package and what that needs, and nothing else."""
    assert run(sys.executable, "-m", "venv", place).returncode == 0
    pip = (place / "bin/python", "-m", "pip", "install", "--no-index", "--find-links", folder)
    done = run(*pip, package)
    assert done.returncode == 0, done.stderr
    return place


@pytest.fixture(scope="module")
def alone(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the programs of an environment that has the client and nothing else."""
    return environment(folder, tmp_path_factory.mktemp("alone"), "litegrip-client") / "bin"


def test_the_client_works_alone(alone: Path) -> None:
    assert run(alone / "litegripctl", "--version").stdout == f"litegripctl {VERSION}\n"
    code = "import litegrip_client as c; print(c.__version__, c.LiteGrip.__name__)"
    assert run(alone / "python", "-c", code).stdout == f"{VERSION} LiteGrip\n"
    for shell in ("bash", "zsh", "fish"):
        assert "litegripctl" in run(alone / "litegripctl", "completion", shell).stdout
    checked = run(alone / "litegripctl", "-c", "nosuch0", "doctor")
    assert checked.returncode == 1
    assert "litegripd nosuch0" in checked.stdout


MISSING: Mapping[str, tuple[tuple[str, ...], str]] = {
    "fleet": (("fleet",), "-m pip install litegrip-fleet"),
    "daemon": (("install-units", "--root", "/nonexistent"), "there is no program litegripd in"),
}


@pytest.mark.parametrize("case", MISSING)
def test_the_client_says_what_is_missing(alone: Path, case: str) -> None:
    arguments, said = MISSING[case]
    done = run(alone / "litegripctl", *arguments, PATH="/usr/bin:/bin")
    assert done.returncode != 0
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def compat(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the environment of a robot's program: the SDK's package, and the client by itself."""
    return environment(folder, tmp_path_factory.mktemp("compat"), "litegrip-compat")


def test_the_package_of_the_sdk_works_with_the_client_alone(compat: Path) -> None:
    code = "import litegrip as g; print(g.__version__, g.LiteGrip('x').load_template('normal'))"
    done = run(compat / "bin/python", "-c", code)
    assert (done.stdout, done.stderr) == (f"{VERSION} True\n", "")


def test_it_is_refused_beside_another_package_of_that_name(compat: Path) -> None:
    (site,) = compat.glob("lib/python3*/site-packages")
    other = site / "another_sdk-1.2.dist-info"
    other.mkdir()
    try:
        (other / "RECORD").write_text("another/x.py,,\nlitegrip/__init__.py,sha256=x,7\n")
        done = run(compat / "bin/python", "-c", "import litegrip")
        assert done.returncode == 1
        assert "pip uninstall another_sdk litegrip-compat" in done.stderr.splitlines()[-1]
    finally:
        (other / "RECORD").unlink()
        other.rmdir()
