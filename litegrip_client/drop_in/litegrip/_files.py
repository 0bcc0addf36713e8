"""Calibration files of the SDK: where they are looked for, and what a configuration takes."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from litegrip_client.values import atomic_file

from ._bridge import finite
from .exceptions import CommandError
from .models import GripperConfig

LOG = logging.getLogger("litegrip")

_HERE = os.path.dirname(os.path.abspath(__file__))
_VARIABLE = "LITEGRIP_CALIB"

FACTORY = os.path.join(_HERE, "factory_calibration.json")
TEMPLATES = {
    name: os.path.join(_HERE, f"calibration_{name}.json") for name in ("normal", "reverse")
}

_REQUIRED = ("zero_position_rad", "max_position_rad", "rad_to_mm")
_TAKEN = (
    ("zero_position_rad", "pos_closed_rad"),
    ("max_position_rad", "pos_open_rad"),
    ("rad_to_mm", "rad_to_mm"),
    ("channel", "can_channel"),
    ("canfd_mode", "canfd_mode"),
    ("kp", "kp"),
    ("kd", "kd"),
    ("grasp_torque_threshold", "grasp_torque_threshold"),
    ("work_stroke_mm", "work_stroke_mm"),
)
"""Keys of a file, and the fields that take them, where they are there."""
_NUMBERS = ("kp", "kd", "grasp_torque_threshold", "work_stroke_mm", "can_id", "mst_id")


def default_path(channel: str) -> str:
    """Return the file of LITEGRIP_CALIB, else that of a channel in ~/.litegrip."""
    named = os.environ.get(_VARIABLE)
    return named or os.path.expanduser(f"~/.litegrip/{channel}_calibration.json")


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return a file's keys; raises `OSError`, and `ValueError` for what is no JSON object."""
    content = json.loads(Path(path).read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError("it holds no JSON object")
    return content


def read_strictly(path: str) -> dict[str, Any]:
    """Return a file's keys; raises `CommandError`."""
    try:
        return read(path)
    except (OSError, ValueError, RecursionError) as error:
        raise CommandError(f"the calibration {path} cannot be read: {error}") from error


def candidates(channel: str, legacy: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the program's own files that can be read and are for `channel`, the best first."""
    for path in (default_path(channel), legacy):
        try:
            content = read(path)
        except FileNotFoundError:
            continue
        except (OSError, ValueError, RecursionError) as error:
            LOG.warning("calibration %s cannot be read, it is passed over: %s", path, error)
            continue
        if content.get("channel") not in (None, channel):
            LOG.info("calibration %s is for channel %s, not %s", path, content["channel"], channel)
            continue
        yield path, content


def apply(content: Mapping[str, Any], config: GripperConfig) -> None:
    """Set the fields that a file has. Raises `KeyError` for a required one that it lacks.

    Raises `CommandError`, and sets nothing, for figures that are not finite, or a scale of 0.
    """
    given = {key: content[key] for key in _REQUIRED}
    given |= {key: content[key] for key in _NUMBERS if content.get(key) is not None}
    for key, value in given.items():
        finite(f"{key} of the calibration", value)
    if content["rad_to_mm"] == 0:
        raise CommandError("rad_to_mm of the calibration is 0")
    for key, field in _TAKEN:
        if content.get(key) is not None:
            setattr(config, field, content[key])
    for name in ("can_id", "mst_id"):
        if content.get(name):
            setattr(config, name, int(content[name]))
    config.calibrated = bool(content.get("calibrated", True))


def content_of(config: GripperConfig, motor_type: str, mst_id: int | None) -> dict[str, Any]:
    """Return the keys of a file for a configuration."""
    content: dict[str, Any] = {
        "channel": config.can_channel,
        "can_id": config.can_id,
        "canfd_mode": config.canfd_mode,
        "calibrated": True,
        "zero_position_rad": config.pos_closed_rad,
        "max_position_rad": config.pos_open_rad,
        "travel_range_rad": abs(config.pos_open_rad - config.pos_closed_rad),
        "rad_to_mm": config.rad_to_mm,
        "work_stroke_mm": config.work_stroke_mm,
        "motor_type": motor_type,
        "kp": config.kp,
        "kd": config.kd,
        "grasp_torque_threshold": config.grasp_torque_threshold,
    }
    return content if not mst_id else {**content, "mst_id": mst_id}


def write(path: str | os.PathLike[str], content: Mapping[str, Any]) -> None:
    """Write a file at once or not at all, with its folder; keys that it has beyond these stay."""
    target = Path(path).expanduser().resolve()
    if str(target) in (*TEMPLATES.values(), FACTORY):
        raise CommandError(f"{path} comes with the package and is not to be written: name another")
    try:
        older = read(target)
    except (OSError, ValueError, RecursionError):
        older = {}
    text = json.dumps({**older, **content}, indent=2) + "\n"
    try:
        atomic_file.write(target, text.encode())
    except OSError as error:
        raise CommandError(f"the calibration cannot be written to {target}: {error}") from error
