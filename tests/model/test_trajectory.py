"""The `.lgt` format to the bit, against a reader and a writer made from its description alone."""

import math
import struct
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.trajectory_format import (
    HEADER,
    MAX_SAMPLES,
    SAMPLE,
    Header,
    read_header,
)
from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import Mount
from litegripd.trajectories.values import csv_line, name_problem, read, summarize
from tests.mutations import MUTATIONS, mutated
from tests.trajectories import HEADER_BYTES, SAMPLE_BYTES, Point, lgt, points_of, sampled, swing

MOUNTS: tuple[Mount | None, ...] = ("normal", "reverse", None)

finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=5e-324, allow_infinity=False)
figures = st.fixed_dictionaries(
    {
        "sample_hz": positive,
        "created_s": finite,
        "closed_rad": finite,
        "open_rad": finite,
        "rad_to_mm": positive,
        "can_id": st.integers(0, 2**32 - 1),
        "mount": st.sampled_from(MOUNTS),
    }
).filter(lambda values: values["closed_rad"] != values["open_rad"])
times = st.lists(finite, max_size=20).map(sorted)
any_samples = times.flatmap(
    lambda ts: st.tuples(
        *(st.tuples(st.just(t), st.floats(0.0, 1.0), finite, finite, finite) for t in ts)
    )
)


def independent(content: bytes) -> tuple[dict[str, Any], list[tuple[float, ...]]]:
    """Read a file by the description of its fields, offset by offset."""
    assert content[:8] == b"LGRTRJ01"
    assert int.from_bytes(content[8:10], "little") == 1
    count = int.from_bytes(content[10:14], "little")
    names = ("sample_hz", "created_s", "closed_rad", "open_rad", "rad_to_mm")
    figures = {
        name: struct.unpack("<d", content[at : at + 8])[0]
        for name, at in zip(names, range(14, 54, 8), strict=True)
    }
    figures["can_id"] = int.from_bytes(content[54:58], "little")
    figures["mount"] = content[58:66].split(b"\0")[0].decode("ascii") or None
    samples = points_of(content)
    assert len(samples) == count
    return figures, samples


def bits(values: Any) -> bytes:
    return b"".join(struct.pack("<d", value) for value in values)


def taught(count: int = 30) -> bytes:
    return lgt(sampled(swing(), (count - 1) / 100.0))


@given(figures=figures, samples=any_samples)
def test_what_is_written_reads_back_to_the_bit(
    figures: dict[str, Any], samples: tuple[tuple[float, ...], ...]
) -> None:
    header = Header(len(samples), **figures)
    content = header.pack() + b"".join(SAMPLE.pack(*sample) for sample in samples)
    seen_figures, seen = independent(content)
    for name in ("mount", "can_id"):
        assert seen_figures.pop(name) == figures[name]
    for name, value in seen_figures.items():
        assert bits([value]) == bits([figures[name]]), name
    assert [bits(one) for one in seen] == [bits(one) for one in samples]
    back, _ = read(memoryview(content))
    assert back == header
    assert back.pack() == content[:HEADER_BYTES]


def test_the_sizes_are_those_of_the_format() -> None:
    assert (HEADER.size, SAMPLE.size) == (HEADER_BYTES, SAMPLE_BYTES)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"magic": b"LGRTRJ02"}, "no .lgt file"),
        ({"magic": b"\0" * 8}, "no .lgt file"),
        ({"version": 0}, "version 0"),
        ({"version": 2}, "version 2"),
        ({"sample_hz": 0.0}, "sample_hz"),
        ({"sample_hz": -100.0}, "sample_hz"),
        ({"sample_hz": math.nan}, "sample_hz"),
        ({"sample_hz": math.inf}, "sample_hz"),
        ({"created_s": math.nan}, "created_s"),
        ({"closed_rad": math.inf}, "closed_rad"),
        ({"open_rad": math.nan}, "open_rad"),
        ({"rad_to_mm": 0.0}, "rad_to_mm"),
        ({"rad_to_mm": -74.8}, "rad_to_mm"),
        ({"rad_to_mm": -math.inf}, "rad_to_mm"),
        ({"open_rad": NOMINAL[0].closed_rad}, "zero travel"),
        ({"mount": b"sideways"}, "unknown mount"),
        ({"mount": b"Normal\0\0"}, "unknown mount"),
        ({"mount": b"normal  "}, "unknown mount"),
        ({"mount": b"normal\0x"}, "unknown mount"),
        ({"mount": b"\xff" * 8}, "unknown mount"),
        ({"count": 2}, "3 samples"),
        ({"count": 4}, "4 samples"),
        ({"count": MAX_SAMPLES + 1}, "at most"),
        ({"count": 2**32 - 1}, "at most"),
    ],
)
def test_a_wrong_header_is_rejected_with_its_reason(fields: dict[str, Any], reason: str) -> None:
    content = lgt([(0.0, 0.1), (0.1, 0.2), (0.2, 0.3)], **fields)
    expected = "2 samples make" if fields == {"count": 2} else reason
    with pytest.raises(TrajectoryFormatError, match=expected):
        read(memoryview(content))


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        ([(0.0, 0.5), (0.1, 1.0000001)], "sample 1: openness"),
        ([(0.0, -1e-9)], "sample 0: openness"),
        ([(0.0, 0.5), (math.nan, 0.5)], "sample 1: t_s is nan, it must be a finite number"),
        ([(0.0, math.nan)], "sample 0: openness is nan, it must be a finite number"),
        ([(-math.inf, 0.5)], "sample 0: t_s is -inf, it must be a finite number"),
        ([(0.0, 0.5), (0.2, 0.5), (0.1, 0.5)], "sample 2: time runs backwards"),
    ],
)
def test_a_wrong_sample_is_rejected_with_its_number(points: list[Point], reason: str) -> None:
    with pytest.raises(TrajectoryFormatError, match=reason):
        read(memoryview(lgt(points)))


@pytest.mark.parametrize("field", [2, 3, 4])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_field_of_a_sample_may_be_other_than_finite(field: int, value: float) -> None:
    values = [0.0, 0.5, 0.0, 0.0, 0.0]
    values[field] = value
    content = lgt([(0.0, 0.5)])[:HEADER_BYTES] + struct.pack("<5d", *values)
    with pytest.raises(TrajectoryFormatError, match="must be a finite number"):
        read(memoryview(content))


def test_large_finite_values_are_no_reason() -> None:
    values = struct.pack("<5d", 0.0, 0.5, 1.7e308, 1.7e308, 1.7e308)
    read(memoryview(lgt([(0.0, 0.5)])[:HEADER_BYTES] + values))


@pytest.mark.parametrize("mount", [b"normal\0\0", b"reverse\0", b"\0" * 8])
def test_each_mount_and_none_are_read(mount: bytes) -> None:
    header = read_header(memoryview(lgt([(0.0, 0.5)], mount=mount)))
    assert header.mount == (mount.rstrip(b"\0").decode() or None)


@pytest.mark.parametrize(
    ("points", "duration_s", "max_rate_s"),
    [
        ([(-1e9, 0.5), (-1e9, 0.5), (-1e9 + 1.0, 0.75)], 1.0, 0.25),  # it may stand still
        ([(0.0, 0.5), (0.0, 0.6), (1.0, 0.6)], 1.0, math.inf),  # a jump
        ([(0.0, 0.5), (1.0, 0.6), (1.1, 0.2), (5.0, 1.0)], 5.0, 4.0),  # in either direction
        ([], 0.0, 0.0),  # whole, but nothing
    ],
)
def test_samples_have_a_duration_and_a_fastest_part(
    points: list[Point], duration_s: float, max_rate_s: float
) -> None:
    header, summary = read(memoryview(lgt(points)))
    assert (header.samples, summary.duration_s) == (len(points), duration_s)
    assert summary.max_rate_s == pytest.approx(max_rate_s)


def test_cut_off_at_any_byte_it_is_rejected() -> None:
    content = taught()
    for length in range(len(content)):
        with pytest.raises(TrajectoryFormatError):
            read(memoryview(content[:length]))


@pytest.mark.parametrize("added", [1, 39, 40, 41])
def test_with_something_added_it_is_rejected(added: int) -> None:
    with pytest.raises(TrajectoryFormatError, match="something was added"):
        read(memoryview(taught() + b"\0" * added))


def test_mutations_are_read_whole_or_rejected() -> None:
    """Never a crash, and what passes has every property that a reader relies on."""
    read_again = 0
    for content in mutated(taught(8), header=HEADER_BYTES):
        try:
            header, _ = read(memoryview(content))
        except TrajectoryFormatError:
            continue
        read_again += 1
        samples = points_of(content)
        assert header.samples == len(samples)
        assert all(math.isfinite(value) for sample in samples for value in sample)
        assert all(0.0 <= sample[1] <= 1.0 for sample in samples)
        assert [sample[0] for sample in samples] == sorted(sample[0] for sample in samples)
    assert 0.05 * MUTATIONS < read_again < 0.9 * MUTATIONS


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_read_or_rejected(content: bytes, begins_well: bool) -> None:
    candidate = lgt([])[:14] + content if begins_well else content
    with suppress(TrajectoryFormatError):
        header, _ = read(memoryview(candidate))
        assert header.samples == 0


@given(any_samples)
def test_csv_reads_back_to_the_bit(samples: tuple[tuple[float, ...], ...]) -> None:
    for sample in samples:
        line = csv_line(sample)
        assert bits(map(float, line.rstrip("\n").split(","))) == bits(sample)


@pytest.mark.parametrize("samples", [-1, MAX_SAMPLES + 1])
def test_no_header_is_made_that_could_not_be_read(samples: int) -> None:
    with pytest.raises(TrajectoryFormatError):
        Header(samples, 100.0, 0.0, 0.1, -1.5, 74.8, 8, None)
    with pytest.raises(TrajectoryFormatError):
        Header(1, 100.0, 0.0, 0.1, -1.5, 74.8, 2**32, None)


def test_samples_are_judged_in_a_view_without_a_copy() -> None:
    content = memoryview(taught())
    assert summarize(content[HEADER_BYTES:]) == read(content)[1]


@pytest.mark.parametrize(
    "name", ["", "x" * 65, "a/b", "..", "../x", "/x", "a\\b", ".x", " x", "x ", "a\nb", "a\0b",
             "\ud800", "\u202e", "😀" * 60]
)  # fmt: skip
def test_names_that_leave_the_directory_or_hide_are_refused(name: str) -> None:
    assert name_problem(name) is not None


@pytest.mark.parametrize("name", ["pick", "x" * 64, "pick and place", "Größe 3", "a..b", "x.lgt"])
def test_ordinary_names_are_fine(name: str) -> None:
    assert name_problem(name) is None
