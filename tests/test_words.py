"""The pages are written in words that every reader knows."""

import pytest

from tests.words import NEVER, found_in, lines_with, pages, read


@pytest.mark.parametrize("page", pages())
def test_a_page_has_none_of_the_words_that_it_can_do_without(page: str) -> None:
    text = read(page)
    found = [f"{word}: {line}" for word in NEVER for line in lines_with(text, word)]
    assert found == []
    assert not +found_in(text, tuple(NEVER))


def test_a_word_is_found_where_a_line_ends_and_in_no_other_word() -> None:
    text = "It goes\non, and tells. An amendment is retold to whoever is_told."
    assert +found_in(text, tuple(NEVER)) == {"go on": 1, "tell": 1, "whoever": 1}
    assert list(lines_with(text, "go on")) == [(1, "It goes")]
