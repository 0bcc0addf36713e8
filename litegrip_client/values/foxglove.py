"""What viewers such as Foxglove are shown of a gripper: topics, their schemas, and messages.

Declared once for the dumps of the daemon and for what shows it live.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from litegrip_client.values.severity import is_warning

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

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
_JOINT = {
    "type": "object",
    "properties": {"name": _TEXT, **dict.fromkeys(("position", "velocity", "effort"), _NUMBER)},
}
JOINTS_SCHEMA: Mapping[str, Any] = {
    "title": "foxglove.JointStates",
    "type": "object",
    "properties": {"timestamp": _TIME, "joints": {"type": "array", "items": _JOINT}},
}
"""As Foxglove publishes it: rad, rad/s and N·m, of the sliding fingers m and m/s."""

_MOTOR_JOINT = "motor"
_FINGER_JOINTS = ("gripper_slide_joint_left", "gripper_slide_joint_right")
"""The fingers, by their names in the vendor's URDF: 0 is open."""

_CLOSED_M = 0.042726
"""Where a finger is closed, there."""

_INFO, _WARNING = 2, 3


@dataclass(frozen=True)
class Topic:
    """What there is of each gripper under a name; messages are JSON that fits the schema."""

    kind: str
    schema: Mapping[str, Any]

    def name(self, channel: str) -> str:
        """Return the topic of one gripper."""
        return f"/litegrip/{channel}/{self.kind}"


TICK = Topic("tick", TICK_SCHEMA)
EVENT = Topic("event", EVENT_SCHEMA)
JOINTS = Topic("joints", JOINTS_SCHEMA)


def log_of(
    at_ns: int, *, number: int, at_s: float, kind: str, message: str, data: Mapping[str, Any]
) -> dict[str, Any]:
    """Return an event as a message; `at_ns` is Unix time, `at_s` CLOCK_MONOTONIC."""
    return {
        "timestamp": time_of(at_ns),
        "level": _WARNING if is_warning(kind, data) else _INFO,
        "message": message,
        "name": kind,
        "file": "",
        "line": 0,
        "seq": number,
        "monotonic_s": at_s,
        "data": data,
    }


def joints_of(
    at_ns: int,
    *,
    position_rad: float | None,
    velocity_rad_s: float | None,
    torque_nm: float | None,
    opening_mm: float | None,
    opens_mm_s: float | None,
) -> dict[str, Any]:
    """Return the motor and, where the opening is known, the fingers that it moves."""
    measured = {"position": position_rad, "velocity": velocity_rad_s, "effort": torque_nm}
    joints: list[dict[str, Any]] = [{"name": _MOTOR_JOINT, **finite(measured)}]
    if opening_mm is not None and opens_mm_s is not None:
        finger = finite(
            {"position": _CLOSED_M - opening_mm / 2000.0, "velocity": -opens_mm_s / 2000.0}
        )
        joints += [{"name": name, **finger} for name in _FINGER_JOINTS]
    return {"timestamp": time_of(at_ns), "joints": joints}


def finite(fields: Mapping[str, float | None]) -> dict[str, float]:
    """Return the known, finite fields, rounded to the digits that have a meaning."""
    return {
        name: round(value, 6)
        for name, value in fields.items()
        if value is not None and value - value == 0.0
    }


def time_of(at_ns: int) -> dict[str, int]:
    """Return a time as Foxglove's schemas have it."""
    sec, nsec = divmod(at_ns, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}
