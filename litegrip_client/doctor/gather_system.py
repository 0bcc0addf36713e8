"""Asks the operating system: iproute2, /sys/class/net, device files, users and groups.

It reads and judges nothing: what was found goes into `facts`.
"""

from __future__ import annotations

import grp
import os
import pwd
import shutil
import stat
import subprocess
from pathlib import Path

from litegrip_client.doctor.facts import SIMULATED, Device, Link, Socket, System, User
from litegrip_client.doctor.link_reading import ARPHRD_CAN, from_files, from_ip

NET = Path("/sys/class/net")
IP_WITHIN_S = 5.0
_ADMIN_PATHS = ("/usr/sbin", "/sbin")
_FILES = ("type", "flags", "tx_queue_len")


class IpError(Exception):
    """iproute2 is not there, or told nothing that can be used; the message says which."""


def system(interface: str, bus_channel: str, net: Path = NET) -> System:
    """Ask about the bus that python-can's `interface` opens as `bus_channel`."""
    if interface in SIMULATED:
        return System()
    if interface != "socketcan":
        return System(device=_device(bus_channel))
    link, problem = _link(bus_channel, net)
    driver, adapter = _hardware(net / bus_channel / "device")
    return System(link, problem, _can_links(net), driver, adapter)


def is_can(name: str) -> bool:
    """Whether there is a CAN interface of a name."""
    return name in _can_links(NET)


def user(group: str) -> User:
    """Ask who runs this program, and whether that is somebody of `group`."""
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
    """Look at those of the daemon's sockets that there are, without connecting to any."""
    found = []
    for path in paths:
        for one in (path, f"{path.removesuffix('.sock')}.stop.sock"):
            try:
                owner_uid = Path(one).stat().st_uid
            except FileNotFoundError:
                continue
            except OSError:  # a directory above is closed to this user
                found.append(Socket(one, is_accessible=False, owner_uid=-1))
                continue
            found.append(Socket(one, os.access(one, os.W_OK), owner_uid))
    return tuple(found)


def ask_ip(name: str) -> str | None:
    """Let iproute2 describe an interface; None where there is none. Raises `IpError`."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), *_ADMIN_PATHS])
    program = shutil.which("ip", path=path)
    if program is None:
        raise IpError("ip (iproute2) is not installed")
    command = [program, "-details", "-statistics", "-json", "link", "show", name]
    environment = {**os.environ, "LC_ALL": "C"}
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=IP_WITHIN_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise IpError(f"ip cannot be run: {error}") from error
    if done.returncode == 0:
        return done.stdout.decode(errors="replace")
    complaint = done.stderr.decode(errors="replace").strip()
    if "does not exist" in complaint:
        return None
    raise IpError(f"ip ended with {done.returncode}: {complaint or 'no word'}")


def _link(name: str, net: Path) -> tuple[Link | None, str | None]:
    """Return the link and why iproute2 told nothing of it, if so."""
    try:
        told = ask_ip(name)
        return (None if told is None else from_ip(told)), None
    except IpError as error:
        problem = str(error)
    except ValueError:
        problem = "ip gives no JSON: it is not iproute2's, or older than 4.14"
    try:
        files = {file: (net / name / file).read_text(encoding="ascii").strip() for file in _FILES}
    except FileNotFoundError:
        return None, problem
    return from_files(name, files), problem


def _can_links(net: Path) -> tuple[str, ...]:
    found = []
    for kind in sorted(net.glob("*/type")):
        try:
            is_can = kind.read_text(encoding="ascii").strip() == str(ARPHRD_CAN)
        except OSError:  # unplugged meanwhile
            continue
        if is_can:
            found.append(kind.parent.name)
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


def _device(bus_channel: str) -> Device | None:
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
    return Device(path, True, stat.S_ISCHR(status.st_mode), accessible, group)
