"""Property tests play other examples at night, and the same ones otherwise."""

import re
from pathlib import Path

import pytest
from hypothesis import Phase, given
from hypothesis import strategies as st
from hypothesis.errors import InvalidArgument

from tests.properties import NIGHTLY, NIGHTLY_FACTOR, examples

HERE = Path(__file__).parent


def played(profile: str) -> list[int]:
    """Return what one test of whole numbers is given."""
    seen: list[int] = []

    @examples(30, profile, database=None, phases=[Phase.generate])
    @given(st.integers(0, 2**60))
    def look(number: int) -> None:
        seen.append(number)

    look()
    return seen


def test_examples_are_the_same_every_time_and_others_at_night() -> None:
    assert played("usual") == played("usual")
    assert len(set(played("usual"))) <= 30
    first, second = played(NIGHTLY), played(NIGHTLY)
    assert first != second
    assert len(first) > 30


def test_a_night_has_more_examples_and_as_many_steps() -> None:
    usual, nightly = (examples(40, name, stateful_step_count=30) for name in ("usual", NIGHTLY))
    assert (usual.max_examples, usual.derandomize) == (40, True)
    assert (nightly.max_examples, nightly.derandomize) == (40 * NIGHTLY_FACTOR, False)
    assert usual.stateful_step_count == nightly.stateful_step_count == 30
    assert usual.deadline is nightly.deadline is None


def test_the_form_is_chosen_by_a_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIPD_PROPERTIES", "nightly")
    assert not examples(1).derandomize
    monkeypatch.delenv("LITEGRIPD_PROPERTIES")
    assert examples(1).derandomize
    with pytest.raises(InvalidArgument):
        examples(1, "weekly")


def test_no_test_plays_the_same_examples_for_ever() -> None:
    """What fixes its examples itself has never seen others, at night neither."""
    fixed = [
        path.name
        for path in HERE.rglob("test_*.py")
        if re.search(r"derandomize\s*=\s*True", path.read_text(encoding="utf-8"))
    ]
    assert fixed == []
