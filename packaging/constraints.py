"""Writes etc/constraints.txt: the versions of all libraries with which the tests have passed.

    python packaging/constraints.py

They are those of the running environment: `make nightly` writes them when it has passed. Needs the
package packaging.
"""

import sys
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "etc/constraints.txt"
FOR_WORK_ON_IT = "dev"
"""The extra that no user installs."""
_HEAD = """\
# The versions with which all tests have passed, on Python {major}.{minor}; written by
# packaging/constraints.py. To install exactly these: pip install -c etc/constraints.txt .
"""


def tested() -> dict[str, str]:
    """Return the version of each library that the project or one of its extras brings to users.

    Raises `PackageNotFoundError` where one is not installed.
    """
    found: dict[str, str] = {}
    extras = metadata.metadata("litegripd").get_all("Provides-Extra") or []
    left = [("litegripd", extra) for extra in ("", *extras) if extra != FOR_WORK_ON_IT]
    seen = set(left)
    while left:
        name, extra = left.pop()
        if name != "litegripd":
            found[name] = metadata.version(name)
        for row in metadata.requires(name) or ():
            needed = Requirement(row)
            if needed.marker is not None and not needed.marker.evaluate({"extra": extra}):
                continue
            for one in ("", *needed.extras):
                step = (canonicalize_name(needed.name), one)
                if step not in seen:
                    seen.add(step)
                    left.append(step)
    return found


def text() -> str:
    """Return the content of the file."""
    head = _HEAD.format(major=sys.version_info.major, minor=sys.version_info.minor)
    rows = [f"{name}=={version}\n" for name, version in sorted(tested().items())]
    return head + "".join(rows)


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
