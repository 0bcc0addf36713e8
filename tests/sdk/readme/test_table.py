"""docs/generated/sdk-sentences.md names a test for every sentence, and every test in here."""

import ast
import re
from pathlib import Path

HERE = Path(__file__).parent
TABLE = HERE.parents[2] / "docs" / "generated" / "sdk-sentences.md"
SECTIONS = (
    "Quick start",
    "Reverse mounts and two grippers on one machine",
    "Leader/follower teleoperation",
    "Trajectory record and replay",
    "The six actions",
    "Progress reporting",
    "Tuning: MotionConfig",
    "Results",
    "How the motion works",
    "Torque, force and safety",
    "Migrating from the 2.2.0 API",
    "Code blocks",
)


def rows() -> list[list[str]]:
    """Return the cells of every row that is neither a head nor a rule."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if line.startswith("|")
    ]
    return [row for row in cells if row[0] not in ("sentence", "---")]


def named() -> set[str]:
    """Return the tests that the table names; one of another package with its path."""
    return {name for row in rows() for name in re.findall(r"`([\w/]+\.py::test_\w+)`", row[1])}


def functions_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_named_test_exists_and_every_test_is_named() -> None:
    here = {
        f"{path.name}::{name}"
        for path in HERE.glob("test_*.py")
        for name in functions_of(path)
        if path.name != Path(__file__).name and name.startswith("test_")
    }
    elsewhere = {name for name in named() if "/" in name}
    assert len(here) > 90
    assert named() - elsewhere == here
    for name in elsewhere:
        file, _, function = name.partition("::")
        assert function in functions_of(HERE.parents[2] / file), name


def test_every_section_has_its_table_in_the_documents_order() -> None:
    text = TABLE.read_text(encoding="utf-8")
    heads = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert tuple(heads) == SECTIONS
    for part in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        assert len(re.findall(r"^\| .+ \| `[\w/]*test_", part, re.MULTILINE)) >= 5


def test_every_row_has_a_sentence_and_a_test_or_a_reason_why_not() -> None:
    for row in rows():
        assert len(row) == 3, row
        sentence, tests, note = row
        assert sentence
        if tests == "—":
            assert note, sentence
        else:
            assert re.fullmatch(r"(`[\w/]+\.py::test_\w+` ?)+", tests), tests
