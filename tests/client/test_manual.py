"""The manual pages: what is in them, that their roff is right, and what making them needs."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from docs.manual import PAGES, write_pages
from litegrip_client.ctl.parser import EXIT_CODES
from tests.client.ctl_commands import every_command
from tests.client.ctl_terminal import ROOT

CHECKERS = (
    ("mandoc", "-Tlint", "-Wwarning"),
    ("groff", "-man", "-ww", "-Tutf8", "-z"),
)


@pytest.mark.parametrize("checker", CHECKERS, ids=lambda one: one[0])
@pytest.mark.parametrize("name", PAGES)
def test_nothing_is_wrong_with_the_roff(
    checker: tuple[str, ...], name: str, tmp_path: Path
) -> None:
    if shutil.which(checker[0]) is None:
        pytest.skip(f"{checker[0]} is not installed")
    (page,) = write_pages(tmp_path, [name])
    done = subprocess.run([*checker, str(page)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_every_command_and_exit_code_is_described() -> None:
    page = PAGES["litegripctl.1"]().replace("\\-", "-")
    headings = "\n".join(line for line in page.splitlines() if line.startswith(".SS "))
    for command in every_command():
        assert re.search(rf"^\.SS {re.escape(command)}( |$)", headings, re.MULTILINE), command
    codes = page.partition(".SH EXIT STATUS")[2].partition(".SH")[0]
    assert re.findall(r"^\\fB(\d+)", codes, re.MULTILINE) == [str(code) for code, _ in EXIT_CODES]


@pytest.mark.skipif(sys.version_info < (3, 11), reason="tomllib is of the library since 3.11")
def test_the_pages_are_made_where_nothing_is_installed(tmp_path: Path) -> None:
    command = [sys.executable, "-S", "-m", "docs.manual", str(tmp_path / "man")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    made = {page.name: page.read_text(encoding="utf-8") for page in (tmp_path / "man").iterdir()}
    assert made.keys() == PAGES.keys()
    assert made["litegripd-fleet.8"] == PAGES["litegripd-fleet.8"]()


def test_make_puts_every_page_where_man_looks_for_it() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    made = re.findall(r"docs\.manual \$\(VENV\)/share/man/man(\d) (.+)", makefile)
    assert sorted(name for _, names in made for name in names.split()) == sorted(PAGES)
    assert all(name.endswith(f".{number}") for number, names in made for name in names.split())
