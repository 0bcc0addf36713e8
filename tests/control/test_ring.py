"""Rings of records: the newest, in order, and none that is torn."""

import struct
from zlib import crc32

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegripd.recorder.recorder import OVERHEAD_BYTES, Ring, records

RECORD = struct.Struct("<Q24s")
SLOT_BYTES = RECORD.size + OVERHEAD_BYTES


def record(number: int) -> bytes:
    return RECORD.pack(number, number.to_bytes(3, "big") * 8)


def filled(slots: int, written: int) -> tuple[Ring, bytearray]:
    memory = bytearray(slots * SLOT_BYTES)
    ring = Ring(memoryview(memory), RECORD.size)
    for _ in range(written):
        ring.put(record(ring.next_number))
    return ring, memory


@settings(deadline=None)
@given(slots=st.integers(1, 40), written=st.integers(0, 130))
def test_the_last_records_come_back_in_their_order(slots: int, written: int) -> None:
    _ring, memory = filled(slots, written)
    kept = range(max(1, written - slots + 1), written + 1)
    assert records(bytes(memory), RECORD.size) == [record(number) for number in kept]
    assert len(memory) == slots * SLOT_BYTES


@settings(deadline=None)
@given(slots=st.integers(1, 20), written=st.integers(0, 60), begun=st.integers(0, SLOT_BYTES))
def test_a_record_that_is_being_written_costs_the_oldest_and_no_other(
    slots: int, written: int, begun: int
) -> None:
    """The writer is seen, or dies, after any number of bytes."""
    _ring, memory = filled(slots, written)
    before = records(bytes(memory), RECORD.size)
    coming = record(written + 1)
    slot = coming + struct.pack("<I", crc32(coming))
    begin = written % slots * SLOT_BYTES
    memory[begin : begin + begun] = slot[:begun]
    seen = records(bytes(memory), RECORD.size)
    survivors = before[1:] if len(before) == slots else before
    assert seen in (before, survivors, [*survivors, coming])
    assert (seen == [*survivors, coming]) == (memory[begin : begin + SLOT_BYTES] == slot)


@settings(deadline=None)
@given(
    written=st.integers(1, 30),
    at=st.integers(0, 10 * SLOT_BYTES - 1),
    flipped=st.integers(1, 255),
)
def test_a_byte_that_changed_costs_its_record_and_no_other(
    written: int, at: int, flipped: int
) -> None:
    _ring, memory = filled(10, written)
    before = records(bytes(memory), RECORD.size)
    memory[at] ^= flipped
    hit = at // SLOT_BYTES
    assert records(bytes(memory), RECORD.size) == [
        kept for kept in before if (RECORD.unpack(kept)[0] - 1) % 10 != hit
    ]


def test_a_record_of_another_length_is_refused_and_writes_nothing() -> None:
    ring, memory = filled(4, 2)
    before = bytes(memory)
    for wrong in (b"", record(3)[:-1], record(3) + b"\0"):
        with pytest.raises(ValueError, match=r"size|shape|structure"):
            ring.put(wrong)
    assert bytes(memory) == before
    assert ring.next_number == 3


def test_memory_that_is_left_over_at_the_end_is_never_touched() -> None:
    memory = bytearray(3 * SLOT_BYTES + 5)
    ring = Ring(memoryview(memory), RECORD.size)
    for number in range(1, 10):
        ring.put(record(number))
    assert memory[-5:] == bytes(5)
    assert len(records(bytes(memory), RECORD.size)) == 3
