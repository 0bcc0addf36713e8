"""Whom a router lets in, by the names of their certificates: who has no business there is logged.

zenoh lets in whoever has a certificate of the authority; the rules only say what he may then do.
"""

import logging
from collections import deque
from collections.abc import Collection

_log = logging.getLogger(__name__)

_KNOWN_IDS = 16
"""Of each gateway, the last ones."""


class Guests:
    """The router's guests; `came` is told of each one."""

    def __init__(self, users: Collection[str], gateways: Collection[str]) -> None:
        self._users = users
        self._ids: dict[str, deque[str]] = {name: deque(maxlen=_KNOWN_IDS) for name in gateways}

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
