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

DATA = Path(__file__).resolve().parent.parent / "data"
PROGRAMS = "/opt/litegripd/bin/"
"""The path of the programs as the files have it; that of the running environment replaces it."""

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
    service = _read("systemd/litegripd@.service").replace(PROGRAMS, f"{programs}/")
    return [
        Planned(f"{_UNITS}/litegripd@.service", service),
        Planned(f"{_UNITS}/litegripd.target", _read("systemd/litegripd.target")),
        Planned("usr/local/lib/sysusers.d/litegripd.conf", _read("systemd/litegripd.sysusers")),
        Planned("etc/litegripd/litegripd.toml", _read("etc/litegripd.toml"), kept=True),
    ]


def serial() -> list[Planned]:
    """Return what lets the daemons use adapters at serial ports."""
    return [Planned(f"{_UNITS}/litegripd@.service.d/serial.conf", _read("systemd/serial.conf"))]


def udev(channels: Sequence[str]) -> list[Planned]:
    """Return what has udev bring these CAN interfaces up, whoever is in charge of the network."""
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
    return directory


def _unusable(why: str) -> CommandError:
    hint = "install it where all may read it: python3 -m venv /opt/litegripd"
    return CommandError(why, reason="wrong_usage", data={"hint": hint})


def _for(channels: Sequence[str], name: str, separator: str) -> str:
    before = _read(name)
    after = re.sub(rf"\b{EXAMPLE_CHANNEL}\b", lambda _: separator.join(channels), before)
    if after == before and list(channels) != [EXAMPLE_CHANNEL]:
        raise ValueError(f"{name} names no {EXAMPLE_CHANNEL} that could be replaced")
    return after


def _read(name: str) -> str:
    return (DATA / name).read_text(encoding="utf-8")
