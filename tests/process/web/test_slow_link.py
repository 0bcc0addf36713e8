"""The page over a slow link: what it shows is true now or marked, and a stop is never a guess."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, expect

from tests.process.daemon_process import DEADLINE_S, Client
from tests.process.web.on_page import opened, part
from tests.process.web.page_process import Page
from tests.process.web.slow_link import SlowLink, slow_link

SLOW_BYTES_PER_S = 5_000
LATE_S, LOOKS_EVERY_S = 1.0, 0.3
SHOWN = """
() => [
  document.querySelector("[data-is=mode]").textContent,
  parseFloat(document.querySelector(".jaws .said").textContent),
]
"""
KEEP_WHAT_IS_SAID = """
() => {
  window.said = [];
  const notice = document.getElementById("notice");
  addEventListener("keydown", () => window.said.push([performance.now(), "pressed"]), true);
  new MutationObserver(() => window.said.push([performance.now(), notice.textContent]))
    .observe(notice, {childList: true, characterData: true, subtree: true});
}
"""


@pytest.fixture
def link() -> Iterator[SlowLink]:
    with slow_link() as running:
        yield running


@pytest.fixture
def window(chromium: Browser, link: SlowLink) -> Iterator[BrowserContext]:
    proxy = {"server": f"socks5://127.0.0.1:{link.port}"}
    window = chromium.new_context(proxy=proxy)  # type: ignore[arg-type]
    window.set_default_timeout(DEADLINE_S * 1000)
    yield window
    window.close()


def test_what_is_shown_over_a_slow_link_is_newer_than_a_second_or_late(
    window: BrowserContext, link: SlowLink, operating: Page, client: Client
) -> None:
    client.despite_silence("motor.enable")
    client.despite_silence("motion.open")
    tab = opened(window, operating)
    link.bytes_per_s = SLOW_BYTES_PER_S
    truth: list[tuple[float, float]] = []

    def look() -> dict[str, Any]:
        state = client.result("state.get")
        truth.append((state["monotonic_s"], state["opening_mm"]))
        return state

    look()
    client.send("motion.move", opening_mm=5.0, speed_mm_s=10.0)
    judged = 0
    while (before := look())["opening_mm"] > 10.0:
        mode, opening_mm = tab.evaluate(SHOWN)
        look()
        if mode == "late":
            continue
        recent = [mm for at_s, mm in truth if at_s > before["monotonic_s"] - LATE_S - LOOKS_EVERY_S]
        assert min(recent) - 0.5 <= opening_mm <= max(recent) + 0.5
        judged += 1
    assert judged > 0


def test_a_stop_over_a_slow_link_is_answered_or_not_confirmed_and_comes(
    window: BrowserContext, link: SlowLink, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    tab.evaluate(KEEP_WHAT_IS_SAID)
    link.bytes_per_s = SLOW_BYTES_PER_S
    began_s = client.result("state.get")["monotonic_s"]
    client.until(lambda state: bool(state["monotonic_s"] > began_s + 3))  # its ways are full
    tab.keyboard.press("Escape")
    client.until(lambda state: state["stop"] is not None)
    expect(tab.locator("#notice")).to_have_text(re.compile("^Stopped"))
    expect(part(tab, "mode")).to_have_text(re.compile("STOPPED|late"))
    said = tab.evaluate("window.said")
    pressed_ms = next(ms for ms, text in said if text == "pressed")
    (sent_ms, sent), (second_ms, second) = [line for line in said if line[1] != "pressed"][:2]
    assert sent == "STOP sent …"
    assert sent_ms - pressed_ms < 100
    assert re.match("Stopped|STOP not confirmed by .* Cut", second)
    assert second_ms - pressed_ms < 700
