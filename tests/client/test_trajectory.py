"""The trajectory format, against a writer made from its description, cut off and mutated."""

import math
import struct
from typing import Any

import pytest

from litegrip_client import CommandError, Trajectory, TrajectorySample
from litegrip_client.values.calibration import (
    NOMINAL_CLOSED_RAD,
    NOMINAL_OPEN_RAD,
    NOMINAL_RAD_TO_MM,
)
from litegrip_client.values.trajectory_format import MAX_SAMPLES
from tests.mutations import MUTATIONS, mutated
from tests.trajectories import HEADER_BYTES, SAMPLE_BYTES, lgt, points_of

FULL: dict[str, Any] = {
    "sample_hz": 100.0,
    "created": 1.7e9,
    "pos_closed_rad": NOMINAL_CLOSED_RAD,
    "pos_open_rad": NOMINAL_OPEN_RAD,
    "rad_to_mm": NOMINAL_RAD_TO_MM,
}


def sample(t: float = 0.0, openness: float = 0.5, **more: float) -> TrajectorySample:
    values = {"position_rad": 0.1, "velocity_rad_s": 0.2, "torque_nm": 0.3, **more}
    return TrajectorySample(t, openness, **values)


def refusal(content: bytes) -> str:
    with pytest.raises(CommandError) as caught:
        Trajectory.from_bytes(content)
    assert caught.value.reason == "trajectory_unreadable"
    return caught.value.message


@pytest.mark.parametrize(
    ("padded", "mount"), [(b"normal\0\0", "normal"), (b"reverse\0", "reverse"), (bytes(8), None)]
)
def test_every_field_is_read(padded: bytes, mount: str | None) -> None:
    points = [(2.5, 0.0), (2.51, 0.125), (2.51, 1.0)]
    content = lgt(
        points,
        sample_hz=50.0,
        created_s=1234.5,
        closed_rad=-1.0,
        open_rad=0.5,
        rad_to_mm=70.0,
        can_id=9,
        mount=padded,
    )
    read = Trajectory.from_bytes(content)
    assert (read.sample_hz, read.created, read.can_id, read.mount) == (50.0, 1234.5, 9, mount)
    assert (read.pos_closed_rad, read.pos_open_rad, read.rad_to_mm) == (-1.0, 0.5, 70.0)
    assert [(one.t, one.openness) for one in read.samples] == points
    assert len(read) == 3
    assert read.duration_s == pytest.approx(0.01)
    assert read.longest_gap_s == pytest.approx(0.01)
    assert read.travel_mm == pytest.approx(105.0)
    assert read.to_bytes() == content


def test_what_is_written_is_the_format_to_the_bit() -> None:
    samples = [sample(0.0, 0.0, torque_nm=-1.5), sample(0.01, 1.0, position_rad=math.pi)]
    written = Trajectory(samples, **FULL, can_id=8, mount="normal").to_bytes()
    assert written[:HEADER_BYTES] == lgt([], count=2)
    assert points_of(written) == [tuple(one) for one in samples]
    assert Trajectory.from_bytes(written).samples == samples


def test_an_empty_one_is_a_trajectory_and_true() -> None:
    empty = Trajectory.from_bytes(lgt([]))
    assert (len(empty), empty.duration_s, empty.longest_gap_s, bool(empty)) == (0, 0.0, 0.0, True)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (lgt([], magic=b"LGRTRJ02"), "no .lgt file"),
        (lgt([], version=2), "version 2, only version 1 can be read"),
        (lgt([(0.0, 0.5)], count=2), "106 bytes, but 2 samples make 146"),
        (lgt([(0.0, 0.5)], count=0), "106 bytes, but 0 samples make 66"),
        (lgt([], count=MAX_SAMPLES + 1), f"{MAX_SAMPLES + 1} samples, at most {MAX_SAMPLES}"),
        (lgt([], sample_hz=0.0), "sample_hz is 0.0, it must be above 0"),
        (lgt([], sample_hz=-1.0), "sample_hz is -1.0, it must be above 0"),
        (lgt([], sample_hz=math.nan), "sample_hz of the header is nan, it must be a finite number"),
        (lgt([], rad_to_mm=0.0), "rad_to_mm is 0.0, it must be above 0"),
        (lgt([], rad_to_mm=math.inf), "rad_to_mm of the header is inf, it must be a finite number"),
        (lgt([], created_s=math.nan), "created_s of the header is nan, it must be a finite number"),
        (lgt([], closed_rad=0.5, open_rad=0.5), "zero travel"),
        (
            lgt([], closed_rad=-math.inf),
            "closed_rad of the header is -inf, it must be a finite number",
        ),
        (lgt([], open_rad=math.nan), "open_rad of the header is nan, it must be a finite number"),
        (lgt([], mount=b"sideways"), "unknown mount b'sideways'"),
        (lgt([], mount=b"NORMAL\0\0"), "unknown mount b'NORMAL'"),
        (lgt([(0.0, 1.000001)]), "sample 0: openness is 1.000001, it must be 0 to 1"),
        (lgt([(0.0, 0.5), (0.01, -1e-9)]), "sample 1: openness is -1e-09, it must be 0 to 1"),
        (lgt([(0.0, math.nan)]), "sample 0: openness is nan, it must be a finite number"),
        (lgt([(math.inf, 0.5)]), "sample 0: t_s is inf, it must be a finite number"),
        (lgt([(0.0, 0.5), (0.02, 0.5), (0.01, 0.5)]), "sample 2: time runs backwards, 0.02 to 0.0"),
    ],
)
def test_each_rejection_says_why(content: bytes, why: str) -> None:
    assert why in refusal(content)


@pytest.mark.parametrize("field", range(2, 5))
def test_a_measurement_that_is_not_finite_is_rejected(field: int) -> None:
    content = bytearray(lgt([(0.0, 0.5), (0.01, 0.5)]))
    struct.pack_into("<d", content, HEADER_BYTES + SAMPLE_BYTES + 8 * field, math.inf)
    assert "must be a finite number" in refusal(bytes(content))


def test_a_file_that_is_cut_off_anywhere_is_rejected() -> None:
    whole = lgt([(number / 100, 0.5) for number in range(5)])
    for length in range(len(whole)):
        text = refusal(whole[:length])
        if length < HEADER_BYTES:
            assert text == f"{length} bytes are too few for a header, which has 66: no .lgt file"
        else:
            assert text.startswith(f"{length} bytes, but 5 samples make {len(whole)}")


def written_again(content: bytes) -> bytes | None:
    """Return what comes of reading and writing, None for what is rejected."""
    try:
        return Trajectory.from_bytes(content).to_bytes()
    except CommandError:
        return None


def test_a_mutated_file_is_read_to_the_bit_or_rejected() -> None:
    """Either it says why not, or it is a trajectory that is written again as it was."""
    whole, rejected = lgt([(number / 10, number / 8) for number in range(8)]), 0
    for content in mutated(whole, header=HEADER_BYTES):
        written = written_again(content)
        assert written in (None, content)
        rejected += written is None
    assert 0.1 * MUTATIONS < rejected < 0.95 * MUTATIONS


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"samples": [(0.0, 0.5)]}, "samples are t, openness"),
        ({"samples": [("a", 0, 0, 0, 0)]}, "samples are t, openness"),
        ({"samples": None}, "samples are t, openness"),
        ({"samples": "pick"}, r"torque_nm, not 'pick'; .* by Trajectory\.load\(name\)$"),
        ({"samples": [sample(), 3]}, "torque_nm; sample 1 is 3$"),
        ({"sample_hz": "often"}, "sample_hz is 'often'"),
        ({"mount": "sideways"}, "unknown mount 'sideways'"),
        ({"can_id": -1}, "can_id is -1"),
        ({"can_id": "8"}, "can_id is '8'"),
    ],
)
def test_what_a_program_makes_is_judged_the_same(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(CommandError, match=why) as caught:
        Trajectory(**{"samples": [sample()], **FULL, **changes})
    assert caught.value.__suppress_context__ or caught.value.__context__ is None


def test_a_trajectory_is_a_value() -> None:
    one = Trajectory([sample()], **FULL)
    assert one == Trajectory(((0, 0.5, 0.1, 0.2, 0.3),), **FULL)  # type: ignore[arg-type]
    assert one != Trajectory([sample(1.0)], **FULL)
    assert repr(one) == "<Trajectory: 1 samples, 0.00 s>"
