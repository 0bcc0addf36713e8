"""The grippers of this machine's portal by its sockets, for users who may not read the key."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from litegrip_client.core.stop import stop_at
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import LiteGripError
from litegrip_fleet.admin.config import PortalConfig
from litegrip_fleet.far.daemon import how_it_is
from litegrip_fleet.wire.foreign import facts_of
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.site import About, Stopped

ANSWER_WITHIN_S = 3.0
"""A portal answers within 2 s, if only that there is no answer."""

_Found = TypeVar("_Found")


def look(portal: PortalConfig, site: str) -> list[About]:
    """Ask how all grippers of a site are; one that does not answer has an error."""

    def about(place: Place) -> About:
        begun_s = time.monotonic()
        try:
            with connect(str(place), portal.socket_path(place), ANSWER_WITHIN_S) as connection:
                hello = connection.call("hello", {"client": "litegripd-fleet"})
                after_s = time.monotonic() - begun_s
                health, state = connection.call("health"), connection.call("state.get")
                facts = facts_of(how_it_is(hello, health, state, connection.call("lease.get")))
        except (LiteGripError, KeyError, TypeError) as error:
            after_s = time.monotonic() - begun_s
            facts = facts_of({"error": str(error)})
        return About(place, after_s, facts)

    return _of_each(sorted(portal.of_site(site)), about)


def stop_all(portal: PortalConfig, site: str, level: str, why: str | None) -> Stopped:
    """Stop all grippers of a site at once."""
    places, begun_s = portal.of_site(site), time.monotonic()

    def stopped(place: Place) -> float | str:
        try:
            stop_at(portal.socket_path(place), level, why, ANSWER_WITHIN_S)
        except LiteGripError as error:
            return error.message
        except OSError as error:
            return f"the portal does not answer: {error.strerror or error}"
        return time.monotonic() - begun_s

    found = dict(zip(places, _of_each(places, stopped), strict=True))
    confirmed = {place: one for place, one in found.items() if isinstance(one, float)}
    failed = {place: one for place, one in found.items() if isinstance(one, str)}
    return Stopped(confirmed, failed, silent=[])


def _of_each(places: Sequence[Place], ask: Callable[[Place], _Found]) -> list[_Found]:
    with ThreadPoolExecutor(max(1, len(places))) as several:
        return list(several.map(ask, places))
