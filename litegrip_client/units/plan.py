"""Which file of the distribution belongs where in a system, and with which words filled in.

Nothing is written here. The files themselves are those of `systemd/` and `etc/` in the sources.
"""

from __future__ import annotations

import re
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from litegrip_client.errors import CommandError
from litegrip_client.units import access

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
        *(
            Planned(f"{_UNITS}/{name}", _in_environment(_read(f"systemd/{name}"), programs))
            for name in ("litegripd@.service", "litegripd.target")
        ),
        Planned("usr/local/lib/sysusers.d/litegripd.conf", _read("systemd/litegripd.sysusers")),
        Planned("usr/local/lib/tmpfiles.d/litegripd.conf", _read("systemd/litegripd.tmpfiles")),
        Planned("etc/litegripd/litegripd.toml", _read("etc/litegripd.toml"), kept=True),
    ]


def serial() -> list[Planned]:
    """Return what lets the daemons use adapters at serial ports."""
    return [Planned(f"{_UNITS}/litegripd@.service.d/serial.conf", _read("systemd/serial.conf"))]


def udev(channels: Sequence[str]) -> list[Planned]:
    """Return what has udev bring these CAN interfaces up, whatever manages the network."""
    return [Planned(RULES, _for(channels, "systemd/85-litegrip.rules", "|"))]


def superseded() -> list[Planned]:
    """Return what of earlier versions is to be removed."""
    return [Planned(path, "") for path in SUPERSEDED]


def channels_in(content: str) -> list[str]:
    """Return the CAN interfaces that a file of `udev`, of any version, names."""
    found = _NAMED.search(content)
    return found[1].replace("|", " ").split() if found else []


def program_directory() -> str:
    """Return where the programs of the running environment are, and the unit can run them.

    Of a version that is reached by a link it is the path by the link, so that the unit stays right
    when that is switched. Raises `CommandError` where the unit could not run them.
    """
    scripts = sysconfig.get_path("scripts")
    if not Path(scripts, "litegripd").is_file():
        raise _unusable(f"there is no program litegripd in {scripts}")
    directory = str(_by_link(Path(scripts)))
    for needed in (directory, str(Path(sys.executable).resolve())):
        if not _PLAIN.fullmatch(needed):
            raise _unusable(f"{needed} has characters that a unit file gives a meaning of its own")
        if any(needed.startswith(f"{hidden}/") for hidden in _HIDDEN):
            raise _unusable(f"{needed} is where the daemon, shut off by its unit, cannot see it")
    obstacle = access.obstacle(directory, access.reader_of())
    if obstacle is not None:
        why = f"the user {access.USER} cannot run the programs in {directory}: {obstacle}"
        if obstacle.path.resolve().is_relative_to(Path(sys.prefix).resolve()):
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
        raise CommandError(
            f"{link} does not lead to {version}, the version that this program is of",
            reason="wrong_usage",
            data={"hint": f"run {link}/bin/litegripctl, or have it lead there: {switch}"},
        )
    return link / scripts.name


def _unusable(why: str, hint: str = _ELSEWHERE) -> CommandError:
    return CommandError(why, reason="wrong_usage", data={"hint": hint})


def _in_environment(content: str, programs: str) -> str:
    manuals = f"{Path(programs).parent}/share/man/"
    return content.replace(PROGRAMS, f"{programs}/").replace(MANUALS, manuals)


def _for(channels: Sequence[str], name: str, separator: str) -> str:
    before = _read(name)
    after = re.sub(rf"\b{EXAMPLE_CHANNEL}\b", lambda _: separator.join(channels), before)
    if after == before and list(channels) != [EXAMPLE_CHANNEL]:
        raise ValueError(f"{name} names no {EXAMPLE_CHANNEL} that could be replaced")
    return after


def _read(name: str) -> str:
    return (DATA / name).read_text(encoding="utf-8")
