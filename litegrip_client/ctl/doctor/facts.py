"""The facts that the doctor's checks look at.

Values only, no requests. What the daemon answered is kept as it came, so that an older or newer
daemon is examined, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from litegrip_client.ctl.findings import Named
from litegrip_client.socketcan.link import Link
from litegrip_client.socketcan.managers import Setting
from litegrip_client.values.atomic_file import Shortage
from litegrip_client.values.figures import PROGRAM
from litegrip_client.values.terms import Voice
from litegrip_client.values.voices import in_shell_of

SIMULATED = ("litegrip_sim", "virtual")
"""Interfaces of python-can without an adapter."""


@dataclass(frozen=True, slots=True)
class System:
    """What the operating system says of the bus."""

    link: Link | None = None
    ip_problem: str | None = None
    """Why iproute2 gave no answer, or None; the link then comes from the kernel's files."""
    can_links: tuple[str, ...] = ()
    """The CAN interfaces that there are."""
    driver: str | None = None
    adapter: str | None = None
    """What a USB adapter calls itself."""
    device: Device | None = None
    settings: tuple[Setting, ...] = ()
    """What files of this system do to the link at every plug and boot."""
    renamed_from: str | None = None
    """The name under which the daemon opened the interface, where it has another one by now."""


@dataclass(frozen=True, slots=True)
class Device:
    """The file of an adapter that is no network interface."""

    path: str
    is_there: bool
    is_character_device: bool = False
    is_accessible: bool = False
    """True if this user may read and write it."""
    group: str | None = None
    is_left_alone: bool = False
    """True if a rule of udev keeps ModemManager off it."""
    probers: tuple[str, ...] = ()
    """The programs of this machine that open serial ports which they do not know."""
    lasting_path: str | None = None
    """The name by its serial number, where the configured one is another."""
    other_ports: int = 0
    """How many other USB adapters have serial ports here."""


@dataclass(frozen=True, slots=True)
class Socket:
    """One of the daemon's sockets."""

    path: str
    is_accessible: bool
    """True if this user may connect."""
    owner_uid: int
    closed_by: tuple[str, str, str | None] | None = None
    """The directory that keeps this user from it, whose it is, and the group that may enter it.

    It is the socket itself where that is for its owner alone.
    """


@dataclass(frozen=True, slots=True)
class User:
    """Who runs this program, and the group whose members may connect to the daemon."""

    name: str
    uid: int
    group: str
    group_exists: bool = True
    is_member: bool = True
    """By the system's list of groups."""
    has_group: bool = True
    """In this session: groups are taken at the login."""


@dataclass(frozen=True, slots=True)
class Daemon:
    """A daemon that answers: its `hello`, `info.get`, `health` and `state.get`."""

    path: str
    hello: Mapping[str, Any]
    info: Mapping[str, Any]
    health: Mapping[str, Any]
    state: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Configuration:
    """A channel's configuration file, of which the daemon's program was asked.

    `content` is what it says, as in `info.get`; else `error` is what is wrong with it, or
    `unchecked` why that is not known.
    """

    file: str
    content: Mapping[str, Any] | None = None
    error: str | None = None
    unchecked: str | None = None
    as_user: str | None = None
    """As whom it was read, where that is not who runs this program."""


@dataclass(frozen=True, slots=True)
class Scan:
    """What has answered when the daemon asked the ids `asked`, or `problem`, why it did not ask.

    `found` has the answering motors' ids, and the ids on which they answer.
    """

    asked: tuple[int, ...] = ()
    found: Mapping[int, int] = field(default_factory=dict)
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class Facts:
    """All that is known; `daemon` None where none answers, `failure` then says why.

    `ctl` is how litegripctl is called for this gripper, `asked_channel` the channel that was asked
    for by name, `now_s` the Unix time. `interface` is None where it is not known.
    """

    channel: str
    version: str
    user: User
    system: System
    sockets: tuple[Socket, ...] = ()
    daemon: Daemon | None = None
    failure: str | None = None
    blocked: str | None = None
    """What to do before any daemon can listen at its socket's path."""
    ctl: str = "litegripctl"
    asked_channel: str | None = None
    is_unit_enabled: bool = False
    """True if systemd starts the channel's daemon by itself."""
    is_unit_installed: bool = True
    """True if systemd has a unit for daemons at all."""
    socket: str | None = None
    """For a shell, the socket that alone was named, and where nobody answers."""
    others: tuple[str, ...] = ()
    """The channels of this machine, where none was named and the usual one is not among them."""
    hung_pid: int | None = None
    """Who listens but does not answer, 0 where that is not known; None where nobody listens."""
    configuration: Configuration | None = None
    """The channel's file, where there is one and no daemon reports what it uses."""
    edited: tuple[str, float] | None = None
    """The file that the running daemon would read now, and the Unix time when it was written."""
    misnamed: str | None = None
    """What lies beside the place of a configuration, where there is none, and is probably one."""
    interface: str | None = "socketcan"
    bus_channel: str = "can0"
    now_s: float = 0.0
    is_remote: bool = False
    """True if the gripper is another machine's: its link and its unit are not here."""
    disks: tuple[Shortage, ...] = ()
    """The file systems of this machine without room for what the daemons write."""
    fleet: Sequence[Named] = ()
    """What the program of this machine's parts of a fleet has found, where it has any."""
    scan: Scan | None = None
    """Which motors are on the bus, where that was asked for."""

    @property
    def is_channel_known(self) -> bool:
        """True unless a socket alone was named where nobody answers, or one has to be chosen."""
        return self.socket is None and not self.others

    @property
    def unit(self) -> str | None:
        """The systemd unit of the channel's daemon; None where the channel or units are unknown."""
        is_known = self.is_channel_known and self.is_unit_installed and not self.is_remote
        return f"litegripd@{self.channel}" if is_known else None

    @property
    def voice(self) -> Voice:
        """Tells what the daemon says in commands for this gripper."""
        return in_shell_of(lambda command: command.replace(PROGRAM, self.ctl))

    @property
    def is_enabled(self) -> bool:
        """True if the motor is enabled, as far as is known."""
        return self.daemon is not None and self.daemon.state.get("enabled") is True
