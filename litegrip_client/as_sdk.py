"""Run a program of the vendor's SDK unchanged, with the package `litegrip` of this project.

    python -m litegrip_client.as_sdk script.py [ARGUMENT ...]
    python -m litegrip_client.as_sdk -m module [ARGUMENT ...]

It puts the folder `drop_in`, which has that package, first on the path: of this process, and by
PYTHONPATH of its children. In a program of one's own, before the first `import litegrip`:

    import litegrip_client.as_sdk; litegrip_client.as_sdk.install()

The distribution litegrip-compat installs the same package for all programs of an environment.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import runpy
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

FOLDER = str(Path(__file__).resolve().parent / "drop_in")
NAME = "litegrip"

_STARTERS = (__file__, runpy.__file__, "<frozen runpy>")
"""Whose lines stand before a program's: of this file, and of what runs it."""

_USAGE = "usage: python -m litegrip_client.as_sdk (SCRIPT | -m MODULE) [ARGUMENT ...]"


def install() -> None:
    """Let `import litegrip` find the package from now on, in children too; again does nothing.

    Raises `RuntimeError` when another one has been imported already.
    """
    loaded = sys.modules.get(NAME)
    if loaded is not None and Path(loaded.__file__ or "").resolve().parent.parent != Path(FOLDER):
        raise RuntimeError(f"{NAME} has been imported already, from {loaded.__file__}")
    # A child needs this package, too: it may be on the path of this process alone.
    ours = [FOLDER, str(Path(__file__).resolve().parent.parent)]
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    rest = [path for path in paths if path and path not in ours]
    os.environ["PYTHONPATH"] = os.pathsep.join([ours[0], *rest, ours[1]])
    if FOLDER not in sys.path:
        sys.path.insert(0, FOLDER)


def _show(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Show an error that ends the program as its own interpreter would: from its first line on."""
    while trace is not None and trace.tb_frame.f_code.co_filename in _STARTERS:
        trace = trace.tb_next
    sys.__excepthook__(kind, error.with_traceback(trace), trace)


def _is_there(module: str) -> bool:
    """Return True if a module is found; what its packages raise when they are imported passes."""
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        return False


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the script or module that the command line names, with its arguments."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not sys.flags.dev_mode:
        sys.excepthook = _show
    if given[:1] == ["-m"] and len(given) > 1:
        install()
        importlib.import_module(NAME)
        sys.argv = given[1:]
        sys.path.insert(1, str(Path.cwd()))
        if not _is_there(given[1]):
            sys.exit(f"there is no module {given[1]}\n{_USAGE}")
        runpy.run_module(given[1], run_name="__main__", alter_sys=True)
        return
    if given[:1] in (["-h"], ["--help"]):
        sys.stdout.write(f"{_USAGE}\n\n{(__doc__ or '').strip()}\n")
        return
    if not given or given[0].startswith("-"):
        sys.exit(_USAGE)
    if not Path(given[0]).exists():
        sys.exit(f"there is no script {given[0]}\n{_USAGE}")
    install()
    importlib.import_module(NAME)  # a script may put a checkout of the SDK first on its path
    sys.argv = given
    sys.path[0:1] = [FOLDER, str(Path(given[0]).resolve().parent)]
    runpy.run_path(given[0], run_name="__main__")


if __name__ == "__main__":
    main()
