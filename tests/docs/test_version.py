"""Programs, changelog and pages name one version."""

import re
from importlib.metadata import version
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client.ctl.main import main

ROOT = Path(__file__).resolve().parents[2]
VERSION = version("litegripd")


def test_the_changelog_has_it() -> None:
    headings = re.findall(r"^## \[([0-9.]+)\] - ", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert headings[0] == VERSION


@pytest.mark.parametrize("page", ["README.md", "docs/installation.md"])
def test_commands_of_the_pages_install_it(page: str) -> None:
    named = set(re.findall(r"litegripd-versions/([0-9.]+)", (ROOT / page).read_text("utf-8")))
    assert VERSION in named


def test_programs_print_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"litegripctl {VERSION}\n"
    assert litegrip_client.__version__ == VERSION
