"""How a site's grippers are: one whose answer is dropped, in a flood, is asked again."""

import asyncio
import json
from typing import Any

import pytest

from litegrip_fleet.wire import site
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import Answered

LEFT, RIGHT = Place("lab", "left"), Place("lab", "right")
FACTS = json.dumps({"version": "1", "verdict": "ok", "mode": "idle"}).encode()
SESSION: Any = object()


def looked(monkeypatch: pytest.MonkeyPatch, *turns: tuple[Place, ...]) -> dict[Place, str | None]:
    """Return what is found wrong with both, which answer in these turns; then nobody does."""
    left = list(turns)

    async def ask(*_arguments: object, **_options: object) -> list[Answered]:
        answering = left.pop(0) if left else ()
        return [Answered(place.about, FACTS, None, 0.0) for place in answering]

    monkeypatch.setattr(site, "ask", ask)
    monkeypatch.setattr(site, "alive", lambda *_arguments: [LEFT, RIGHT])
    monkeypatch.setattr(site, "LOOK_WITHIN_S", 0.2)
    found = asyncio.run(site.look(SESSION))
    return {about.place: about.facts.get("error") for about in found}


def test_who_has_not_answered_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    assert looked(monkeypatch, (LEFT,), (), (RIGHT,)) == {LEFT: None, RIGHT: None}


def test_who_never_answers_is_said_to_be_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    found = looked(monkeypatch, (LEFT,), (LEFT,))
    assert found == {LEFT: None, RIGHT: "it is there, and does not answer"}


def test_who_has_answered_is_not_taken_for_two_gateways(monkeypatch: pytest.MonkeyPatch) -> None:
    assert looked(monkeypatch, (LEFT,), (LEFT, RIGHT)) == {LEFT: None, RIGHT: None}


def test_two_gateways_are_said_to_be_so(monkeypatch: pytest.MonkeyPatch) -> None:
    found = looked(monkeypatch, (LEFT, LEFT, RIGHT))
    assert found == {LEFT: site.TWO_GATEWAYS, RIGHT: None}
