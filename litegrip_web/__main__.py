"""Runs `litegripd-web`, also as a module: python -m litegrip_web."""

import sys

EXIT_PACKAGES = 5
"""As of the daemon: systemd does not start again what lacks a package."""


def main() -> int:
    """Run it; return its exit code, or 5 where a package is missing."""
    try:
        from litegrip_web.main import main as serve  # noqa: PLC0415 - what it needs may be missing
    except ModuleNotFoundError as missing:
        from litegrip_client.ctl.install import requirement  # noqa: PLC0415 - an error

        package = (missing.name or "websockets").partition(".")[0]
        remedy = f"{sys.executable} -m pip install '{requirement(package)}'"
        sys.stderr.write(f"litegripd-web: {package} is not installed: {remedy}\n")
        return EXIT_PACKAGES
    return serve()


if __name__ == "__main__":
    sys.exit(main())
