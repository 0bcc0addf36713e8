"""The daemon's configuration: TOML to frozen values, refused as a whole when anything is wrong.

What there is, and what it may be, is in `config_table.py`.
"""

import dataclasses
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from litegripd.app.config_table import KEYS, MAX_CPUS, TABLES
from litegripd.app.roles import ALLOWED, Access, UnknownEntryError, access_of
from litegripd.io.can.bus import BusSettings
from litegripd.io.helper.files import TEMPLATES
from litegripd.model.motor_types import DM4310
from litegripd.rpc.facts import Configuration
from litegripd.trajectories.owners import MB, Limits

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DIRECTORY = Path("/etc/litegripd")


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names file, key and what is allowed."""


@dataclass(frozen=True, slots=True)
class MotorConfig:
    """The motor on the bus; `master_id` None is found by register MST_ID.

    `second_master` says what another sender of commands leads to: motions are refused, or only
    told of.
    """

    type: str = DM4310.name
    can_id: int = 0x08
    master_id: int | None = None
    second_master: str = "refuse"


@dataclass(frozen=True, slots=True)
class GripperConfig:
    """What the motor moves; `mount` a template's name or a calibration file's path."""

    mount: str | None = None
    stroke_mm: float = 120.0


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """The control thread: its rate, its priority (0: ordinary) and its CPUs (empty: all)."""

    rate_hz: int = 200
    priority: int = 50
    cpus: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class RpcConfig:
    """The socket; `path` None is chosen by the channel's name, `group` may use it."""

    socket: str | None = None
    group: str = "litegrip"


@dataclass(frozen=True, slots=True)
class TeleopConfig:
    """Teleoperation links; `zenoh_config` is a file of zenoh's own, for TLS and access lists."""

    zenoh_config: str | None = None


@dataclass(frozen=True, slots=True)
class TrajectoryConfig:
    """How many named trajectories, and how many megabytes of them, are kept for each user."""

    most_per_user: int = 500
    most_mb_per_user: int = 500

    @property
    def limits(self) -> Limits:
        """The same as the store counts it."""
        return Limits(self.most_per_user, self.most_mb_per_user * MB)


@dataclass(frozen=True, slots=True)
class Config:
    """The whole configuration of one channel, and the file that it came from, if any."""

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

    def as_info(self) -> Configuration:
        """Tell what a client may want to know of it, for `info.get` and `litegripd --check`."""
        bus = self.bus
        return {
            "file": None if self.source is None else str(self.source),
            "bus": {"interface": bus.interface, "channel": bus.channel, "bitrate": bus.bitrate},
            "control": dataclasses.asdict(self.control),
            "rpc": {"group": self.rpc.group},
            "trajectories": {
                "most_per_user": self.trajectories.most_per_user,
                "most_mb_per_user": self.trajectories.most_mb_per_user,
            },
        }


_KEYS = {(key.table, key.name): key for key in KEYS}
_OURS = ("ignore_config",)
"""Arguments of python-can that the daemon sets itself."""

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
    """Read the configuration of `channel`; without a file, the defaults.

    Raises `ConfigError` for a file that cannot be read, is not TOML, or has an unknown key, a
    wrong type or an impossible value.
    """
    if path is None:
        return _build(channel, {}, None)
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    return _build(channel, content, path)


def _build(channel: str, content: Mapping[str, Any], source: Path | None) -> Config:
    where = "defaults" if source is None else str(source)
    for table, values in content.items():
        if table not in TABLES:
            raise ConfigError(f"{where}: unknown table [{table}]; allowed: {_listed(TABLES)}")
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


def _access(where: str, table: Mapping[str, Any]) -> Access:
    try:
        return access_of(table.get("default", "operator"), table)
    except UnknownEntryError as error:
        raise ConfigError(f"{where}: [access] {error}; allowed: {ALLOWED}") from error


def _check(where: str, table: str, key: str, value: Any) -> None:
    """Refuse an unknown key, a wrong type or an impossible value.

    Further keys of [bus] are python-can's: only it knows which its interface takes.
    """
    known = _KEYS.get((table, key))
    name = f"{where}: [{table}] {key}"
    if known is None:
        if table == "bus" and key not in _OURS:
            if not isinstance(value, bool | int | float | str):
                raise ConfigError(f"{name} is {value!r}, it must be a string, number or boolean")
            return
        allowed = [one.name for one in KEYS if one.table == table]
        raise ConfigError(f"{name} is unknown; allowed: {_listed(allowed)}")
    if not _has_type(value, known.kind):
        raise ConfigError(f"{name} is {value!r}, it must be {_NAMED[known.kind]}")
    if known.kind in (int, float) and not known.low <= value <= known.high:
        raise ConfigError(f"{name} is {value}, it must be {known.low:g} to {known.high:g}")
    if known.choices and value not in known.choices:
        raise ConfigError(f"{name} is {value!r}, it must be one of: {_listed(known.choices)}")
    if known.kind is str and not value:
        raise ConfigError(f"{name} is empty; leave the key out for the default")


def _check_paths(where: str, gripper: GripperConfig, socket: str | None, zenoh: str | None) -> None:
    """Refuse what would depend on the directory that the daemon happens to start in."""
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
        return isinstance(value, int | float) and math.isfinite(value)
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


def override(
    config: Config, *, socket: str | None, interface: str | None, simulate: bool
) -> Config:
    """Apply the command line, which wins over the file.

    `simulate` takes the simulated gripper in place of the bus: interface `litegrip_sim`, with the
    configured type of motor, and, where none is configured, the mount that it has.
    """
    if socket is not None:
        config = dataclasses.replace(config, rpc=dataclasses.replace(config.rpc, socket=socket))
    if simulate:
        mount = config.gripper.mount or "normal"
        gripper = dataclasses.replace(config.gripper, mount=mount)
        options = {"mount": mount} if mount in TEMPLATES else {}
        if config.motor.type != DM4310.name:
            options["motor_type"] = config.motor.type
        bus = BusSettings("litegrip_sim", config.channel, config.bus.bitrate, options)
        return dataclasses.replace(config, bus=bus, gripper=gripper)
    if interface is not None:
        bus = dataclasses.replace(config.bus, interface=interface)
        return dataclasses.replace(config, bus=bus)
    return config
