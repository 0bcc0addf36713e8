"""The pages, and what the daemon says, are written in words that every reader knows."""

import pytest

from tests.words import NEVER, found_in, lines_with, pages, read, sentences, spoken


@pytest.mark.parametrize("page", pages())
def test_a_page_has_none_of_the_words_that_it_can_do_without(page: str) -> None:
    text = read(page)
    found = [f"{word}: {line}" for word in NEVER for line in lines_with(text, word)]
    assert found == []
    assert not +found_in(text, tuple(NEVER))


@pytest.mark.parametrize("name", spoken())
def test_the_daemon_says_none_of_the_words_that_it_can_do_without(name: str) -> None:
    said = list(sentences(read(name)))
    assert [(line, text) for line, text in said if +found_in(text, tuple(NEVER))] == []


def test_descriptions_and_refusals_and_the_fixed_parts_of_formatted_ones_are_sentences() -> None:
    source = '"""Tell it."""\nx = Method("a.b", "Tell"\n " all.")\nlog(f"{x} goes on: {y}")\n'
    assert list(sentences(source)) == [(2, "Tell all."), (4, " goes on: ")]
    said = "\n".join(text for name in spoken() for _line, text in sentences(read(name)))
    for text in ("Report the daemon's health.", "clear it with stop.clear", "jaws press with"):
        assert text in said


def test_a_word_is_found_where_a_line_ends_and_in_no_other_word() -> None:
    text = "It goes\non, and tells. An amendment is retold to whoever is_told."
    assert +found_in(text, tuple(NEVER)) == {"go on": 1, "tell": 1, "whoever": 1}
    assert list(lines_with(text, "go on")) == [(1, "It goes")]
