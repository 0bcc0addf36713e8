"""The manual pages: what is in them, that their roff is right, and that they are installed."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import tomli

from litegrip_client.ctl.parser import EXIT_CODES
from tests.client.ctl_commands import every_command
from tests.client.ctl_terminal import ROOT

PAGES = sorted((ROOT / "man").iterdir())
CHECKERS = (
    ("mandoc", "-Tlint", "-Wwarning"),
    ("groff", "-man", "-ww", "-Tutf8", "-z"),
)


def text(name: str) -> str:
    return (ROOT / "man" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("checker", CHECKERS, ids=lambda one: one[0])
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_nothing_is_wrong_with_the_roff(checker: tuple[str, ...], page: Path) -> None:
    if shutil.which(checker[0]) is None:
        pytest.skip(f"{checker[0]} is not installed")
    done = subprocess.run([*checker, str(page)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_every_command_and_exit_code_is_described() -> None:
    page = text("litegripctl.1").replace("\\-", "-")
    headings = "\n".join(line for line in page.splitlines() if line.startswith(".SS "))
    for command in every_command():
        assert re.search(rf"^\.SS {re.escape(command)}( |$)", headings, re.MULTILINE), command
    codes = page.partition(".SH EXIT STATUS")[2].partition(".SH")[0]
    assert re.findall(r"^\\fB(\d+)", codes, re.MULTILINE) == [str(code) for code, _ in EXIT_CODES]


def test_every_page_is_installed() -> None:
    project = tomli.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    installed = {
        name: where
        for where, names in project["tool"]["setuptools"]["data-files"].items()
        for name in names
    }
    wanted = {f"man/{page.name}": f"share/man/man{page.suffix[1:]}" for page in PAGES}
    assert (installed, len(PAGES)) == (wanted, 5)
