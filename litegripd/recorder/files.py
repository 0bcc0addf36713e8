"""The flight recorder's dumps on the disk: read from its memory and written as MCAP files.

Only the helper process runs this. The copy of the memory may be made at any moment, even while a
record is being written. A file has one message per tick and one per event, as JSON with its schema.
The fields have the names of the state; unknown ones are left out. Events have the schema
`foxglove.Log`, which viewers show as a log, and what was measured is there a second time, as
`foxglove.JointStates`, which viewers draw without being told what it is.

A bounded amount is kept. Dumps that a client asked for are counted apart from the others: no
request may remove the record of a fault. A number in the name gives the order. The time of day in
the name is for people: the clock may have been set since.
"""

import contextlib
import io
import json
import math
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from mcap.writer import CompressionType, Writer

from litegrip_client.values import foxglove
from litegrip_client.values.atomic_file import why_not_written
from litegripd.control.snapshot import mode_of
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import FileError
from litegripd.io.helper.child import MEMORY_FD, copy_of
from litegripd.io.helper.files import own_directory
from litegripd.model.calibration import Dumped
from litegripd.model.motor import MitCommand, Ranges, status_name
from litegripd.motor import codec
from litegripd.motor.phases import Phase
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
    _header, description, tick_part, *event_parts = parts
    ticks = tuple(map(_tick, records(tick_part, recorder.TICK.size)))
    kept = {record for part in event_parts for record in records(part, recorder.TEXT_RECORD_BYTES)}
    events = sorted(map(_text, kept), key=lambda event: (event.at_s, event.number))
    described = records(description, recorder.TEXT_RECORD_BYTES)
    if not described:
        raise ValueError("the recorder's memory does not say whose it is")
    about = _text(described[0]).content["data"]
    programs = {
        event.content["data"]["client"]: event.content["data"]["program"]
        for event in events
        if event.content["kind"] == "owner" and "data" in event.content
    }
    began_s = ticks[0].at_s if ticks else 0.0
    return Recording(
        about=about,
        ticks=ticks,
        events=tuple(event for event in events if event.at_s >= began_s),
        programs=programs,
    )


def _tick(record: bytes) -> Tick:
    return Tick._make(recorder.TICK.unpack(record))


def _text(record: bytes) -> RecordedEvent:
    number, at_s, length = recorder.TEXT.unpack_from(record)
    text = record[recorder.TEXT.size : recorder.TEXT.size + length]
    return RecordedEvent(number, at_s, json.loads(text, parse_constant=lambda _name: None))


_JOINTS_EVERY_S = 0.018
"""50 times a second is enough for an eye; each tick would make files larger by two thirds."""

# Looking up a name in an enumeration is slow, and a dump has tens of thousands of them.
_PHASE_NAMES = {
    **{phase.value: phase.name.lower() for phase in Phase},
    Phase.CLEARING_FAULT.value: "unfaulting",  # as in the dumps that users have
}
_MOTOR_NAMES = [phase.value for phase in recorder.PHASES]
_STATUS_NAMES = [status_name(code) for code in range(16)]
_SPECIAL = {
    codec.ENABLE: "enable",
    codec.DISABLE: "disable",
    codec.SET_ZERO: "set_zero",
    codec.CLEAR_FAULT: "clear_fault",
}


def to_mcap(recording: Recording, cause: str, note: str, offset_ns: int) -> bytes:
    """Return the file's content; CLOCK_MONOTONIC plus `offset_ns` is the time of day."""
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.ZSTD)
    writer.start(profile="", library="litegripd")
    about = {name: str(value) for name, value in recording.about.items()}
    writer.add_metadata("litegripd", {**about, "cause": cause, "note": note})
    channel = str(recording.about["channel"])
    ticks = _channel(writer, foxglove.TICK, channel)
    events = _channel(writer, foxglove.EVENT, channel)
    joints = _channel(writer, foxglove.JOINTS, channel)
    joints_at_s = -math.inf
    for tick in recording.ticks:
        at_ns = round(tick.at_s * 1e9) + offset_ns
        _add(writer, ticks, at_ns, tick.number, tick_fields(tick, recording.programs))
        if tick.flags & recorder.HAS_FEEDBACK and tick.at_s > joints_at_s + _JOINTS_EVERY_S:
            joints_at_s = tick.at_s
            _add(writer, joints, at_ns, tick.number, _joints(tick, at_ns))
    for event in recording.events:
        at_ns = round(event.at_s * 1e9) + offset_ns
        _add(writer, events, at_ns, event.number, _event_fields(event, at_ns))
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def tick_fields(tick: Tick, programs: Mapping[int, str]) -> dict[str, Any]:
    """Return a tick's values by the names of the schema."""
    motor = recorder.PHASES[tick.public_phase]
    flags = tick.flags
    fields: dict[str, Any] = {
        "seq": tick.number,
        "monotonic_s": tick.at_s,
        "late_us": round(tick.late_us, 1),
        "lost_ticks": tick.lost_ticks,
        "bus": "up" if flags & recorder.BUS_UP else "down",
        "motor": _MOTOR_NAMES[tick.public_phase],
        "phase": _PHASE_NAMES[tick.phase],
        "mode": mode_of(motor, bool(tick.job), bool(flags & recorder.IS_SLACK)),
        "failed": bool(flags & recorder.FAILED),
        "stopped": bool(flags & recorder.IS_STOPPED),
        "frames": tick.frames,
        "send_failures": tick.send_failures,
        "unanswered": tick.unanswered,
    }
    if flags & recorder.HAS_FEEDBACK:
        fields |= _feedback_fields(tick)
    if flags & recorder.HAS_SENT:
        fields |= _sent_fields(tick)
    if flags & recorder.HAS_REQUEST:
        fields |= foxglove.finite(
            {"requested_rad": tick.requested_rad, "requested_torque_nm": tick.requested_torque_nm}
        )
    if tick.job:
        fields |= {"job": tick.job, "job_kind": recorder.KINDS[tick.kind]}
    if tick.pid:
        fields |= {"pid": tick.pid, "client": tick.client}
        if tick.client in programs:
            fields["program"] = programs[tick.client]
    return fields


def _feedback_fields(tick: Tick) -> dict[str, Any]:
    fields = {
        "error_code": tick.status,
        "status": _STATUS_NAMES[tick.status],
        "driver_temperature_c": tick.driver_temperature_c,
        "coil_temperature_c": tick.coil_temperature_c,
    }
    measured: dict[str, float | None] = {
        "age_s": tick.age_s,
        "position_rad": tick.position_rad,
        "velocity_rad_s": tick.velocity_rad_s,
        "torque_nm": tick.torque_nm,
        "opening_mm": tick.opening_mm(tick.position_rad),
    }
    return fields | foxglove.finite(measured)


def _sent_fields(tick: Tick) -> dict[str, Any]:
    """Return the decoded frame that was sent; a command in the ranges that the daemon used."""
    special = _SPECIAL.get(tick.sent)
    fields: dict[str, Any] = {"sent": special or "command", "sent_hex": tick.sent.hex()}
    if special is not None:
        return fields
    ranges = Ranges(tick.position_range_rad, tick.velocity_range_rad_s, tick.torque_range_nm)
    command: MitCommand = codec.decode_command(tick.sent, ranges)
    decoded: dict[str, float | None] = {
        "command_rad": command.position_rad,
        "command_rad_s": command.velocity_rad_s,
        "command_torque_nm": command.torque_nm,
        "kp": command.kp_nm_rad,
        "kd": command.kd_nm_s_rad,
    }
    if command.kp_nm_rad > 0.0:  # without stiffness the position has no meaning
        decoded["command_mm"] = tick.opening_mm(command.position_rad)
    return fields | foxglove.finite(decoded)


def _event_fields(event: RecordedEvent, at_ns: int) -> dict[str, Any]:
    content = event.content
    return foxglove.log_of(
        at_ns,
        number=event.number,
        at_s=event.at_s,
        kind=content["kind"],
        message=content["message"],
        data=content.get("data", {}),
    )


def _joints(tick: Tick, at_ns: int) -> dict[str, Any]:
    return foxglove.joints_of(
        at_ns,
        position_rad=tick.position_rad,
        velocity_rad_s=tick.velocity_rad_s,
        torque_nm=tick.torque_nm,
        opening_mm=tick.opening_mm(tick.position_rad),
        opens_mm_s=tick.velocity_rad_s * tick.mm_per_rad,
    )


def _channel(writer: Writer, topic: foxglove.Topic, channel: str) -> int:
    schema = topic.schema
    text = json.dumps(schema).encode()
    identity = writer.register_schema(name=schema["title"], encoding="jsonschema", data=text)
    return writer.register_channel(
        topic=topic.name(channel), message_encoding="json", schema_id=identity
    )


def _add(writer: Writer, channel: int, at_ns: int, number: int, fields: dict[str, Any]) -> None:
    data = json.dumps(fields, separators=(",", ":"), allow_nan=False).encode()
    writer.add_message(
        channel_id=channel,
        log_time=at_ns,
        publish_time=at_ns,
        sequence=number & 0xFFFFFFFF,
        data=data,
    )


KEPT_FILES = 10
KEPT_BYTES = 64_000_000
"""For each sort: asked for by a client, or written by the daemon itself."""

_ASKED_FOR = "demand"
_NAME = re.compile(r"\.?(\d+)-\d{8}T.+\.mcap")
"""The name of a dump, or of one that is being written; files with other names are left alone."""


def dump(cause: str, note: str, memory_fd: int = MEMORY_FD) -> Dumped:
    """Write the recorder's content to a new file; return its path and a summary.

    Raises `FileError` if it cannot be written, or if nothing is recorded yet.
    """
    now_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
    recording = read(copy_of(memory_fd))
    if not recording.ticks:
        raise FileError("nothing has been recorded yet")
    content = to_mcap(recording, cause, note, now_ns - monotonic_ns)
    directory = own_directory(str(recording.about["channel"]), "dumps")
    newest = max((number for number, _path in _numbered(directory, "*.mcap")), default=0)
    path = directory / _name(newest + 1, cause, now_ns)
    try:
        atomic_file.write(path, content)
        prune(path.parent, keep=path)
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {why_not_written(error, path)}") from error
    return {
        "path": str(path),
        "ticks": len(recording.ticks),
        "seconds": round(recording.duration_s, 3),
        "bytes": len(content),
    }


def prune(directory: Path, keep: Path) -> None:
    """Remove the oldest dumps of the sort of `keep` beyond `KEPT_BYTES`, but never `keep`."""
    asked_for = _is_asked_for(keep)
    dumps = [
        path for _n, path in _numbered(directory, "*.mcap") if _is_asked_for(path) == asked_for
    ]
    total_bytes = 0
    for place, path in enumerate(dumps):
        total_bytes += path.stat().st_size
        if path != keep and (place >= KEPT_FILES or total_bytes > KEPT_BYTES):
            path.unlink()
    for number, path in _numbered(directory, ".*.mcap.*.tmp"):  # of killed helpers
        # During a restart another helper may write at the same time.
        if abs(number - _number(keep)) > 1:
            with contextlib.suppress(FileNotFoundError):
                path.unlink()


def _numbered(directory: Path, pattern: str) -> list[tuple[int, Path]]:
    """Return the dumps that match `pattern`, with their numbers, the newest first."""
    ours = (path for path in directory.glob(pattern) if _NAME.match(path.name))
    return sorted(((_number(path), path) for path in ours), reverse=True)


def _number(path: Path) -> int:
    return int(path.name.lstrip(".").partition("-")[0])


def _is_asked_for(path: Path) -> bool:
    return path.stem.endswith(f"-{_ASKED_FOR}")


def _name(number: int, cause: str, now_ns: int) -> str:
    """Return a name with the rising `number`, by which names sort, and the time of day, UTC."""
    seconds, rest_ns = divmod(now_ns, 1_000_000_000)
    stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime(seconds))
    return f"{number:06}-{stamp}.{rest_ns // 1_000_000:03}Z-{cause}.mcap"
