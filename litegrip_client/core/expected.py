"""What a program of the SDK says of its gripper when it makes one: compared, never set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from litegrip_client.values.calibration import GripperConfig
from litegrip_client.values.checks import flag, integer
from litegrip_client.values.errors import CommandError, ParameterError

_TOLERANCE = 1e-3
"""Of figures: a file's rounding is no difference."""

_HINTS = {
    "kp": "load a calibration with these gains (load_calibration), or give kp and kd to a motion",
    "kd": "load a calibration with these gains (load_calibration), or give kp and kd to a motion",
    "motor_type": "leave it out, or have [motor] type of the daemon's configuration changed;"
    " docs/configuration.md says which types it drives, and which figures it lacks of the others",
}
_HINT = "leave it out, or have the daemon's configuration or calibration changed"


def expectations(  # noqa: PLR0917 - the arguments of the SDK's LiteGrip
    channel: str | None,
    can_id: int | None,
    mst_id: int | None,
    canfd_mode: bool | None,
    motor_type: str | None,
    config: GripperConfig | None,
) -> tuple[str | None, int | None, dict[str, Any]]:
    """Return channel, CAN id, and what else the daemon's gripper must be.

    An argument counts more than the same in `config`. Raises `ParameterError` for CAN FD, and for
    an id that is no number.
    """
    expected: dict[str, Any] = {}
    if config is not None:
        if not isinstance(config, GripperConfig):
            raise ParameterError(
                f"config is {config!r:.60}, it must be a GripperConfig",
                reason="invalid_params",
                data={"parameter": "config"},
            )
        expected = _changed(config)
        canfd_mode = config.canfd_mode if canfd_mode is None else canfd_mode
        if channel is None and config.channel != GripperConfig().channel:
            channel = config.channel
        can_id = expected.pop("can_id", None) if can_id is None else can_id
    if canfd_mode is not None and flag("canfd_mode", canfd_mode):
        raise ParameterError(
            "canfd_mode cannot be true: the motor speaks classic CAN at 1 Mbit/s",
            reason="invalid_params",
            data={"parameter": "canfd_mode"},
        )
    if mst_id is not None:
        expected["mst_id"] = integer("mst_id", mst_id)
    if motor_type is not None:
        expected["motor_type"] = motor_type
    return channel, can_id, expected


def _changed(config: GripperConfig) -> dict[str, Any]:
    """Return the fields that are not as in an object that nobody has changed."""
    plain = GripperConfig()
    compared = (one.name for one in fields(GripperConfig) if one.name not in _NOT_COMPARED)
    return {
        name: getattr(config, name)
        for name in compared
        if config.is_read or getattr(config, name) != getattr(plain, name)
    }


_NOT_COMPARED = (
    *("channel", "canfd_mode", "calibrated", "grasp_torque_threshold"),
    *("max_stroke_mm", "own"),
)


def check_expected(expected: Mapping[str, Any], hello: Mapping[str, Any], path: str) -> None:
    """Raise `CommandError` if the daemon's gripper is not what a program expects."""
    found = GripperConfig.from_wire(hello)
    for name, wanted in expected.items():
        value = getattr(found, name)
        if wanted is None or value is None or _is_same(wanted, value):
            continue
        raise CommandError(
            f"the daemon at {path} has {name} {_shown(name, value)}, not {_shown(name, wanted)}",
            reason="wrong_gripper",
            data={"parameter": name, "hint": _HINTS.get(name, _HINT)},
        )


def _shown(name: str, value: object) -> str:
    """Return a figure as it is written everywhere: an id in hex."""
    return f"0x{value:02X}" if name == "mst_id" and isinstance(value, int) else f"{value}"


def _is_same(wanted: Any, value: Any) -> bool:
    if isinstance(value, float):
        try:
            return math.isclose(float(wanted), value, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE)
        except (TypeError, ValueError):
            return False
    return bool(wanted == value)
