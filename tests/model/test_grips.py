"""The file of taught grips: what is written reads back, what is damaged is refused."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.trajectory_format import (
    MAX_GRIP_BYTES,
    MOST_FORCE_N,
    MOST_GRIPS,
    TaughtGrip,
    check_grips,
    grips_of,
    pack_grips,
    unpack_grips,
)
from tests.mutations import MUTATIONS, mutated

DIGEST = "ab" * 32
GRIPS = (
    TaughtGrip(0.25, 0.5, 1.25, 0.5, 60.0, 8.0, "motion.grasp by demo"),
    TaughtGrip(1.25, 1.25, 2.75, 0.4, 48.125, 12.5, "motion.set_force by demo"),
)

finite = st.floats(allow_nan=False, allow_infinity=False)
any_grips = st.lists(
    st.builds(
        lambda times, *others: TaughtGrip(*sorted(times), *others),
        st.tuples(finite, finite, finite),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1e300),
        st.floats(5e-324, MOST_FORCE_N),
        st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=80),
    ),
    max_size=5,
).map(tuple)


@given(any_grips)
def test_what_is_written_reads_back_to_the_bit(grips: tuple[TaughtGrip, ...]) -> None:
    assert unpack_grips(pack_grips(grips, DIGEST), DIGEST) == grips


def test_the_most_grips_with_the_longest_figures_fit_into_the_file() -> None:
    third = 1 / 3 * 1e-300
    grip = TaughtGrip(-third, -third, -third, third, third, third, '"' * 80)
    assert len(pack_grips((grip,) * MOST_GRIPS, DIGEST)) <= MAX_GRIP_BYTES


def test_the_file_says_what_it_is() -> None:
    content = json.loads(pack_grips(GRIPS, DIGEST))
    head = {"format": "litegrip-grips", "version": 1, "lgt_sha256": DIGEST}
    assert {key: content[key] for key in content.keys() - {"grips"}} == head


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"format": "other"}, "no file of grips"),
        ({"more": 1}, "no file of grips"),
        ({"version": 2}, "version 2"),
        ({"version": True}, "version True"),
        ({"version": None}, "version None"),
        ({"lgt_sha256": "cd" * 32}, "another .lgt"),
        ({"lgt_sha256": 5}, "another .lgt"),
        ({"grips": None}, "must be an array"),
        ({"grips": {}}, "must be an array"),
        ({"grips": [{}] * (MOST_GRIPS + 1)}, "at most 200"),
        ({"grips": [[]]}, "grip 0 is no object"),
        ({"grips": [{}]}, "grip 0 is no object"),
    ],
)
def test_a_wrong_file_is_refused_with_its_reason(changes: dict[str, Any], why: str) -> None:
    content = {**json.loads(pack_grips(GRIPS, DIGEST)), **changes}
    with pytest.raises(TrajectoryFormatError, match=why):
        unpack_grips(json.dumps(content).encode(), DIGEST)


def test_a_key_that_is_there_twice_is_refused() -> None:
    content = pack_grips(GRIPS, DIGEST).replace(b'"version": 1', b'"version": 1, "version": 1')
    with pytest.raises(TrajectoryFormatError, match="twice"):
        unpack_grips(content, DIGEST)


def test_grips_lie_between_the_samples_one_after_the_other() -> None:
    check_grips(GRIPS, 0.25, 2.75)
    for first_s, last_s in ((0.26, 2.75), (0.25, 2.74)):
        with pytest.raises(TrajectoryFormatError, match=r"grip [01]"):
            check_grips(GRIPS, first_s, last_s)
    with pytest.raises(TrajectoryFormatError, match="grip 1: closing_s"):
        check_grips((GRIPS[1], GRIPS[0]), 0.0, 5.0)


def test_cut_off_at_any_byte_it_is_refused() -> None:
    content = pack_grips(GRIPS, DIGEST)
    for length in range(len(content) - 1):  # the last one ends the last line
        with pytest.raises(TrajectoryFormatError):
            unpack_grips(content[:length], DIGEST)


def test_mutations_are_read_whole_or_refused() -> None:
    """Never a crash, and what passes has every property that a replay relies on."""
    whole, read_again = pack_grips(GRIPS, DIGEST), 0
    for content in mutated(whole):
        try:
            grips = unpack_grips(content, DIGEST)
        except TrajectoryFormatError:
            continue
        read_again += 1
        assert grips == grips_of(json.loads(content)["grips"])
        for grip in grips:
            figures = (grip.width_mm, grip.closing_s, grip.start_s, grip.end_s)
            assert all(map(math.isfinite, figures))
            assert grip.closing_s <= grip.start_s <= grip.end_s
            assert 0.0 <= grip.openness <= 1.0
            assert 0.0 < grip.force_n <= MOST_FORCE_N
            assert grip.source.isprintable()
    assert 0.01 * MUTATIONS < read_again < 0.9 * MUTATIONS
