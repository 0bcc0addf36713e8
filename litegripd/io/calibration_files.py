"""The chain of calibration files and templates, read by the helper process.

The order is the vendor's: the channel's own file, then the old file for all channels, then the
factory's. A file that names another channel is skipped there: its direction could be wrong.
"""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from litegripd.model.calibration import Calibration, CalibrationError, parse_calibration
from litegripd.model.geometry import Geometry

DATA = Path(__file__).parent.parent / "model" / "data"
TEMPLATES = ("normal", "reverse")
MAX_FILE_BYTES = 65_536


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


def find_calibration(channel: str, mount: str | None) -> Found:
    """Return the calibration that a configuration asks for, else the first one of the chain.

    Raises `CalibrationError` where one was asked for by name or path and cannot be used: falling
    back could answer "reverse" with the factory's normal mount.
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
        state_directory() / f"{channel}_calibration.json",
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
            skipped.append(str(error))
            continue
        if calibration.channel not in (None, channel):
            skipped.append(f"{path}: it is for channel {calibration.channel}")
            continue
        return Found(calibration, path, tuple(skipped))
    return Found(None, None, tuple(skipped))


def _read(path: Path) -> Calibration:
    try:
        with path.open("rb") as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > MAX_FILE_BYTES:
        raise CalibrationError(f"{path}: larger than {MAX_FILE_BYTES} bytes")
    try:
        return parse_calibration(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: not UTF-8") from error
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error


def load_operation(parameters: Mapping[str, object]) -> dict[str, object]:
    """Find a calibration, as the helper's operation `calibration.load`."""
    mount = parameters["mount"]
    found = find_calibration(str(parameters["channel"]), None if mount is None else str(mount))
    calibration = found.calibration
    return {
        "path": None if found.path is None else str(found.path),
        "skipped": found.skipped,
        "calibration": None
        if calibration is None
        else {**asdict(calibration.geometry), **{n: getattr(calibration, n) for n in _PLAIN}},
    }


def found_from(answer: Mapping[str, Any]) -> Found:
    """Make what `load_operation` found of its answer."""
    path = None if answer["path"] is None else Path(answer["path"])
    values = answer["calibration"]
    if values is None:
        return Found(None, path, tuple(answer["skipped"]))
    geometry = Geometry(values["closed_rad"], values["open_rad"], values["rad_to_mm"])
    calibration = Calibration(geometry, **{name: values[name] for name in _PLAIN})
    return Found(calibration, path, tuple(answer["skipped"]))


_PLAIN = ("calibrated", "channel", "kp_nm_rad", "kd_nm_s_rad")
