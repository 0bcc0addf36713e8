"""Makes docs/generated/sdk-compat.md: `python -m tests.sdk.table`.

The rows are the specification's names. A name that the package lacks, or whose members differ, is
an error here, not a row; what is refused is tried, and the row has what the refusal says.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

from litegrip_client import as_sdk

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "generated" / "sdk-compat.md"

_HEAD = """# The SDK's names, in the package litegrip

Made by `python -m tests.sdk.table` from `tests/sdk/specification.toml`, which the tests compare
with the package name by name, and `tests/sdk/differences.toml`. "as there" is what those tests
found. [from-the-sdk.md](../from-the-sdk.md) says what a program has to do.

"""


def read(name: str) -> dict[str, Any]:
    """Return one of the two files beside this one."""
    return tomllib.loads((HERE / f"{name}.toml").read_text(encoding="utf-8"))


def found(path: str) -> Any:
    """Return what the package has by a name, without the package's own; raises AttributeError."""
    have: Any = importlib.import_module("litegrip")
    for part in path.split("."):
        have = getattr(have, part, None) or importlib.import_module(f"{have.__name__}.{part}")
    return have


def refusal(path: str, member: str) -> str:
    """Use a member that is refused; return what to do instead, by its own words."""
    kind = found(path)
    made = kind(*[None] * {"GripperTeleop": 4, "TrajectoryPlayer": 2}.get(kind.__name__, 1))
    arguments = [None] * {"set_id_filter": 1, "add_id_filter": 1, "send": 2, "send_multi": 3}.get(
        member, 0
    )
    try:
        getattr(made, member)(*arguments)
    except found("CommandError") as error:
        return str(error).partition("instead: ")[2]
    raise AssertionError(f"{path}.{member} is not refused")


def rows() -> list[tuple[str, str]]:
    """Return each name and what it is here."""
    specified, differences = read("specification"), read("differences")
    other, refused = differences["other"], differences["refused"]
    names: list[str] = []
    for module, listed in specified["modules"].items():
        place = module.removeprefix("litegrip").removeprefix(".")
        names += [f"{place}.{name}" if place else name for name in listed.split()]
    for path, members in specified["signatures"].items():
        of = path.removeprefix("litegrip.")
        names += [f"{of}.{name}" for name in members if name != "__init__"]
    for path, members in specified["properties"].items():
        of = path.removeprefix("litegrip.")
        names += [f"{of}.{name}" for name in members.split() if f"{of}.{name}" not in names]
    unknown = {*other, *refused} - {*names}
    assert not unknown, f"no such names in the specification: {sorted(unknown)}"
    made: list[tuple[str, str]] = []
    for name in names:
        if name in refused:
            made.append((f"`{name}`", "can be imported and made; its members are refused:"))
            made += [
                (f"`{name}.{member}`", f"refused; instead: {refusal(name, member)}")
                for member in refused[name]
            ]
        else:
            made.append((f"`{name}`", f"other way: {other[name]}" if name in other else "as there"))
    return made


def page() -> str:
    """Return the page."""
    lines = [f"| {name} | {what} |" for name, what in rows()]
    return _HEAD + "| name | here |\n| --- | --- |\n" + "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.path.insert(0, as_sdk.FOLDER)
    PAGE.write_text(page(), encoding="utf-8")
