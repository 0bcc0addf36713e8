"""A page whose user may only look and stop, by the daemon, offers nothing else, and says why."""

import os
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, expect

from tests.process.daemon_process import SIMULATED, DaemonProcess, daemon_for_all
from tests.process.web.on_page import button, opened, part
from tests.process.web.page_process import Page, page

CHANNEL = f"rights-{os.getpid()}"
NOBODY = 65_534

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")


@pytest.fixture(scope="module")
def daemon() -> Iterator[DaemonProcess]:
    config = f"{SIMULATED}observers = [{NOBODY}]\n"
    with daemon_for_all(CHANNEL, config) as running:
        yield running


@pytest.fixture(scope="module")
def observing(daemon: DaemonProcess) -> Iterator[Page]:
    arguments = ("--socket", str(daemon.socket_path), "--operate")
    with page(*arguments, uid=NOBODY, channels=(CHANNEL,)) as running:
        yield running


def test_an_observers_page_says_from_the_start_that_it_looks_and_stops(
    window: BrowserContext, observing: Page, daemon: DaemonProcess
) -> None:
    tab = opened(window, observing)
    expect(part(tab, "read-only")).to_have_text(
        "This page looks and stops: for the daemon, the user nobody, who runs litegripd-web, is"
        " an observer. “[access]” in the daemon's configuration decides that (docs/access.md)."
    )
    with daemon.connect() as client:
        client.result("lease.acquire")
        expect(tab.locator(".facts")).to_contain_text("python")
        for name in ("Take control", "Take it over", "Enable", "Put in"):
            expect(button(tab, name)).to_be_hidden()
    tab.keyboard.press("o")
    expect(part(tab, "outcome")).to_have_text("open: this page looks and stops only")


def test_an_observers_page_clears_its_own_stop_and_no_other(
    window: BrowserContext, observing: Page, daemon: DaemonProcess
) -> None:
    tab = opened(window, observing)
    clear = button(tab, "Clear the stop")
    with daemon.connect() as client:
        tab.keyboard.press("Escape")
        client.until(lambda state: state["stop"] is not None)
        expect(part(tab, "stopped")).to_have_text(re.compile("until it is cleared[.]$"))
        clear.click()
        client.until(lambda state: state["stop"] is None)
        client.result("stop", level="hold", why="lunch")
        expect(part(tab, "stopped")).to_contain_text("until it is cleared ('litegripctl clear').")
        expect(clear).to_be_hidden()
        client.result("stop.clear")
