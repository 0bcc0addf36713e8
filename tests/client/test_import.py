"""What importing the client brings in."""

import ast
import importlib
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import litegrip_client

ROOT = Path(__file__).resolve().parents[2]


def run(code: str, cache: Path, *options: str) -> str:
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(cache), "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(
        [sys.executable, *options, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def imported(first: str, cache: Path, before: str = "sys") -> dict[str, str]:
    """Return which modules a statement brings in behind an import, and their files."""
    code = (
        f"import sys, {before}; before = set(sys.modules); {first}\n"
        "for name in set(sys.modules) - before:\n"
        "    print(name, getattr(sys.modules[name], '__file__', None) or '', sep='\t')"
    )
    rows = (line.partition("\t") for line in run(code, cache).splitlines())
    return {name: path for name, _, path in rows}


def test_only_the_standard_library_is_imported(tmp_path: Path) -> None:
    names = imported(
        "import litegrip_client, litegrip_client.values.results, litegrip_client.line.feeds,"
        " litegrip_client.ctl.main",
        tmp_path,
    )
    roots = {name.partition(".")[0] for name in names}
    assert "litegrip_client" in roots
    assert roots - {"litegrip_client"} <= sys.stdlib_module_names


def test_no_file_of_a_site_directory_is_loaded_by_the_program(tmp_path: Path) -> None:
    site = sysconfig.get_path("purelib")
    paths = imported("import litegrip_client.ctl.main", tmp_path).values()
    assert not [path for path in paths if path.startswith(site)]


def test_a_python_that_is_too_old_is_named_before_anything_else_fails(tmp_path: Path) -> None:
    code = (
        "import sys; sys.version_info = (3, 8, 20)\n"
        "try: import litegrip_client\n"
        "except ImportError as error: print(error)"
    )
    told = "litegrip_client needs Python 3.10 or newer, this is 3.8.20\n"
    assert run(code, tmp_path) == told


def test_asyncio_is_imported_when_it_is_asked_for_and_not_before(tmp_path: Path) -> None:
    code = (
        "import importlib, pkgutil, sys, litegrip_client, litegrip_client.core as core\n"
        "litegrip_client.LiteGrip()\n"
        "for one in pkgutil.iter_modules(core.__path__, 'litegrip_client.core.'):\n"
        "    importlib.import_module(one.name)\n"
        "print('asyncio' in sys.modules)\n"
        "print(litegrip_client.aio.LiteGrip.__name__, 'asyncio' in sys.modules)"
    )
    assert run(code, tmp_path).splitlines() == ["False", "LiteGrip True"]


@pytest.mark.parametrize(
    "first",
    [
        "from litegrip_client import LiteGrip",
        "import litegrip_client.ctl.program, litegrip_client.ctl.commands.state",
    ],
)
def test_what_is_slow_to_import_is_not_imported(tmp_path: Path, first: str) -> None:
    slow = ("typing", "dataclasses", "inspect", "subprocess", "pathlib", "logging", "asyncio")
    code = f"import site, sys; {first}; print(*{{*{slow}}} & set(sys.modules))"
    assert run(code, tmp_path, "-S").split() == []


def test_importing_the_package_alone_imports_none_of_its_modules(tmp_path: Path) -> None:
    names = set(imported("import litegrip_client", tmp_path))
    assert names - {"__future__", "importlib", "warnings"} == {"litegrip_client"}


def test_the_first_line_of_a_program_imports_what_a_call_needs(tmp_path: Path) -> None:
    """What an import takes is what it imports: see `python -m bench.timing.startup`."""
    before = "json, socket, threading, contextlib, struct"
    names = imported("from litegrip_client import LiteGrip", tmp_path, before)
    assert {name for name in names if "litegrip" not in name} <= {
        *("__future__", "_weakrefset", "_warnings", "array", "errno", "grp", "importlib"),
        *("math", "select", "selectors", "stat", "warnings", "weakref"),
    }
    assert {name.removeprefix("litegrip_client.") for name in names if "litegrip" in name} == {
        *("litegrip_client", "core", "core.discovery", "core.session", "core.sockets"),
        *("line", "line.connection", "line.exchange"),
        *("threads", "threads.actions", "threads.blocking", "threads.gripper"),
        *("threads.sdk_gripper", "values", "values.checks", "values.error_table"),
        *("values.errors", "values.fields", "values.tracebacks", "values.warn"),
    }


def test_the_names_for_type_checkers_are_those_that_are_there() -> None:
    tree = ast.parse(Path(litegrip_client.__file__).read_text())
    (told,) = [
        node for node in tree.body if isinstance(node, ast.If) and "TYPE_" in ast.dump(node.test)
    ]
    imported = {
        alias.name: (node.module or "").removeprefix("litegrip_client.")
        for node in told.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported.pop("aio") == "litegrip_client"
    assert imported == litegrip_client._MODULE_OF
    assert {*imported, "__version__"} == set(litegrip_client.__all__)


def test_what_is_exported_is_there() -> None:
    renamed = {"GripperMode": "Control_Mode", "GripperParams": "DefaultParams"}
    for name in litegrip_client.__all__:
        value = getattr(litegrip_client, name)
        assert getattr(value, "__name__", name) == renamed.get(name, name)
    assert litegrip_client.__version__
    assert list(litegrip_client.CALIB_TEMPLATES) == ["normal", "reverse"]
    assert not hasattr(litegrip_client, "grasp")


def test_all_public_names_and_no_others_are_completed(tmp_path: Path) -> None:
    code = (
        "import rlcompleter, litegrip_client\n"
        "print(*(name for name in dir(litegrip_client) if name[0] != '_'))\n"
        "complete = rlcompleter.Completer(globals()).complete\n"
        "print(complete('litegrip_client.Connect', 0))\n"
        "print(*(name for name in dir(litegrip_client) if name[0] != '_'))"
    )
    before, completed, after = run(code, tmp_path).splitlines()
    public = {name for name in litegrip_client.__all__ if name[0] != "_"} | {"aio"}
    assert set(before.split()) == set(after.split()) == public
    assert completed.startswith("litegrip_client.ConnectError")


def test_a_copy_that_is_not_installed_has_the_version_of_a_source(tmp_path: Path) -> None:
    code = (
        "import importlib.metadata as m\n"
        "def missing(name): raise m.PackageNotFoundError(name)\n"
        "m.version = missing\n"
        "import litegrip_client\n"
        "print(litegrip_client.__version__)"
    )
    assert run(code, tmp_path).strip() == "0.0.0+source"


@pytest.mark.parametrize(
    "module",
    ["errors", "results", "calibration", "motion_config", "trajectory", "core.discovery"],
)
def test_former_places_of_modules_have_the_same_names(module: str) -> None:
    room = "" if "." in module else "values."
    now = importlib.import_module(f"litegrip_client.{room}{module}")
    former = importlib.import_module(f"litegrip_client.{module.rpartition('.')[2]}")
    own = {
        name: one
        for name, one in vars(now).items()
        if name in getattr(now, "__all__", vars(now))
        and name[0] != "_"
        and getattr(one, "__module__", None) == now.__name__
    }
    assert own
    assert all(getattr(former, name) is one for name, one in own.items())
