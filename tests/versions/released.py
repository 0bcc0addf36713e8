"""Released versions, as their wheels in `tests/released` have them, and what each can be asked."""

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

WHEELS = Path(__file__).parents[1] / "released"
RELEASED = tuple(sorted({file.name.split("-")[1] for file in WHEELS.glob("*.whl")}))

SINCE: Mapping[str, str] = {"cancel": "0.2.0", "latest": "0.2.0", "move_to": "0.2.0"}
"""By a step's name, or by a command line of `tests/client/ctl_commands.py`: the version that
brought the call, where that is later than the first. It is not tried with versions before."""

_PRINT_DOCUMENT = """\
import sys
from litegripd.app.build import encoded_document
from litegripd.model.gripper import DM4310
sys.stdout.buffer.write(encoded_document(DM4310, simulated=True))
"""


@dataclass(frozen=True)
class Release:
    """A version that is unpacked in a folder."""

    version: str
    folder: Path

    def environment(self) -> dict[str, str]:
        """Return an environment in which Python finds this version before any other."""
        return {**os.environ, "PYTHONPATH": str(self.folder)}


def is_later(name: str, version: str) -> bool:
    """Return True for a step or a command line that a version does not have yet."""
    since = SINCE.get(name)
    return since is not None and _order(version) < _order(since)


def unpacked(version: str, folder: Path) -> Release:
    """Unpack daemon and client of a version."""
    wheels = sorted(WHEELS.glob(f"*-{version}-*.whl"))
    assert [wheel.name.split("-")[0] for wheel in wheels] == ["litegrip_client", "litegripd"]
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    return Release(version, folder)


@cache
def document(version: str) -> dict[str, Any]:
    """Return the OpenRPC document of a version's daemon."""
    with TemporaryDirectory() as folder:
        release = unpacked(version, Path(folder))
        command = [sys.executable, "-c", _PRINT_DOCUMENT]
        environment = release.environment()
        done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def parameters(of: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the methods of a document, and of each its parameters by name."""
    return {row["name"]: {one["name"]: one for one in row["params"]} for row in of["methods"]}


def choices(parameter: Mapping[str, Any]) -> list[str]:
    """Return what a parameter may name; empty if it is no choice."""
    schema = parameter["schema"]
    found: list[str] = schema.get("items", schema).get("enum", [])
    return found


def _order(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))
