"""STOP, and what goes wrong: in sight and at hand wherever the page is scrolled, on each screen."""

import contextlib
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, written
from tests.process.web.on_page import (
    SEEN,
    button,
    discard,
    enable,
    fact,
    grasp,
    opened,
    part,
    places,
    take_control,
    wait_until_it_fits,
)
from tests.process.web.page_process import Page, mortal, page

CUT = "Stop latched, but the motor does not answer: cut its power."
DOES_NOTHING = "STOP does nothing here: cut the motor's power. Then open the whole address again."
RED = "rgb(179, 20, 30)"
SCREENS = {"wide": (1400, 900), "phone": (390, 844), "phone, on its side": (844, 390)}


@pytest.fixture(params=SCREENS)
def window(chromium: Browser, request: pytest.FixtureRequest) -> Iterator[BrowserContext]:
    """A window of each kind; all can be touched."""
    width, height = SCREENS[request.param]
    window = chromium.new_context(viewport={"width": width, "height": height}, has_touch=True)
    window.set_default_timeout(DEADLINE_S * 1000)
    yield window
    window.close()


def middle(tab: Tab, selector: str) -> tuple[float, float]:
    """Return where somebody aims who sees it there: nothing is scrolled, nothing waited for."""
    box = tab.locator(selector).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


STOPS_IN_SIGHT = """
() => [...document.querySelectorAll("button")].filter(
  (node) => node.innerText.startsWith("STOP") && node.checkVisibility({visibilityProperty: true})
).length
"""


@pytest.mark.parametrize("how", ["mouse", "touch", "Enter", "Escape"])
def test_stop_works_behind_an_open_dialog(
    window: BrowserContext, operating: Page, client: Client, how: str
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    button(tab, "Zero …").click()
    expect(tab.get_by_role("dialog")).to_be_visible()
    assert tab.evaluate(STOPS_IN_SIGHT) == 1
    if how == "mouse":
        tab.mouse.click(*middle(tab, "#stop"))
    elif how == "touch":
        tab.touchscreen.tap(*middle(tab, "#stop"))
    else:
        if how == "Enter":
            tab.locator("#stop").focus()
        tab.keyboard.press(how)
    client.until(lambda state: state["stop"] is not None)
    expect(tab.locator("#notice")).to_contain_text("Stopped.")
    expect(tab.get_by_role("dialog")).to_be_visible()
    button(tab, "Cancel").click()
    expect(tab.get_by_role("dialog")).to_be_hidden()


def test_the_page_behind_a_dialog_is_out_of_reach(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    button(tab, "Zero …").click()
    expect(tab.get_by_role("dialog")).to_be_visible()
    tab.get_by_label("The jaws open").focus()
    for _ in range(12):  # more than what can be reached
        tab.keyboard.press("Tab")
        assert tab.evaluate("!document.activeElement.closest('main, footer')")
    place = tab.locator("[data-do=enable]").bounding_box()
    assert place is not None
    behind = "([x, y]) => document.elementFromPoint(x, y)?.closest('main') ?? null"
    assert tab.evaluate(behind, [place["x"] + 2, place["y"] + 2]) is None
    button(tab, "Cancel").click()
    button(tab, "Zero …").click()  # the page is within reach again
    expect(tab.get_by_role("dialog")).to_be_visible()


def to_the_controls(tab: Tab) -> None:
    """Scroll to where somebody grasps, who does not see what the jaws' head says."""
    expect(tab.locator(".jaws .tray")).to_be_visible()  # all is drawn
    button(tab, "Grasp").evaluate("(node) => node.scrollIntoView({block: 'end'})")
    tab.evaluate("scrollBy(0, 100)")


def at_the_controls(window: BrowserContext, operating: Page) -> Tab:
    """Return the page of one who has control, and has scrolled there."""
    tab = opened(window, operating)
    take_control(tab)
    to_the_controls(tab)
    return tab


def test_a_loss_and_a_fault_are_said_where_the_buttons_are(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    grasp(client)
    tab = at_the_controls(window, operating)
    alarm = tab.locator("#alarm")
    expect(alarm).to_be_hidden()
    before = places(tab)
    client.result("sim.object")
    expect(alarm).to_have_text("OBJECT LOST")
    expect(alarm).to_be_in_viewport(ratio=1)
    expect(alarm.locator("span").first).to_have_css("background-color", RED)
    tab.keyboard.press("Escape")
    expect(alarm).to_have_text("OBJECT LOST, STOPPED")
    clear = button(tab, "Clear the stop")
    expect(clear).to_be_in_viewport(ratio=1)
    assert places(tab) == before
    tab.mouse.click(*middle(tab, "[data-do=clear]"))  # without scrolling there
    expect(clear).to_be_hidden()
    client.result("sim.fault", name="overload")
    expect(alarm).to_have_text("OBJECT LOST, FAULT: overload")
    expect(alarm).to_be_in_viewport(ratio=1)
    assert alarm.evaluate("(node) => node.scrollHeight <= node.clientHeight")
    assert places(tab) == before


def test_a_motor_that_is_silent_is_said_and_what_needs_it_looks_so(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = at_the_controls(window, operating)
    before = places(tab)
    alarm, notice = tab.locator("#alarm"), tab.locator("#notice")
    client.result("sim.fault", name="silent")
    expect(alarm).to_have_text("MOTOR SILENT")
    expect(alarm).to_be_in_viewport(ratio=1)
    for name in ("Enable", "Open", "Hold", "Let go", "Grasp", "Set force", "Zero …", "Teach"):
        expect(button(tab, name)).to_be_disabled()
    expect(part(tab, "slider")).to_be_disabled()
    expect(button(tab, "Disable")).to_be_enabled()  # it may hear, and only not be heard
    tab.keyboard.press("Escape")
    expect(notice).to_have_text(CUT)
    expect(notice).to_have_css("background-color", RED)
    expect(notice).to_be_in_viewport(ratio=1)
    assert tab.evaluate(COVERED_BY_NOTICE) == []
    expect(part(tab, "stopped")).to_contain_text("the motor does not answer: cut its power.")
    expect(alarm).to_have_text("MOTOR SILENT, STOPPED")
    assert places(tab) == before
    client.result("sim.fault", name="none")
    expect(notice).to_have_text("Stopped. Nothing moves until it is cleared.")
    expect(alarm).to_have_text("STOPPED")
    client.result("sim.fault", name="silent")
    expect(notice).to_have_text(CUT)
    client.result("stop.clear")
    expect(notice).to_have_text("")


def test_a_stop_that_a_silent_motor_does_not_hear_of_is_said_on_each_page(
    window: BrowserContext, operating: Page, looking: Page, client: Client
) -> None:
    pressed, other = opened(window, operating), opened(window, looking)
    client.result("sim.fault", name="silent")
    expect(other.locator("#alarm")).to_have_text("MOTOR SILENT")
    expect(other.locator("#notice")).to_have_text("")
    pressed.keyboard.press("Escape")
    for tab in (pressed, other, opened(window, looking)):
        notice = tab.locator("#notice")
        expect(notice).to_have_text(CUT)
        expect(notice).to_have_css("background-color", RED)
        assert tab.evaluate(COVERED_BY_NOTICE) == []
    notice = other.locator("#notice")
    client.result("sim.fault", name="none")
    expect(notice).to_have_text("Stopped. Nothing moves until it is cleared.")
    client.result("sim.fault", name="silent")
    expect(notice).to_have_text(CUT)
    client.result("stop.clear")
    expect(notice).to_have_text("")


COVERED_BY_NOTICE = """
() => {
  const rect = (node) => node.getBoundingClientRect();
  const notice = document.querySelector("#notice");
  const [said, bar] = [rect(notice), rect(document.querySelector("header"))];
  const meets = (one) =>
    said.left < one.right && one.left < said.right
    && said.top < one.bottom && one.top < said.bottom;
  const wrong = [...document.querySelectorAll("header button, #alarm, #toasts li, .head, .head *")]
    .filter((node) => node.checkVisibility() && meets(rect(node)))
    .filter((node) => rect(node).top >= bar.bottom || node.closest("header"))
    .map((node) => node.outerHTML);
  if (said.bottom > bar.bottom) wrong.push("it hangs below the bar");
  if (notice.scrollHeight > notice.clientHeight) wrong.push("it is cut off");
  return wrong;
}
"""
"""What the red line covers, or lacks."""


@contextlib.contextmanager
def two_grippers(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[Tab, list[DaemonProcess], list[Client]]]:
    """Show two grippers on one page."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    sockets = tmp_path / "litegripd"
    sockets.mkdir()
    names = [f"left-{os.getpid()}", f"right-{os.getpid()}"]  # a channel has one daemon
    with contextlib.ExitStack() as stack:
        daemons, clients = [], []
        for name in names:
            folder = tmp_path / name
            folder.mkdir()
            for ending in (".sock", ".stop.sock"):
                (sockets / f"{name}{ending}").symlink_to(folder / f"rpc{ending}")
            path = str(folder / "rpc.sock")
            daemons.append(DaemonProcess(folder, name, *written(folder), "--socket", path))
            stack.callback(daemons[-1].kill)
            clients.append(stack.enter_context(daemons[-1].connect()))
        running = stack.enter_context(page("--operate", channels=tuple(names)))
        tab = window.new_page()
        tab.goto(running.told)
        for name in names:
            panel = tab.get_by_role("article", name=f"Gripper {name}")
            expect(panel.locator("[data-is=mode]")).to_have_text("disabled")
            expect(panel.locator(".jaws .tray")).to_be_visible()
        yield tab, daemons, clients


def test_of_two_grippers_each_question_names_the_one_that_it_is_about(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        for side, client in zip(("left", "right"), clients, strict=True):
            name = f"{side}-{os.getpid()}"
            panel = tab.get_by_role("article", name=f"Gripper {name}")
            panel.get_by_role("button", name="Take control").click()
            panel.get_by_role("button", name="Enable").click()
            client.until(lambda state: bool(state["enabled"]))
            panel.get_by_role("button", name="Zero …").click()
            expect(tab.get_by_role("dialog", name=f"{name}: Measure the travel")).to_be_visible()
            tab.get_by_role("button", name="Correct the scale only").click()
            expect(tab.get_by_role("dialog", name=f"{name}: The scale will use")).to_be_visible()
            tab.get_by_role("button", name="No, leave it").click()
            tab.get_by_role("button", name="Cancel").click()


NAMELESS = """
(name) => {
  const middle = (node) => {
    const {top, bottom} = node.getBoundingClientRect();
    return (top + bottom) / 2;
  };
  const bar = document.querySelector("header");
  const isSeen = (node) => bar.getBoundingClientRect().bottom <= node.getBoundingClientRect().top;
  const stage = document.querySelector(`[data-channel="${name}"] .stage`);
  const names = [...stage.querySelectorAll("b")].filter((node) => node.textContent === name);
  return [...stage.querySelectorAll("button, [type=range]")]
    .filter((node) => node.checkVisibility({visibilityProperty: true}))
    .filter((node) => {
      node.scrollIntoView({block: "center"});
      return !names.some((one) => isSeen(one) && Math.abs(middle(one) - middle(node)) < 100);
    })
    .map((node) => node.textContent || node.ariaLabel);
}
"""
"""What acts on a gripper and has not its name beside it, wherever the page is scrolled."""


def test_of_two_grippers_each_has_its_name_beside_what_acts_on_it(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, _clients):
        wait_until_it_fits(tab)
        for side in ("left", "right"):
            assert tab.evaluate(NAMELESS, f"{side}-{os.getpid()}") == []


def test_of_two_grippers_a_key_moves_only_the_one_that_was_used_last(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, daemons, clients):
        left, right = (
            tab.get_by_role("article", name=f"Gripper {side}-{os.getpid()}")
            for side in ("left", "right")
        )
        left.get_by_role("button", name="Take control").click()
        left.get_by_role("button", name="Enable").click()
        expect(left.get_by_role("button", name="Open", exact=True)).to_be_enabled()
        expect(left.get_by_text("keys act here")).to_be_visible()
        before = len(clients[0].result("job.list")["jobs"])
        right.get_by_role("heading").first.click()
        expect(left.get_by_text("keys act here")).to_be_hidden()
        tab.keyboard.press("c")
        expect(right.locator("[data-is=outcome]")).to_contain_text("close: press “Take control”")
        right.get_by_role("button", name="Take control").click()
        expect(right.get_by_text("keys act here")).to_be_visible()
        daemons[1].kill()
        tab.keyboard.press("o")
        expect(right.locator("[data-is=mode]")).to_have_text("no daemon")
        tab.keyboard.press("o")
        lack = tab.locator("#toasts li").filter(has_text="open: the gripper is not connected")
        expect(lack).to_have_count(1)
        assert len(clients[0].result("job.list")["jobs"]) == before
        left.get_by_role("heading").first.click()
        tab.keyboard.press("o")
        clients[0].until(lambda state: bool(state["mode"] == "moving"))


def test_of_two_grippers_nothing_is_covered_by_what_has_to_be_done_now(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, daemons, clients):
        left, right = f"left-{os.getpid()}", f"right-{os.getpid()}"
        notice, alarm = tab.locator("#notice"), tab.locator("#alarm")
        bar = tab.locator("header")
        before = bar.bounding_box()
        clients[0].result("sim.fault", name="silent")
        expect(alarm).to_have_text(f"{left}: MOTOR SILENT")
        tab.keyboard.press("Escape")
        expect(notice).to_have_text(f"Stop latched, but {left} does not answer: cut its power.")
        expect(alarm).to_have_text(f"{left}: MOTOR SILENT; all: STOPPED")
        assert tab.evaluate(COVERED_BY_NOTICE) == []
        clients[1].result("sim.fault", name="silent")
        expect(notice).to_have_text("Stop latched, but the motors do not answer: cut their power.")
        expect(alarm).to_have_text("all: MOTOR SILENT, STOPPED")
        assert tab.evaluate(COVERED_BY_NOTICE) == []
        assert bar.bounding_box() == before
        daemons[0].kill()
        expect(alarm).to_have_text(f"{left}: NO DAEMON; {right}: MOTOR SILENT, STOPPED")
        tab.keyboard.press("Escape")
        cut = f"STOP did not reach {left} (no daemon answers)"
        deaf = f"{cut}; {right} is silent. Cut their power."
        expect(notice).to_have_text(deaf)
        assert tab.evaluate(COVERED_BY_NOTICE) == []
        daemons[1].kill()
        expect(alarm).to_have_text("all: NO DAEMON")
        tab.keyboard.press("Escape")
        both = f"STOP did not reach {left}, {right} (no daemon answers). Cut their power."
        expect(notice).to_have_text(both)
        assert tab.evaluate(COVERED_BY_NOTICE) == []


CUT_OFF = """
() => [...document.querySelectorAll("#alarm, #toasts li:last-child span")]
  .filter((node) => node.scrollHeight > node.clientHeight)
  .map((node) => node.outerHTML)
"""


def test_of_two_grippers_a_stop_is_seen_beside_a_fault_that_let_go(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        bar = tab.locator("header").bounding_box()
        alarm, seen = tab.locator("#alarm"), tab.locator("#toasts li").filter(visible=True)
        grasp(clients[0])
        clients[0].result("sim.fault", name="overload")
        expect(seen).to_contain_text(["LET GO: remove what loads the jaws, then enable again"])
        for client in clients:
            client.result("stop", level="hold")
        left = f"left-{os.getpid()}"
        expect(alarm).to_have_text(f"{left}: LET GO, FAULT: overload; all: STOPPED")
        expect(alarm.get_by_text("STOPPED")).to_be_in_viewport(ratio=1)
        assert not alarm.evaluate("(node) => node.scrollHeight > node.clientHeight")
        clears = tab.locator("#clears button")
        expect(clears).to_have_text([f"Clear {left}", f"Clear right-{os.getpid()}"])
        boxes = [one.bounding_box() for one in (*clears.all(), seen, tab.locator("#stop"))]
        assert tab.evaluate(MEET, boxes) == []
        assert tab.locator("header").bounding_box() == bar


def test_of_two_grippers_a_loss_is_said_before_a_fault_of_the_other_and_its_own_fault_with_it(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        left, right = f"left-{os.getpid()}", f"right-{os.getpid()}"
        seen = tab.locator("#toasts li").filter(visible=True)
        grasp(clients[0])
        clients[0].result("sim.object")
        lost = f"{left}: OBJECT LOST: "
        expect(seen).to_contain_text([f"{lost}“Open”, then “Grasp” again"])
        clients[1].despite_silence("motor.enable")
        clients[1].result("sim.fault", name="overload")
        expect(tab.locator("#alarm")).to_contain_text(f"{right}: FAULT: overload")
        expect(tab.locator("#toasts li")).to_have_count(2)
        expect(seen).to_contain_text([lost])
        clients[0].result("sim.fault", name="overload")
        expect(seen).to_contain_text([f"{lost}remove what loads the jaws"])
        assert seen.locator("span").evaluate(SEEN, "remove what loads the jaws")


def test_of_two_grippers_no_line_is_cut_that_says_what_is_wrong(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        bar, alarm = tab.locator("header").bounding_box(), tab.locator("#alarm")
        left, right = f"left-{os.getpid()}", f"right-{os.getpid()}"
        panel = tab.get_by_role("article", name=f"Gripper {left}")
        panel.get_by_role("button", name="Take control").click()
        expect(panel.get_by_role("button", name="Disable")).to_be_enabled()
        clients[0].result("lease.take", why="my turn")
        grasp(clients[0])
        clients[0].result("sim.object")
        expect(alarm).to_have_text(f"{left}: OBJECT LOST, CONTROL LOST")
        clients[0].result("sim.fault", name="communication_lost")
        clients[0].result("stop", level="hold")
        own = "OBJECT LOST, FAULT: communication lost, STOPPED, CONTROL LOST"
        expect(alarm).to_have_text(f"{left}: {own}")
        assert tab.evaluate(CUT_LINES) == {"cut": 0, "hidden": 0}
        grasp(clients[1])
        clients[1].result("sim.fault", name="over_current")
        clients[1].result("stop", level="hold")
        loud = (
            f"{left}: OBJECT LOST, FAULT: communication lost;"
            f" {right}: LET GO, FAULT: over current; all: STOPPED"
        )
        expect(alarm).to_have_text(f"{loud}; {left}: CONTROL LOST")
        assert tab.evaluate(CUT_LINES)["cut"] == 0
        assert tab.locator("header").bounding_box() == bar


CUT_LINES = """
() => {
  const alarm = document.querySelector("#alarm");
  const {top, bottom} = alarm.getBoundingClientRect();
  const words = document.createRange();
  words.selectNodeContents(alarm);
  const lines = [...words.getClientRects()];
  const isIn = (line) => line.top > top - 2 && line.bottom < bottom + 2;
  const isOut = (line) => line.top > bottom - 2;
  const count = (is) => lines.filter(is).length;
  return {cut: count((line) => !isIn(line) && !isOut(line)), hidden: count(isOut)};
}
"""
"""How many words of the list are cut through, and how many are reached by scrolling only."""


def test_a_second_click_at_the_same_place_clears_no_other_stop(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        tab.keyboard.press("Escape")
        names = [f"left-{os.getpid()}", f"right-{os.getpid()}"]
        left, right = (button(tab, f"Clear {name}") for name in names)
        expect(right).to_be_visible()
        for name in names:
            panel = tab.get_by_role("article", name=f"Gripper {name}")
            panel.get_by_role("button", name="Take control").click()
        place, other = left.bounding_box(), right.bounding_box()
        assert place is not None
        left.click()
        clients[0].until(lambda state: state["stop"] is None)
        expect(left).to_be_hidden()
        assert right.bounding_box() == other
        tab.mouse.click(place["x"] + place["width"] / 2, place["y"] + place["height"] / 2)
        assert clients[1].result("state.get")["stop"] is not None
        right.click()
        expect(tab.locator("#clears")).to_be_hidden()


TIGHT = """
() => [...document.querySelectorAll("#clears button")].filter((node) => {
  const words = document.createRange();
  words.selectNodeContents(node);
  const [label, whole] = [words.getBoundingClientRect(), node.getBoundingClientRect()];
  return label.top < whole.top + 1.5 || label.bottom > whole.bottom - 1.5
    || label.left < whole.left + 1.5 || label.right > whole.right - 1.5;
}).map((node) => node.textContent)
"""


def test_of_two_grippers_what_clears_a_stop_has_room_for_its_words(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, _daemons, clients):
        for client in clients:
            client.result("stop", level="hold")
        expect(tab.locator("#clears button").last).to_be_visible()
        assert tab.evaluate(TIGHT) == []


def test_what_to_do_about_a_loss_is_read_without_a_tap_and_all_of_it_with_one(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, operating)
    client.result("sim.fault", name="overload")
    said = tab.locator("#toasts span")
    expect(said).to_contain_text("(“Enable”): the motor reports overload; what was held with 10 N")
    assert said.evaluate(SEEN, "remove what loads the jaws, then enable")
    said.click()
    assert said.evaluate(SEEN, "has been let go")


TIMES = """
(article) => {
  const told = article.querySelector("[data-is=said]").innerText;
  return told.toLowerCase().split("remove what loads the jaws").length - 1;
}
"""


def test_what_to_do_about_a_fault_that_let_go_is_said_once_in_the_head(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, operating)
    client.result("sim.fault", name="overload")
    expect(part(tab, "said")).to_contain_text("has been let go.")
    expect(part(tab, "mode")).to_have_text("fault")
    assert tab.locator("article").evaluate(TIMES) == 1


def test_of_two_grippers_a_stop_of_one_that_fails_is_as_loud_as_one_of_all(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, daemons, clients):
        name = f"left-{os.getpid()}"
        panel = tab.get_by_role("article", name=f"Gripper {name}")
        failed = tab.locator("#toasts li").filter(has_text=f"STOP not confirmed by {name}.")
        daemons[0].process.send_signal(signal.SIGSTOP)
        try:
            expect(panel.locator("[data-is=mode]")).to_have_text("late")
            panel.get_by_role("button", name="STOP", exact=True).click()
            expect(failed).to_contain_text("Cut the motor's power.")
            assert tab.locator("#toasts li:last-child").inner_text() == failed.inner_text()
            assert failed.evaluate("(node) => getComputedStyle(node).backgroundColor") == RED
        finally:
            daemons[0].process.send_signal(signal.SIGCONT)
        clients[0].until(lambda state: state["stop"] is not None)
        expect(failed).to_have_count(0)
        assert clients[1].result("state.get")["stop"] is None


def test_of_two_grippers_what_to_do_is_seen_when_a_daemon_stood_still(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, daemons, clients):
        grasp(clients[0])
        panel = tab.get_by_role("article", name=f"Gripper left-{os.getpid()}")
        expect(panel.locator("[data-is=held]")).to_have_text("object detected")
        daemons[0].process.send_signal(signal.SIGSTOP)
        try:
            expect(panel.locator("[data-is=mode]")).to_have_text("late")
            first = re.compile("^Keep hands off: what is shown is old. Press STOP; if that is not")
            expect(panel.locator("[data-is=why]")).to_have_text(first)
            assert panel.locator("[data-is=said]").evaluate(FIRST) == "why"
            tab.wait_for_timeout(1500)  # longer than a motor without commands stays armed
        finally:
            daemons[0].process.send_signal(signal.SIGCONT)
        act = "enable again (“Enable”); if it recurs"
        expect(panel.locator("[data-is=lost-text]")).to_contain_text(f": {act}")
        expect(panel.locator("[data-is=lost-text]")).to_contain_text("itself stood still for")
        said = tab.locator("#toasts li:last-child span")
        expect(said).to_contain_text(f"LET GO: {act}")
        assert said.evaluate(SEEN, "enable again (“Enable”)")


FIRST = """
(node) => [...node.children].find((one) => one.checkVisibility() && one.textContent).dataset.is
"""


def test_what_to_do_about_a_daemon_or_a_server_that_is_gone_is_read_before_a_loss(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "lost") as (_, daemon, running):
        tab = opened(window, running)
        with daemon.connect() as client:
            grasp(client)
            expect(part(tab, "held")).to_have_text("object detected")
        daemon.kill()
        expect(part(tab, "lost")).to_have_text("LET GO")
        said, why = part(tab, "said"), part(tab, "why")
        assert said.evaluate(FIRST) == "why"
        assert why.evaluate(SEEN, "Start the daemon ('litegripctl doctor' says what is wrong)")
    expect(why).to_have_text(re.compile("^Start litegripd-web again: with the same secret"))
    assert said.evaluate(FIRST) == "why"
    assert why.evaluate(SEEN, "with the same secret (--token-file)")


def test_what_goes_on_is_read_as_a_whole(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    enable(tab, client)
    button(tab, "Teach").click()
    outcome = part(tab, "outcome")
    expect(outcome).to_have_text("Recording: move the jaws by hand, then end and keep it.")
    assert outcome.evaluate("(node) => node.scrollHeight <= node.clientHeight")
    discard(tab)


MEET = """
(boxes) => boxes.flatMap((one, at) => boxes.slice(at + 1).filter((other) =>
  one.x < other.x + other.width && other.x < one.x + one.width &&
  one.y < other.y + other.height && other.y < one.y + one.height))
"""


@pytest.mark.parametrize("end", ["Read", "STOP", "stop"])
def test_a_stop_that_was_missed_is_as_loud_as_a_loss_once_the_daemon_answers(
    window: BrowserContext, tmp_path: Path, end: str
) -> None:
    with contextlib.ExitStack() as stack:
        run, first, running = stack.enter_context(mortal(tmp_path, "missed"))
        tab = opened(window, running)
        take_control(tab)
        bar = tab.locator("header").bounding_box()
        first.kill()
        expect(part(tab, "mode")).to_have_text("no daemon")
        tab.keyboard.press("Escape")
        expect(tab.locator("#notice")).to_contain_text("STOP did not reach")
        client = stack.enter_context(run().connect())
        alarm, toasts = tab.locator("#alarm"), tab.locator("#toasts li")
        expect(alarm).to_contain_text("NOT STOPPED")
        expect(alarm.locator("span").first).to_have_css("background-color", RED)
        expect(toasts.last).to_have_text(re.compile("^NOT STOPPED: press STOP again. "))
        expect(toasts.last).to_have_css("background-color", RED)
        expect(toasts.last).to_be_in_viewport(ratio=1)
        assert tab.evaluate(CUT_OFF) == []
        assert tab.locator("header").bounding_box() == bar
        tab.keyboard.press("o")  # says in the bar that there is no control
        expect(toasts.filter(visible=True)).to_contain_text(["NOT STOPPED"])
        if end == "Read":
            toasts.last.get_by_role("button", name="Read").click()
        elif end == "STOP":
            tab.locator("#stop").click()
        else:
            client.result("stop", level="hold")
        expect(toasts.filter(has_text="NOT STOPPED")).to_have_count(0)
        expect(alarm).not_to_contain_text("NOT STOPPED")


def test_of_two_grippers_each_is_told_by_its_own_button_and_as_long_as_it_is_so(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with two_grippers(window, tmp_path, monkeypatch) as (tab, daemons, clients):
        left = f"left-{os.getpid()}"
        panel = tab.get_by_role("article", name=f"Gripper {left}")
        outcome = panel.locator("[data-is=outcome]")
        panel.get_by_role("button", name="Take control").click()
        expect(panel.get_by_role("button", name="Give control back")).to_be_visible()
        clients[0].result("stop", level="hold")
        expect(button(tab, f"Clear {left}")).to_be_visible()
        tab.keyboard.press("o")
        expect(outcome).to_have_text(f"open: stopped: “Clear {left}” first")
        panel.get_by_role("button", name="STOP", exact=True).click()
        expect(outcome).to_have_text("Stopped. Nothing moves until it is cleared.")
        daemons[0].kill()
        expect(panel.locator("[data-is=mode]")).to_have_text("no daemon")
        expect(outcome).to_have_text("")
        right = tab.get_by_role("article", name=f"Gripper right-{os.getpid()}")
        clients[1].result("sim.fault", name="overload")
        button(tab, f"right-{os.getpid()}").click()
        expect(right.locator("[data-is=channel]")).to_be_in_viewport(ratio=1)
        assert tab.evaluate(COVERED_BY_BAR) == []


COVERED_BY_BAR = """
() => {
  const bar = document.querySelector("header").getBoundingClientRect().bottom;
  return [...document.querySelectorAll(".gripper:last-child .head *")]
    .filter((node) => node.checkVisibility() && node.getBoundingClientRect().top < bar)
    .map((node) => node.outerHTML);
}
"""
CUT_IN_DIALOG = """
() => {
  const rect = (node) => node.getBoundingClientRect();
  const dialog = document.querySelector("dialog[open]");
  const said = rect(dialog.querySelector(".barred"));
  return said.bottom > Math.min(rect(dialog).bottom, innerHeight) || said.top < rect(dialog).top;
}
"""


def test_why_nothing_moves_is_in_sight_in_a_dialog_that_has_no_room(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    button(tab, "Zero …").click()
    size = tab.viewport_size
    assert size is not None
    client.result("stop", level="hold")
    expect(tab.get_by_role("dialog")).to_contain_text("Not now: stopped")
    for height in range(size["height"], 320, -40):
        tab.set_viewport_size({"width": size["width"], "height": height})
        assert not tab.evaluate(CUT_IN_DIALOG), height


UNCOVERED = """
() => {
  const bottom = document.querySelector("#notice").getBoundingClientRect().bottom;
  const nodes = document.querySelector("dialog[open]").children;
  return [...nodes].every((node) => node.getBoundingClientRect().top >= bottom);
}
"""


def test_what_has_to_be_done_now_covers_nothing_of_a_dialog_and_moves_nothing_in_it(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    button(tab, "Zero …").click()
    cancel = button(tab, "Cancel")
    place = cancel.bounding_box()
    client.result("sim.fault", name="silent")
    tab.keyboard.press("Escape")
    expect(tab.locator("#notice")).to_have_text(CUT)
    assert tab.evaluate(UNCOVERED)
    assert cancel.bounding_box() == place
    long = "STOP did not reach can7 (litegripd does not answer). Cut the motor's power."
    tab.locator("#notice").evaluate("(node, text) => { node.textContent = text; }", long)
    assert tab.evaluate(UNCOVERED)


BROKEN_FIGURES = """
() => [...document.querySelectorAll("dd:not(.wide)")]
  .filter((node) => node.clientHeight > 2.5 * parseFloat(getComputedStyle(node).lineHeight))
  .map((node) => node.outerHTML)
"""


def test_the_figures_of_a_silent_motor_are_last_known(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, operating)
    grey = tab.locator("dt", has_text="Opening").evaluate("(node) => getComputedStyle(node).color")
    figures = ("Opening", "Force", "Set force", "Coil", "Driver", "Time to the heat limit")
    for name in (*figures, "On the object"):
        expect(fact(tab, name)).not_to_have_text(re.compile("last known|^--"))
        expect(fact(tab, name)).not_to_have_css("color", grey)
    client.result("sim.fault", name="silent")
    for name in figures:
        expect(fact(tab, name)).to_have_text(re.compile(r"\w.*, last known$"))
        expect(fact(tab, name)).to_have_css("color", grey)
    expect(fact(tab, "On the object")).to_have_text(re.compile("^--$|, last known$"))
    wait_until_it_fits(tab)
    assert tab.evaluate(BROKEN_FIGURES) == []
    client.result("sim.fault", name="none")
    for name in figures:
        expect(fact(tab, name)).not_to_have_css("color", grey)
        expect(fact(tab, name)).not_to_contain_text("last known")


def test_a_grasp_that_found_nothing_is_said_where_it_was_asked_for(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    client.despite_silence("motor.enable")
    tab = at_the_controls(window, operating)
    before = places(tab)
    button(tab, "Grasp").click()
    toast = tab.locator("#toasts li")
    expect(toast).to_contain_text("grasp: no object")
    expect(toast).to_be_in_viewport(ratio=1)
    assert places(tab) == before


COVERED = """
() => {
  const rect = (node) => node.getBoundingClientRect();
  const said = [...document.querySelectorAll("#toasts li")].map(rect);
  const meets = (a, b) =>
    a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
  const bar = rect(document.querySelector("header")).bottom;
  return [...document.querySelectorAll("main button, main input")]
    .filter((node) => node.checkVisibility() && rect(node).top >= bar)
    .filter((node) => said.some((one) => meets(one, rect(node))))
    .map((node) => node.outerHTML);
}
"""


def test_what_went_wrong_covers_no_controls_and_moves_none(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = at_the_controls(window, operating)
    before = places(tab)
    toasts = tab.locator("#toasts li")
    tab.keyboard.press("e")
    expect(button(tab, "Open")).to_be_enabled()
    press = "(node) => node.click()"  # without a look at where it is
    button(tab, "Replay").evaluate(press)  # of what there is not
    expect(toasts).to_have_count(1)
    button(tab, "Grasp").evaluate(press)  # of nothing
    expect(toasts).to_have_count(2)
    client.result("sim.fault", name="overload")
    expect(toasts).to_have_count(3)
    expect(toasts.last).to_contain_text("Remove what loads the jaws")
    expect(toasts.last).to_be_in_viewport(ratio=1)
    assert tab.evaluate(COVERED) == []
    assert places(tab) == before
    toasts.last.locator("span").click()  # all of them, as long as somebody wants to
    expect(toasts.first).to_be_in_viewport(ratio=1)
    tab.keyboard.press("e")  # now the fault is over
    expect(toasts).to_have_count(2)


CONTRAST = """
(node) => {
  const channels = (color) => color.match(/[0-9.]+/g).slice(0, 3).map((value) => value / 255);
  const light = (value) => value <= 0.03928 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  const bright = ([r, g, b]) => 0.2126 * light(r) + 0.7152 * light(g) + 0.0722 * light(b);
  const back = channels(getComputedStyle(node.closest(".gripper")).backgroundColor);
  const share = Number(getComputedStyle(node.closest(".body")).opacity);
  const ink = channels(getComputedStyle(node.querySelector("dt")).color);
  const seen = ink.map((value, at) => value * share + back[at] * (1 - share));
  const [dark, lit] = [bright(seen), bright(back)].sort((a, b) => a - b);
  return (lit + 0.05) / (dark + 0.05);
}
"""
"""How well words are told from what is behind them, 1 to 21."""


def test_a_daemon_and_a_page_server_that_are_gone_are_said_where_the_buttons_are(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "gone") as (_, daemon, running):
        tab = opened(window, running)
        to_the_controls(tab)
        alarm = tab.locator("#alarm")
        expect(alarm).to_be_hidden()
        expect(tab.locator("#stop")).to_have_css("background-color", RED)
        daemon.kill()
        expect(tab.locator("#stop")).not_to_have_css("background-color", RED)
        expect(alarm).to_have_text("NO DAEMON")
        expect(alarm).to_be_in_viewport(ratio=1)
        assert tab.locator("dl").evaluate(CONTRAST) > 3  # of what is last known
    expect(alarm).to_have_text("NO CONNECTION")
    expect(part(tab, "mode")).to_have_text("no connection")


def test_a_page_loaded_again_says_how_to_go_on_and_the_whole_address_works_there(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    stop = tab.locator("#stop")
    expect(stop).to_have_css("background-color", RED)
    tab.reload()
    expect(stop).to_be_enabled()  # who presses it is told, not left in doubt
    expect(stop).not_to_have_css("background-color", RED)
    notice = tab.locator("#notice")
    for how in ("click", "Escape"):
        stop.click() if how == "click" else tab.keyboard.press(how)
        expect(notice).to_have_text(DOES_NOTHING)
        expect(notice).to_have_css("background-color", RED)
        expect(notice).to_be_in_viewport(ratio=1)
        assert tab.evaluate(COVERED_BY_NOTICE) == []
        notice.evaluate("(node) => { node.textContent = ''; }")
    assert client.result("state.get")["stop"] is None
    told = tab.get_by_role("main")
    expect(told).to_contain_text("STOP does nothing here")
    expect(told).to_contain_text(f'echo "{operating.url}#$(cat /run/litegripd-web/token)"')
    tab.goto(operating.told)  # in the same tab: only what stands behind "#" is another
    expect(part(tab, "mode")).to_have_text("disabled")
    expect(stop).to_have_css("background-color", RED)
    stop.click()
    client.until(lambda state: state["stop"] is not None)


def test_the_address_for_a_bookmark_is_the_whole_one(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    window.grant_permissions(["clipboard-read", "clipboard-write"])
    tab = opened(window, operating)
    assert operating.token not in tab.url
    button(tab, "Copy the whole address").click()
    expect(tab.get_by_text("Copied: make a bookmark of it.")).to_be_visible()
    assert tab.evaluate("navigator.clipboard.readText()") == operating.told
    assert operating.token not in tab.content()
