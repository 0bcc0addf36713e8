"""The film at the top of the README: it is one, and does not keep a reader waiting."""

import re
from pathlib import Path

from PIL import Image, ImageSequence

ROOT = Path(__file__).parents[2]
MOST_BYTES = 1_500_000


def test_the_readme_begins_with_a_film_of_the_page() -> None:
    found = re.search(r"^!\[.+\]\((.+)\)$", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE)
    assert found is not None
    path = ROOT / found[1]
    assert path.stat().st_size < MOST_BYTES
    with Image.open(path) as film:
        lasts_ms = [frame.info["duration"] for frame in ImageSequence.Iterator(film)]
    assert len(lasts_ms) > 30
    assert 5_000 < sum(lasts_ms) < 20_000
