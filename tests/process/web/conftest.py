"""A real browser, where the machine has one, and a page of a simulated gripper in it."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, sync_playwright
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.web.on_page import opened
from tests.process.web.page_process import Page, page

# The first one draws no window around a page, which would need processes of its own: it opens a
# page in a quarter of the time.
PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser")
CHROMIUM = next(filter(None, map(shutil.which, PROGRAMS)), None)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium: apt install chromium-headless-shell")
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


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where the pages of this module look for the socket of a test's daemon."""
    return tmp_path_factory.mktemp("place") / "rpc.sock"


@pytest.fixture(scope="module")
def looking(place: Path) -> Iterator[Page]:
    with page("--socket", str(place)) as running:
        yield running


@pytest.fixture(scope="module")
def operating(place: Path) -> Iterator[Page]:
    with page("--socket", str(place), "--operate") as running:
        yield running


@pytest.fixture
def client(simulated: DaemonProcess, place: Path) -> Iterator[Client]:
    for ending in (".sock", ".stop.sock"):
        link = place.with_suffix(ending)
        link.unlink(missing_ok=True)
        link.symlink_to(simulated.socket_path.with_suffix(ending))
    with simulated.connect() as connected:
        connected.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        yield connected


@pytest.fixture
def shown(window: BrowserContext, looking: Page, client: Client) -> Tab:
    return opened(window, looking)


@pytest.fixture
def operated(window: BrowserContext, operating: Page, client: Client) -> Tab:
    return opened(window, operating)
