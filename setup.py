"""Builds what needs a program to be made: completion for shells. All else is in pyproject.toml."""

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildWithCompletion(build_py):
    """Builds the packages, and the scripts by which shells complete litegripctl.

    An editable installation gets none: there, `litegripctl completion` makes them.
    """

    def run(self) -> None:
        """Build them."""
        super().run()
        if self.editable_mode:
            return
        sys.path.insert(0, str(ROOT))
        from docs.completion import completion_script  # noqa: PLC0415 - needs what is built

        for shell in ("bash", "zsh", "fish"):
            script = Path(self.build_lib) / f"litegrip_client/data/litegripctl.{shell}"
            script.write_text(completion_script(shell), encoding="utf-8")


setup(cmdclass={"build_py": BuildWithCompletion})
