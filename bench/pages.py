"""Write the tables that benches in virtual time print into the pages that have them.

python -m bench.pages

A table stands in the place of the one with the same head, the second of two such in that of the
second. The sentences around it are a person's: read them again. The tables are the same on every
machine.
"""

import contextlib
import functools
import io
from collections.abc import Callable
from pathlib import Path

from bench.jaws import damaged, grasps, holding, presses, touch, trajectories, worst
from bench.teleop import lossy

DOCS = Path(__file__).parents[1] / "docs"
PAGES: dict[str, tuple[Callable[[], None], ...]] = {
    "grasping": (holding.main,),
    "grasping-reasons": (holding.main,),
    "generated/grasping-figures": (grasps.main, holding.main, touch.main),
    "pressing": (presses.main,),
    "generated/pressing-figures": (presses.main, worst.main, damaged.main),
    "generated/teleoperation-figures": (lossy.main,),
    "trajectories": (trajectories.following,),
}


@functools.cache
def printed(bench: Callable[[], None]) -> str:
    """Return what a bench prints."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        bench()
    return text.getvalue()


def tables(lines: list[str]) -> dict[tuple[str, int], tuple[int, int]]:
    """Return where each table begins and ends, by its head and how many had the same before it."""
    found: dict[tuple[str, int], tuple[int, int]] = {}
    head = None
    for number, line in enumerate([*lines, ""]):
        if line.startswith("|"):
            head = (line, number) if head is None else head
        elif head is not None:
            count = sum(text == head[0] for text, _ in found)
            found[head[0], count], head = (head[1], number), None
    return found


def with_tables(page: str, text: str) -> str:
    """Return a page with the tables of `text`; one that it does not have is left out."""
    fresh = text.splitlines()
    lines = page.splitlines()
    for head, (first, last) in tables(fresh).items():
        place = tables(lines).get(head)
        if place is not None:
            lines[slice(*place)] = fresh[first:last]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the pages, and name those that have changed."""
    for name, benches in PAGES.items():
        path = DOCS / f"{name}.md"
        page = path.read_text(encoding="utf-8")
        new = page
        for bench in benches:
            new = with_tables(new, printed(bench))
        if new != page:
            path.write_text(new, encoding="utf-8")
            print(f"{path.name} has changed")


if __name__ == "__main__":
    main()
