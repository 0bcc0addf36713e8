"""What an installation brings: each library that users get is named with its licence."""

import re
import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]


def test_every_library_of_users_is_named_with_a_licence() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    rows = project["dependencies"] + [
        row for name in extras if name != "dev" for row in extras[name]
    ]
    libraries = {re.split(r"[^\w-]", row)[0] for row in rows}
    assert len(libraries) >= 8
    page = (ROOT / "docs/installation.md").read_text(encoding="utf-8").replace("\n", " ")
    for library in libraries:
        assert re.search(rf"\b{library} \([^)]+\)", page), library
