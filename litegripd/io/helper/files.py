"""The files of a channel, read and written by the helper process: calibrations, motion settings.

Calibrations are searched in the vendor's order: the channel's own file, then the old file for all
channels, then the factory's. A file that names another channel is skipped: its direction could be
wrong. A file that exists but cannot be used ends the search, and is an error that names it: no
default takes its place.
"""

import json
import os
import reprlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from litegrip_client.values import strict_json
from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.text import cause
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import REAL, FileError, FileSystem
from litegripd.model.calibration import (
    Calibration,
    CalibrationError,
    Saved,
    parse_calibration,
    to_plain,
)

DATA = Path(__file__).parents[2] / "model" / "data"
TEMPLATES = ("normal", "reverse")
MAX_FILE_BYTES = 16_384
"""Of a file, and of what it holds as ASCII JSON: what was found must fit into one packet."""

_MAX_CHANNEL = 64
_HINT = (
    "the search ends here, since another file could have the jaws' direction reversed: repair or"
    ' remove this one, or name the mount in the configuration ([gripper] mount = "normal" or'
    ' "reverse")'
)


@dataclass(frozen=True, slots=True)
class Found:
    """A calibration, the file that it came from, and the files that were passed over, and why."""

    calibration: Calibration | None
    path: Path | None
    skipped: tuple[str, ...]


def state_directory() -> Path:
    """Return where the daemon keeps its own files."""
    given = os.environ.get("STATE_DIRECTORY")
    if given:
        return Path(given.split(":")[0])
    shared = Path("/var/lib/litegripd")
    if os.access(shared, os.W_OK) or os.access(shared.parent, os.W_OK):
        return shared
    state_home = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(state_home) / "litegripd"


def own_file(channel: str, kind: str) -> Path:
    """Return the path of one of the daemon's own files, e.g. of the kind "motion".

    Raises `ValueError` for a channel that is no plain file name: it came from a command line.
    """
    return state_directory() / f"{_plain(channel)}_{kind}.json"


def own_directory(channel: str, kind: str) -> Path:
    """Return the directory of the daemon's own files of one kind; raises as `own_file` does."""
    return state_directory() / kind / _plain(channel)


def _plain(channel: str) -> str:
    """Return a channel's name if it can be part of a file's."""
    if (
        not 0 < len(channel) <= _MAX_CHANNEL
        or channel.startswith(".")
        or "/" in channel
        or not channel.isprintable()
    ):
        raise ValueError(
            f"channel {channel[:_MAX_CHANNEL]!r} cannot be part of a file's name: it must have 1 to"
            f" {_MAX_CHANNEL} printable characters, no / and no leading dot"
        )
    return channel


def find_configured(channel: str, mount: str | None) -> Found:
    """Return the calibration that a daemon starts with.

    A template is nominal: where the daemon's own file has the same mount, that is what was
    measured since, and wins. Raises as `find_calibration` does.
    """
    if mount not in TEMPLATES:
        return find_calibration(channel, mount)
    own = own_file(channel, "calibration")
    try:
        measured = _read(own)
    except FileNotFoundError:
        return find_calibration(channel, mount)
    if measured.geometry.mount == mount and measured.channel in (None, channel):
        return Found(measured, own, ())
    skipped = (f"{own}: it is not for mount {mount} on channel {channel}, which is configured",)
    return replace(find_calibration(channel, mount), skipped=skipped)


def find_calibration(channel: str, mount: str | None) -> Found:
    """Return the requested calibration, else the first one of the chain.

    Raises `CalibrationError` where one was asked for by name or path and cannot be used, and where
    one of the chain is there and cannot be used: falling back could answer "reverse" with the
    factory's normal mount. Raises `ValueError` for a channel that is no plain file name.
    """
    if mount in TEMPLATES:
        path = DATA / f"{mount}.json"
        return Found(_read(path).direction_only(), path, ())
    asked = mount or os.environ.get("LITEGRIP_CALIB")
    if asked is not None:
        path = Path(asked).expanduser()
        if mount is not None and not path.is_absolute():
            raise CalibrationError(
                f"{mount!r} is neither a template ({', '.join(TEMPLATES)}) nor an absolute path"
            )
        try:
            return Found(_read(path), path, ())
        except FileNotFoundError:
            raise CalibrationError(f"{path}: there is no such file") from None
    return _first_of(channel, chain(channel))


def chain(channel: str) -> tuple[Path, ...]:
    """Return the files that are tried for a channel, in their order."""
    home = Path.home() / ".litegrip"
    return (
        own_file(channel, "calibration"),
        home / f"{channel}_calibration.json",
        home / "litegrip_calibration.json",
        DATA / "factory.json",
    )


def _first_of(channel: str, paths: tuple[Path, ...]) -> Found:
    skipped: list[str] = []
    for path in paths:
        try:
            calibration = _read(path)
        except FileNotFoundError:
            continue
        except CalibrationError as error:
            # The previous file is never used unasked: its mount may differ.
            previous, hint = path.with_name(f"{path.stem}.previous.json"), _HINT
            if os.access(previous, os.R_OK):
                hint += f"; the calibration before it is {previous}"
            raise CalibrationError(f"{error}; {hint}") from error
        if calibration.channel not in (None, channel):
            skipped.append(f"{path}: it is for channel {reprlib.repr(calibration.channel)}")
            continue
        return Found(calibration, path, tuple(skipped))
    return Found(None, None, tuple(skipped))


def _read(path: Path) -> Calibration:
    try:
        text = atomic_file.read(path, MAX_FILE_BYTES)
    except atomic_file.FileError as error:
        raise CalibrationError(str(error)) from error
    try:
        calibration = parse_calibration(text)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}{cause(text)}") from error
    if len(json.dumps(calibration.content)) > MAX_FILE_BYTES:
        raise CalibrationError(f"{path}: larger than {MAX_FILE_BYTES} bytes as ASCII JSON")
    return replace(calibration, saved_s=path.stat().st_mtime)


def load_operation(parameters: Mapping[str, object]) -> dict[str, object]:
    """Find a calibration, as the helper's operation `calibration.load`.

    `mount` is what is asked for, if anything is; `configured` is true if the configuration asks.
    """
    mount = parameters["mount"]
    find = find_configured if parameters["configured"] else find_calibration
    found = find(str(parameters["channel"]), None if mount is None else str(mount))
    return {
        "path": None if found.path is None else str(found.path),
        "skipped": found.skipped,
        "factory": found.path == DATA / "factory.json",
        "calibration": None if found.calibration is None else to_plain(found.calibration),
    }


def templates_operation(_parameters: Mapping[str, object]) -> list[dict[str, object]]:
    """Read the templates, as the helper's operation `calibration.templates`."""
    paths = {name: DATA / f"{name}.json" for name in TEMPLATES}
    return [{"name": name, "content": _read(path).content} for name, path in paths.items()]


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
        content = strict_json.decode_file(text)
        return {"config": _checked_motion(content, channel), "path": str(path)}
    except ValueError as error:
        raise FileError(f"{path}: {error}{cause(text)}; repair or remove it") from None


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
        raise FileError(f"{path}: cannot be written: {why_not_written(error, path)}") from error
