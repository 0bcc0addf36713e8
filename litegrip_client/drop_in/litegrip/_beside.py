"""Whether another distribution has installed a package `litegrip` into the same folder."""

from __future__ import annotations

from pathlib import Path

DISTRIBUTION = "litegrip-compat"

_OWN = DISTRIBUTION.replace("-", "_")
_MARK = b"\nlitegrip/__init__.py,"


def check(folder: Path) -> None:
    """Raise `ImportError` if the files of two distributions are mixed in `folder`.

    Where this package is installed as its own distribution its records lie there, and others'.
    """
    if not any(folder.glob(f"{_OWN}-*.dist-info")):
        return
    for record in folder.glob("*.dist-info/RECORD"):
        name = record.parent.name
        if not name.startswith(f"{_OWN}-") and _MARK in b"\n" + record.read_bytes():
            other = name.removesuffix(".dist-info").rpartition("-")[0]
            raise ImportError(
                f"{DISTRIBUTION} and {other} both install the package litegrip, and have"
                f" overwritten each other: pip uninstall {other} {DISTRIBUTION}, then install the"
                " one that you want"
            )
