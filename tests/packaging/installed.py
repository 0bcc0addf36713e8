"""Tells whether packages are installed that a test needs."""

import re
from importlib.metadata import PackageNotFoundError, version


def has(*packages: str) -> bool:
    """Return True if all are there; `name>=77` looks at the first number of the version."""
    for package in packages:
        name, _, least = package.partition(">=")
        try:
            found = version(name)
        except PackageNotFoundError:
            return False
        if least and int(re.split(r"\D", found)[0]) < int(least):
            return False
    return True
