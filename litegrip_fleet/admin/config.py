"""The configuration, /etc/litegripd/fleet.toml: one file for gateway, portal and router."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from litegrip_client.core.discovery import check_channel
from litegrip_client.core.sockets import PORTAL_DIRECTORY, STOP_LEVELS
from litegrip_client.values.errors import ParameterError
from litegrip_client.values.strict_json import is_finite
from litegrip_client.values.text import toml_of
from litegrip_fleet.admin.access import ROLES
from litegrip_fleet.admin.options import FILE
from litegrip_fleet.far.admission import LONGEST_TTL_S, SHORTEST_TTL_S
from litegrip_fleet.far.far_session import DEFAULT_TTL_S
from litegrip_fleet.wire.keys import BadNameError, Place, check_name
from litegrip_fleet.wire.network import Network, Tls

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

MOST_WATCHED = 8


_Value = TypeVar("_Value")


class FleetConfigError(ValueError):
    """A configuration that cannot be used; the message names file, key and allowed values."""


@dataclass(frozen=True, slots=True)
class GatewayConfig:
    """Which daemons of this machine are on the network, by their names there.

    While one of the users `stop_when_silent` shows no life, all are stopped by `stop_level`.
    """

    site: str
    grippers: Mapping[str, str]
    stop_when_silent: Sequence[str] = ()
    stop_level: str = STOP_LEVELS[0]

    @property
    def places(self) -> Mapping[Place, str]:
        """The channel of each gripper."""
        return {Place(self.site, name): channel for name, channel in self.grippers.items()}


@dataclass(frozen=True, slots=True)
class PortalConfig:
    """Which remote grippers have sockets here, and as whom and how this machine's users act."""

    user: str
    grippers: Sequence[Place]
    role: str = "operator"
    ttl_s: float = DEFAULT_TTL_S
    directory: str = PORTAL_DIRECTORY

    def of_site(self, site: str) -> list[Place]:
        """Return the grippers of a site; "*" is every one."""
        return [place for place in self.grippers if site in ("*", place.site)]

    def socket_path(self, place: Place) -> str:
        """Return the socket for a gripper's requests."""
        return f"{self.directory}/{place}.sock"


@dataclass(frozen=True, slots=True)
class RouterConfig:
    """Where the router listens, and who may what."""

    listen: Sequence[str]
    users: Mapping[str, str] = field(default_factory=dict)
    gateways: Mapping[str, Sequence[Place]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """All of it; a part that this machine has not is None."""

    source: str
    network: Network
    insecure: bool = False
    gateway: GatewayConfig | None = None
    portal: PortalConfig | None = None
    router: RouterConfig | None = None


def load(file: str = FILE) -> FleetConfig:
    """Read a configuration; raises `FleetConfigError`."""
    try:
        content = toml_of(Path(file).read_bytes(), tomllib.loads)
    except OSError as error:
        hint = ""
        if isinstance(error, FileNotFoundError) and file == FILE:
            hint = (
                ": this machine has no part of a fleet; 'litegripctl install-units --fleet', as"
                " root, writes one to begin with"
            )
        raise FleetConfigError(f"{file}: {error.strerror}{hint}") from error
    except ValueError as error:
        raise FleetConfigError(f"{file}: {error}") from error
    try:
        top = _Table(file, "", content)
        network, insecure = _network(top.part("network") or _Table(file, "network", {}))
        gateway, portal, router = (top.part(name) for name in ("gateway", "portal", "router"))
        top.finish()
        return FleetConfig(
            file,
            network,
            insecure,
            None if gateway is None else _gateway(gateway),
            None if portal is None else _portal(portal),
            None if router is None else _router(router),
        )
    except (BadNameError, ParameterError) as error:
        raise FleetConfigError(f"{file}: {error}") from error


def _network(table: "_Table") -> tuple[Network, bool]:
    connect = table.get("connect", _texts, ())
    insecure = table.get("insecure", _boolean, False)
    files: dict[str, str | None] = {
        name: table.get(name, _text, None) for name in ("ca", "certificate", "key")
    }
    table.finish()
    ca, certificate, key = (files[name] for name in ("ca", "certificate", "key"))
    if ca is not None and certificate is not None and key is not None:
        if insecure:
            raise table.error("insecure", "is true although certificates are named: choose one")
        return Network(connect=connect, tls=Tls(ca, certificate, key)), False
    if any(files.values()) or not insecure:
        raise table.error(
            "ca",
            "certificate and key belong together, and without them nothing is encrypted and"
            " everybody may do everything: name all three, or set insecure = true to try it out",
        )
    return Network(connect=connect), True


def _gateway(table: "_Table") -> GatewayConfig:
    site = check_name(table.get("site", _text), "[gateway] site")
    named = table.get("grippers", _mapping)
    watched: Sequence[str] | None = table.get("stop_when_silent", _texts, None)
    level: str | None = table.get("stop_level", _text, None)
    table.finish()
    grippers = {
        check_name(name, "[gateway] gripper"): check_channel(channel)
        for name, channel in named.items()
    }
    if not grippers:
        raise table.error("grippers", 'is empty: name => channel, as in left = "can0"')
    if watched is not None:
        watched = [check_name(user, "[gateway] stop_when_silent") for user in watched]
        if not 1 <= len(watched) <= MOST_WATCHED or len(set(watched)) < len(watched):
            problem = f"must name 1 to {MOST_WATCHED} users, each once; leave it out for no switch"
            raise table.error("stop_when_silent", problem)
    elif level is not None:
        raise table.error("stop_level", "means nothing without stop_when_silent: name the users")
    if level is not None and level not in STOP_LEVELS:
        problem = f"is {level!r}, it must be one of: {', '.join(STOP_LEVELS)}"
        raise table.error("stop_level", problem)
    return GatewayConfig(site, grippers, watched or (), level or STOP_LEVELS[0])


def _portal(table: "_Table") -> PortalConfig:
    user = check_name(table.get("user", _text), "[portal] user")
    places = [Place.of(text) for text in table.get("grippers", _texts)]
    role = table.get("role", _text, "operator")
    ttl_s = table.get("ttl_s", _number, DEFAULT_TTL_S)
    directory = table.get("directory", _text, PORTAL_DIRECTORY)
    table.finish()
    if role not in ROLES:
        raise table.error("role", f"is {role!r}, it must be one of: {', '.join(ROLES)}")
    if not SHORTEST_TTL_S <= ttl_s <= LONGEST_TTL_S:
        raise table.error("ttl_s", f"is {ttl_s:g}, it must be {SHORTEST_TTL_S} to {LONGEST_TTL_S}")
    if not places or len(set(places)) < len(places):
        raise table.error("grippers", "must name each gripper once, and one at least")
    return PortalConfig(user, places, role, ttl_s, directory)


def _router(table: "_Table") -> RouterConfig:
    listen = table.get("listen", _texts)
    users = table.get("users", _mapping, {})
    gateways = table.get("gateways", _mapping, {})
    table.finish()
    if not listen:
        raise table.error("listen", 'is empty: ["tls/[::]:7447"] listens on every address')
    for user, role in users.items():
        check_name(user, "[router.users] user")
        if role not in ROLES:
            raise table.error(
                f"users.{user}", f"is {role!r}, it must be one of: {', '.join(ROLES)}"
            )
    places: dict[str, list[Place]] = {}
    for name, texts in gateways.items():
        check_name(name, "[router.gateways] gateway")
        if name in users:
            raise table.error(f"gateways.{name}", "is a user, too: give it another certificate")
        places[name] = [Place.of(text) for text in _texts(texts) or ()]
        if not places[name]:
            raise table.error(f"gateways.{name}", 'must be an array of grippers, ["lab.left"]')
    return RouterConfig(listen, users, places)


_MISSING: Any = object()


class _Table:
    """A table of the file, whose keys are taken one by one."""

    def __init__(self, file: str, name: str, content: Mapping[str, Any]) -> None:
        self._file = file
        self._name = name
        self._content = dict(content)
        self._known: list[str] = []

    def error(self, key: str, problem: str) -> FleetConfigError:
        """Return the error of a key."""
        table = f"[{self._name}] " if self._name else ""
        return FleetConfigError(f"{self._file}: {table}{key} {problem}")

    def part(self, name: str) -> "_Table | None":
        """Take a table, or None where there is none."""
        self._known.append(name)
        content = self._content.pop(name, None)
        if content is None:
            return None
        if not isinstance(content, dict):
            raise self.error(name, "must be a table")
        return _Table(self._file, name, content)

    def get(
        self, key: str, read: Callable[[Any], _Value | None], default: Any = _MISSING
    ) -> _Value:
        """Take a key's value, by `read`, which returns None for one of another type."""
        self._known.append(key)
        if key not in self._content:
            if default is _MISSING:
                close = get_close_matches(key, self._content, 1)
                meant = f"; is it meant by {close[0]!r}, which is unknown?" if close else ""
                raise self.error(key, f"is missing{meant}")
            value: _Value = default
            return value
        found = self._content.pop(key)
        read_value = read(found)
        if read_value is None:
            raise self.error(key, f"cannot be {found!r:.60}: it must be {_EXPECTED[read]}")
        return read_value

    def finish(self) -> None:
        """Raise `FleetConfigError` for a key that nobody took."""
        for key in self._content:
            raise self.error(key, f"is unknown; there are: {', '.join(self._known)}")


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value else None


def _texts(value: Any) -> Sequence[str] | None:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        return None
    return value


def _mapping(value: Any) -> Mapping[str, Any] | None:
    return value if isinstance(value, dict) else None


def _boolean(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _number(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and is_finite(value) else None


_EXPECTED: Mapping[Any, str] = {
    _text: "a text",
    _texts: "an array of texts",
    _mapping: "a table",
    _boolean: "true or false",
    _number: "a finite number",
}
