"""What repeats in the log of the page's process is counted, as the daemon does."""

import asyncio
import logging
from pathlib import Path

import pytest

from litegrip_client.values import repeats
from litegrip_web import main as web
from litegrip_web.options import EXIT_OK
from litegrip_web.server import Settings


def test_a_line_that_repeats_is_counted_and_reported_while_the_page_is_served(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now_s = 0.0

    async def serve(_settings: Settings, _token_file: Path | None) -> None:
        nonlocal now_s
        (handler,) = logging.getLogger().handlers
        monkeypatch.setattr(handler, "_clock", lambda: now_s)
        for number in range(1000):
            logging.getLogger("litegrip_client").warning("no daemon at can%d", number)
        polling = asyncio.create_task(repeats.poll_handlers())
        await asyncio.sleep(0)
        now_s = 11.0
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        polling.cancel()

    monkeypatch.setattr(repeats, "_LOOK_EVERY_S", 0.0)
    monkeypatch.setattr(web, "_serve", serve)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    assert web.main(["can0"]) == EXIT_OK
    assert capsys.readouterr().err.splitlines() == [
        "litegripd-web: no daemon at can0",
        "litegripd-web: no daemon at can999 (again: 999 times in 11 s, the last 11 s ago)",
    ]
