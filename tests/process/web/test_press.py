"""STOP acts when it is pressed, however it is let go: by each finger, and once for each press."""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, BrowserContext, Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import DEADLINE_S, Client
from tests.process.web.on_page import OBJECT_MM, button, enable, grasp, opened, part, take_control
from tests.process.web.page_process import Page


@pytest.fixture
def window(chromium: Browser) -> Iterator[BrowserContext]:
    """A phone's window, which can be touched."""
    window = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True)
    window.set_default_timeout(DEADLINE_S * 1000)
    yield window
    window.close()


class Fingers:
    """What touches a tab's screen, each finger known by its place in the list."""

    def __init__(self, tab: Tab) -> None:
        self._session = tab.context.new_cdp_session(tab)

    def __call__(self, kind: str, *points: tuple[float, float]) -> None:
        fingers = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})


def press_and_hold(tab: Tab, x: float, y: float) -> None:
    tab.mouse.move(x, y)
    tab.mouse.down()


def touch_beside_another_finger(tab: Tab, x: float, y: float) -> None:
    slider = part(tab, "slider").bounding_box()
    assert slider is not None
    thumb = (slider["x"] + 20, slider["y"] + slider["height"] / 2)
    fingers = Fingers(tab)
    fingers("touchStart", thumb)
    fingers("touchStart", thumb, (x, y))
    fingers("touchEnd", thumb)
    fingers("touchEnd")


def smear(tab: Tab, x: float, y: float) -> None:
    fingers = Fingers(tab)
    fingers("touchStart", (x, y))
    for step in range(1, 6):
        fingers("touchMove", (x + 4 * step, y + 6 * step))
    fingers("touchEnd")


def slip_off(tab: Tab, x: float, y: float) -> None:
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x, y + 200, steps=3)
    tab.mouse.up()


def click(tab: Tab, x: float, y: float) -> None:
    tab.mouse.click(x, y, delay=60)


def tap(tab: Tab, x: float, y: float) -> None:
    tab.touchscreen.tap(x, y)


def enter(tab: Tab, _x: float, _y: float) -> None:
    tab.locator("#stop").focus()
    tab.keyboard.press("Enter")


def slip_off_then_space(tab: Tab, x: float, y: float) -> None:
    """Press once more by a key: the pointer's press that came before takes nothing from it."""
    slip_off(tab, x, y)
    expect(tab.locator("#notice")).to_contain_text("Stopped.")
    button(tab, "Clear the stop").click()
    expect(button(tab, "Clear the stop")).to_be_hidden()
    tab.locator("#stop").focus()
    tab.keyboard.press("Space")


Press = Callable[[Tab, float, float], None]

PRESSES: dict[Press, int] = {
    press_and_hold: 1,
    touch_beside_another_finger: 1,
    smear: 1,
    slip_off: 1,
    click: 1,
    tap: 1,
    enter: 1,
    slip_off_then_space: 2,
}


@pytest.mark.parametrize("press", PRESSES)
def test_stop_acts_when_it_is_pressed(
    window: BrowserContext,
    operating: Page,
    client: Client,
    press: Press,
) -> None:
    tab = opened(window, operating)
    take_control(tab)
    box = tab.locator("#stop").bounding_box()
    assert box is not None
    before = client.result("state.get")["stop_generation"]
    press(tab, box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    client.until(lambda state: state["stop"] is not None)
    expect(tab.locator("#notice")).to_contain_text("Stopped.")
    button(tab, "Clear the stop").click()
    expect(button(tab, "Clear the stop")).to_be_hidden()
    assert client.result("state.get")["stop_generation"] - before == PRESSES[press]


def swipe(tab: Tab, node: Locator, dx: float, dy: float) -> None:
    """Draw a finger over the page, from a part of it, by so many pixels."""
    node.evaluate("(node) => node.scrollIntoView({block: 'center'})")
    box = node.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 5, box["y"] + box["height"] / 2
    fingers = Fingers(tab)
    fingers("touchStart", (x, y))
    for step in range(1, 13):
        fingers("touchMove", (x + dx * step / 12, y + dy * step / 12))
    fingers("touchEnd")


def swipe_until_it_scrolls(tab: Tab, node: Locator, dy: float) -> None:
    tab.evaluate("scrollTo(0, 200)")
    node.evaluate("(node) => node.scrollIntoView({block: 'center'})")
    before = tab.evaluate("scrollY")
    swipe(tab, node, 0.0, dy)
    while tab.evaluate("scrollY") == before:
        tab.wait_for_timeout(20)


@pytest.mark.parametrize("dy", [-120.0, 120.0])
def test_who_scrolls_a_phones_page_moves_no_jaws(
    window: BrowserContext, operating: Page, client: Client, dy: float
) -> None:
    """A thumb that begins on the slider scrolls the page, as one beside it does."""
    tab = opened(window, operating)
    enable(tab, client)
    button(tab, "Open").click()
    expect(part(tab, "outcome")).to_contain_text("open: reached")
    jobs = client.result("job.list")["jobs"]
    swipe_until_it_scrolls(tab, part(tab, "slider"), dy)
    expect(part(tab, "slider-text")).to_have_text("80.0 mm")
    expect(part(tab, "outcome")).to_contain_text("open: reached")
    assert client.result("job.list")["jobs"] == jobs
    # A key or a finger that slides it moves the jaws, also after that.
    part(tab, "slider").press("ArrowLeft")
    client.until(lambda state: bool(state["job"] is None and 78 < state["opening_mm"] < 79.8))
    swipe(tab, part(tab, "slider"), 60.0, 0.0)
    client.until(lambda state: bool(state["job"] is None and state["opening_mm"] < 70))


@pytest.mark.parametrize("dy", [-120.0, 120.0])
def test_who_scrolls_over_the_jaws_takes_nothing_out_of_them(
    window: BrowserContext, operating: Page, client: Client, dy: float
) -> None:
    grasp(client)
    tab = opened(window, operating)
    expect(part(tab, "held")).to_have_text("object detected")
    swipe_until_it_scrolls(tab, tab.locator(".jaws .item"), dy)
    told_s = client.result("state.get")["monotonic_s"]
    client.until(lambda state: bool(state["monotonic_s"] > told_s + 0.5))
    assert client.result("state.get")["is_grasped"]
    assert client.result("sim.get")["object"]["width_mm"] == OBJECT_MM
    for words in tab.locator(".jaws .tray text").all():
        expect(words).to_be_hidden()  # they ask for it to be dragged
