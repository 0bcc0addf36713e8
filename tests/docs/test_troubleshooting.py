"""The table from the symptom to the command: each row is what the doctor says of such facts."""

import re

import pytest

from tests.client.doctor.test_checks import BY_NAME, CASES
from tests.docs.test_pages import text_of

PAGE = text_of("docs/troubleshooting.md")
TABLE = PAGE.partition("## From the symptom to the command")[2].partition("\n## ")[0]
ROW = re.compile(r"\| (?P<symptom>.+?) \| (?P<level>ERROR|WARNING) (?P<check>[\w-]+): (?P<says>.+?)"
                 r" \| (?P<does>.+) \|")  # fmt: skip
ROWS = [found.groupdict() for found in map(ROW.fullmatch, TABLE.splitlines()) if found]


def shown(text: str) -> str:
    """Return a text of the doctor as the table has it: of the usual channel, for Markdown."""
    return text.replace("litegripctl -c can0 ", "litegripctl ").replace("|", "\\|")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['check']}: {row['says'][:30]}")
def test_the_doctor_says_so_and_gives_that_command(row: dict[str, str]) -> None:
    found = [
        finding
        for case in CASES
        if case.check == row["check"]
        and (finding := BY_NAME[case.check](case.facts)) is not None
        and finding.level == row["level"].lower()
        and row["says"] in shown(finding.text)
    ]
    assert found
    commands = re.findall(r"`([^`]+)`", row["does"])
    words = re.sub(r"(; then )?`[^`]+`", "", row["does"])
    assert commands or words
    assert any(
        [shown(finding.command)] == commands if finding.command and commands else not commands
        for finding in found
    )
    assert any(words in shown(finding.advice or "") for finding in found)


def test_whatever_a_check_finds_has_a_row() -> None:
    assert len(ROWS) == TABLE.count("\n| ") - 2  # the head, and the line below it
    assert {row["check"] for row in ROWS} == BY_NAME.keys()


def test_each_mode_of_a_link_has_a_row() -> None:
    told = {row["says"].partition(" is on")[0] for row in ROWS if row["check"] == "modes"}
    modes = {case.facts.system.link.modes for case in CASES if case.check == "modes"
             and case.level in ("error", "warning") and case.facts.system.link}  # fmt: skip
    assert told == {mode[0].lower() for mode in modes if len(mode) == 1}
