"""A whole site at once: who is there, and a stop for all."""

import asyncio
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from litegrip_fleet.wire.foreign import facts_in, stop_problem
from litegrip_fleet.wire.keys import PREFIX, Place, place_in
from litegrip_fleet.wire.lateness import STOP_WITHIN_S
from litegrip_fleet.wire.network import Answered, ask

TWO_GATEWAYS = "two gateways offer it: each would carry out what is asked; end one of them"
LOOK_WITHIN_S = 1.0
_ASK_AGAIN_S = 0.5
_LOOK_AGAIN_S = 0.05


def alive(session: zenoh.Session, site: str = "*") -> list[Place]:
    """Return the grippers whose daemons can be reached."""
    replies = session.liveliness().get(f"{PREFIX}/{site}/*/alive", timeout=LOOK_WITHIN_S)
    places = {place_in(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None}
    return sorted(place for place in places if place is not None)


@dataclass(frozen=True, slots=True)
class About:
    """How a gripper is, as its gateway says; `after_s` is how long the answer took."""

    place: Place
    after_s: float
    facts: Mapping[str, Any]


async def look(session: zenoh.Session, site: str = "*") -> list[About]:
    """Ask how all grippers of a site are; one that is there and does not answer has an error."""
    begun_s = time.monotonic()
    looking = asyncio.create_task(asyncio.to_thread(alive, session, site))
    found = await _asked_all(session, site, begun_s)
    there = await looking
    while not found.keys() >= set(there) and time.monotonic() - begun_s < LOOK_WITHIN_S:
        await asyncio.sleep(_LOOK_AGAIN_S)  # a flood of such questions: some get no answer
        found = {**await _asked_all(session, site, begun_s), **found}
    for place in there:
        silent = {"error": "it is there, and does not answer"}
        found.setdefault(place, About(place, LOOK_WITHIN_S, silent))
    return [found[place] for place in sorted(found)]


async def _asked_all(session: zenoh.Session, site: str, begun_s: float) -> dict[Place, About]:
    loop, key = asyncio.get_running_loop(), f"{PREFIX}/{site}/*/hello"
    within_s = max(begun_s + LOOK_WITHIN_S - time.monotonic(), _LOOK_AGAIN_S)
    found: dict[Place, About] = {}
    for answer in await ask(session, key, b"", None, loop, within_s=within_s):
        place, facts = place_in(answer.key), facts_in(answer.payload)
        if place in found:
            facts = {"error": TWO_GATEWAYS}
        if place is not None:
            found[place] = About(place, answer.at_s - begun_s, facts)
    return found


@dataclass(frozen=True, slots=True)
class Stopped:
    """What became of a stop of a site: who has confirmed it, who has refused, who is silent."""

    confirmed: dict[Place, float]
    """By the time that it took, in seconds."""
    failed: dict[Place, str]
    silent: list[Place]
    lost: Sequence[str] = ()
    """Why a way to the site could not be gone."""
    is_whole: bool = True
    """False if the site may have other grippers, which nobody could be asked for."""

    @property
    def ok(self) -> bool:
        """True if every gripper of the site, and one at least, has stopped."""
        return self.is_whole and bool(self.confirmed) and not self.failed and not self.silent


async def stop_all(
    session: zenoh.Session, site: str, user: str, expected: Iterable[Place], line: bytes
) -> Stopped:
    """Stop all grippers of a site, asking again until all have answered, or the time is up."""
    loop = asyncio.get_running_loop()
    begun_s = time.monotonic()
    key = f"{PREFIX}/{site}/*/stop/{user}"
    waits_for = set(expected)
    confirmed: dict[Place, float] = {}
    failed: dict[Place, str] = {}
    is_first = True
    while (left_s := begun_s + STOP_WITHIN_S - time.monotonic()) > 0.0:
        if not is_first and not waits_for - confirmed.keys():
            break
        is_first = False
        within_s = min(_ASK_AGAIN_S * 2, left_s)
        answers = await ask(session, key, line, None, loop, within_s=within_s, is_stop=True)
        for place, problem in _problems_in(answers).items():
            if place in confirmed:
                continue
            if problem is None:
                confirmed[place] = time.monotonic() - begun_s
                failed.pop(place, None)
            else:
                failed[place] = problem
        await asyncio.sleep(min(0.05, max(0.0, left_s)))
    silent = sorted(waits_for - confirmed.keys() - failed.keys())
    return Stopped(confirmed, failed, silent)


def _problems_in(answers: Iterable[Answered]) -> dict[Place, str | None]:
    """Return for each gripper why it did not stop, None if it did; of two gateways, both must."""
    problems: dict[Place, str | None] = {}
    for answer in answers:
        place = place_in(answer.key)
        if place is not None:
            problems[place] = problems.get(place) or stop_problem(answer.payload)
    return problems
