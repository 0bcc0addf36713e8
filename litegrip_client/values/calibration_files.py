"""Calibration files of the client: its own file system, its own environment, the templates.

JSON, interchangeable with the vendor SDK's. This module only finds, reads and writes
them. The daemon decides what a file means, and if it can be used.
"""

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from litegrip_client.values import atomic_file
from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.calibration import CALIBRATION_KEYS
from litegrip_client.values.errors import CommandError, ParameterError
from litegrip_client.values.text import json_of
from litegrip_client.values.warn import warn

CALIB_VARIABLE = "LITEGRIP_CALIB"
MAX_FILE_BYTES = 16_000
"""What fits into one line to the daemon; a calibration has some 400 bytes."""

_DATA = Path(__file__).resolve().parents[1] / "data"

CALIB_TEMPLATES: dict[str, str] = {
    name: str(_DATA / f"{name}.json") for name in ("normal", "reverse")
}
"""Name of a mount: the path of its template. They are nominal: direction and geometry only."""


DEFAULT_CALIB = CALIB_TEMPLATES["normal"]
"""The nominal calibration: that of a normal mount, as the SDK's factory file is."""


def default_calib_path(channel: str = "can0") -> str:
    """Return the file of this user's in which the SDK keeps a channel's calibration.

    The daemon has a file of its own: `load_calibration()` finds both, and `save_calibration()`
    without a path writes the daemon's.
    """
    return str(Path(os.path.expanduser("~/.litegrip")) / f"{channel}_calibration.json")  # noqa: PTH111 - no error without a home


def list_templates() -> list[str]:
    """Return the names of the mounts, in the order in which to offer them."""
    return list(CALIB_TEMPLATES)


def check_template(name: str) -> str:
    """Return `name` if it is a template; raises `CommandError` that lists them."""
    if not isinstance(name, str) or name not in CALIB_TEMPLATES:
        raise ParameterError(
            f"{name!r:.80} is no mount, it must be one of: {', '.join(CALIB_TEMPLATES)}",
            reason="invalid_params",
            data={"parameter": "template", "allowed": list_templates()},
        )
    return name


def template_at(path: str | os.PathLike[str]) -> str | None:
    """Return the template whose file `path` is, if it is one."""
    resolved = _path(path)
    return next((name for name, own in CALIB_TEMPLATES.items() if Path(own) == resolved), None)


def environment_path() -> str | None:
    """Return the file that LITEGRIP_CALIB names for all channels."""
    return os.environ.get(CALIB_VARIABLE) or None


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a file's keys; raises `CommandError` when that cannot be done."""
    found = _path(path)
    try:
        with found.open("rb") as file:
            raw = file.read(MAX_FILE_BYTES + 1)
        if len(raw) > MAX_FILE_BYTES:
            raise _unreadable(path, f"it is larger than {MAX_FILE_BYTES} bytes")
        content = json_of(raw)
    except (OSError, ValueError) as error:
        raise _unreadable(path, getattr(error, "strerror", None) or str(error)) from None
    if not isinstance(content, dict):
        raise _unreadable(path, "it holds no JSON object")
    return content


def own_files(channel: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Read the user's own files that are for `channel`: its own one, then the old one for all.

    A file that names another channel is passed over, since its direction could be wrong; the log
    says so. Raises `CommandError` for one that is there and cannot be read: what would be found
    instead could be the other mount's.
    """
    for name in (f"{channel}_calibration.json", "litegrip_calibration.json"):
        path = f"~/.litegrip/{name}"
        try:
            content = read(path)
        except CommandError as error:
            if not isinstance(error.__context__, FileNotFoundError):
                raise
            continue
        if content.get("channel") not in (None, channel):
            warn(f"passed over: {path} is for channel {content['channel']!r:.80}")
            continue
        yield path, content


def check_writable(path: str | os.PathLike[str]) -> None:
    """Raise `CommandError` for a template, which is no place for a measurement."""
    if (name := template_at(path)) is not None:
        raise ParameterError(
            f"{path} is the template {name}, which is not to be written",
            reason="invalid_params",
            data={"hint": f"name another file, or unset {CALIB_VARIABLE} if it names this one"},
        )


def write(path: str | os.PathLike[str], content: Mapping[str, Any]) -> str:
    """Write a file at once or not at all, with its directory; return its path.

    Keys of an older file there that calibrations do not have are kept. Raises `CommandError`.
    """
    check_writable(path)
    target = _path(path)
    text = json.dumps({**_foreign_keys(target), **content}, indent=2, allow_nan=False) + "\n"
    try:
        atomic_file.write(target, text.encode())
    except OSError as error:
        raise CommandError(
            f"the calibration cannot be written to {target}: {why_not_written(error, target)}",
            reason="not_saved",
            data={"path": str(target)},
        ) from error
    return str(target)


def _foreign_keys(path: Path) -> dict[str, Any]:
    try:
        older = read(path)
    except CommandError:
        return {}  # missing, or nothing that is worth keeping
    return {key: value for key, value in older.items() if key not in CALIBRATION_KEYS}


def _path(path: str | os.PathLike[str]) -> Path:
    try:
        # Links are resolved, so that a link still points to the new file.
        return Path(path).expanduser().resolve()
    except (TypeError, ValueError, OSError, RuntimeError) as error:  # RuntimeError: no home, a loop
        text = f"{path!r:.80} cannot be the path of a calibration: {error}"
        raise ParameterError(text, reason="invalid_params") from error


def _unreadable(path: str | os.PathLike[str], why: str) -> CommandError:
    data: dict[str, Any] = {"path": os.fspath(path)}
    if os.fspath(path) in CALIB_TEMPLATES:
        data["hint"] = f'for the mount of that name: load_calibration(template="{path}")'
    text = f"the calibration {path} cannot be read: {why}"
    return CommandError(text, reason="calibration_unreadable", data=data)
