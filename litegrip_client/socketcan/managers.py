"""Who else sets up a CAN interface: the files of what manages networks, and what they set.

A rate that one of them sets comes back at every plug and boot, whatever was typed meanwhile. The
doctor and the daemon's helper process name the file. Nothing is changed here: `Setting.command`
is what mends it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from litegrip_client.socketcan.link import BITRATE, HARMFUL, HINDERING, rate_text

NETWORKD, IFUPDOWN, NETWORK_MANAGER = "systemd-networkd", "ifupdown", "NetworkManager"

_NETWORK_DIRECTORIES = (
    "etc/systemd/network",
    "run/systemd/network",
    "usr/local/lib/systemd/network",
    "usr/lib/systemd/network",
    "lib/systemd/network",
)
"""In the order in which a name in one hides the same name in the next."""

_NETWORKD_MODES = {
    "FDMode": "FD",
    "FDNonISO": "FD-NON-ISO",
    "ListenOnly": "LISTEN-ONLY",
    "Loopback": "LOOPBACK",
    "OneShot": "ONE-SHOT",
    "TripleSampling": "TRIPLE-SAMPLING",
    "PresumeAck": "PRESUME-ACK",
}
_IFUPDOWN_MODES = {
    "listenonly": "LISTEN-ONLY",
    "loopback": "LOOPBACK",
    "oneshot": "ONE-SHOT",
    "triple": "TRIPLE-SAMPLING",
}
_KEEPS_DOWN = ("down", "always-down")
_NEVER_OF_CAN = ("MACAddress", "PermanentMACAddress", "SSID", "BSSID", "WLANInterfaceType")
"""What no CAN interface has, so that a [Match] with one of them is not for it."""

_SCRIPTS = (
    ("a rule of udev", "etc/udev/rules.d/*.rules"),
    ("a rule of udev", "run/udev/rules.d/*.rules"),
    ("a rule of udev", "usr/local/lib/udev/rules.d/*.rules"),
    ("a unit of systemd", "etc/systemd/system/*.service"),
    ("a unit of systemd", "etc/systemd/system/*.service.d/*.conf"),
    ("a unit of systemd", "usr/local/lib/systemd/system/*.service"),
    ("a script of NetworkManager", "etc/NetworkManager/dispatcher.d/*"),
    ("a script of ifupdown", "etc/network/if-*.d/*"),
    ("a script at boot", "etc/rc.local"),
)
"""Where commands stand that set a link up, and what runs them."""

_COMMAND = re.compile(r"\bip\s+(?:-\S+\s+)*link\s+set\s+(?:dev\s+)?(?P<name>\S+)\s(?P<rest>.*)")
_RATE = re.compile(r"(?<!\S)bitrate\s+(\d+)")
_MODE = re.compile(r"(?<!\S)([a-z-]+)\s+on\b")
_KERNEL = re.compile(r'KERNEL=="([^"]*)"')
_STANZA = re.compile(r"(iface|auto|allow-\S+|mapping|source|source-directory|no-\S+)\s")
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([KMG]?)")
_LONGEST_FILE = 262_144


@dataclass(frozen=True, slots=True)
class Setting:
    """What one file does to the interface `name`.

    `line` is that of the bit rate, 0 where there is none. `takes` says how it takes the link from
    others, None where it does not.
    """

    name: str
    manager: str
    file: str
    line: int = 0
    bitrate: int | None = None
    modes: tuple[str, ...] = ()
    takes: str | None = None
    root: str = "/"

    @property
    def is_wrong(self) -> bool:
        """True if no motor answers, or not for long, with what it sets."""
        is_other_rate = self.bitrate not in (None, BITRATE)
        return is_other_rate or bool(self.modes) or self.takes is not None

    @property
    def text(self) -> str:
        """What it sets, in words, behind the name of its file."""
        sets = [] if self.bitrate is None else [rate_text(self.bitrate)]
        sets += [mode.lower() for mode in self.modes]
        said = [] if not sets else [f"sets {', '.join(sets)}"]
        said += [] if self.takes is None else [self.takes]
        at = f":{self.line}" if self.line else ""
        return f"{self.file}{at} ({self.manager}) {' and '.join(said) or 'manages it'}"

    @property
    def command(self) -> str | None:
        """What corrects a wrong one for the next plug and boot; None where a person has to."""
        if self.manager == NETWORKD:
            folder = Path(self.root, _NETWORK_DIRECTORIES[0], f"{Path(self.file).name}.d")
            keys = {mode: key for key, mode in _NETWORKD_MODES.items()}
            content = f"[CAN]\\nBitRate={BITRATE}\\n"
            content += "".join(f"{keys[mode]}=no\\n" for mode in self.modes)
            content += "" if self.takes is None else "[Link]\\nActivationPolicy=up\\n"
            quoted = shlex.quote(str(folder))
            return (
                f"sudo mkdir -p {quoted} && printf '{content}' | sudo tee {quoted}/90-litegrip.conf"
                " && sudo networkctl reload"
            )
        if self.manager == NETWORK_MANAGER:
            path = Path(self.root, "etc/NetworkManager/conf.d", f"90-{self.name}.conf")
            line = f"[keyfile]\\nunmanaged-devices+=interface-name:{self.name}\\n"
            return (
                f"printf '{line}' | sudo tee {shlex.quote(str(path))} && sudo nmcli general reload"
            )
        if self.line and self.bitrate not in (None, BITRATE):
            change = rf"{self.line}s/\(\bbitrate[[:space:]]*\){self.bitrate}\b/\1{BITRATE}/"
            return f"sudo sed -i '{change}' {shlex.quote(self.file)}"
        return None


def settings_of(name: str, driver: str | None = None, root: Path = Path("/")) -> list[Setting]:
    """Return what the files of a system do to the CAN interface `name`.

    What this user may not read is passed over.
    """
    found: list[Setting] = []
    if uses_networkd(root):
        found += _of_networkd(name, driver, root)
    if any((root / path).exists() for path in ("sbin/ifup", "usr/sbin/ifup")):
        found += _of_ifupdown(name, root)
    if _uses_network_manager(root):
        found += _of_network_manager(name, root)
    for what, pattern in _SCRIPTS:
        for path in sorted(root.glob(pattern)):
            found += _of_commands(name, what, path, _lines(path))
    return found


def uses_networkd(root: Path) -> bool:
    """Return True if systemd-networkd is enabled in a system, or runs."""
    enabled = root.glob("etc/systemd/system/*.wants/systemd-networkd.service")
    return any(enabled) or (root / "run/systemd/netif/links").is_dir()


def _uses_network_manager(root: Path) -> bool:
    enabled = root.glob("etc/systemd/system/*.wants/NetworkManager.service")
    return any(enabled) or (root / "run/NetworkManager/devices").is_dir()


def _lines(path: Path) -> list[str]:
    """Return a file's lines; none of one that is none, is closed to this user, or is huge."""
    try:
        if not path.is_file() or path.stat().st_size > _LONGEST_FILE:
            return []
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


@dataclass(frozen=True, slots=True)
class _Row:
    section: str
    key: str
    value: str
    line: int


def _rows(path: Path) -> list[_Row]:
    """Read a file of sections, keys and values, as systemd and NetworkManager have them."""
    rows, section = [], ""
    for number, line in enumerate(_lines(path), 1):
        text = line.strip()
        if text.startswith("[") and text.endswith("]"):
            section = text[1:-1]
        elif "=" in text and not text.startswith(("#", ";")):
            key, _, value = text.partition("=")
            rows.append(_Row(section, key.strip(), value.strip(), number))
    return rows


def _of_networkd(name: str, driver: str | None, root: Path) -> list[Setting]:
    """Return what the .network file sets that counts: the first one, by its name, that matches."""
    for file in _by_name(root, "", "*.network"):
        rows = _rows(file)
        if not rows or not _matches([row for row in rows if row.section == "Match"], name, driver):
            continue
        own = {(row.section, row.key): row for row in rows}
        added = [row for path in _by_name(root, f"{file.name}.d", "*.conf") for row in _rows(path)]
        values = {**own, **{(row.section, row.key): row for row in added}}
        if _is_yes(_value(values, "Link", "Unmanaged")):
            return []
        rate = values.get(("CAN", "BitRate"))
        policy = _value(values, "Link", "ActivationPolicy")
        modes = [
            mode for key, mode in _NETWORKD_MODES.items() if _is_yes(_value(values, "CAN", key))
        ]
        return [
            Setting(
                name,
                NETWORKD,
                str(file),
                line=rate.line if rate is not None and rate in rows else 0,
                bitrate=None if rate is None else _size(rate.value),
                modes=tuple(modes),
                takes="keeps it down" if policy in _KEEPS_DOWN else None,
                root=str(root),
            )
        ]
    return []


def _by_name(root: Path, folder: str, pattern: str) -> list[Path]:
    """Return files of networkd's in the order of their names, without those that are hidden."""
    found: dict[str, Path] = {}
    for directory in _NETWORK_DIRECTORIES:
        for path in (root / directory / folder).glob(pattern):
            found.setdefault(path.name, path)
    return [found[name] for name in sorted(found)]


def _matches(rows: Sequence[_Row], name: str, driver: str | None) -> bool:
    """Return True if a [Match] is for a CAN interface; what cannot be judged counts as if it was.

    systemd lets an empty section match everything; a "!" in front turns its patterns round.
    """
    known = {"Name": name, "Type": "can", "Kind": "can", "Driver": driver}
    for row in rows:
        if row.key in _NEVER_OF_CAN:
            return False
        value = known.get(row.key)
        words = row.value.removeprefix("!").replace('"', "").split()
        is_one = value is not None and any(fnmatchcase(value, word) for word in words)
        if value is not None and is_one is row.value.startswith("!"):
            return False
    return True


def _value(values: dict[tuple[str, str], _Row], section: str, key: str) -> str:
    row = values.get((section, key))
    return "" if row is None else row.value.lower()


def _is_yes(text: str) -> bool:
    return text in ("yes", "true", "1", "on", "y", "t")


def _size(text: str) -> int | None:
    """Read systemd's sizes, to the base 1000: 500K, 1M, 1000000."""
    found = _SIZE.fullmatch(text.strip())
    if found is None:
        return None
    return round(float(found[1]) * {"": 1, "K": 1e3, "M": 1e6, "G": 1e9}[found[2]])


def _of_ifupdown(name: str, root: Path) -> Iterator[Setting]:
    """Yield what the stanzas of `interfaces` set; their commands count as those of scripts."""
    for path in (
        root / "etc/network/interfaces",
        *sorted((root / "etc/network/interfaces.d").glob("*")),
    ):
        is_ours, line, bitrate, modes = False, 0, None, []
        lines = _lines(path)
        for number, text in enumerate(lines, 1):
            words = text.split()
            if _STANZA.match(text.lstrip()):
                is_ours = words[0] == "iface" and fnmatchcase(name, words[1])
            elif is_ours and words[:1] == ["bitrate"] and words[1:2] and words[1].isdecimal():
                line, bitrate = number, int(words[1])
            elif is_ours and len(words) > 1 and words[0] in _IFUPDOWN_MODES and words[1] == "on":
                modes.append(_IFUPDOWN_MODES[words[0]])
        if bitrate is not None or modes:
            yield Setting(name, IFUPDOWN, str(path), line, bitrate, tuple(modes))
        yield from _of_commands(name, IFUPDOWN, path, lines)


def _of_network_manager(name: str, root: Path) -> Iterator[Setting]:
    """Yield the profiles that are for the interface, unless it is none of NetworkManager's."""
    configured = [
        root / "etc/NetworkManager/NetworkManager.conf",
        *sorted((root / "etc/NetworkManager/conf.d").glob("*.conf")),
    ]
    left = [
        entry.strip()
        for path in configured
        for row in _rows(path)
        if row.section == "keyfile" and row.key in ("unmanaged-devices", "unmanaged-devices+")
        for entry in re.split(r"[;,]", row.value)
    ]
    if any(
        fnmatchcase(name, re.sub(r"^interface-name[:=]", "", entry).removeprefix("="))
        for entry in left
        if entry.startswith("interface-name")
    ):
        return
    for directory in ("etc", "run", "usr/lib"):
        for path in sorted((root / directory).glob("NetworkManager/system-connections/*")):
            values = {(row.section, row.key): row for row in _rows(path)}
            if _value(values, "connection", "interface-name") != name.lower():
                continue
            if _value(values, "connection", "autoconnect") == "false":
                continue
            takes = "takes it: by this profile, which has no bit rate, it is set up and down"
            yield Setting(name, NETWORK_MANAGER, str(path), takes=takes, root=str(root))


def _of_commands(name: str, what: str, path: Path, lines: Sequence[str]) -> Iterator[Setting]:
    """Yield what `ip link set` of a script, a rule or a unit does to the interface."""
    bad = {mode.lower(): mode for mode in (*HINDERING, *HARMFUL)}
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("#"):
            continue
        for command in re.split(r"&&|;|\|\||\bRUN\+?=", line):
            found = _COMMAND.search(command)
            if found is None or not _is_meant(found["name"].strip("\"'"), name, line):
                continue
            rate = _RATE.search(found["rest"])
            modes = [bad[word] for word in _MODE.findall(found["rest"]) if word in bad]
            if rate is not None or modes:
                bitrate = None if rate is None else int(rate[1])
                yield Setting(name, what, str(path), number, bitrate, tuple(modes))


def _is_meant(word: str, name: str, line: str) -> bool:
    """Return True if a command's interface may be `name`: a variable, unless its rule has others.

    The rule of `install-units` names its interfaces elsewhere, and sets the motor's rate.
    """
    if not word.startswith(("$", "%")):
        return word == name
    kernel = _KERNEL.search(line)
    return kernel is None or any(fnmatchcase(name, one) for one in kernel[1].split("|"))
