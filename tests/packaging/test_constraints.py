"""The versions with which the tests have passed, for installations that want exactly those."""

from runpy import run_path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.packaging.requirements import ROOT, of_users


def _pinned() -> dict[str, str]:
    rows = (ROOT / "etc/constraints.txt").read_text(encoding="utf-8").splitlines()
    return dict(row.split("==") for row in rows if not row.startswith("#"))


def test_each_library_of_users_is_pinned_within_its_bounds() -> None:
    """But for one that Python has by itself where the tests ran."""
    needed = [Requirement(row) for row in of_users()]
    pinned = _pinned()
    judged = 0
    for one in needed:
        if one.marker is None:
            assert one.specifier.contains(pinned[canonicalize_name(one.name)]), one
            judged += 1
    assert judged >= 8


def test_the_file_is_what_its_program_writes_of_an_environment() -> None:
    """Whatever versions are here today: the same form, and nothing that only work on it needs."""
    written = run_path(str(ROOT / "packaging/constraints.py"))["text"]()
    names = [row.partition("==")[0] for row in written.splitlines() if not row.startswith("#")]
    assert names == sorted(names)
    assert {"python-can", "pyserial", "eclipse-zenoh", "websockets", "rich"} <= set(names)
    assert not {"litegripd", "pytest", "mypy", "ruff", "hypothesis", "setuptools"} & set(names)
    for row in written.splitlines()[2:]:
        Requirement(row)
