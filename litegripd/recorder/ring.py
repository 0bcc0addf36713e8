"""Rings of slots in a memory of fixed size: the newest records, each complete or not at all.

Another process may read while this one writes, and this one may die at any byte. So each record
has its own checksum, and there is no other list of records: no counter can be wrong.
"""

import struct
from zlib import crc32

_NUMBER = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
OVERHEAD_BYTES = _CHECKSUM.size


class Ring:
    """Writes records of `record_bytes` into `memory`; each replaces the oldest.

    A record begins with its number, 8 bytes, little-endian: `next_number` when it is written.
    """

    def __init__(self, memory: memoryview, record_bytes: int) -> None:
        self.next_number = 1
        self._memory = memory
        self._slot_bytes = record_bytes + OVERHEAD_BYTES
        self._end = len(memory) // self._slot_bytes * self._slot_bytes
        self._offset = 0

    def put(self, record: bytes) -> None:
        """Write a record; raises `ValueError` for one of another length, before it writes."""
        begin = self._offset
        end = begin + self._slot_bytes
        self._memory[begin:end] = record + _CHECKSUM.pack(crc32(record))
        self._offset = end if end < self._end else 0
        self.next_number += 1


def records(memory: bytes | memoryview, record_bytes: int) -> list[bytes]:
    """Return the complete records in a ring's memory, the oldest first.

    Records that are torn, or being written, and empty slots are left out.
    """
    slot_bytes = record_bytes + OVERHEAD_BYTES
    found: list[tuple[int, bytes]] = []
    for begin in range(0, len(memory) // slot_bytes * slot_bytes, slot_bytes):
        record = bytes(memory[begin : begin + record_bytes])
        (checksum,) = _CHECKSUM.unpack_from(memory, begin + record_bytes)
        if crc32(record) == checksum:
            found.append((*_NUMBER.unpack_from(record), record))
    return [record for _number, record in sorted(found)]
