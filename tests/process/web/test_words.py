"""What the daemon tells of programs, stops and jobs, in the page's words; what was typed stays."""

import re

from playwright.sync_api import BrowserContext, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import SEEN, button, enable, fact, grasp, opened, part, take_control
from tests.process.web.page_process import Page

SAMPLES = 30
STOPPED = r"^Stopped at [0-9:]{8} by STOP on the page\. Nothing moves until it is cleared\.$"


def test_a_stop_of_the_page_is_called_that_in_each_text(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    operated.locator("h1").click()
    operated.keyboard.press("Escape")
    expect(part(operated, "stopped")).to_have_text(re.compile(STOPPED))
    told = re.compile("broken off after .*, “Keep the part” or “Discard”: STOP on the page")
    expect(operated.locator("#toasts")).to_contain_text(told)
    assert client.result("state.get")["stop"]["by"] == "litegripd-web"
    client.result("stop.clear")
    client.result("stop", level="hold", why="lunch")
    expect(part(operated, "stopped")).to_contain_text("by python. ")
    expect(part(operated, "stopped")).to_contain_text("Why: lunch.")


def test_a_purpose_that_is_the_programs_name_is_said_once(operated: Tab, client: Client) -> None:
    grasp(client)
    client.result("lease.acquire", purpose="python")
    expect(fact(operated, "Lease")).to_have_text(re.compile(r"^python \(pid \d+\)$"))
    button(operated, "Take it over").click()
    question = operated.get_by_role("dialog")
    expect(question).to_contain_text(re.compile(r"over from python \(pid \d+\)\? At this"))
    button(operated, "No, leave it").click()
    client.result("lease.release")
    client.result("lease.acquire", purpose="a script")
    expect(fact(operated, "Lease")).to_have_text(re.compile(r"^python \(pid \d+\), a script$"))


def test_the_name_of_a_motion_is_kept_when_the_page_is_loaded_again(
    window: BrowserContext, operating: Page, client: Client
) -> None:
    tab = opened(window, operating)
    expect(part(tab, "name")).to_have_value("taught")
    take_control(tab)
    part(tab, "name").fill("t2")
    tab.goto("about:blank")
    tab.goto(operating.told)
    expect(part(tab, "name")).to_have_value("t2")


def test_the_opening_that_was_typed_stays_until_the_daemons_figure_is_another(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    stroke = operated.get_by_label("The jaws open")
    button(operated, "Zero …").click()
    stroke.fill("84")
    operated.keyboard.press("Escape")
    client.until(lambda state: state["stop"] is not None)
    button(operated, "Cancel").click()
    button(operated, "Clear the stop").click()
    button(operated, "Zero …").click()
    expect(stroke).to_have_value("84")
    button(operated, "Cancel").click()
    client.result("lease.take", why="my turn")
    client.result("calibration.rescale", stroke_mm=86.0)
    client.result("lease.release")
    expect(part(operated, "slider")).to_have_attribute("max", "87.0")
    take_control(operated)
    button(operated, "Zero …").click()
    expect(stroke).to_have_value("86")


def test_behind_a_stop_the_head_says_first_what_to_do_about_a_loss(
    operated: Tab, client: Client
) -> None:
    operated.set_viewport_size({"width": 390, "height": 844})
    grasp(client)
    client.result("sim.fault", name="overload")
    client.result("stop", level="hold", why="a fault that nobody has expected here")
    expect(part(operated, "stopped")).to_be_visible()
    assert part(operated, "lost-text").evaluate(SEEN, "remove what loads the jaws, then enable")


def test_on_a_narrow_phone_all_that_is_wrong_is_in_sight(operated: Tab, client: Client) -> None:
    operated.set_viewport_size({"width": 320, "height": 640})
    enable(operated, client)
    client.result("lease.take", why="my turn")
    grasp(client)
    client.result("sim.fault", name="overload")
    client.result("stop", level="hold")
    alarm = operated.locator("#alarm")
    expect(alarm).to_have_text("LET GO, FAULT: overload, STOPPED, CONTROL LOST")
    assert alarm.evaluate("(node) => node.scrollHeight <= node.clientHeight")
