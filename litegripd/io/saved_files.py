"""The daemon's own files for a channel, written and read by the helper process.

The calibration that was measured and the motion settings that were chosen. A file that is there
but cannot be used is an error that names it; nothing here puts a default in its place.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from litegripd.io import atomic_file
from litegripd.io.atomic_file import REAL, FileError, FileSystem
from litegripd.io.calibration_files import MAX_FILE_BYTES, own_file
from litegripd.model.calibration import CalibrationError, Saved, parse_calibration


def save_calibration(parameters: Mapping[str, object], file_system: FileSystem = REAL) -> Saved:
    """Save `content` as the calibration of `channel`, as the operation `calibration.save`.

    Keeps the file before as `<channel>_calibration.previous.json`. Raises `CalibrationError`, and
    writes nothing, for a content that could not be read back; `ValueError` for a channel that is
    no plain file name; `FileError` where the file cannot be written.
    """
    channel = str(parameters["channel"])
    path = own_file(channel, "calibration")
    previous = own_file(channel, "calibration.previous")
    content = parameters["content"]
    if not isinstance(content, Mapping):
        raise CalibrationError(f"the content for {path} is not an object")
    text = _text({**content, "channel": channel})
    try:
        parse_calibration(text)
    except CalibrationError as error:
        raise CalibrationError(f"{path} is not written: {error}") from error
    kept = _write(path, text, previous, file_system)
    return {
        "path": str(path),
        "previous": str(previous) if kept else None,
        "saved_s": time.time(),
    }


def load_motion(parameters: Mapping[str, object]) -> dict[str, object]:
    """Return the motion settings saved for `channel`, as the operation `motion.load`.

    `config` is None where there is no file. The values are plain, but not judged here. Raises
    `FileError` for a file that cannot be used.
    """
    channel = str(parameters["channel"])
    path = own_file(channel, "motion")
    try:
        text = atomic_file.read(path, MAX_FILE_BYTES)
    except FileNotFoundError:
        return {"config": None, "path": str(path)}
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
        return {"config": _checked_motion(content, channel), "path": str(path)}
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: {error}; repair or remove it") from None


def save_motion(
    parameters: Mapping[str, object], file_system: FileSystem = REAL
) -> dict[str, object]:
    """Save `config` as the motion settings of `channel`, as the operation `motion.save`.

    Raises `ValueError` for a channel that is no plain file name and for a config that
    `load_motion` would refuse; `FileError` where the file cannot be written.
    """
    channel = str(parameters["channel"])
    path = own_file(channel, "motion")
    content = {"channel": channel, "config": parameters["config"]}
    _checked_motion(content, channel)
    _write(path, _text(content, allow_nan=False), None, file_system)
    return {"path": str(path)}


def _checked_motion(content: Any, channel: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise ValueError("not a JSON object")
    if content.get("channel") != channel:
        raise ValueError(f"it is not for channel {channel}")
    config = content.get("config")
    if not isinstance(config, dict):
        raise ValueError("config is missing or not an object")
    for name, value in config.items():
        if value is not None and not isinstance(value, str | int | float):
            raise ValueError(f"config: {name[:64]} is neither a number, boolean, string nor null")
    return config


def _refuse_constant(name: str) -> float:
    raise ValueError(f"not valid JSON: {name} is no number")


def _text(content: Mapping[str, Any], *, allow_nan: bool = True) -> str:
    return json.dumps(content, indent=2, allow_nan=allow_nan) + "\n"


def _write(path: Path, text: str, previous: Path | None, file_system: FileSystem) -> bool:
    content = text.encode()
    if len(content) > MAX_FILE_BYTES:
        raise FileError(
            f"{path} is not written: {len(content)} bytes, more than the {MAX_FILE_BYTES} of a file"
        )
    try:
        return atomic_file.write(path, content, keep_previous=previous, file_system=file_system)
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror}") from error
