"""The version of what is installed: the client alone, or the whole project."""

from __future__ import annotations

DISTRIBUTIONS = ("litegrip-client", "litegripd")
"""Those that can bring this package. Where the first is installed, the second asks for its version
(packaging/distributions.py); where it is not, the second was installed from the repository."""


def client_version() -> str:
    """Return the version of this client."""
    return installed_version(*DISTRIBUTIONS)


def installed_version(*names: str) -> str:
    """Return the first distribution's that is there; an uninstalled source tree has none."""
    from contextlib import suppress  # noqa: PLC0415 - seldom needed, as the next, which is slow
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    for name in names:
        with suppress(PackageNotFoundError):
            return version(name)
    return "0.0.0+source"
