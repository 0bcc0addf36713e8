"""What users get: the requirements of the project and of its extras but for the work on it."""

import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parents[2]


def of_users() -> list[str]:
    """Return the rows of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    return list(project["dependencies"]) + [
        row for name in extras if name != "dev" for row in extras[name]
    ]
