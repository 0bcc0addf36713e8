"""A stop that two gateways of one gripper answer: it is confirmed when both have confirmed it."""

import asyncio
from typing import Any

import pytest

from litegrip_fleet.near import portal
from litegrip_fleet.wire import site
from litegrip_fleet.wire.keys import Place
from litegrip_fleet.wire.network import Answered

LEFT = Place("lab", "left")
DONE = b'{"jsonrpc":"2.0","id":1,"result":{"level":"hold","generation":1}}\n'
NOT_DONE = b'{"jsonrpc":"2.0","id":null,"error":{"code":-32060,"message":"no daemon","data":{}}}\n'
SESSION: Any = object()


def answering(monkeypatch: pytest.MonkeyPatch, *payloads: bytes) -> None:
    """Answer each query with these."""

    async def ask(*_arguments: object, **_options: object) -> list[Answered]:
        return [Answered(LEFT.stop("op1"), payload, None, 0.0) for payload in payloads]

    monkeypatch.setattr(site, "ask", ask)
    monkeypatch.setattr(portal, "ask", ask)
    monkeypatch.setattr(site, "STOP_WITHIN_S", 0.1)


@pytest.mark.parametrize("payloads", [(DONE, NOT_DONE), (NOT_DONE, DONE)])
def test_one_that_has_not_stopped_is_not_confirmed(
    monkeypatch: pytest.MonkeyPatch, payloads: tuple[bytes, ...]
) -> None:
    answering(monkeypatch, *payloads)
    stopped = asyncio.run(site.stop_all(SESSION, "lab", "op1", [LEFT], b"hold\n"))
    assert (stopped.ok, stopped.confirmed, stopped.failed) == (False, {}, {LEFT: "no daemon"})
    assert asyncio.run(portal.stop_one(lambda: SESSION, LEFT, "op1", b"hold\n", b"")) == NOT_DONE


def test_both_confirm_it(monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, DONE, DONE)
    stopped = asyncio.run(site.stop_all(SESSION, "lab", "op1", [LEFT], b"hold\n"))
    assert (stopped.ok, list(stopped.confirmed), stopped.failed) == (True, [LEFT], {})
    assert asyncio.run(portal.stop_one(lambda: SESSION, LEFT, "op1", b"hold\n", b"")) == DONE
