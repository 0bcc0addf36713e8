"""claims.txt names the test of each sentence of docs/from-the-sdk.md, and of README on the SDK."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("claims.txt")

END_OF_SENTENCE = re.compile(r"(?<=[.?!])(?:\*\*)? (?=[A-Z`*\[])")
ITEM = re.compile(r"(- |\d\. )")


def paragraphs(text: str) -> Iterator[str]:
    """Return headings, paragraphs, items of lists and rows of tables, without blocks of code."""
    lines: list[str] = []
    text = re.sub(r"\n *```.*?```\n", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"\n\|.*\n\| ---.*\n", "\n", text)
    for line in [*text.splitlines(), ""]:
        stripped = line.strip()
        begins = not stripped or stripped[0] in "#|" or ITEM.match(stripped)
        if begins and lines:
            yield " ".join(lines)
            lines.clear()
        if stripped:
            lines.append(ITEM.sub("", stripped, count=1) if begins else stripped)


def sentences(paragraph: str) -> list[str]:
    if paragraph[0] in "#|":
        return [paragraph] if paragraph[0] == "|" else []
    return END_OF_SENTENCE.split(paragraph)


def claims() -> list[str]:
    page = (ROOT / "docs" / "from-the-sdk.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    return [
        *(one for part in paragraphs(page) for one in sentences(part)),
        *(one for part in paragraphs(readme) if "SDK" in part for one in sentences(part)),
    ]


def table() -> dict[str, list[str]]:
    """Return what stands indented below each claim: the names of tests, or a reason in brackets."""
    found: dict[str, list[str]] = {}
    claim = ""
    for line in TABLE.read_text(encoding="utf-8").splitlines():
        if line.startswith("    "):
            found[claim].append(line.strip())
        else:
            claim = line
            assert claim not in found, claim
            found[claim] = []
    return found


def test_every_claim_stands_in_the_table_word_for_word() -> None:
    assert len(claims()) > 150
    assert list(table()) == list(dict.fromkeys(claims()))


@cache
def functions_of(path: str) -> set[str]:
    tree = ast.parse((ROOT / "tests" / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_claim_has_tests_that_exist_or_a_reason() -> None:
    for claim, proofs in table().items():
        assert proofs, claim
        for proof in proofs:
            path, _, name = proof.partition("::")
            assert proof.startswith("(") or name in functions_of(path), proof


def test_most_claims_have_a_test() -> None:
    """A reason is for what is advice, or says what the SDK does or where something stands."""
    reasons = [proofs[0] for proofs in table().values() if proofs[0].startswith("(")]
    assert set(reasons) <= {"(advice)", "(of the SDK)", "(of the page)"}
    assert len(reasons) < len(table()) / 5
