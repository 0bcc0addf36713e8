"""What is installed: the version, and whether Debian's package manager has brought it."""

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


def is_of_debian() -> bool:
    """Return True if a Debian package has brought this client: further ones come by apt."""
    from importlib.metadata import PackageNotFoundError, distribution  # noqa: PLC0415

    try:
        return (distribution(DISTRIBUTIONS[0]).read_text("INSTALLER") or "").strip() == "dpkg"
    except PackageNotFoundError:
        return False
