"""Run a script of the vendor's SDK unchanged: `python -m litegrip_client.as_sdk script.py ...`.

`import litegrip`, and what a script imports of it, then finds the names of `litegrip_client`. In a
program of one's own, before the first import of `litegrip`:

    import litegrip_client.as_sdk; litegrip_client.as_sdk.install()
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import runpy
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import litegrip_client

NAME = "litegrip"
_MODULES = {
    f"{NAME}.{module}"
    for module in (
        *("actions", "calibration", "config", "errors", "exceptions", "gripper", "motion"),
        *("teleop", "trajectory", "types", "units"),
    )
}
"""Modules of the package that a script may import from; each has all names."""
_USAGE = "usage: python -m litegrip_client.as_sdk SCRIPT [ARGUMENT ...]"


class _Alias(ModuleType):
    """The SDK's package, or any module of it: it has the names of `litegrip_client`."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__version__":
            raise AttributeError(name)
        try:
            return getattr(litegrip_client, name)
        except AttributeError:
            text = f"module {self.__name__!r} has no attribute {name!r} (it is litegrip_client)"
            raise AttributeError(text) from None


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the package and its modules, before a package of that name that is installed."""

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None = None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != NAME and fullname not in _MODULES:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        module = _Alias(spec.name)
        module.__dict__["__all__"] = list(litegrip_client.__all__)
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing: the names come when they are asked for."""


def install() -> None:
    """Let `import litegrip` find `litegrip_client` from now on; a second call does nothing.

    Raises `RuntimeError` when the SDK itself has been imported already.
    """
    loaded = sys.modules.get(NAME)
    if loaded is not None and not isinstance(loaded, _Alias):
        raise RuntimeError(f"{NAME} has been imported already, from {loaded.__file__}")
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the script that the command line names, with its arguments."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or given[0].startswith("-"):
        sys.exit(_USAGE)
    if not Path(given[0]).exists():
        sys.exit(f"there is no script {given[0]}\n{_USAGE}")
    install()
    sys.argv = given
    sys.path[0] = str(Path(given[0]).resolve().parent)
    runpy.run_path(given[0], run_name="__main__")


if __name__ == "__main__":
    main()
