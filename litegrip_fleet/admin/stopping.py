"""A stop of a whole site by every way there is, at once: the portal's sockets, and each router.

The portal's sessions are there already; a new one may be kept out by a router that is busy or gone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import zenoh

from litegrip_client.core.stop import stop_params
from litegrip_client.line.exchange import request_line
from litegrip_fleet.admin import by_portal
from litegrip_fleet.admin.config import PortalConfig
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import Network, NetworkError, close, reached
from litegrip_fleet.wire.site import Stopped, alive, stop_all

BY_PORTAL = "the portal"
SILENT = "silent"
_NOT_SENT = "; no stop was sent: use the switch that cuts the power"


def stop_site(
    networks: Sequence[Network], part: PortalConfig, site: str, level: str, why: str | None
) -> tuple[Stopped, ExitStack]:
    """Stop all grippers of a site by each of the networks, and those of the portal by its sockets.

    Returns what became of it, and what is to be closed afterwards. Where no router could be
    reached, the site may have other grippers. Raises `NetworkError` if there was no way at all.
    """
    sessions = ExitStack()
    ways: dict[str, Callable[[], Stopped]] = {}
    if not networks or part.of_site(site):
        ways[BY_PORTAL] = lambda: by_portal.stop_all(part, site, level, why)

    def by_network(network: Network) -> Stopped:
        session = reached(network)
        sessions.callback(close, session)
        line = request_line(1, "stop", stop_params(level, why))
        return asyncio.run(_stopped(session, site, part, line))

    for network in networks:
        ways[", ".join(network.connect)] = partial(by_network, network)
    with ThreadPoolExecutor(len(ways)) as several:
        begun = {way: several.submit(stop) for way, stop in ways.items()}
    lost = [str(error) for future in begun.values() if (error := future.exception()) is not None]
    done = {way: future.result() for way, future in begun.items() if not future.exception()}
    if not done:
        raise NetworkError("; ".join(lost) + _NOT_SENT)
    is_whole = not networks or bool(done.keys() - {BY_PORTAL})
    return replace(merged(done), lost=lost, is_whole=is_whole), sessions


async def _stopped(session: zenoh.Session, site: str, part: PortalConfig, line: bytes) -> Stopped:
    # Stopping comes first: who else is there is asked for meanwhile.
    looking = asyncio.create_task(asyncio.to_thread(alive, session, site))
    stopped = await stop_all(session, site, part.user, part.of_site(site), line)
    for place in await looking:
        if place not in stopped.confirmed and place not in stopped.failed:
            stopped.silent.append(place)
    return stopped


def merged(ways: Mapping[str, Stopped]) -> Stopped:
    """Return what became of a stop that went several ways: one that confirms it is enough."""
    confirmed: dict[Place, float] = {}
    for stopped in ways.values():
        for place, after_s in stopped.confirmed.items():
            confirmed[place] = min(after_s, confirmed.get(place, after_s))
    problems: dict[Place, list[tuple[str, str]]] = {}
    for way, stopped in ways.items():
        told = {**dict.fromkeys(stopped.silent, SILENT), **stopped.failed}
        for place, problem in told.items():
            if place not in confirmed:
                problems.setdefault(place, []).append((way, problem))
    failed = {place: _told(rows, len(ways)) for place, rows in problems.items()}
    silent = sorted(place for place, problem in failed.items() if problem == SILENT)
    return Stopped(confirmed, {p: t for p, t in failed.items() if t != SILENT}, silent)


def _told(rows: Sequence[tuple[str, str]], ways: int) -> str:
    """Return why a stop is not confirmed, by each way if there are several."""
    if ways == 1 or all(problem == SILENT for _way, problem in rows):
        return rows[0][1]
    return "; ".join(f"by {way}: {problem}" for way, problem in rows)
