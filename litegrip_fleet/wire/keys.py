"""The names of sites, grippers and users, and the keys that they make on the network.

A name becomes a part of a key, and the router's rules compare keys: so none can hold a wildcard,
and none can leave its place.
"""

import re
from dataclasses import dataclass
from typing import TypeGuard

PREFIX = "litegripd/1"
"""1 is the major version of what gateways and portals say to each other."""

CLASSES = {"observer": "observe", "operator": "operate", "admin": "admin"}
"""The part of a key that says with which role a session asks, so that a router refuses by it."""

ROLE_OF_CLASS = {word: role for role, word in CLASSES.items()}

_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
NAME_RULE = "1 to 32 letters, digits, '_' and '-'"


class BadNameError(ValueError):
    """A name that cannot be part of a key; the message says what can."""


def check_name(name: object, what: str) -> str:
    """Return `name`; raises `BadNameError` if it cannot be the name of a `what`."""
    if not is_name(name):
        raise BadNameError(f"{what} {name!r:.60}: it must be {NAME_RULE}")
    return name


def is_name(value: object) -> TypeGuard[str]:
    """Return True for what can be a name: it is a whole part of a key, and no wildcard."""
    return isinstance(value, str) and _NAME.fullmatch(value) is not None


@dataclass(frozen=True, order=True, slots=True)
class Place:
    """A gripper on the network: its site, and its name there."""

    site: str
    gripper: str

    @classmethod
    def of(cls, text: object) -> "Place":
        """Return the place that `SITE.GRIPPER` names; raises `BadNameError`."""
        site, dot, gripper = text.partition(".") if isinstance(text, str) else ("", "", "")
        if not dot:
            raise BadNameError(
                f"gripper {text!r:.80}: it must be SITE.GRIPPER, lab.left for example"
            )
        return cls(check_name(site, "site"), check_name(gripper, "gripper"))

    def __str__(self) -> str:
        return f"{self.site}.{self.gripper}"

    @property
    def key(self) -> str:
        """The key under which all of this gripper lies."""
        return f"{PREFIX}/{self.site}/{self.gripper}"

    @property
    def alive(self) -> str:
        """The token that says that its daemon can be reached."""
        return f"{self.key}/alive"

    @property
    def about(self) -> str:
        """Where everybody may ask how it is."""
        return f"{self.key}/hello"

    def rpc(self, user: str, session: str, role: str) -> str:
        """Where a user's session asks."""
        return f"{self.key}/rpc/{user}/{session}/{CLASSES[role]}"

    def to(self, user: str, session: str) -> str:
        """Where the gateway sends what a session has not asked for at that moment."""
        return f"{self.key}/to/{user}/{session}"

    def stop(self, user: str) -> str:
        """Where a user stops it."""
        return f"{self.key}/stop/{user}"


def place_in(key: str) -> Place | None:
    """Return the gripper to which a key belongs, None for another kind of key."""
    parts = key.split("/")
    if len(parts) < 5 or "/".join(parts[:2]) != PREFIX:
        return None
    try:
        return Place(check_name(parts[2], "site"), check_name(parts[3], "gripper"))
    except BadNameError:
        return None


@dataclass(frozen=True, slots=True)
class Caller:
    """Whose session an `rpc` key names, and with which role; the router vouches for it."""

    user: str
    session: str
    role: str


def caller_in(key: str) -> Caller | None:
    """Return who asks by an `rpc` key; None for another kind of key, or a malformed one."""
    parts = key.split("/")
    if len(parts) != 8 or parts[4] != "rpc" or parts[7] not in ROLE_OF_CLASS:
        return None
    user, session = parts[5:7]
    if _NAME.fullmatch(user) is None or _NAME.fullmatch(session) is None:
        return None
    return Caller(user, session, ROLE_OF_CLASS[parts[7]])


def stopper_in(key: str) -> str | None:
    """Return the user whom a `stop` key names; None for another kind of key."""
    parts = key.split("/")
    if len(parts) != 6 or parts[4] != "stop" or _NAME.fullmatch(parts[5]) is None:
        return None
    return parts[5]
