"""Puts the planned files into a system and takes them out again; both may be repeated.

A changed configuration is never overwritten, and what the daemons have stored is never touched.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from litegrip_client import atomic_file
from litegrip_client.errors import CommandError
from litegrip_client.units import plan
from litegrip_client.units.access import USER
from litegrip_client.units.plan import Planned

_MODE = 0o644
_ENABLED = "etc/systemd/system/*.wants/litegripd[@.]*"
_RUNNING = "run/systemd/units/invocation:litegripd@*.service"
"""systemd's own notes, from a unit's start until it has stopped or failed."""

_DROP_INS = "systemd/system/litegripd@*.service.d/*.conf"
_FOREIGN = re.compile(r"^\s*User\s*=\s*(\S+)", re.MULTILINE)
_NO_OTHER_USER = f"/run/litegripd and /var/lib/litegripd belong to {USER}: it cannot write there"
_NETWORKD = "etc/systemd/system/*.wants/systemd-networkd.service"


@dataclass(frozen=True, slots=True)
class Done:
    """What became of one file: installed, replaced, unchanged, kept, removed."""

    path: str
    what: str


@dataclass(frozen=True, slots=True)
class Wishes:
    """What to install beside the units: CAN interfaces to bring up, access to serial ports."""

    channels: Sequence[str] = ()
    serial: bool = False


def uses_networkd(root: Path) -> bool:
    """Return True if systemd-networkd is enabled in a system."""
    return any(root.glob(_NETWORKD))


def is_packaged(root: Path) -> bool:
    """Return True if a system has the units from the Debian package."""
    return (root / plan.PACKAGED).is_file()


def enabled(root: Path) -> list[str]:
    """Return which units are enabled in a system: litegripd@can0, say, and litegripd.target."""
    return sorted({link.name.removesuffix(".service") for link in root.glob(_ENABLED)})


def running(root: Path) -> list[str]:
    """Return the daemons that systemd runs or is about to restart: litegripd@can0, say."""
    names = (note.name.partition(":")[2] for note in root.glob(_RUNNING))
    return sorted(name.removesuffix(".service") for name in names)


def foreign_users(root: Path) -> list[str]:
    """Return the drop-ins that run a daemon as another user, and why that does not work."""
    notes = []
    for path in sorted({*root.glob(f"etc/{_DROP_INS}"), *root.glob(f"run/{_DROP_INS}")}):
        for value in _FOREIGN.findall(path.read_text(errors="replace")):
            if value == USER:
                continue
            notes.append(f"{path} sets User={value}; {_NO_OTHER_USER}")
    return notes


def hiding(root: Path) -> list[str]:
    """Return the files that systemd takes in place of those that are installed."""
    names = ("litegripd@.service", "litegripd.target")
    paths = [root / "etc/systemd/system" / name for name in names]
    return [str(path) for path in paths if path.is_file()]


def outdated(root: Path) -> list[str]:
    """Return the administrator's copies of files that are no longer installed: they hide none."""
    copies = [root / path.replace("usr/local/lib", "etc", 1) for path in plan.SUPERSEDED]
    return [str(path) for path in copies if path.is_file()]


def channels(root: Path) -> list[str]:
    """Return the CAN interfaces that are brought up by what was installed before."""
    paths = [root / path for path in (plan.RULES, *plan.SUPERSEDED)]
    contents = [path.read_text(errors="replace") for path in paths if path.is_file()]
    return list(dict.fromkeys(name for text in contents for name in plan.channels_in(text)))


def install(root: Path, wishes: Wishes, programs: str) -> list[Done]:
    """Install the requested files, and reinstall those installed before.

    Where the package has brought the units, only what belongs beside them; copies of an earlier
    installation, which would be used in their place, are removed. Raises `CommandError` where a
    file cannot be written.
    """
    files: list[Planned] = []
    done: list[Done] = []
    if is_packaged(root):
        done += _remove_all(root, plan.units(programs))
    else:
        files += plan.units(programs)
    if wishes.serial or (root / plan.serial()[0].path).is_file():
        files += plan.serial()
    named = list(dict.fromkeys([*channels(root), *wishes.channels]))
    if named:
        files += plan.udev(named)
        done += _remove_all(root, plan.superseded())
    return [_put(root, file) for file in files] + done


def uninstall(root: Path) -> list[Done]:
    """Remove what `install` has installed; raises `CommandError` while one is enabled or runs."""
    left = [] if is_packaged(root) else sorted({*enabled(root), *running(root)})
    if left:
        raise CommandError(
            f"enabled or running: {', '.join(left)}",
            reason="wrong_usage",
            data={"hint": f"first: systemctl disable --now {' '.join(left)}"},
        )
    files = plan.units("") + plan.serial() + plan.udev((plan.EXAMPLE_CHANNEL,)) + plan.superseded()
    return _remove_all(root, files)


def _put(root: Path, file: Planned) -> Done:
    path = root / file.path
    content = file.content.encode()

    def put() -> str:
        before = path.read_bytes() if path.exists() else None
        if before == content:
            return "unchanged"
        if before is not None and file.kept:
            return "kept"
        _make_directories(path.parent)
        atomic_file.write(path, content)
        path.chmod(_MODE)
        return "installed" if before is None else "replaced"

    return Done(str(path), _attempt("written", path, put))


def _remove_all(root: Path, files: Sequence[Planned]) -> list[Done]:
    done = []
    for file in files:
        path = root / file.path
        if not path.exists():
            continue
        done.append(Done(str(path), "kept" if file.kept else _remove(path)))
    drop_ins = root / plan.serial()[0].path
    if not drop_ins.exists() and drop_ins.parent.is_dir() and not any(drop_ins.parent.iterdir()):
        drop_ins.parent.rmdir()
    return done


def _remove(path: Path) -> str:
    def remove() -> str:
        path.unlink()
        return "removed"

    return _attempt("removed", path, remove)


def _make_directories(directory: Path) -> None:
    """Make a directory that all may read, whatever the umask."""
    if not directory.is_dir():
        _make_directories(directory.parent)
        directory.mkdir()
        directory.chmod(0o755)


def _attempt(doing: str, path: Path, action: Callable[[], str]) -> str:
    try:
        return action()
    except OSError as error:
        raise CommandError(
            f"{path} cannot be {doing}: {error.strerror}",
            reason="file_not_written",
            data={"hint": "it takes root: sudo"},
        ) from error
