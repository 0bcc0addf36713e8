"""A recording as an MCAP file: one message per tick and one per event, as JSON with its schema.

The fields have the names of the state; unknown ones are left out. Events have the schema
`foxglove.Log`, which viewers show as a log. Only the helper process runs this.
"""

import io
import json
from collections.abc import Mapping
from typing import Any

from mcap.writer import CompressionType, Writer

from litegripd.control.snapshot import mode_of
from litegripd.model.motor import MitCommand, Ranges, status_name
from litegripd.motor import codec
from litegripd.motor.phases import Phase
from litegripd.recorder import recorder
from litegripd.recorder.reader import RecordedEvent, Recording, Tick

_NUMBER, _TEXT, _TRUTH = {"type": "number"}, {"type": "string"}, {"type": "boolean"}
_INTEGER = {"type": "integer"}
TICK_SCHEMA: Mapping[str, Any] = {
    "title": "litegrip.Tick",
    "type": "object",
    "properties": {
        **dict.fromkeys(("seq", "lost_ticks", "frames", "send_failures", "unanswered"), _INTEGER),
        **dict.fromkeys(("monotonic_s", "late_us", "age_s"), _NUMBER),
        **dict.fromkeys(("bus", "motor", "phase", "mode", "status", "sent", "sent_hex"), _TEXT),
        **dict.fromkeys(("failed", "stopped"), _TRUTH),
        **dict.fromkeys(("position_rad", "velocity_rad_s", "torque_nm", "opening_mm"), _NUMBER),
        **dict.fromkeys(
            ("error_code", "driver_temperature_c", "coil_temperature_c", "job", "pid", "client"),
            _INTEGER,
        ),
        **dict.fromkeys(
            ("command_rad", "command_rad_s", "command_torque_nm", "command_mm", "kp", "kd"),
            _NUMBER,
        ),
        **dict.fromkeys(("requested_rad", "requested_torque_nm"), _NUMBER),
        **dict.fromkeys(("job_kind", "program"), _TEXT),
    },
}
_TIME = {"type": "object", "properties": {"sec": _INTEGER, "nsec": _INTEGER}}
EVENT_SCHEMA: Mapping[str, Any] = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        **dict.fromkeys(("level", "line", "seq"), _INTEGER),
        **dict.fromkeys(("message", "name", "file"), _TEXT),
        "monotonic_s": _NUMBER,
        "data": {"type": "object"},
    },
}
_INFO, _WARNING = 2, 3
_WARNINGS = frozenset({"stop", "object_lost", "heat", "refused", "recorder", "lease_lost"})
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
    ticks = _channel(writer, f"/litegrip/{channel}/tick", TICK_SCHEMA)
    events = _channel(writer, f"/litegrip/{channel}/event", EVENT_SCHEMA)
    for tick in recording.ticks:
        at_ns = round(tick.at_s * 1e9) + offset_ns
        _add(writer, ticks, at_ns, tick.number, tick_fields(tick, recording.programs))
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
        fields |= _finite(
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
    return fields | _finite(measured)


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
    return fields | _finite(decoded)


def _finite(fields: Mapping[str, float | None]) -> dict[str, float]:
    """Return the known, finite fields, rounded to the digits that have a meaning."""
    return {
        name: round(value, 6)
        for name, value in fields.items()
        if value is not None and value - value == 0.0
    }


def _event_fields(event: RecordedEvent, at_ns: int) -> dict[str, Any]:
    content = event.content
    sec, nsec = divmod(at_ns, 1_000_000_000)
    return {
        "timestamp": {"sec": sec, "nsec": nsec},
        "level": _WARNING if content["kind"] in _WARNINGS else _INFO,
        "message": content["message"],
        "name": content["kind"],
        "file": "",
        "line": 0,
        "seq": event.number,
        "monotonic_s": event.at_s,
        "data": content.get("data", {}),
    }


def _channel(writer: Writer, topic: str, schema: Mapping[str, Any]) -> int:
    text = json.dumps(schema).encode()
    identity = writer.register_schema(name=schema["title"], encoding="jsonschema", data=text)
    return writer.register_channel(topic=topic, message_encoding="json", schema_id=identity)


def _add(writer: Writer, channel: int, at_ns: int, number: int, fields: dict[str, Any]) -> None:
    data = json.dumps(fields, separators=(",", ":"), allow_nan=False).encode()
    writer.add_message(
        channel_id=channel,
        log_time=at_ns,
        publish_time=at_ns,
        sequence=number & 0xFFFFFFFF,
        data=data,
    )
