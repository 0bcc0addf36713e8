"""A real browser, where the machine has one."""

import os
import shutil
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, sync_playwright

from tests.process.daemon_process import DEADLINE_S

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium: apt install chromium")
    with sync_playwright() as playwright:
        sandbox = ["--no-sandbox"] if os.getuid() == 0 else []
        names = "--host-resolver-rules=MAP robot.lab 127.0.0.1"
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=[names, *sandbox])
        yield browser
        browser.close()


@pytest.fixture
def window(chromium: Browser) -> Iterator[BrowserContext]:
    """A window whose pages must not complain: no error, nothing that the policy forbids."""
    window = chromium.new_context(viewport={"width": 1280, "height": 900})
    window.set_default_timeout(DEADLINE_S * 1000)
    complaints: list[str] = []
    window.on("console", lambda told: complaints.append(f"{told.type}: {told.text}"))
    window.on("weberror", lambda told: complaints.append(str(told.error)))
    yield window
    window.close()
    known = (
        *("Failed to load resource", "WebSocket connection"),  # while nobody answers
        "Opener-Policy header has been ignored",  # under a name that is not secure
    )
    assert [text for text in complaints if not any(part in text for part in known)] == []
