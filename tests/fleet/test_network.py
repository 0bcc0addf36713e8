"""What comes from the network is taken on a thread of its own, whatever becomes of it."""

import asyncio
import queue
import threading
from typing import Any

import pytest
import zenoh

from litegrip_fleet.wire.network import all_in_order, hand_over


class Source:
    """A source that gives what it is filled with, and is then undeclared."""

    def __init__(self, *items: object) -> None:
        self._items: queue.SimpleQueue[object] = queue.SimpleQueue()
        for item in items:
            self._items.put(item)
        self.handler = self
        self.has_ended = threading.Event()

    def recv(self) -> object:
        if self._items.empty():
            self.has_ended.set()
            raise zenoh.ZError("undeclared")
        return self._items.get()


def test_what_cannot_be_taken_is_logged_and_the_next_is_taken(
    caplog: pytest.LogCaptureFixture,
) -> None:
    taken: list[object] = []

    def take(item: Any) -> None:
        taken.append(10 / item)

    source = Source(5, 0, 2)
    hand_over(source, take, "stop lab.left")  # type: ignore[arg-type]
    assert source.has_ended.wait(10.0)
    assert taken == [2.0, 5.0]
    assert "stop lab.left: what came was not taken" in caplog.text
    assert "ZeroDivisionError" in caplog.text


def test_the_event_loop_takes_all_in_order_and_what_comes_after_its_end_harms_nobody() -> None:
    taken: list[int] = []

    async def scene() -> None:
        loop = asyncio.get_running_loop()
        hand_over_one = all_in_order(loop, taken.append)
        sending = [asyncio.to_thread(hand_over_one, number) for number in range(3)]
        for one in sending:
            await one
        late.append(hand_over_one)

    late: list[object] = []
    asyncio.run(scene())
    assert taken == [0, 1, 2]
    (hand_over_one,) = late
    assert callable(hand_over_one)
    hand_over_one(3)
    assert taken == [0, 1, 2]
