"""The daemon's configuration: TOML to frozen values, rejected as a whole if anything is wrong.

`KEYS` is the only definition of the keys and their values: the check, the page
docs/configuration.md and the commented etc/litegripd.toml follow from it. Any other key is
unknown. Users and groups of `[access]` are looked up once, at the start.
"""

import dataclasses
import difflib
import grp
import math
import os
import pwd
import reprlib
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from litegrip_client.values.strict_json import is_finite
from litegrip_client.values.text import toml_of
from litegripd.io.helper.files import TEMPLATES
from litegripd.model.gripper import (
    DM4310,
    MOTOR_TYPES,
    STROKE_MM,
    STROKE_RANGE_MM,
    SUPERSEDED_STROKE_MM,
    GripperId,
    why_not_driven,
)
from litegripd.model.motor import SIMULATOR, BusSettings
from litegripd.model.plain import plain_of
from litegripd.rpc.reports import Configuration
from litegripd.rpc.sessions import ROLES, Peer, Role
from litegripd.trajectories.store import MB, Limits

MAX_STANDARD_ID = 0x7FE  # 0x7FF carries register traffic
MAX_CPUS = 1024


@dataclass(frozen=True, slots=True)
class Key:
    """One key of one table.

    `kind` is the type of the value in TOML; `list` means CPUs, `tuple` users. `shown` is the
    default as written in a file. It is an example if no value means the same as leaving the key
    out. `why_not` says why a value that is none of the `choices` is rejected, if it knows more.
    """

    table: str
    name: str
    kind: type
    shown: str
    meaning: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    why_not: Callable[[str], str | None] = lambda _: None


TABLES = {
    "bus": "The CAN bus, handed to python-can. Further keys are arguments of the interface, for"
    " example tty_baudrate of slcan.",
    "motor": "The motor on the bus.",
    "gripper": "What the motor moves.",
    "control": "The control thread.",
    "rpc": "The socket for clients. A second one beside it, can0.stop.sock for can0.sock, takes"
    " stops and nothing else.",
    "access": "Who may do what. All who may connect may read and stop; these lists say who may do"
    " more. Where several entries fit, the highest role counts. Root and the daemon's own user are"
    " admins in any case.",
    "trajectories": "The named trajectories that the daemon keeps. A limit refuses what would go"
    " beyond it, and removes nothing. What is there from before the daemon noted who had saved it"
    " counts for nobody, until it is replaced.",
    "teleop": "Teleoperation.",
}
"""The tables in the order of the documentation, and the subject of each."""

KEYS = (
    Key(
        "bus",
        "interface",
        str,
        '"socketcan"',
        'The interface of python-can: "socketcan", "slcan", "gs_usb", ..., or "litegrip_sim", a'
        " simulated gripper. One that python-can does not have here is refused, with those that it"
        " has.",
    ),
    Key(
        "bus",
        "channel",
        str,
        '"can0"',
        "The interface's channel, for slcan the path of a device. Left out: the daemon's channel.",
    ),
    Key(
        "bus",
        "bitrate",
        int,
        "1000000",
        "Bit/s. For socketcan the system sets it: ip link set can0 type can bitrate 1000000.",
        10_000,
        1_000_000,
    ),
    Key(
        "motor",
        "type",
        str,
        f'"{DM4310.name}"',
        "The type of motor; one of another type is not enabled. Never tried on hardware:"
        f" {', '.join(row.name for row in MOTOR_TYPES.values() if row.is_untried)}.",
        choices=tuple(MOTOR_TYPES),
        why_not=why_not_driven,
    ),
    Key(
        "motor",
        "can_id",
        int,
        "0x08",
        "The id that the motor is commanded by (its register ESC_ID).",
        0x01,
        MAX_STANDARD_ID,
    ),
    Key(
        "motor",
        "master_id",
        int,
        "0x18",
        "The id that it answers with (its register MST_ID). Left out: found by itself.",
        0x00,
        MAX_STANDARD_ID,
    ),
    Key(
        "motor",
        "second_master",
        str,
        '"refuse"',
        "When another program commands the motor on the same bus: refuse motions, or only report"
        " it.",
        choices=("refuse", "tolerate"),
    ),
    Key(
        "gripper",
        "mount",
        str,
        '"normal"',
        '"normal" or "reverse" declares which way closing runs: what the daemon has measured of'
        " such a mount counts, else its nominal template. Or the absolute path of a calibration"
        " file. Left out: the first that fits of the daemon's own file for this channel,"
        " ~/.litegrip/<channel>_calibration.json, ~/.litegrip/litegrip_calibration.json (of the"
        " daemon's user) and, for can0, the factory's.",
    ),
    Key(
        "gripper",
        "stroke_mm",
        float,
        f"{STROKE_MM}",
        "How far the jaws open, as a caliper measures it: this and 1 mm, by which a probe presses"
        " into the open stop, are the millimetres of a measured travel. A calibration that differs"
        " by more than 15 % is refused. 120.0, the default of earlier versions, counts as 85.0, and"
        " is warned of.",
        *STROKE_RANGE_MM,
    ),
    Key("control", "rate_hz", int, "200", "Ticks a second.", 100, 1000),
    Key(
        "control",
        "priority",
        int,
        "50",
        "Real-time priority (SCHED_FIFO) of the control thread; 0: an ordinary thread, as without"
        " the right to more.",
        0,
        99,
    ),
    Key(
        "control",
        "cpus",
        list,
        "[1]",
        "The CPUs that it may run on. Left out: all.",
    ),
    Key(
        "rpc",
        "socket",
        str,
        '"/run/litegripd/can0.sock"',
        "The absolute path where clients connect. Left out: /run/litegripd/<channel>.sock, or"
        " $XDG_RUNTIME_DIR/litegripd/<channel>.sock for a user who may not write there.",
    ),
    Key("rpc", "group", str, '"litegrip"', "The group whose members may connect."),
    Key(
        "access",
        "default",
        str,
        '"operator"',
        "The role of every user in no list: observer (read and stop), operator (also move) or admin"
        " (also take the lease from others and change the daemon's defaults).",
        choices=ROLES,
    ),
    Key(
        "access",
        "admins",
        tuple,
        '["alice", "@lab", 1000]',
        'Users, groups (with an "@") and uids that are admins. Left out: none.',
    ),
    Key("access", "operators", tuple, "[]", "The same for operators."),
    Key("access", "observers", tuple, "[]", "The same for observers."),
    Key(
        "access",
        "gateways",
        tuple,
        "[]",
        "Users that may speak for users of other machines (on_behalf of hello), each with at most"
        " the role that they have themselves. Left out: none.",
    ),
    Key(
        "trajectories",
        "most_per_user",
        int,
        "500",
        "How many a user (uid) may have, root and the daemon's own user included.",
        1,
        100_000,
    ),
    Key(
        "trajectories",
        "most_mb_per_user",
        int,
        "500",
        "How many megabytes (10^6 bytes) a user's may have together, with their grips. The longest"
        " recording has 14.4.",
        1,
        1_000_000,
    ),
    Key(
        "teleop",
        "zenoh_config",
        str,
        '"/etc/litegripd/zenoh-tls.json5"',
        "The absolute path of a configuration file of zenoh's own, for TLS and access lists;"
        " etc/zenoh-tls.json5 is one. Left out: the link is open to everyone who reaches its port.",
    ),
)


ALLOWED = "a user's name, \"@\" and a group's name, or a uid as a number, 0 to 4294967294"

_ROOT = 0
_MAX_UID = 2**32 - 2  # the last one means "no user" to the kernel

Entry: TypeAlias = str | int


class UnknownEntryError(ValueError):
    """An entry that names no user or group; the message names the entry and its list."""


@dataclass(frozen=True, slots=True)
class Access:
    """The roles by uid and by gid; `default` is for every other user who may connect.

    `gateways` are the uids, and `gateway_groups` the gids, that may speak for remote users.
    """

    default: Role = "operator"
    users: Mapping[int, Role] = field(default_factory=dict)
    groups: Mapping[int, Role] = field(default_factory=dict)
    gateways: frozenset[int] = frozenset()
    gateway_groups: frozenset[int] = frozenset()

    def role_of(self, peer: Peer) -> Role:
        """Return the highest role of a client; root and the daemon's user are admins."""
        if peer.uid in (_ROOT, os.geteuid()):
            return "admin"
        given = [self.groups.get(gid) for gid in (peer.gid, *peer.groups)]
        given.append(self.users.get(peer.uid))
        return max(filter(None, given), key=ROLES.index, default=self.default)

    def is_gateway(self, peer: Peer) -> bool:
        """Return True for a client that may speak for users of other machines."""
        gids = {peer.gid, *peer.groups}
        return peer.uid in self.gateways or not gids.isdisjoint(self.gateway_groups)


def access_of(default: Role, lists: Mapping[str, Sequence[Entry]]) -> Access:
    """Look up the entries of "observers", "operators" and "admins".

    Raises `UnknownEntryError` for an entry that names no user or group.
    """
    users: dict[int, Role] = {}
    groups: dict[int, Role] = {}
    for role in ROLES:  # the highest role last: it overwrites lower ones
        key = f"{role}s"
        uids, gids = _ids(key, lists)
        users |= dict.fromkeys(uids, role)
        groups |= dict.fromkeys(gids, role)
    return Access(default, users, groups, *_ids("gateways", lists))


def _ids(key: str, lists: Mapping[str, Sequence[Entry]]) -> tuple[frozenset[int], frozenset[int]]:
    """Return the uids and the gids of a list."""
    uids, gids = set(), set()
    for entry in lists.get(key, ()):
        if isinstance(entry, str) and entry.startswith("@"):
            gids.add(_gid(key, entry[1:]))
        else:
            uids.add(_uid(key, entry))
    return frozenset(uids), frozenset(gids)


def _gid(key: str, name: str) -> int:
    try:
        return grp.getgrnam(name).gr_gid
    except (KeyError, ValueError):  # ValueError: a NUL inside, or not encodable
        raise UnknownEntryError(f"{key}: there is no group {name!r}") from None


def _uid(key: str, entry: Entry) -> int:
    if isinstance(entry, int):
        if not 0 <= entry <= _MAX_UID:
            raise UnknownEntryError(f"{key}: {reprlib.repr(entry)} cannot be a uid")
        return entry
    try:
        return pwd.getpwnam(entry).pw_uid
    except (KeyError, ValueError):
        raise UnknownEntryError(f"{key}: there is no user {entry!r}") from None


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DIRECTORY = Path("/etc/litegripd")


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names file, key and allowed values."""


@dataclass(frozen=True, slots=True)
class MotorConfig:
    """The motor on the bus; with `master_id` None, register MST_ID gives the id.

    `second_master` says what follows when another program commands the motor: motions are
    rejected, or it is only reported.
    """

    type: str = DM4310.name
    can_id: int = 0x08
    master_id: int | None = None
    second_master: str = "refuse"


@dataclass(frozen=True, slots=True)
class GripperConfig:
    """The gripper; `mount` is a template's name or the path of a calibration file."""

    mount: str | None = None
    stroke_mm: float = STROKE_MM

    @property
    def named_file(self) -> str | None:
        """The calibration file that is named here or by LITEGRIP_CALIB, None for what is found."""
        mount = self.mount or os.environ.get("LITEGRIP_CALIB")
        return None if mount is None or mount in TEMPLATES else str(Path(mount).expanduser())

    @property
    def is_superseded(self) -> bool:
        """True if the stroke is the placeholder that earlier versions wrote into the file."""
        return self.stroke_mm == SUPERSEDED_STROKE_MM


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """The control thread: rate, priority (0: ordinary) and CPUs (empty: all)."""

    rate_hz: int = 200
    priority: int = 50
    cpus: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RpcConfig:
    """The socket; `path` None follows from the channel's name, and `group` may connect."""

    socket: str | None = None
    group: str = "litegrip"


@dataclass(frozen=True, slots=True)
class TeleopConfig:
    """Teleoperation links; `zenoh_config` is a zenoh file, for TLS and access lists."""

    zenoh_config: str | None = None


@dataclass(frozen=True, slots=True)
class TrajectoryConfig:
    """The most named trajectories, and the most megabytes of them, that each user may keep."""

    most_per_user: int = 500
    most_mb_per_user: int = 500

    @property
    def limits(self) -> Limits:
        """The same in the store's units."""
        return Limits(self.most_per_user, self.most_mb_per_user * MB)


@dataclass(frozen=True, slots=True)
class Config:
    """The whole configuration of one channel, and the path of its file, if there is one."""

    channel: str
    bus: BusSettings
    motor: MotorConfig = field(default_factory=MotorConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    rpc: RpcConfig = field(default_factory=RpcConfig)
    access: Access = field(default_factory=Access)
    trajectories: TrajectoryConfig = field(default_factory=TrajectoryConfig)
    teleop: TeleopConfig = field(default_factory=TeleopConfig)
    source: Path | None = None

    @property
    def gripper_id(self) -> GripperId:
        """The gripper, as the daemon's rooms below know it."""
        gripper = self.gripper
        return GripperId(
            self.channel,
            self.bus.channel,
            self.motor.can_id,
            STROKE_MM if gripper.is_superseded else gripper.stroke_mm,
            gripper.mount,
            MOTOR_TYPES[self.motor.type],
        )

    def as_info(self) -> Configuration:
        """Return the part that clients may read, for `info.get` and `litegripd --check`."""
        bus = self.bus
        return {
            "file": None if self.source is None else str(self.source),
            "bus": {"interface": bus.interface, "channel": bus.channel, "bitrate": bus.bitrate},
            "control": dataclasses.asdict(self.control),
            "gripper": {
                "stroke_mm": self.gripper.stroke_mm,
                "calibration": self.gripper.named_file,
            },
            "rpc": {"group": self.rpc.group},
            "trajectories": {
                "most_per_user": self.trajectories.most_per_user,
                "most_mb_per_user": self.trajectories.most_mb_per_user,
            },
        }


SAME_TABLES = ("bus", "motor", "gripper", "rpc")
"""Tables that must not change at a restart that holds: the hold depends on them."""


def same_settings(config: Config) -> dict[str, Any]:
    """Return the tables that must be the same for a successor, as plain values."""
    return {table: plain_of(getattr(config, table)) for table in SAME_TABLES}


_KEYS = {(key.table, key.name): key for key in KEYS}
_OURS = ("ignore_config",)
"""Arguments of python-can that the daemon sets itself."""

_MISSPELT = 0.85
"""How alike a key and one of ours are at least; data_bitrate and channel_id are less alike."""

_NAMED = {
    str: "a string",
    int: "an integer",
    float: "a number",
    list: "an array of integers, 0 to 1023",
    tuple: f"an array of these: {ALLOWED}",
}


def find(channel: str, directory: Path = DIRECTORY) -> Path | None:
    """Return the file for a channel: its own, else the common one, else None."""
    candidates = (directory / f"{channel}.toml", directory / "litegripd.toml")
    return next((path for path in candidates if path.is_file()), None)


def load(channel: str, path: Path | None) -> Config:
    """Return the configuration of `channel`; without a file, the defaults.

    Raises `ConfigError` for a file that cannot be read, is not TOML, or has an unknown key, a
    wrong type or an impossible value.
    """
    if path is None:
        return _build(channel, {}, None)
    try:
        content = toml_of(path.read_bytes(), tomllib.loads)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from error
    return _build(channel, content, path)


def _build(channel: str, content: Mapping[str, Any], source: Path | None) -> Config:
    where = "defaults" if source is None else str(source)
    for table, values in content.items():
        if table not in TABLES:
            raise ConfigError(f"{where}: {_unknown_table(table, values)}")
        if not isinstance(values, dict):
            raise ConfigError(f"{where}: {table} must be a table, written [{table}]")
        for key, value in values.items():
            _check(where, table, key, value)
    motor = MotorConfig(**content.get("motor", {}))
    if motor.can_id == motor.master_id:
        raise ConfigError(
            f"{where}: [motor] master_id is can_id, 0x{motor.can_id:02X}: the motor answers on"
            " another id than it is commanded by"
        )
    gripper = GripperConfig(**content.get("gripper", {}))
    teleop = TeleopConfig(**content.get("teleop", {}))
    _check_paths(where, gripper, content.get("rpc", {}).get("socket"), teleop.zenoh_config)
    bus = dict(content.get("bus", {}))
    control = dict(content.get("control", {}))
    if "cpus" in control:
        control["cpus"] = tuple(control["cpus"])
    return Config(
        channel=channel,
        bus=BusSettings(
            interface=bus.pop("interface", "socketcan"),
            channel=bus.pop("channel", channel),
            bitrate=bus.pop("bitrate", 1_000_000),
            options=bus,
        ),
        motor=motor,
        gripper=gripper,
        control=ControlConfig(**control),
        rpc=RpcConfig(**content.get("rpc", {})),
        access=_access(where, content.get("access", {})),
        trajectories=TrajectoryConfig(**content.get("trajectories", {})),
        teleop=teleop,
        source=source,
    )


def _unknown_table(name: str, value: Any) -> str:
    """Return why there is no such table; a key that stands before any table looks like one."""
    if isinstance(value, dict):
        return f"unknown table [{name}]; allowed: {_listed(TABLES)}"
    owners = [f"[{key.table}]" for key in KEYS if key.name == name]
    if not owners:
        return f"unknown key {name}, in no table; allowed tables: {_listed(TABLES)}"
    tables = " and of ".join(owners)
    return f"{name} is a key of {tables}: put it under {' or '.join(owners)}"


def _access(where: str, table: Mapping[str, Any]) -> Access:
    try:
        return access_of(table.get("default", "operator"), table)
    except UnknownEntryError as error:
        raise ConfigError(f"{where}: [access] {error}; allowed: {ALLOWED}") from error


def _check(where: str, table: str, key: str, value: Any) -> None:
    """Reject an unknown key, a wrong type or an impossible value.

    Any other key of [bus] is passed to python-can, unless it looks like a misspelt own one: an
    interface may ignore what it does not know, and then another bus would be opened.
    """
    known = _KEYS.get((table, key))
    name = f"{where}: [{table}] {key}"
    own = [one.name for one in KEYS if one.table == table]
    if known is None:
        if table == "bus" and key not in _OURS:
            if not isinstance(value, str) and not (
                isinstance(value, bool | int | float) and is_finite(value)
            ):
                shown = reprlib.repr(value)
                raise ConfigError(f"{name} is {shown}, it must be a string, number or boolean")
            if meant := difflib.get_close_matches(key, own, 1, _MISSPELT):
                raise ConfigError(f"{name} is unknown; did you mean {meant[0]}?")
            return
        raise ConfigError(f"{name} is unknown; allowed: {_listed(own)}")
    is_number = known.kind in (int, float)
    if not _has_type(value, known.kind) or (is_number and not known.low <= value <= known.high):
        within = f", {known.low:.9g} to {known.high:.9g}" if is_number else ""
        text = f"{name} is {reprlib.repr(value)}, it must be {_NAMED[known.kind]}{within}"
        is_quoted = isinstance(value, str) and known.kind is not str
        raise ConfigError(f"{text}, without quotes" if is_quoted else text)
    if known.choices and value not in known.choices:
        why = known.why_not(value) or f"it must be one of: {_listed(known.choices)}"
        raise ConfigError(f"{name} is {value!r}, {why}")
    if known.kind is str and not value:
        raise ConfigError(f"{name} is empty; leave the key out for the default")


def _check_paths(where: str, gripper: GripperConfig, socket: str | None, zenoh: str | None) -> None:
    """Reject relative paths: they would depend on the directory in which the daemon starts."""
    mount = gripper.mount
    if mount is not None and mount not in TEMPLATES:
        allowed = f"one of {_listed(TEMPLATES)}, or the absolute path of a calibration file"
        if not mount.startswith("/"):
            raise ConfigError(f"{where}: [gripper] mount is {mount!r}, it must be {allowed}")
        if not Path(mount).is_file():
            raise ConfigError(f"{where}: [gripper] mount is {mount}, where there is no file")
    if socket is not None and not socket.startswith("/"):
        raise ConfigError(f"{where}: [rpc] socket is {socket!r}, it must be an absolute path")
    if zenoh is not None and not (zenoh.startswith("/") and Path(zenoh).is_file()):
        text = f"[teleop] zenoh_config is {zenoh!r}, it must be the absolute path of a file"
        raise ConfigError(f"{where}: {text}")


def _has_type(value: Any, kind: type) -> bool:
    if isinstance(value, bool):
        return False
    if kind is float:
        return isinstance(value, int | float) and is_finite(value)
    if kind is list:
        return isinstance(value, list) and all(
            isinstance(item, int) and not isinstance(item, bool) and 0 <= item < MAX_CPUS
            for item in value
        )
    if kind is tuple:
        return isinstance(value, list) and all(
            isinstance(item, int | str) and not isinstance(item, bool) for item in value
        )
    return isinstance(value, kind)


def _listed(names: Any) -> str:
    return ", ".join(names)


OWN_MECHANICS = "own"
"""Those that the simulator has by itself."""


def override(
    config: Config, *, socket: str | None, interface: str | None, simulate: str | None
) -> Config:
    """Return the configuration with the command line applied, which wins over the file.

    `simulate` replaces the bus by a simulated gripper: interface `litegrip_sim`, with the
    configured type of motor, and with the mechanics that it names. If no mount is configured, it is
    the simulated gripper's.
    """
    if socket is not None:
        config = dataclasses.replace(config, rpc=dataclasses.replace(config.rpc, socket=socket))
    if simulate is not None:
        mount = config.gripper.mount or "normal"
        gripper = dataclasses.replace(config.gripper, mount=mount)
        options = {"mount": mount} if mount in TEMPLATES else {}
        if config.motor.type != DM4310.name:
            options["motor_type"] = config.motor.type
        if simulate != OWN_MECHANICS:
            options["mechanics"] = simulate
        bus = BusSettings(SIMULATOR, config.channel, config.bus.bitrate, options)
        return dataclasses.replace(config, bus=bus, gripper=gripper)
    if interface is not None:
        bus = dataclasses.replace(config.bus, interface=interface)
        return dataclasses.replace(config, bus=bus)
    return config
