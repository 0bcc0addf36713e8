"""Reads the values in a flight recorder's memory, which `recorder` has written.

The copy of the memory may be made at any moment, even while a record is being written.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from litegripd.recorder import recorder
from litegripd.recorder.recorder import records


class Tick(NamedTuple):
    """One tick as it was packed, in the order of `recorder.TICK`; `flags` are bits."""

    number: int
    at_s: float
    late_us: float
    lost_ticks: int
    flags: int
    public_phase: int
    phase: int
    frames: int
    kind: int
    sent: bytes
    position_range_rad: float
    velocity_range_rad_s: float
    torque_range_nm: float
    status: int
    driver_temperature_c: int
    coil_temperature_c: int
    position_rad: float
    velocity_rad_s: float
    torque_nm: float
    age_s: float
    requested_rad: float
    requested_torque_nm: float
    closed_rad: float
    mm_per_rad: float
    unanswered: int
    send_failures: int
    job: int
    pid: int
    client: int

    def opening_mm(self, position_rad: float) -> float | None:
        """Return the opening at a position, by that tick's calibration; None without one."""
        if not self.flags & recorder.CALIBRATED:
            return None
        return (position_rad - self.closed_rad) * self.mm_per_rad


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """One event, or a change of owner; `content` has kind, message and data."""

    number: int
    at_s: float
    content: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Recording:
    """The content of a memory, the oldest records first.

    `events` are from the time of the ticks; `programs` are clients' names by their numbers.
    """

    about: Mapping[str, Any]
    ticks: tuple[Tick, ...]
    events: tuple[RecordedEvent, ...]
    programs: Mapping[int, str]

    @property
    def duration_s(self) -> float:
        """The time from the first tick to the last."""
        return self.ticks[-1].at_s - self.ticks[0].at_s if self.ticks else 0.0


def read(memory: bytes) -> Recording:
    """Return the content of a copy of a recorder's memory; raises `ValueError` for any other."""
    if len(memory) < recorder.HEADER.size:
        raise ValueError(f"{len(memory)} bytes are no recorder's memory")
    magic, slots = recorder.HEADER.unpack_from(memory)
    if magic != recorder.MAGIC:
        raise ValueError("this is no recorder's memory, or of another version")
    parts = recorder.parts(memoryview(memory), slots)
    _header, description, tick_part, event_part, refusal_part = parts
    ticks = tuple(map(_tick, records(tick_part, recorder.TICK.size)))
    events = [*_texts(event_part), *_texts(refusal_part)]
    about = next((text.content["data"] for text in _texts(description)), None)
    if about is None:
        raise ValueError("the recorder's memory does not say whose it is")
    programs = {
        event.content["data"]["client"]: event.content["data"]["program"]
        for event in events
        if event.content["kind"] == "owner" and "data" in event.content
    }
    began_s = ticks[0].at_s if ticks else 0.0
    return Recording(
        about=about,
        ticks=ticks,
        events=tuple(
            sorted((e for e in events if e.at_s >= began_s), key=lambda e: (e.at_s, e.number))
        ),
        programs=programs,
    )


def _tick(record: bytes) -> Tick:
    return Tick._make(recorder.TICK.unpack(record))


def _texts(part: memoryview) -> Iterable[RecordedEvent]:
    for record in records(part, recorder.TEXT_RECORD_BYTES):
        number, at_s, length = recorder.TEXT.unpack_from(record)
        text = record[recorder.TEXT.size : recorder.TEXT.size + length]
        yield RecordedEvent(number, at_s, json.loads(text, parse_constant=lambda _name: None))
