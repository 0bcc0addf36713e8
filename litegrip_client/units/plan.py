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

EXAMPLE_CHANNEL = "can0"
_UNITS = "usr/local/lib/systemd/system"
_NETWORKS = "usr/local/lib/systemd/network"
_NAMED = re.compile(r'^(?:Name=|.*KERNEL==")([^"\n]+)', re.MULTILINE)
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


def networkd(channels: Sequence[str]) -> list[Planned]:
    """Return what has systemd-networkd bring these CAN interfaces up."""
    return [
        Planned(f"{_NETWORKS}/{name}", _for(channels, f"systemd/{name}", " "))
        for name in ("80-litegrip.network", "80-litegrip.link")
    ]


def udev(channels: Sequence[str]) -> list[Planned]:
    """Return what has udev bring these CAN interfaces up."""
    content = _for(channels, "systemd/80-litegrip.rules", "|")
    return [Planned("usr/local/lib/udev/rules.d/80-litegrip.rules", content)]


def channels_in(content: str) -> list[str]:
    """Return the CAN interfaces that a file of `networkd` or `udev` names."""
    found = _NAMED.search(content)
    return found[1].replace("|", " ").split() if found else []


def program_directory() -> str:
    """Return where the programs of the running environment are, and the unit can run them.

    Raises `CommandError` where it could not.
    """
    directory = sysconfig.get_path("scripts")
    if not Path(directory, "litegripd").is_file():
        raise _unusable(f"there is no program litegripd in {directory}")
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
