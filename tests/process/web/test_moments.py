"""The page in the moments that matter: what it says agrees with itself, and stays in its place."""

import contextlib
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client, DaemonProcess
from tests.process.web.on_page import (
    OBJECT_MM,
    button,
    called_well,
    enable,
    fact,
    grasp,
    opened,
    part,
    places,
    take_control,
    wait_until_it_fits,
)
from tests.process.web.page_process import Page, mortal

STOPPED = "Stopped. Nothing moves until it is cleared."


@contextmanager
def frozen(process: "subprocess.Popen[Any]") -> Iterator[None]:
    """Freeze a process, and let it go on in the end."""
    process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        process.send_signal(signal.SIGCONT)


def test_nothing_says_stopped_once_the_stop_is_cleared(operated: Tab, client: Client) -> None:
    notice, outcome = operated.locator("#notice"), part(operated, "outcome")
    take_control(operated)
    for clear in (button(operated, "Clear the stop").click, lambda: client.result("stop.clear")):
        operated.keyboard.press("Escape")
        expect(notice).to_have_text(STOPPED)
        expect(part(operated, "mode")).to_have_text("STOPPED")
        clear()
        expect(part(operated, "mode")).to_have_text("disabled")
        expect(notice).to_have_text("")
        expect(outcome).not_to_contain_text("Stopped")


COLOR = "(node, part) => getComputedStyle(node, part).color"
COLORS = "(node) => ['::before', null].map((part) => getComputedStyle(node, part).color)"
"""Of mark and text at once: the head may turn red between two looks."""


def test_what_is_held_is_last_known_once_nothing_measures_it(
    window: BrowserContext, tmp_path: Path
) -> None:
    """Whoever does not measure knows nothing of the object: not that it is held, nor that not."""
    with contextlib.ExitStack() as stack:
        _, daemon, running = stack.enter_context(mortal(tmp_path, "held"))
        client = stack.enter_context(daemon.connect())
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        grasp(client)
        tab = opened(window, running)
        take_control(tab)
        tab.set_viewport_size({"width": 360, "height": 740})
        wait_until_it_fits(tab)
        held, slider, health = (part(tab, name) for name in ("held", "slider-text", "health-text"))
        expect(held).to_have_text("object detected")
        expect(slider).to_have_text("something is held")
        expect(health).to_have_text(called_well())
        lamp, jaws = part(tab, "lamp"), tab.locator(".jaws .jaw")
        drawing = tab.locator(".jaws")
        expect(drawing).to_have_css("user-select", "none")
        place = drawing.bounding_box()
        before = [jaw.get_attribute("x") for jaw in jaws.all()]
        well = lamp.evaluate(COLOR, "::before")
        green = held.evaluate(COLOR, "::before")
        with frozen(daemon.process):
            expect(held).to_have_text("object detected, last known")
            expect(slider).to_have_text("held, last known")
            expect(health).to_have_text(called_well(", last known"))
            mark, text = held.evaluate(COLORS)
            assert mark == text != green
            assert lamp.evaluate(COLOR, "::before") != well
            daemon.kill()
        expect(part(tab, "mode")).to_have_text("no daemon")
        assert [jaw.get_attribute("x") for jaw in jaws.all()] == before
        assert drawing.bounding_box() == place
        cut = "(node) => node.scrollWidth > node.clientWidth"
        assert not part(tab, "mode").evaluate(cut)
        expect(tab.locator(".jaws .jaw.unknown")).to_have_count(2)
        expect(tab.locator(".body")).to_have_css("filter", "grayscale(1)")
        expect(fact(tab, "Opening")).to_have_text(re.compile(r"^\d.* mm, last known$"))
        expect(held).to_have_text("object detected, last known")
        expect(slider).to_have_text("held, last known")
        mark, text = held.evaluate(COLORS)
        assert mark == text
    expect(part(tab, "mode")).to_have_text("no connection")
    expect(held).to_have_text("object detected, last known")


def test_a_late_page_says_of_a_motion_and_a_lease_that_they_may_be_over(
    operated: Tab, client: Client, simulated: DaemonProcess
) -> None:
    enable(operated, client)
    button(operated, "Open").click()
    outcome, lease = part(operated, "outcome"), fact(operated, "Lease")
    expect(outcome).to_contain_text("open: reached")
    expect(lease).to_contain_text("litegripd-web")
    part(operated, "pace").fill("5")
    button(operated, "Close").click()
    expect(part(operated, "mode")).to_contain_text("moving: close")
    expect(outcome).to_have_text("close …")
    with frozen(simulated.process):
        expect(outcome).to_have_text("close …, last known")
        expect(lease).to_have_text(re.compile(r"^litegripd-web \(pid \d+\), last known$"))
        operated.keyboard.press("o")
        expect(outcome).to_have_text("open: late: it would act later, unseen")
    expect(lease).not_to_contain_text("last known")
    expect(outcome).not_to_contain_text("last known")


SIZES = {"wide": (1400, 900), "phone": (360, 740)}


@pytest.mark.parametrize("size", SIZES)
def test_nothing_moves_when_an_object_is_lost_and_a_stop_comes(
    window: BrowserContext, operating: Page, client: Client, size: str
) -> None:
    grasp(client)
    tab = opened(window, operating)
    width, height = SIZES[size]
    tab.set_viewport_size({"width": width, "height": height})
    wait_until_it_fits(tab)
    expect(part(tab, "held")).to_have_text("object detected")
    expect(tab.locator(".jaws .tray")).to_be_visible()
    before = places(tab)
    client.result("sim.object")
    expect(part(tab, "lost")).to_be_visible()
    expect(part(tab, "lost-text")).to_have_text(re.compile("^At .*; the object is lost: "))
    assert places(tab) == before
    tab.keyboard.press("Escape")
    expect(part(tab, "mode")).to_have_text("STOPPED")
    expect(tab.locator("#notice")).to_have_text(STOPPED)
    expect(part(tab, "lost")).to_be_visible()
    assert places(tab) == before
    client.result("stop.clear")
    expect(part(tab, "mode")).not_to_have_text("STOPPED")
    assert places(tab) == before
    for name in ("lost", "mode"):
        cut = part(tab, name).evaluate("(node) => node.scrollWidth > node.clientWidth")
        assert not cut, name


@pytest.mark.parametrize(
    ("width", "height", "names"),
    [(390, 844, ["Open", "Close"]), (1400, 900, ["Open", "Grasp", "Teach", "Replay"])],
)
def test_jaws_stop_and_the_buttons_that_move_are_in_sight_together(
    operated: Tab, width: int, height: int, names: list[str]
) -> None:
    operated.set_viewport_size({"width": width, "height": height})
    wait_until_it_fits(operated)
    expect(operated.locator(".jaws .tray")).to_be_visible()
    expect(operated.get_by_text("drag it in")).to_be_visible()
    for node in (operated.locator(".jaws"), operated.locator("#stop")):
        expect(node).to_be_in_viewport(ratio=1)
    for name in names:
        expect(button(operated, name)).to_be_in_viewport(ratio=1)


KEEP_WHEN_IT_IS_LATE_NO_MORE = """
() => {
  const mode = document.querySelector("[data-is=mode]");
  new MutationObserver(() => mode.textContent !== "late" && (window.inTimeMs ??= performance.now()))
    .observe(mode, {childList: true, characterData: true, subtree: true});
}
"""


def test_states_come_in_time_for_a_while_before_they_are_late_no_more(
    shown: Tab, simulated: DaemonProcess, client: Client
) -> None:
    """Over a link that delays them by about a second the word would come and go."""
    with frozen(simulated.process):
        expect(part(shown, "mode")).to_have_text("late")
        shown.evaluate(KEEP_WHEN_IT_IS_LATE_NO_MORE)
        wakes_ms = shown.evaluate("performance.now()")
    expect(part(shown, "mode")).to_have_text("disabled")
    assert shown.evaluate("window.inTimeMs") - wakes_ms > 700


def test_the_ruler_says_the_opening_also_while_it_is_late(
    operated: Tab, simulated: DaemonProcess, client: Client
) -> None:
    opening_mm = client.result("state.get")["opening_mm"]
    said = operated.locator(".jaws .said")
    expect(said).to_have_text(f"{opening_mm:.1f} mm")
    expect(said).to_have_class("said")
    with frozen(simulated.process):
        expect(part(operated, "mode")).to_have_text("late")
        expect(said).to_have_class("said unknown")
        expect(said).to_have_text(f"{opening_mm:.1f} mm")
    expect(said).to_have_class("said")


REASON = (
    "the reason that somebody gave, which goes on and on for a while, and tells who may clear it"
)


@pytest.mark.parametrize("size", SIZES)
def test_a_long_reason_hides_nothing_and_all_of_it_can_be_read(
    operated: Tab, client: Client, size: str
) -> None:
    width, height = SIZES[size]
    operated.set_viewport_size({"width": width, "height": height})
    wait_until_it_fits(operated)
    client.result("stop", level="hold", why=f"{REASON}. {REASON}. {REASON}"[:256])
    text = part(operated, "said")
    expect(text).to_contain_text(REASON)
    expect(text).to_have_css("-webkit-line-clamp", "2" if size == "wide" else "3")  # with "…"
    is_cut = "(node) => node.scrollHeight > node.clientHeight"
    assert text.evaluate(is_cut)
    # What matters stands before the reason.
    expect(text).to_have_text(
        re.compile(r"^\s*Stopped \(hold\) at \S+ by .*\. Nothing moves until")
    )
    text.click()
    assert not text.evaluate(is_cut)
    button(operated, "Clear the stop").click()
    expect(part(operated, "stopped")).to_be_hidden()
    client.result("stop", level="hold", why="short")
    expect(text).to_contain_text("Why: short.")
    expect(text).not_to_have_class(re.compile("whole"))


def test_no_outcome_stands_beside_what_contradicts_it(
    operated: Tab, simulated: DaemonProcess, client: Client
) -> None:
    outcome, mode = part(operated, "outcome"), part(operated, "mode")
    client.result("sim.object", width_mm=OBJECT_MM)
    enable(operated, client)
    button(operated, "Grasp").click()
    measured = r"grasp: object held, \d\d\.\d mm, force set to 10\.0 N"  # but for the force
    expect(outcome).to_have_text(re.compile(rf"^{measured}$"))
    events = part(operated, "events")
    expect(events).to_contain_text(re.compile(rf"job \d+, {measured}, \d+\.\d s"))
    client.result("sim.object")
    expect(part(operated, "lost")).to_be_visible()
    expect(outcome).to_have_text("")
    for told in ("clear the stop: done", "enable: done"):
        client.result("stop", level="disable")
        expect(mode).to_have_text("STOPPED")
        expect(outcome).to_have_text("")
        button(operated, "Clear the stop").click()
        expect(outcome).to_have_text("clear the stop: done")
        expect(mode).not_to_have_text("STOPPED")
        if told == "enable: done":
            button(operated, "Enable").click()
            expect(outcome).to_have_text(told)
    client.result("lease.take", why="my turn")
    expect(outcome).to_have_text("python took control: my turn")
    told_s = client.result("state.get")["monotonic_s"]
    client.until(lambda state: bool(state["monotonic_s"] > told_s + 1))  # by the page's clock, too
    client.result("motion.close")
    expect(outcome).to_have_text("")
    button(operated, "Take it over").click()
    expect(outcome).to_contain_text("You have control")
    with frozen(simulated.process):  # for longer, maybe, than a lease lives
        expect(mode).to_have_text("late")
        expect(outcome).to_have_text("")
