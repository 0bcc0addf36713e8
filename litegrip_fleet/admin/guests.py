"""Whom a router lets in, by the names of their certificates: who has no business there is logged.

zenoh lets in whoever has a certificate of the authority, as often as he likes, until it has no room
for anybody; the rules only say what he may then do. So each certificate has room of its own.
"""

import logging
from collections import deque
from collections.abc import Collection, Iterable

_log = logging.getLogger(__name__)

_KNOWN_IDS = 16
"""Of each gateway, the last ones."""
MOST_OF_ONE = 64
"""Connections with one certificate: portals and commands of one user on many machines."""
MOST_WITHOUT_A_ROW = 4
"""They can do nothing; one that a user has for a moment tells him that he is in no table."""


class Guests:
    """The router's guests; `came` is told of each one."""

    def __init__(self, users: Collection[str], gateways: Collection[str]) -> None:
        self._users = users
        self._ids: dict[str, deque[str]] = {name: deque(maxlen=_KNOWN_IDS) for name in gateways}
        self._staying: dict[str, list[str]] = {}

    def came(self, name: str, identity: str) -> None:
        """Log a guest who is in no table, or has come with the id of a gateway.

        Only gateways answer, so only their ids are told to others.
        """
        for gateway, ids in self._ids.items():
            if gateway != name and identity in ids:
                _log.error(
                    "%s has connected with the id of %s, which is kept out until it comes by"
                    " another: give the fleet a new authority, and %s no certificate of it",
                    name,
                    gateway,
                    name,
                )
        if name in self._ids:
            if identity not in self._ids[name]:
                self._ids[name].append(identity)
        elif name not in self._users:
            _log.warning(
                "%s is in no table: a certificate of this authority lets it connect, and do"
                " nothing else",
                name,
            )

    def without_room(self, present: Iterable[tuple[str, str]]) -> list[str]:
        """Return the addresses of those who have to go, the last to come of each name.

        `present` has the name in the certificate of each connection there is, and its address.
        """
        addresses: dict[str, set[str]] = {}
        for name, address in present:
            addresses.setdefault(name, set()).add(address)
        self._staying = {name: kept for name, kept in self._staying.items() if name in addresses}
        surplus: list[str] = []
        for name, there in addresses.items():
            most = MOST_OF_ONE if name in self._ids or name in self._users else MOST_WITHOUT_A_ROW
            kept = [address for address in self._staying.get(name, ()) if address in there]
            others = there.difference(kept)
            while others and len(kept) < most:
                kept.append(others.pop())
            self._staying[name] = kept
            surplus += others
            if others:
                _log.warning(
                    "%s has %d connections, as many as one certificate may have: another one is"
                    " closed",
                    name,
                    most,
                )
        return surplus
