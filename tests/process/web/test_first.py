"""What the bar says first: what is so now, and asks for an act. Nothing moves on a late page."""

import contextlib
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.web.on_page import SEEN, button, enable, grasp, opened, part, take_control
from tests.process.web.page_process import Page, mortal

ACTS = {
    "LATE": "LATE: Keep hands off: what is shown is old. Press STOP; if that is not confirmed,"
    " cut the motor's power.",
    "OBJECT LOST": "OBJECT LOST: “Open”, then “Grasp” again",
    "NO DAEMON": "NO DAEMON: Start the daemon ('litegripctl doctor' says what is wrong)",
    "NO CONNECTION": "NO CONNECTION: Start litegripd-web again: with the same secret",
}
SCREENS = {"wide": (1400, 900), "phone": (390, 844)}
RED = "rgb(179, 20, 30)"


@pytest.fixture(params=SCREENS)
def window(chromium: Browser, request: pytest.FixtureRequest) -> Iterator[BrowserContext]:
    width, height = SCREENS[request.param]
    window = chromium.new_context(viewport={"width": width, "height": height})
    window.set_default_timeout(DEADLINE_S * 1000)
    yield window
    window.close()


@contextlib.contextmanager
def frozen(daemon: DaemonProcess) -> Iterator[None]:
    """Let a daemon stand still."""
    daemon.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        daemon.process.send_signal(signal.SIGCONT)


def row(tab: Tab) -> Locator:
    """Find the line of the bar that is seen without a click."""
    return tab.locator("#toasts li").filter(visible=True)


def expect_act(tab: Tab, name: str) -> None:
    """Expect that the bar says what to do about a trouble, in sight."""
    expect(row(tab)).to_have_count(1)
    expect(row(tab)).to_contain_text(ACTS[name])
    expect(row(tab)).to_have_css("background-color", RED)
    assert row(tab).locator("span").evaluate(SEEN, ACTS[name])


def test_what_to_do_is_said_first_about_what_is_so_now(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "first") as (_, daemon, running):
        tab = opened(window, running)
        head = tab.locator(".head")
        with daemon.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
            grasp(client)
            expect(part(tab, "held")).to_have_text("object detected")
            bar = tab.locator("header").bounding_box()
            with frozen(daemon):
                expect_act(tab, "LATE")
                expect(head).to_have_css("background-color", RED)
                expect(row(tab).get_by_role("button", name="Read")).to_have_count(0)
            expect(row(tab)).not_to_contain_text([ACTS["LATE"]])
            client.despite_silence("motion.hold")
            client.despite_silence("motor.enable")
            grasp(client)
            client.result("sim.object")
            expect_act(tab, "OBJECT LOST")
            row(tab).get_by_role("button", name="Read").click()
            expect(part(tab, "lost")).to_have_text("OBJECT LOST")  # the head says it until a motion
            expect(row(tab)).to_have_count(0)
            grasp(client)
            client.result("sim.fault", name="overload")
            expect(row(tab)).to_contain_text("LET GO: remove what loads the jaws, then enable")
            with frozen(daemon):
                expect_act(tab, "LATE")
            expect(row(tab)).to_contain_text("LET GO: ")
            assert tab.locator("header").bounding_box() == bar
        daemon.kill()
        expect_act(tab, "NO DAEMON")
        let_go = tab.locator("#toasts li", has_text="LET GO")
        expect(let_go).to_have_text(re.compile(r"was let go by a fault \(overload\)Read$"))
    expect_act(tab, "NO CONNECTION")


KEEP_WHAT_THE_BAR_SAYS = """
() => {
  window.bar = [];
  const text = () => {
    const lines = [...document.querySelectorAll("#toasts li")];
    const seen = lines.filter((one) => one.checkVisibility());
    return [document.querySelector("#alarm"), ...seen].map((node) => node.textContent).join("; ");
  };
  new MutationObserver(() => window.bar.push(text()))
    .observe(document.querySelector("header"), {childList: true, subtree: true});
}
"""


def test_the_word_late_and_what_to_do_about_it_come_together(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "word") as (_, daemon, running):
        tab = opened(window, running)
        with daemon.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        tab.evaluate(KEEP_WHAT_THE_BAR_SAYS)
        with frozen(daemon):
            expect_act(tab, "LATE")
        expect(tab.locator("#alarm")).not_to_contain_text("LATE")
    bar = tab.evaluate("window.bar")
    late = [said for said in bar if "LATE" in said]
    assert late
    assert [said for said in late if not said.startswith(f"LATE; {ACTS['LATE']}")] == []


@pytest.mark.parametrize("is_moving", [True, False])
def test_a_daemon_that_is_gone_while_the_jaws_move_is_as_loud_as_a_late_one(
    window: BrowserContext, tmp_path: Path, is_moving: bool
) -> None:
    with mortal(tmp_path, "loud") as (run, daemon, running):
        tab = opened(window, running)
        head = tab.locator(".head")
        with daemon.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
            if is_moving:
                client.despite_silence("motor.enable")
                client.despite_silence("motion.close", speed_mm_s=5, wait=False)
                expect(part(tab, "mode")).to_contain_text("moving")
            daemon.kill()
        expect(part(tab, "mode")).to_have_text("no daemon")
        color = head.evaluate("(node) => getComputedStyle(node).backgroundColor")
        assert (color == RED) is is_moving
        run()
        expect(part(tab, "mode")).not_to_have_text("no daemon")
        expect(head).not_to_have_css("background-color", RED)


def test_what_nobody_can_do_without_a_daemon_is_not_said_then(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "advice") as (run, daemon, running):
        tab = opened(window, running)
        with daemon.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
            enable(tab, client)
            button(tab, "Grasp").click()
            expect(row(tab)).to_contain_text("grasp: no object")
        daemon.kill()
        expect_act(tab, "NO DAEMON")
        grasped = tab.locator("#toasts li", has_text="grasp: no object")
        expect(grasped).to_have_count(1)
        row(tab).locator("span").click()
        expect(grasped).to_be_hidden()
        row(tab).locator("span").click()
        tab.keyboard.press("Escape")
        expect(tab.locator("#notice")).to_contain_text("STOP did not reach")
        second = run()
        missed = tab.locator("#toasts li", has_text="NOT STOPPED: press STOP again")
        expect(missed).to_be_visible()
        expect(grasped).to_have_count(1)
        expect(tab.locator("#toasts")).to_have_attribute("data-more", re.compile(r"\+\d"))
        second.kill()
        expect_act(tab, "NO DAEMON")
        expect(missed).to_be_hidden()
        run()
        expect(missed).to_be_visible()


def test_that_control_was_taken_is_said_beside_a_loss_and_a_present_fault_before_it(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    client.result("lease.take", why="my turn")
    alarm = tab.locator("#alarm")
    expect(alarm).to_have_text("CONTROL LOST")
    grasp(client)
    client.result("sim.object")
    expect_act(tab, "OBJECT LOST")
    expect(alarm).to_have_text("OBJECT LOST, CONTROL LOST")
    client.result("sim.fault", name="overload")
    expect(row(tab)).to_contain_text("OBJECT LOST: remove what loads the jaws, then enable again")
    client.result("sim.fault", name="none")
    client.despite_silence("motor.clear_fault")
    client.despite_silence("motor.enable")
    expect_act(tab, "OBJECT LOST")
    client.despite_silence("motion.open")
    expect(row(tab)).to_contain_text("python took control: my turn")
    button(tab, "Read").click()
    expect(alarm).to_be_hidden()


def test_nothing_moves_from_a_late_page_and_what_ends_a_motion_does(
    window: BrowserContext, operating: Page, simulated: DaemonProcess, client: Client
) -> None:
    tab = opened(window, operating)
    enable(tab, client)
    expect(part(tab, "slider")).to_be_enabled()
    before_mm = client.result("state.get")["opening_mm"]
    jobs = client.result("job.list")["jobs"]
    why = "late: it would act later, unseen"
    with frozen(simulated):
        expect(part(tab, "mode")).to_have_text("late")
        for name in ("Enable", "Open", "Close", "Grasp", "Set force", "Zero …", "Teach", "Replay"):
            expect(button(tab, name)).to_be_disabled()
        expect(part(tab, "slider")).to_be_disabled()
        for name in ("Hold", "Let go", "Disable"):
            expect(button(tab, name)).to_be_enabled()
        expect(tab.locator("#stop")).to_be_enabled()
        expect(part(tab, "to-use")).to_have_text(why)
        for key, name in {"o": "open", "c": "close", "g": "grasp", "e": "enable"}.items():
            tab.keyboard.press(key)
            expect(part(tab, "outcome")).to_have_text(f"{name}: {why}")
    expect(part(tab, "mode")).not_to_have_text("late")
    assert client.result("job.list")["jobs"] == jobs
    assert abs(client.result("state.get")["opening_mm"] - before_mm) < 1
