"""Builds what needs a program to be made: completion and manual. All else is in pyproject.toml."""

import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent


class BuildWithTexts(build_py):
    """Builds the packages, the scripts by which shells complete litegripctl, and the manual pages.

    An editable installation gets none: there, `litegripctl completion` makes the scripts.
    """

    def run(self) -> None:
        """Build them."""
        super().run()
        if self.editable_mode:
            return
        sys.path.insert(0, str(ROOT))
        from docs.completion import completion_script  # noqa: PLC0415 - need what is built
        from docs.manual import write_pages  # noqa: PLC0415

        library = Path(self.build_lib)
        for shell in ("bash", "zsh", "fish"):
            script = library / f"litegrip_client/data/litegripctl.{shell}"
            script.write_text(completion_script(shell), encoding="utf-8")
        self.distribution.data_files = [
            (f"share/man/man{page.suffix[1:]}", [str(page)])
            for page in write_pages(library.parent / "man")
        ]


setup(cmdclass={"build_py": BuildWithTexts})
