"""Tables as the pages in `docs/` have them."""

from collections.abc import Iterable


def line(cells: list[str]) -> str:
    return "|" + "".join(f" {cell} |" if cell else " |" for cell in cells)


def table(title: str, head: Iterable[str], rows: Iterable[list[str]]) -> None:
    """Print a table, each row as soon as it is known."""
    names = list(head)
    print(f"### {title}\n")
    for cells in (names, ["---"] * len(names)):
        print(line(cells))
    for row in rows:
        print(line(row), flush=True)
    print()
