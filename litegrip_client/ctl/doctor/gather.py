"""Gathers the facts: asks the daemon, if one answers, and then the system about its bus."""

from __future__ import annotations

import contextlib
import grp
import json
import os
import pwd
import re
import shlex
import stat
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import litegrip_client
from litegrip_client.core.discovery import (
    FLEET_PROGRAM,
    GROUP,
    channels_with_socket,
    closed_directory,
    enabled_channels,
    group_of,
    is_enabled,
    is_socket_given,
    is_unit_installed,
    private_owner,
    program_of,
    socket_paths,
)
from litegrip_client.core.sockets import SYSTEM_DIRECTORY, stop_path
from litegrip_client.ctl.doctor.facts import (
    SIMULATED,
    Configuration,
    Daemon,
    Device,
    Facts,
    Scan,
    Socket,
    System,
    User,
)
from litegrip_client.ctl.findings import Named, read, warning
from litegrip_client.socketcan.link import (
    ARPHRD_CAN,
    IpError,
    Link,
    ask_ip,
    from_files,
    from_ip,
)
from litegrip_client.socketcan.managers import settings_of
from litegrip_client.threads.blocking import connect
from litegrip_client.values.atomic_file import (
    FULL_BYTES,
    LARGEST_BYTES,
    SYSTEM_DIRECTORIES,
    shortages,
)
from litegrip_client.values.errors import LiteGripError
from litegrip_client.values.voices import in_shell

DIRECTORY = Path("/etc/litegripd")
CHECK_WITHIN_S = 10.0
_WRITTEN = (
    ("/var/lib/litegripd", LARGEST_BYTES),
    *((directory, FULL_BYTES) for directory in ("/run/litegripd", *SYSTEM_DIRECTORIES)),
)
"""Where the units' daemons write, with what must be free; a daemon's health tells of its own."""
USER = "litegrip"
"""As whom systemd runs the daemons."""
_PLACE = re.compile(r"[A-Za-z0-9_-]{1,32}\.[A-Za-z0-9_-]{1,32}")
"""SITE.GRIPPER, as gateways call theirs."""
_WRONG = 2
"""The exit code of litegripd for a configuration that is wrong, and for its usage."""


def _configuration_path(channel: str) -> str | None:
    """Return the file that a daemon of `channel` reads, None where there is none."""
    candidates = (DIRECTORY / f"{channel}.toml", DIRECTORY / "litegripd.toml")
    return next((str(path) for path in candidates if os.path.isfile(path)), None)  # noqa: PTH113


def _edited(path: str | None) -> tuple[str, float] | None:
    try:
        return None if path is None else (path, Path(path).stat().st_mtime)
    except OSError:
        return None


_ENDINGS = (".toml", ".toml.txt", ".txt", ".conf", ".cfg", ".ini")


def _misnamed(channel: str) -> str | None:
    """Return what was probably meant as the channel's file; editors add an ending, and hide it."""
    meant = [f"{channel}{ending}".lower() for ending in _ENDINGS]
    with contextlib.suppress(OSError):
        for path in sorted(DIRECTORY.iterdir()):
            if path.name.lower() in meant:
                return str(path)
    return None


def configuration_file(channel: str) -> Configuration | None:
    """Have the file of `channel` checked, or the common one; None where there is neither."""
    path = _configuration_path(channel)
    if path is None:
        return None
    if not os.access(path, os.R_OK):
        return Configuration(path, unchecked="this user may not read it")
    identity = _daemons_identity()
    as_user = USER if identity else None
    done = _run("litegripd", [channel, "--config", path, "--check"], CHECK_WITHIN_S, identity)
    if isinstance(done, str):
        return Configuration(path, unchecked=done)
    last = _last_line(done)
    try:
        return Configuration(path, content=json.loads(done.stdout), as_user=as_user)
    except ValueError:
        if done.returncode == _WRONG and not done.stderr.startswith(b"usage:"):  # of an older one
            return Configuration(path, error=last.removeprefix("litegripd: "), as_user=as_user)
        why = f"litegripd --check ended with {done.returncode}: {last or 'no word'}"
        return Configuration(path, unchecked=why)


def _daemons_identity() -> dict[str, Any]:
    """Return how a program is run as the daemons' user by root, who may read what that one may not.

    Empty for everybody else, and where there is no such user.
    """
    if os.getuid() != 0:
        return {}
    try:
        entry = pwd.getpwnam(USER)
    except KeyError:
        return {}
    groups = os.getgrouplist(USER, entry.pw_gid)
    return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": groups}


FLEET_CHECK_WITHIN_S = 60.0


def fleet_check(file: str) -> Sequence[Named]:
    """Have this machine's parts of a fleet checked by their own program.

    Its checks are called `fleet-` and their names.
    """
    done = _run(FLEET_PROGRAM, ["--config", file, "check", "--json"], FLEET_CHECK_WITHIN_S, {})
    if isinstance(done, str):
        problem = done
    else:
        try:
            found = read(json.loads(done.stdout))
        except ValueError:
            last = _last_line(done) or "no word"
            problem = f"{FLEET_PROGRAM} check ended with {done.returncode}: {last}"
        else:
            if found is not None:
                return [(f"fleet-{name}", finding) for name, finding in found]
            problem = f"{FLEET_PROGRAM} check has printed something else than findings"
    text = f"{file} was not checked: {problem}"
    return [("fleet", warning(text, advice="run there: litegripd-fleet check"))]


def _run(
    name: str, options: Sequence[str], within_s: float, identity: Mapping[str, Any]
) -> subprocess.CompletedProcess[bytes] | str:
    """Run one of our programs; return why it cannot be, where that is so."""
    program = program_of(name)
    if program is None:
        return f"the program {name} is not found here"
    try:
        return subprocess.run(
            [program, *options],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=within_s,
            check=False,
            **identity,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{name} cannot be run{f' as {USER}' if identity else ''}: {error}"


def _last_line(done: subprocess.CompletedProcess[bytes]) -> str:
    return done.stderr.decode(errors="replace").strip().rpartition("\n")[2]


def other_channels(usual: str) -> tuple[str, ...]:
    """Return the channels that this machine has in place of the usual one.

    Those of daemons that were killed are among them: the doctor says that of them. None where the
    usual one is of this machine, or has a unit that is enabled: it may be meant.
    """
    found = tuple(dict.fromkeys([*channels_with_socket(), *enabled_channels()]))
    return () if _is_own(usual) or usual in found else found


def is_remote_name(channel: str) -> bool:
    """Return True if a channel that does not answer is called like a gripper of another machine."""
    return _PLACE.fullmatch(channel) is not None and not _is_own(channel)


def _is_own(channel: str) -> bool:
    """Return True if a channel has a configuration or a CAN interface on this machine."""
    return os.path.isfile(DIRECTORY / f"{channel}.toml") or is_can(channel)  # noqa: PTH113


NET = Path("/sys/class/net")
_FILES = ("type", "flags", "tx_queue_len", "ifindex")


def system(
    interface: str,
    bus_channel: str,
    net: Path = NET,
    root: Path = Path("/"),
    held_index: int | None = None,
) -> System:
    """Ask about the bus that python-can's `interface` opens as `bus_channel`.

    `held_index` is the kernel's number of the interface that a daemon holds: if that has another
    name by now, it is asked about that one.
    """
    if interface in SIMULATED:
        return System()
    if interface != "socketcan":
        return System(device=_device(bus_channel, root))
    link, problem = _link(bus_channel, net)
    renamed_from = None
    if held_index is not None and (link is None or link.index not in (None, held_index)):
        now_called = _interfaces(net, "ifindex", held_index)
        if now_called:
            renamed_from, bus_channel = bus_channel, now_called[0]
            link, problem = _link(bus_channel, net)
    driver, adapter = _hardware(net / bus_channel / "device")
    settings = tuple(settings_of(bus_channel, driver, root))
    links = _interfaces(net, "type", ARPHRD_CAN)
    return System(
        link, problem, links, driver, adapter, settings=settings, renamed_from=renamed_from
    )


def is_can(name: str) -> bool:
    """Return True if there is a CAN interface of a name."""
    return name in _interfaces(NET, "type", ARPHRD_CAN)


def user(group: str) -> User:
    """Return the user who runs this program; `is_member` is true for one of `group`."""
    uid = os.getuid()
    try:
        entry = pwd.getpwuid(uid)
    except KeyError:  # in a container, say
        name, listed = str(uid), []
    else:
        name, listed = entry.pw_name, os.getgrouplist(entry.pw_name, entry.pw_gid)
    try:
        gid = grp.getgrnam(group).gr_gid
    except KeyError:
        return User(name, uid, group, group_exists=False, is_member=False, has_group=False)
    has_group = gid in (os.getegid(), *os.getgroups())
    return User(name, uid, group, is_member=has_group or gid in listed, has_group=has_group)


def sockets(paths: list[str]) -> tuple[Socket, ...]:
    """Return the daemon's sockets that exist, without connecting."""
    found = []
    for path in paths:
        for one in (path, stop_path(path)):
            try:
                status = Path(one).stat()
            except PermissionError:  # a directory above is closed to this user
                found.append(Socket(one, False, -1, closed_directory(one)))
                continue
            except (OSError, ValueError):  # nothing is there, nor can anything be
                continue
            if not stat.S_ISSOCK(status.st_mode):
                continue
            may_write = os.access(one, os.W_OK)
            alone = None if may_write else private_owner(one)
            closed_by = None if alone is None else (one, alone, None)
            found.append(Socket(one, may_write, status.st_uid, closed_by))
    return tuple(found)


def _group(
    served: Sequence[Socket], configuration: Mapping[str, Any], *, is_answering: bool
) -> str:
    """Return the group whose members may connect: that of the sockets that do not answer."""
    configured = str(configuration.get("rpc", {}).get("group", GROUP))
    if is_answering or not served:
        return configured
    closed = served[0].closed_by
    return (group_of(served[0].path) if closed is None else closed[2]) or configured


def _link(name: str, net: Path) -> tuple[Link | None, str | None]:
    """Return the link, and why iproute2 gave no answer, or None."""
    try:
        shown = ask_ip(name)
        return (None if shown is None else from_ip(shown)), None
    except IpError as error:
        problem = str(error)
    except ValueError:
        problem = "ip gives no JSON: it is not iproute2's, or older than 4.14"
    try:
        files = {file: (net / name / file).read_text(encoding="ascii").strip() for file in _FILES}
    except FileNotFoundError:
        return None, problem
    return from_files(name, files), problem


def _interfaces(net: Path, file: str, content: int) -> tuple[str, ...]:
    """Return the network interfaces of which a file of the kernel has this content."""
    found = []
    for path in sorted(net.glob(f"*/{file}")):
        with contextlib.suppress(OSError):  # unplugged meanwhile
            if path.read_text(encoding="ascii").strip() == str(content):
                found.append(path.parent.name)
    return tuple(found)


def _hardware(device: Path) -> tuple[str | None, str | None]:
    """Return the driver of a network interface, and what its USB device calls itself."""
    try:
        driver = (device / "driver").readlink().name
    except OSError:
        return None, None
    try:  # `device` is the USB interface, the directory above it the USB device
        return driver, (device.resolve().parent / "product").read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return driver, None


def _device(bus_channel: str, root: Path) -> Device | None:
    """Look at the adapter's file; python-can takes a bit rate behind it: /dev/ttyACM0@115200."""
    path = bus_channel.partition("@")[0]
    if not path.startswith("/"):
        return None
    try:
        status = Path(path).stat()
    except OSError:
        return Device(path, is_there=False)
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = None
    accessible = os.access(path, os.R_OK | os.W_OK)
    is_device = stat.S_ISCHR(status.st_mode)
    number = f"c{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"
    named = {entry: entry.resolve() for entry in sorted((root / _BY_ID).glob("*"))}
    own = Path(path).resolve()
    lasting = next((str(entry) for entry, port in named.items() if port == own), None)
    return Device(
        path,
        True,
        is_device,
        accessible,
        group,
        is_left_alone=is_device and _IGNORED in _udev_properties(root, number),
        probers=tuple(
            name
            for name, files in _PROBERS.items()
            if any((root / file).exists() for file in files)
        ),
        lasting_path=None if path in map(str, named) else lasting,
        other_ports=len(set(named.values()) - {own}),
    )


_BY_ID = "dev/serial/by-id"
_IGNORED = "E:ID_MM_DEVICE_IGNORE=1"
_PROBERS = {
    "ModemManager": ("usr/sbin/ModemManager", "sbin/ModemManager"),
    "brltty": ("usr/bin/brltty", "bin/brltty", "usr/sbin/brltty"),
}


def _udev_properties(root: Path, number: str) -> list[str]:
    """Return udev's notes on a device, as it keeps them for everybody to read."""
    try:
        return (root / "run/udev/data" / number).read_text(errors="replace").splitlines()
    except OSError:
        return []


ANSWER_WITHIN_S = 5.0


def gather(channel: str, socket: str | None, *, channel_chosen: bool) -> Facts:
    """Return the facts that the checks need; without a daemon, those that need none.

    `channel_chosen` is true if the user named this channel.
    """
    daemon, failure, hung_pid, blocked = _daemon(channel, socket)
    paths = socket_paths(channel, socket) if daemon is None else [daemon.path]
    asked = channel if channel_chosen and socket is None else None
    others: tuple[str, ...] = ()
    if daemon is None and not channel_chosen and not is_socket_given(socket):
        others = other_channels(channel)
    is_channel_known = not others and (
        daemon is not None or channel_chosen or not is_socket_given(socket)
    )
    file = None
    configuration: Mapping[str, Any] = {}
    is_remote = is_channel_known and is_remote_name(channel)
    if daemon is not None:
        is_remote = daemon.hello.get("remote") is not None
        channel = str(daemon.hello.get("channel", channel))
        configuration = daemon.info.get("configuration", {})
    elif is_channel_known and not is_remote:
        file = configuration_file(channel)
        configuration = (file.content if file is not None else None) or {}
    bus = configuration.get("bus", {})
    served = sockets(paths)
    # Whoever starts a daemon by hand may have given it a configuration from anywhere.
    by_hand = daemon is None and any(not one.path.startswith(SYSTEM_DIRECTORY) for one in served)
    is_whole = not by_hand if file is None else file.content is not None
    is_read = is_channel_known and not is_remote and is_whole
    may_be_it = is_can(channel) and (by_hand if file is None else file.unchecked is not None)
    interface = str(bus.get("interface", "socketcan")) if is_read or may_be_it else None
    bus_channel = str(bus.get("channel", channel))
    held = None if daemon is None or is_remote else daemon.health.get("bus", {}).get("ifindex")
    asked_system = system(interface, bus_channel, held_index=held) if interface else System()
    if asked_system.renamed_from is not None and asked_system.link is not None:
        bus_channel = asked_system.link.name
    fleet_file = DIRECTORY / "fleet.toml"
    is_in_fleet = fleet_file.exists() or (is_remote and daemon is None)
    where = f" -c {channel}" if is_channel_known else ""
    if socket:
        where = f" --socket {shlex.quote(socket)}"
    return Facts(
        channel=channel,
        version=litegrip_client.__version__,
        user=user(_group(served, configuration, is_answering=daemon is not None)),
        system=asked_system,
        sockets=served,
        daemon=daemon,
        failure=failure,
        ctl=f"litegripctl{where}",
        asked_channel=asked,
        is_unit_enabled=not is_socket_given(socket) and is_enabled(channel),
        is_unit_installed=is_unit_installed(),
        socket=None if is_channel_known or others else shlex.quote(paths[0]),
        others=others,
        hung_pid=hung_pid,
        blocked=blocked,
        configuration=file,
        edited=None
        if daemon is None or is_remote
        else _edited(configuration.get("file") or _configuration_path(channel)),
        misnamed=None if is_remote or _configuration_path(channel) else _misnamed(channel),
        interface=interface,
        bus_channel=bus_channel,
        now_s=time.time(),
        is_remote=is_remote,
        disks=() if is_remote else tuple(shortages(_WRITTEN)),
        fleet=fleet_check(str(fleet_file)) if is_in_fleet else (),
    )


def scan(facts: Facts) -> Scan:
    """Have the daemon ask other ids for a motor."""
    if facts.daemon is None:
        return Scan(problem="no daemon answers, which would ask")
    try:
        with connect(facts.channel, facts.daemon.path, ANSWER_WITHIN_S) as connection:
            connection.voice = facts.voice
            connection.greet("litegripctl doctor")
            told = connection.call("motor.scan")
    except LiteGripError as error:
        return Scan(problem=error.message)
    found = {int(row["can_id"]): int(row["master_id"]) for row in told["found"]}
    return Scan(tuple(told["asked"]), found)


def _daemon(
    channel: str, socket: str | None
) -> tuple[Daemon | None, str | None, int | None, str | None]:
    """Return what the daemon says, or why nothing, who listens all the same, and what to move."""
    pid = 0
    try:
        with connect(channel, socket, ANSWER_WITHIN_S) as connection:
            pid, connection.voice = connection.daemon_pid, in_shell
            hello = connection.greet("litegripctl doctor")
            answers = [connection.call(method) for method in ("info.get", "health", "state.get")]
            return Daemon(connection.socket_path, hello, *answers), None, None, None
    except LiteGripError as error:
        hung_pid = pid if error.reason == "no_answer" else None
        return None, error.message, hung_pid, error.data.get("blocked")
