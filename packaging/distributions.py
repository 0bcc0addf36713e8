"""Builds the distributions that people can take one of, wheel and sdist of each, into dist/.

    python packaging/distributions.py [--no-isolation] [DIRECTORY]

Needs the packages build and shtab. pyproject.toml declares all of them at once, as one project;
here is only what each takes of it. The same sources make the same bytes: times in the archives are
SOURCE_DATE_EPOCH, or that of the last commit; where there is no git, that of pyproject.toml.
"""

import argparse
import gzip
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

from docs.completion import completion_script  # noqa: E402
from docs.manual import write_pages  # noqa: E402

TOML = Path("pyproject.toml")


@dataclass(frozen=True)
class Distribution:
    """What one distribution takes of the project; names are those of its tables."""

    package: str
    description: str
    dependencies: tuple[str, ...] = ()
    """Names of requirements, of the project or of its extras."""
    extras: tuple[str, ...] = ()
    takes: dict[str, str] = field(default_factory=dict)
    """Extras that are requirements of the same version: `web` is litegrip-web."""
    needs: tuple[str, ...] = ()
    """Other distributions, of the same version."""
    pages: tuple[str, ...] = ()
    folder: str = ""
    """Where its package lies, if not beside the others."""


CLIENT = "litegrip-client"
DISTRIBUTIONS = {
    CLIENT: Distribution(
        "litegrip_client",
        "Use a LiteGrip gripper through litegripd; needs only the standard library",
        extras=("metrics", "plot", "watch"),
        pages=("litegripctl.1",),
    ),
    "litegripd": Distribution(
        "litegripd",
        "A daemon that owns a LiteGrip gripper's CAN bus and lets many processes use it",
        dependencies=("eclipse-zenoh", "mcap", "python-can", "tomli"),
        extras=("mujoco",),
        takes={
            "fleet": "litegrip-fleet",
            "metrics": f"{CLIENT}[metrics]",
            "plot": f"{CLIENT}[plot]",
            "watch": f"{CLIENT}[watch]",
            "web": "litegrip-web",
        },
        needs=(CLIENT,),
        pages=("litegripd.8", "litegrip-sim.1"),
    ),
    "litegrip-web": Distribution(
        "litegrip_web",
        "A page in the browser for LiteGrip grippers that litegripd drives",
        dependencies=("websockets",),
        needs=(CLIENT,),
        pages=("litegripd-web.8",),
    ),
    "litegrip-fleet": Distribution(
        "litegrip_fleet",
        "LiteGrip grippers of other machines: gateway and portal over zenoh",
        dependencies=("eclipse-zenoh", "tomli"),
        needs=(CLIENT,),
        pages=("litegripd-fleet.8",),
    ),
    "litegrip-compat": Distribution(
        "litegrip",
        "The package litegrip of the gripper's SDK, for grippers that litegripd drives",
        needs=(CLIENT,),
        folder="litegrip_client/drop_in",
    ),
}


def tables(name: str, whole: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a distribution's pyproject.toml, from those of the whole project."""
    one, project, tools = DISTRIBUTIONS[name], whole["project"], whole["tool"]["setuptools"]
    version = project["version"]
    extras = project["optional-dependencies"]
    shipped = [row for extra, rows in extras.items() if extra != "dev" for row in rows]
    rows = {_name(row): row for row in (*project["dependencies"], *shipped)}
    made = {
        **{key: project[key] for key in ("version", "readme", "license", "license-files")},
        **{key: project[key] for key in ("requires-python", "keywords", "classifiers")},
        "name": name,
        "description": one.description,
        "dependencies": [
            *(f"{need}=={version}" for need in one.needs),
            *(rows[need] for need in one.dependencies),
        ],
        "optional-dependencies": {
            **{extra: extras[extra] for extra in one.extras},
            **{extra: [f"{needed}=={version}"] for extra, needed in one.takes.items()},
        },
        "scripts": _inside(one.package, project["scripts"]),
        "entry-points": {
            group: rows
            for group, every in project["entry-points"].items()
            if (rows := _inside(one.package, every))
        },
    }
    data: dict[str, list[str]] = {}
    for page in one.pages:
        data.setdefault(f"share/man/man{page[-1]}", []).append(f"man/{page}")
    return {
        "build-system": {
            "requires": [row for row in whole["build-system"]["requires"] if "setup" in row],
            "build-backend": whole["build-system"]["build-backend"],
        },
        "project": made,
        "tool": {
            "setuptools": {
                "script-files": [
                    row for row in tools["script-files"] if row.startswith(f"{one.package}/")
                ],
                "packages": {"find": {"include": [f"{one.package}*"]}},
                "package-data": {one.package: tools["package-data"][one.package]},
                "data-files": data,
            }
        },
    }


def _inside(package: str, entries: dict[str, str]) -> dict[str, str]:
    """Return the entries that lead into a package."""
    return {name: where for name, where in entries.items() if where.startswith(f"{package}.")}


def _name(requirement: str) -> str:
    found = re.match(r"[\w.-]+", requirement)
    assert found, requirement  # noqa: S101 - pyproject.toml is this project's own
    return found[0]


def as_toml(table: dict[str, Any], above: str = "") -> Iterator[str]:
    """Make the lines of a table: JSON's texts and lists of texts are TOML's as well."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict)}
    if above:
        yield f"[{above}]"
    for key, value in table.items():
        if key not in inner:
            yield f"{json.dumps(key)} = {json.dumps(value, ensure_ascii=False)}"
    for key, value in inner.items():
        yield from as_toml(value, f"{above}.{json.dumps(key)}" if above else json.dumps(key))


def lay(name: str, tree: Path) -> None:
    """Lay the sources of a distribution, complete: links are files, what is made is made."""
    one = DISTRIBUTIONS[name]
    skipped = shutil.ignore_patterns("__pycache__", "litegripctl.*")
    shutil.copytree(ROOT / one.folder / one.package, tree / one.package, ignore=skipped)
    for file in ("README.md", "LICENSE"):
        shutil.copy(ROOT / file, tree)
    write_pages(tree / "man", one.pages)
    if name == CLIENT:
        for shell in ("bash", "zsh", "fish"):
            script = tree / f"litegrip_client/data/litegripctl.{shell}"
            script.write_text(completion_script(shell), encoding="utf-8")
    whole = tomllib.loads((ROOT / TOML).read_text(encoding="utf-8"))
    (tree / TOML).write_text("\n".join(as_toml(tables(name, whole))) + "\n", encoding="utf-8")
    manifest = f"recursive-include man *\nrecursive-include {one.package} *\n"
    (tree / "MANIFEST.in").write_text(manifest, encoding="utf-8")
    for path in tree.rglob("*"):  # not those of who checked the sources out
        path.chmod(0o755 if path.is_dir() or os.access(path, os.X_OK) else 0o644)


def equalise(sdist: Path, epoch: int) -> None:
    """Write an sdist again, with nothing in it of when, where and by whom it was built."""
    inner = io.BytesIO()
    with (
        tarfile.open(sdist) as was,
        tarfile.open(fileobj=inner, mode="w", format=tarfile.PAX_FORMAT) as tar,
    ):
        for member in sorted(was.getmembers(), key=lambda one: one.name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = epoch, 0, 0, "", ""
            member.pax_headers = {}
            tar.addfile(member, was.extractfile(member) if member.isfile() else None)
    with sdist.open("wb") as out, gzip.GzipFile("", "wb", fileobj=out, mtime=epoch) as packed:
        packed.write(inner.getvalue())


def epoch_s() -> int:
    """Return the time that the archives' files get."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    command = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    try:
        return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    except (FileNotFoundError, subprocess.CalledProcessError):  # an archive of the sources
        return int((ROOT / "pyproject.toml").stat().st_mtime)


def build(name: str, folder: Path, options: list[str]) -> None:
    """Build the sdist of a distribution, and, from what is in it, the wheel."""
    epoch = epoch_s()
    with tempfile.TemporaryDirectory() as work:
        tree, made = Path(work, name), Path(work, "made")
        lay(name, tree)
        command = [sys.executable, "-m", "build", *options, "--outdir", str(made), str(tree)]
        environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch)}
        environment.pop("PYTHONPATH", None)
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{name} could not be built:\n{done.stdout}{done.stderr}")
        for file in sorted(made.iterdir()):
            if file.name.endswith(".tar.gz"):
                equalise(file, epoch)
            shutil.copy(file, folder)
            sys.stdout.write(f"{folder / file.name}\n")


def main() -> None:
    """Build all of them."""
    parser = argparse.ArgumentParser(description="Build the distributions.")
    parser.add_argument("directory", nargs="?", type=Path, default=ROOT / "dist")
    parser.add_argument("--no-isolation", action="store_true", help="use the setuptools of here")
    given = parser.parse_args()
    os.umask(0o022)
    given.directory.mkdir(parents=True, exist_ok=True)
    for name in DISTRIBUTIONS:
        build(name, given.directory, ["--no-isolation"] if given.no_isolation else [])


if __name__ == "__main__":
    main()
