"""Who may do what: the roles that the configuration gives to users and groups.

Names are looked up once, at the start; the kernel tells who a client is.
"""

import grp
import os
import pwd
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from litegripd.rpc.sessions import ROLES, Peer, Role

ALLOWED = "a user's name, \"@\" and a group's name, or a uid as a number, 0 to 4294967294"

_ROOT = 0
_MAX_UID = 2**32 - 2  # the last one means "no user" to the kernel

Entry: TypeAlias = str | int


class UnknownEntryError(ValueError):
    """An entry that names nobody; the message says which, of which list."""


@dataclass(frozen=True, slots=True)
class Access:
    """The roles by uid and by gid; `default` for whoever may connect and is in neither."""

    default: Role = "operator"
    users: Mapping[int, Role] = field(default_factory=dict)
    groups: Mapping[int, Role] = field(default_factory=dict)

    def role_of(self, peer: Peer) -> Role:
        """Return the highest role that an entry gives; root and the daemon's user are admins."""
        if peer.uid in (_ROOT, os.geteuid()):
            return "admin"
        given = [self.groups.get(gid) for gid in (peer.gid, *peer.groups)]
        given.append(self.users.get(peer.uid))
        return max(filter(None, given), key=ROLES.index, default=self.default)


def access_of(default: Role, lists: Mapping[str, Sequence[Entry]]) -> Access:
    """Look up the entries of "observers", "operators" and "admins".

    Raises `UnknownEntryError` for an entry that names nobody.
    """
    users: dict[int, Role] = {}
    groups: dict[int, Role] = {}
    for role in ROLES:  # a higher one later, so that it counts
        key = f"{role}s"
        for entry in lists.get(key, ()):
            if isinstance(entry, str) and entry.startswith("@"):
                groups[_gid(key, entry[1:])] = role
            else:
                users[_uid(key, entry)] = role
    return Access(default, users, groups)


def _gid(key: str, name: str) -> int:
    try:
        return grp.getgrnam(name).gr_gid
    except (KeyError, ValueError):  # the latter: with a NUL inside, or not encodable
        raise UnknownEntryError(f"{key}: there is no group {name!r}") from None


def _uid(key: str, entry: Entry) -> int:
    if isinstance(entry, int):
        if not 0 <= entry <= _MAX_UID:
            raise UnknownEntryError(f"{key}: {entry} cannot be a uid")
        return entry
    try:
        return pwd.getpwnam(entry).pw_uid
    except (KeyError, ValueError):
        raise UnknownEntryError(f"{key}: there is no user {entry!r}") from None
