"""Count the words that a reader stumbles over, in each room of the code and in each page.

python -m tests.words [WORD]

With a word of the table, list the lines that have it. CONTRIBUTING.md says which words take its
place. A part of a longer name, as in `test_told_twice`, does not count. A generated page has the
words of the code that it is made from, so it counts apart.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from docs.generate import GENERATED

ROOT = Path(__file__).parent.parent
CODE = (
    "litegripd",
    "litegrip_client",
    "litegrip_fleet",
    "litegrip_web",
    "tests",
    "bench",
    "docs",
    "examples",
)
FROM_CODE = {generated.path for generated in GENERATED} | {"docs/generated/faults.md"}
NOT_READ = {"tests/words.py", "tests/test_words.py", "litegrip_client/values/error_table.py"}

NEVER = {
    "anew": r"anew",
    "go on": r"(?:go|goes|going|gone|went) on",
    "mend": r"mend(?:s|ed|ing)?",
    "so much": r"so much",
    "such as": r"such as",
    "tell": r"tell(?:s|ing)?",
    "told": r"told",
    "unfaulting": r"unfaulting",
    "unfit": r"unfit",
    "unfree": r"unfree",
    "unsettled": r"unsettled",
    "whoever": r"whoever",
}
"""Words that a page can always do without."""

SELDOM = {
    "errand": r"errands?",
    "fares": r"fares?",
    "order": r"orders?",
    "rest": r"rests?",
    "shall": r"shall",
    "should it": r"should (?:it|they)",
    "whether": r"whether",
    "wish": r"wish(?:es|ed)?",
}
"""Words that have a good use, and many that are not good."""

PATTERNS = {
    word: re.compile(rf"\b(?:{pattern})\b", re.IGNORECASE)
    for word, pattern in (NEVER | SELDOM).items()
}


def pages() -> list[str]:
    """Return the pages that are written by hand."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]
    return sorted(set(map(name_of, found)) - FROM_CODE)


def sources() -> list[str]:
    """Return the files of code."""
    found = (path for folder in CODE for path in (ROOT / folder).rglob("*.py"))
    return sorted(set(map(name_of, found)) - NOT_READ)


def spoken() -> list[str]:
    """Return the files of code whose sentences the daemon says."""
    return [name for name in sources() if name.startswith("litegripd/")]


def sentences(source: str) -> Iterator[tuple[int, str]]:
    """Give the line and the text of each string of a module that has words; no docstring.

    Of a formatted string that are its fixed parts. Strings that are written side by side are one.
    """
    tree = ast.parse(source)
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or id(node) in docstrings:
            continue
        if isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value


def name_of(path: Path) -> str:
    """Return a file's path below the root."""
    return str(path.relative_to(ROOT))


def room_of(name: str) -> str:
    """Return the room of a file: its page, or the first two folders."""
    parts = Path(name).parts
    if name.endswith(".md"):
        return "generated pages" if name in FROM_CODE else name
    return "/".join(parts[:-1][:2])


def found_in(text: str, words: tuple[str, ...] = tuple(PATTERNS)) -> Counter[str]:
    """Return how often each word is in a text; a line's end counts as a space."""
    flat = re.sub(r"\s+", " ", text)
    return Counter({word: len(PATTERNS[word].findall(flat)) for word in words})


def lines_with(text: str, word: str) -> Iterator[tuple[int, str]]:
    """Give the number and the text of each line where a word begins."""
    lines = text.splitlines()
    for number, line in enumerate(lines, 1):
        following = lines[number].strip() if number < len(lines) else ""
        first = PATTERNS[word].search(f"{line} {following}")
        if first and first.start() < len(line):
            yield number, line.strip()


def read(name: str) -> str:
    """Return a file's text."""
    return (ROOT / name).read_text(encoding="utf-8")


def main() -> None:
    """Print the table, or the lines with one word."""
    names = [*pages(), *sorted(name for name in FROM_CODE if name.endswith(".md")), *sources()]
    if len(sys.argv) > 1:
        for name in names:
            for number, line in lines_with(read(name), sys.argv[1]):
                print(f"{name}:{number}: {line}")
        return
    rooms: dict[str, Counter[str]] = {}
    for name in names:
        rooms.setdefault(room_of(name), Counter()).update(found_in(read(name)))
    print(f"{'':30}", *(f"{word:>{len(word) + 1}}" for word in PATTERNS))
    total: Counter[str] = Counter()
    for room, counts in sorted(rooms.items()):
        print(row(room, counts))
        total.update(counts)
    print(row("in total", total))


def row(room: str, counts: Counter[str]) -> str:
    """Return a line of the table."""
    return " ".join(
        (f"{room:30}", *(f"{counts[word] or '':>{len(word) + 1}}" for word in PATTERNS))
    )


if __name__ == "__main__":
    main()
