"""What waits for one browser: answers in their order, and of the states the newest."""

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from litegrip_web.outbox import MOST_BYTES, QUICK_S, SLOW_S, STATES_ON_THEIR_WAY, Outbox


async def is_waiting(task: Coroutine[Any, Any, str | None]) -> bool:
    """Return True if a call waits once everything else has had its turn."""
    pending = asyncio.ensure_future(task)
    for _ in range(3):
        await asyncio.sleep(0)
    waits = not pending.done()
    pending.cancel()
    return waits


def test_answers_keep_their_order_and_come_before_states() -> None:
    async def play() -> None:
        outbox = Outbox()
        outbox.put_state("state")
        for text in ("a", "b"):
            await outbox.put(text)
        assert [await outbox.take() for _ in range(3)] == ["a", "b", "state"]

    asyncio.run(play())


def test_only_the_newest_state_waits() -> None:
    async def play() -> None:
        outbox = Outbox()
        for number in range(100):
            outbox.put_state(f"state {number}")
        assert await outbox.take() == "state 99"
        assert await is_waiting(outbox.take())

    asyncio.run(play())


def test_a_browser_that_shows_nothing_gets_few_states_and_then_the_newest() -> None:
    async def play() -> None:
        outbox = Outbox()
        for number in range(STATES_ON_THEIR_WAY):
            outbox.put_state(f"state {number}")
            assert await outbox.take() == f"state {number}"
        for number in range(1000, 1100):
            outbox.put_state(f"state {number}")
        assert await is_waiting(outbox.take())
        await outbox.put("an answer")
        assert await outbox.take() == "an answer"
        outbox.see()
        assert await outbox.take() == "state 1099"

    asyncio.run(play())


def test_where_states_take_long_one_is_on_its_way_until_they_are_quick() -> None:
    async def play() -> None:
        now_s = 0.0
        outbox = Outbox(lambda: now_s)

        async def sent() -> int:
            """Count what is sent until the browser has to show something."""
            count = 0
            outbox.put_state("state")
            while not await is_waiting(outbox.take()):
                count += 1
                outbox.put_state("state")
            return count

        def see_all_after(took_s: float) -> None:
            nonlocal now_s
            now_s += took_s
            for _ in range(STATES_ON_THEIR_WAY):
                outbox.see()

        assert await sent() == STATES_ON_THEIR_WAY
        see_all_after(SLOW_S + 0.01)
        assert await sent() == 1
        see_all_after((SLOW_S + QUICK_S) / 2)
        assert await sent() == 1
        on_their_way = 1
        for most in range(2, STATES_ON_THEIR_WAY + 1):
            outbox.see()
            on_their_way += await sent() - 1
            assert on_their_way == most

    asyncio.run(play())


def test_after_the_daemon_has_gone_nothing_of_it_is_on_its_way() -> None:
    async def play() -> None:
        outbox = Outbox()
        for number in range(STATES_ON_THEIR_WAY):
            outbox.put_state(f"state {number}")
            await outbox.take()
        outbox.put_state("old")
        outbox.forget_states()
        assert await is_waiting(outbox.take())
        outbox.put_state("new")
        assert await outbox.take() == "new"

    asyncio.run(play())


@pytest.mark.parametrize("seen", [0, 1])
def test_the_daemon_is_not_read_while_a_browser_takes_nothing(seen: int) -> None:
    async def play() -> None:
        outbox = Outbox()
        await outbox.put("x" * (MOST_BYTES + 1))
        pending = asyncio.ensure_future(outbox.put("behind it"))
        await asyncio.sleep(0)
        assert not pending.done()
        for _ in range(seen):
            outbox.see()
            await asyncio.sleep(0)
        assert not pending.done()
        await outbox.take()
        await pending
        assert await outbox.take() == "behind it"

    asyncio.run(play())
