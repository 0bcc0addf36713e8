"""What importing the client brings in, and how long it takes."""

import importlib
import os
import statistics
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import litegrip_client
from tests.client.helpers import processor_time_of_children_s

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 0.045


def run(code: str, cache: Path) -> str:
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(cache), "PYTHONPATH": str(ROOT)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def test_only_the_standard_library_is_imported(tmp_path: Path) -> None:
    code = (
        "import sys; before = set(sys.modules); import litegrip_client, "
        "litegrip_client.values.results, litegrip_client.line.feeds, litegrip_client.ctl.main; "
        "print(*sorted({name.partition('.')[0] for name in set(sys.modules) - before}))"
    )
    names = set(run(code, tmp_path).split())
    assert "litegrip_client" in names
    assert names - {"litegrip_client"} <= sys.stdlib_module_names


def test_no_file_of_a_site_directory_is_loaded_by_the_program(tmp_path: Path) -> None:
    code = (
        "import sys; before = set(sys.modules); import litegrip_client.ctl.main; "
        "print(*(getattr(sys.modules[n], '__file__', None) or '' "
        "for n in set(sys.modules) - before), sep='\\n')"
    )
    site = sysconfig.get_path("purelib")
    assert not [path for path in run(code, tmp_path).splitlines() if path.startswith(site)]


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


def test_what_is_slow_to_import_is_not_imported(tmp_path: Path) -> None:
    code = (
        "import sys; from litegrip_client import LiteGrip; "
        "print(*sorted({'typing', 'dataclasses', 'inspect', 'subprocess'} & set(sys.modules)))"
    )
    assert run(code, tmp_path).split() == []


def test_importing_is_quick(tmp_path: Path) -> None:
    """The figure stands in the message; a machine that is busy gets three chances."""

    def seconds(code: str) -> float:
        before_s = processor_time_of_children_s()
        run(code, tmp_path)
        return processor_time_of_children_s() - before_s

    run("import litegrip_client", tmp_path)
    figures = []
    for _ in range(3):
        turns = [(seconds("import litegrip_client"), seconds("pass")) for _ in range(7)]
        figures.append(statistics.median(one - bare for one, bare in turns))
        if figures[-1] < LIMIT_S:
            break
    assert min(figures) < LIMIT_S, f"import litegrip_client takes {figures} s"


def test_what_is_exported_is_there() -> None:
    renamed = {"GripperMode": "Control_Mode", "GripperParams": "DefaultParams"}
    for name in litegrip_client.__all__:
        value = getattr(litegrip_client, name)
        assert getattr(value, "__name__", name) == renamed.get(name, name)
    assert litegrip_client.__version__
    assert list(litegrip_client.CALIB_TEMPLATES) == ["normal", "reverse"]
    assert not hasattr(litegrip_client, "grasp")


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
