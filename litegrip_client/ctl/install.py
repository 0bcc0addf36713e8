"""Puts the distribution's files into a system and takes them out again; both may be repeated.

The files are those of `systemd/` and `etc/` in the sources, with words filled in. Whether the
daemons' user can run the programs is judged by modes, and no command is run: the user may not exist
yet, and then it is as all others.
"""

from __future__ import annotations

import contextlib
import errno
import importlib.metadata
import importlib.util
import os
import pwd
import re
import stat
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from litegrip_client.values import atomic_file
from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.errors import CommandError
from litegrip_client.values.version import is_of_debian

USER = "litegrip"

_READ, _SEARCH = 4, 1
"""Rights of a mode; the latter is also that to run a program."""
_ACCESS_LIST = "system.posix_acl_access"


@dataclass(frozen=True, slots=True)
class Reader:
    """Who is to read: a user that there is, or one of whom nothing is known."""

    uid: int = -1
    gids: frozenset[int] = frozenset()

    def may(self, path: Path, bits: int) -> bool:
        """Return True if a file's mode lets them; one with its own access list is trusted."""
        found = path.stat()
        shift = 6 if found.st_uid == self.uid else 3 if found.st_gid in self.gids else 0
        if (found.st_mode >> shift) & bits == bits:
            return True
        try:
            return _ACCESS_LIST in os.listxattr(path)
        except OSError:  # a file system that has none
            return False


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A file or directory that keeps a user from running the daemon, and why."""

    path: Path
    why: str

    def __str__(self) -> str:
        return f"{self.path} {self.why}"


def reader_of(name: str = USER) -> Reader:
    """Return what the system knows of a user."""
    try:
        entry = pwd.getpwnam(name)
    except KeyError:
        return Reader()
    return Reader(entry.pw_uid, frozenset(os.getgrouplist(name, entry.pw_gid)))


def obstacle(programs: str, reader: Reader) -> Obstacle | None:
    """Return the first thing that keeps a user from running the daemon, if any."""
    for path, bits in _needed(Path(programs)):
        for step in _way(path):
            why = _closed(step, reader, bits if step == path else 0)
            if why is not None:
                return Obstacle(step, why)
    return None


def _closed(step: Path, reader: Reader, bits: int) -> str | None:
    """Return why a reader lacks these rights, or None; directories must always let them through."""
    try:
        mode = step.stat().st_mode
        needed = bits | (_SEARCH if stat.S_ISDIR(mode) else 0)
        return None if reader.may(step, needed) else f"is closed to it (mode {mode & 0o7777:04o})"
    except OSError as error:
        return f"cannot be used: {error.strerror}"


def _needed(programs: Path) -> Iterator[tuple[Path, int]]:
    """Yield the programs, their interpreters, its library, and all packages."""
    for name in ("litegripd", "litegripctl"):
        yield programs / name, _READ | _SEARCH
        first = (programs / name).read_bytes().partition(b"\n")[0]
        if first.startswith(b"#!/"):
            yield Path(os.fsdecode(first[2:].split()[0])), _SEARCH
    yield Path(os.__file__), _READ
    for kind in ("purelib", "platlib"):
        packages = Path(sysconfig.get_path(kind))
        yield packages, _READ
        found = (path for path in sorted(packages.iterdir()) if path.name != "__pycache__")
        yield from ((path, _READ) for path in found)
    for name in ("litegripd", "litegrip_client"):  # elsewhere in an editable installation
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            yield Path(spec.origin).parent, _READ


def _way(path: Path) -> list[Path]:
    """List each directory on the way to a file, and the file, links followed one by one."""
    way: dict[Path, None] = {}
    left = [path]
    while left:
        current = left.pop()
        for step in (*reversed(current.parents), current):
            if step not in way:
                way[step] = None
                if step.is_symlink():
                    left.append(step.parent / step.readlink())
    return list(way)


DATA = Path(__file__).resolve().parent.parent / "data"
PROGRAMS = "/opt/litegripd/bin/"
MANUALS = "/opt/litegripd/share/man/"
"""Paths as the files have them; those of the running environment replace them."""

VERSIONS = "-versions"
"""Environments below a directory of this ending are versions, one of which a link without it leads
to: /opt/litegripd to one of those in /opt/litegripd-versions."""

PACKAGED = "usr/lib/systemd/system/litegripd@.service"
"""The unit of the Debian package; a copy in usr/local/lib would be used in place of it."""

EXAMPLE_CHANNEL = "can0"
_UNITS = "usr/local/lib/systemd/system"
RULES = "usr/local/lib/udev/rules.d/85-litegrip.rules"
"""Behind 80-net-setup-link.rules, before which an interface does not have its name."""
SERIAL_RULES = "usr/local/lib/udev/rules.d/91-litegrip-serial.rules"
"""Behind those of ModemManager (80-mm-candidate) and brltty (85 or 90)."""
SUPERSEDED = (
    "usr/local/lib/udev/rules.d/80-litegrip.rules",
    "usr/local/lib/systemd/network/80-litegrip.network",
    "usr/local/lib/systemd/network/80-litegrip.link",
)
"""What earlier versions installed for the same, which would undo it or do it twice."""
_NAMED = re.compile(r'^(?:Name=|.*(?:KERNEL|LITEGRIP_NAME\})==")([^"\n]+)', re.MULTILINE)
_ELSEWHERE = "install it where all may read it: python3 -m venv /opt/litegripd"
_PLAIN = re.compile(r"[A-Za-z0-9_./+-]+")
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # noqa: S108 - not used, refused
"""What the unit does not see: ProtectHome and PrivateTmp."""


@dataclass(frozen=True, slots=True)
class Planned:
    """A file and its content; one that is `kept` is never overwritten and never removed."""

    path: str
    content: str
    kept: bool = False


def units(programs: str) -> list[Planned]:
    """Return what every installation has."""
    return [
        _unit("litegripd@.service", programs),
        _unit("litegripd.target", programs),
        _unit("litegripd-web.service", programs),
        Planned("usr/local/lib/sysusers.d/litegripd.conf", _read("systemd/litegripd.sysusers")),
        Planned("usr/local/lib/tmpfiles.d/litegripd.conf", _read("systemd/litegripd.tmpfiles")),
        Planned("etc/litegripd/litegripd.toml", _read("etc/litegripd.toml"), kept=True),
    ]


def serial() -> list[Planned]:
    """Return what lets the daemons use adapters at serial ports, and keeps others off them."""
    return [
        Planned(f"{_UNITS}/litegripd@.service.d/serial.conf", _read("systemd/serial.conf")),
        Planned(SERIAL_RULES, _read("systemd/91-litegrip-serial.rules")),
    ]


def fleet(programs: str) -> list[Planned]:
    """Return what gateway, portal and router of a fleet have."""
    return [
        _unit("litegripd-fleet@.service", programs),
        Planned(
            "usr/local/lib/sysusers.d/litegripd-fleet.conf",
            _read("systemd/litegripd-fleet.sysusers"),
        ),
        Planned("etc/litegripd/fleet.toml", _read("etc/fleet.toml"), kept=True),
    ]


def udev(channels: Sequence[str]) -> list[Planned]:
    """Return what has udev bring these CAN interfaces up, whatever manages the network."""
    name = "systemd/85-litegrip.rules"
    before = _read(name)
    content = re.sub(rf"\b{EXAMPLE_CHANNEL}\b", lambda _: "|".join(channels), before)
    if content == before and list(channels) != [EXAMPLE_CHANNEL]:
        raise ValueError(f"{name} names no {EXAMPLE_CHANNEL} that could be replaced")
    return [Planned(RULES, content)]


def superseded() -> list[Planned]:
    """Return what of earlier versions is to be removed."""
    return [Planned(path, "") for path in SUPERSEDED]


def program_directory() -> str:
    """Return where the programs of the running environment are, and the unit can run them.

    Of a version that is reached by a link it is the path by the link, so that the unit stays right
    when that is switched. Raises `CommandError` where the unit could not run them.
    """
    scripts = sysconfig.get_path("scripts")
    if not Path(scripts, "litegripd").is_file():
        why = f"there is no program litegripd in {scripts}"
        raise _unusable(why, "apt install litegripd") if is_of_debian() else _unusable(why)
    directory = str(_by_link(Path(scripts)))
    for needed in (directory, str(Path(sys.executable).resolve())):
        if not _PLAIN.fullmatch(needed):
            raise _unusable(f"{needed} has characters that a unit file gives a meaning of its own")
        if any(needed.startswith(f"{hidden}/") for hidden in _HIDDEN):
            raise _unusable(f"{needed} is where the daemon, shut off by its unit, cannot see it")
    in_the_way = obstacle(directory, reader_of())
    if in_the_way is not None:
        why = f"the user {USER} cannot run the programs in {directory}: {in_the_way}"
        if in_the_way.path.resolve().is_relative_to(Path(sys.prefix).resolve()):
            raise _unusable(why, f"let all read it: chmod --recursive go+rX {sys.prefix}")
        raise _unusable(why)
    return directory


def _by_link(scripts: Path) -> Path:
    """Return the path by the link that leads to this version, where there are versions."""
    version = scripts.parent
    versions = version.parent
    if not versions.name.endswith(VERSIONS):
        return scripts
    link = versions.with_name(versions.name.removesuffix(VERSIONS))
    if link.resolve() != version.resolve():
        new = f"{link}.new"
        switch = f"ln -s {versions.name}/{version.name} {new} && mv -T {new} {link}"
        raise _unusable(
            f"{link} does not lead to {version}, the version that this program is of",
            f"run {link}/bin/litegripctl, or have it lead there: {switch}",
        )
    return link / scripts.name


def _unusable(why: str, hint: str = _ELSEWHERE) -> CommandError:
    return CommandError(why, reason="wrong_usage", data={"hint": hint})


def _unit(name: str, programs: str) -> Planned:
    """Return a unit, with the paths of the environment that has these programs."""
    manuals = f"{Path(programs).parent}/share/man/"
    content = _read(f"systemd/{name}").replace(PROGRAMS, f"{programs}/").replace(MANUALS, manuals)
    return Planned(f"{_UNITS}/{name}", content)


def _read(name: str) -> str:
    return (DATA / name).read_text(encoding="utf-8")


_MODE = 0o644
_ENABLED = "etc/systemd/system/*.wants/litegripd[-@.]*"
_RUNNING = "run/systemd/units/invocation:litegripd[-@]*.service"
"""systemd's own notes, from a unit's start until it has stopped or failed."""

_DROP_INS = "systemd/system/litegripd@*.service.d/*.conf"
_FOREIGN = re.compile(r"^\s*User\s*=\s*(\S+)", re.MULTILINE)
_NO_OTHER_USER = f"/run/litegripd and /var/lib/litegripd belong to {USER}: it cannot write there"


@dataclass(frozen=True, slots=True)
class Done:
    """What became of one file: installed, replaced, unchanged, kept, removed."""

    path: str
    what: str


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to install beside the units: interfaces to bring up, serial ports, a fleet's parts."""

    channels: Sequence[str] = ()
    serial: bool = False
    fleet: bool = False


def is_packaged(root: Path) -> bool:
    """Return True if a system has the units from the Debian package."""
    return (root / PACKAGED).is_file()


def enabled(root: Path) -> list[str]:
    """Return which units are enabled in a system: litegripd@can0, say, and litegripd.target."""
    return sorted({link.name.removesuffix(".service") for link in root.glob(_ENABLED)})


def running(root: Path) -> list[str]:
    """Return the daemons that systemd runs or is about to restart: litegripd@can0, say."""
    names = (note.name.partition(":")[2] for note in root.glob(_RUNNING))
    return sorted(name.removesuffix(".service") for name in names)


@dataclass(frozen=True, slots=True)
class Lacking:
    """A unit whose program lacks a package in the environment, and the command that installs it."""

    unit: str
    package: str
    remedy: str
    is_fleet: bool = False

    def is_used(self, root: Path) -> bool:
        """Return True if the unit is enabled or runs."""
        name = self.unit.partition("@")[0]
        return any(one.startswith(name) for one in (*enabled(root), *running(root)))


_NEEDS = (
    ("litegripd-web", "litegrip-web", "litegrip_web"),
    ("litegripd-web", "websockets", "websockets.asyncio.server"),
    ("litegripd-fleet@", "litegrip-fleet", "litegrip_fleet"),
    ("litegripd-fleet@", "eclipse-zenoh", "zenoh"),
)
"""Units, a package that each needs, and the module that is imported from it: first the distribution
of the unit's program, which brings all others."""


def lacking(programs: str) -> list[Lacking]:
    """Return the units whose packages are not in the running environment."""
    found: dict[str, Lacking] = {}
    for unit, package, module in _NEEDS:
        if unit not in found and not _is_there(module):
            is_apt = package.startswith("litegrip") and is_of_debian()
            pip = f"{programs}/python -m pip install '{requirement(package)}'"
            remedy = f"apt install {package}" if is_apt else pip
            found[unit] = Lacking(unit, package, remedy, is_fleet=unit.endswith("@"))
    return list(found.values())


def _is_there(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # a package above it, of too old a version perhaps
        return False


def requirement(package: str) -> str:
    """Return a package with the versions that this program takes."""
    for name in ("litegripd", "litegrip-web", "litegrip-fleet"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            for row in importlib.metadata.requires(name) or ():
                if row.startswith(package):
                    return row.partition(";")[0].strip()
    return package


def foreign_users(root: Path) -> list[str]:
    """Return the drop-ins that run a daemon as another user, and why that does not work."""
    notes = []
    found = {*root.glob(f"etc/{_DROP_INS}"), *root.glob(f"run/{_DROP_INS}")}
    for path in sorted(path for path in found if path.is_file()):
        users = _FOREIGN.findall(path.read_text(errors="replace"))
        notes += [f"{path} sets User={one}; {_NO_OTHER_USER}" for one in users if one != USER]
    return notes


def hiding(root: Path) -> list[str]:
    """Return the files that systemd takes in place of those that are installed."""
    names = [Path(file.path).name for file in units("") + fleet("") if _UNITS in file.path]
    paths = [root / "etc/systemd/system" / name for name in names]
    return [str(path) for path in paths if path.is_file()]


def outdated(root: Path) -> list[str]:
    """Return the administrator's copies of files that are no longer installed: they hide none."""
    copies = [root / path.replace("usr/local/lib", "etc", 1) for path in SUPERSEDED]
    return [str(path) for path in copies if path.is_file()]


def channels(root: Path) -> list[str]:
    """Return the CAN interfaces that are brought up by what was installed before."""
    paths = [root / path for path in (RULES, *SUPERSEDED)]
    contents = [path.read_text(errors="replace") for path in paths if path.is_file()]
    named = [found[1] for text in contents if (found := _NAMED.search(text))]
    return list(dict.fromkeys(" ".join(named).replace("|", " ").split()))


def install(root: Path, wanted: Wanted, programs: str) -> list[Done]:
    """Install the requested files, and reinstall those installed before.

    Where the package has brought the units, only what belongs beside them; copies of an earlier
    installation, which would be used in their place, are removed. Raises `CommandError` where a
    file cannot be written.
    """
    files: list[Planned] = []
    done: list[Done] = []
    if is_packaged(root):
        done += _remove_all(root, units(programs) + fleet(programs))
    else:
        files += units(programs)
        if wanted.fleet or (root / fleet(programs)[0].path).is_file():
            files += fleet(programs)
    if wanted.serial or (root / serial()[0].path).is_file():
        files += serial()
    named = list(dict.fromkeys([*channels(root), *wanted.channels]))
    if named:
        files += udev(named)
        done += _remove_all(root, superseded())
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
    files = units("") + serial() + fleet("") + udev((EXAMPLE_CHANNEL,)) + superseded()
    return _remove_all(root, files)


def _put(root: Path, file: Planned) -> Done:
    path = root / file.path
    content = file.content.encode()
    if path.exists() and not path.is_file():  # to read a pipe would wait for ever
        raise CommandError(
            f"{path} cannot be written: it is there, and no plain file",
            reason="file_not_written",
            data={"hint": "look what has put it there; remove it, and repeat the command"},
        )
    with _attempt("written", path):
        before = path.read_bytes() if path.exists() else None
        if before == content:
            return Done(str(path), "unchanged")
        if before is not None and file.kept:
            return Done(str(path), "kept")
        _make_directories(path.parent)
        atomic_file.write(path, content)
        path.chmod(_MODE)
    return Done(str(path), "installed" if before is None else "replaced")


def _remove_all(root: Path, files: Sequence[Planned]) -> list[Done]:
    done = []
    for file in files:
        path = root / file.path
        if not path.exists():
            continue
        if not file.kept:
            with _attempt("removed", path):
                path.unlink()
        done.append(Done(str(path), "kept" if file.kept else "removed"))
    drop_ins = root / serial()[0].path
    if not drop_ins.exists() and drop_ins.parent.is_dir() and not any(drop_ins.parent.iterdir()):
        drop_ins.parent.rmdir()
    return done


def _make_directories(directory: Path) -> None:
    """Make a directory that all may read, whatever the umask."""
    if not directory.is_dir():
        _make_directories(directory.parent)
        directory.mkdir()
        directory.chmod(0o755)


_HINTS = {
    errno.EACCES: "it takes root: sudo",
    errno.EPERM: "it takes root: sudo",
    errno.EROFS: "that file system can only be read: mount it writable, or put the file into the"
    " system's image",
}


@contextlib.contextmanager
def _attempt(doing: str, path: Path) -> Iterator[None]:
    """Raise `CommandError` for what the system refuses in the block."""
    try:
        yield
    except OSError as error:
        raise CommandError(
            f"{path} cannot be {doing}: {why_not_written(error, path)}",
            reason="file_not_written",
            data={"hint": _HINTS.get(error.errno or 0, "look at that place")},
        ) from error
