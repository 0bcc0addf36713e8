import asyncio

import pytest

from litegrip_client.threads.blocking import complete


async def double(number: int) -> int:
    return 2 * number


async def quadruple(number: int) -> int:
    return await double(await double(number))


async def fail() -> int:
    raise ZeroDivisionError


def test_what_does_not_suspend_is_run_to_its_end() -> None:
    assert complete(quadruple(3)) == 12
    with pytest.raises(ZeroDivisionError):
        complete(fail())


def test_what_suspends_is_refused() -> None:
    with pytest.raises(RuntimeError, match="wants an event loop"):
        complete(asyncio.sleep(0))
