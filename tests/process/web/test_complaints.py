"""What the page complains of: in its own words, once, and no longer than it is so."""

import re
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import OBJECT_MM, button, enable, grasp, opened, part, take_control
from tests.process.web.page_process import Page

SAMPLES = 30


def toasts(tab: Tab) -> Any:
    return tab.locator("#toasts li")


def test_what_is_over_is_said_no_more(operated: Tab, client: Client) -> None:
    take_control(operated)
    client.result("lease.take", why="my turn")
    expect(toasts(operated)).to_contain_text(["python took control: my turn"])
    button(operated, "Take it over").click()
    expect(toasts(operated)).to_have_count(0)
    client.result("sim.fault", name="overload")
    expect(toasts(operated)).to_contain_text([": the motor reports overload"])
    button(operated, "Clear the fault").click()
    expect(toasts(operated)).to_have_count(0)


def test_what_is_tried_again_is_said_once(operated: Tab, client: Client) -> None:
    enable(operated, client)
    for name in ("here", "there"):
        part(operated, "name").fill(name)
        button(operated, "Replay").click()
        expect(toasts(operated).last).to_contain_text(f"no trajectory '{name}'")
        expect(toasts(operated)).to_have_count(1)
    button(operated, "Read").click()
    expect(toasts(operated)).to_have_count(0)


def test_a_stop_leaves_no_complaint_behind(operated: Tab, client: Client) -> None:
    enable(operated, client)
    part(operated, "pace").fill("10")
    operated.keyboard.press("Tab")
    button(operated, "Close").click()
    client.until(lambda state: bool(state["job"] and state["opening_mm"] < 59))
    operated.keyboard.press("Escape")
    line = part(operated, "events").locator("span", has_text="broken off")
    expect(line).to_have_text(re.compile(r"^job \d+, close: broken off: STOP on the page, "))
    button(operated, "Clear the stop").click()
    expect(part(operated, "outcome")).to_have_text("clear the stop: done")
    expect(toasts(operated)).to_have_count(0)


def test_a_key_that_does_nothing_says_why(operated: Tab, client: Client) -> None:
    outcome = part(operated, "outcome")
    operated.keyboard.press("o")
    expect(toasts(operated)).to_contain_text(["open: press “Take control” first"])
    operated.keyboard.press("g")
    expect(outcome).to_have_text("grasp: press “Take control” first")
    expect(toasts(operated)).to_have_count(1)
    take_control(operated)
    expect(toasts(operated)).to_have_count(0)
    client.result("stop", level="hold")
    expect(part(operated, "to-use")).to_contain_text("stopped: ")
    operated.keyboard.press("o")
    expect(outcome).to_have_text("open: stopped: “Clear the stop” first")
    client.result("stop.clear")
    client.result("sim.fault", name="silent")
    expect(part(operated, "mode")).to_have_text("offline")
    operated.keyboard.press("o")
    expect(outcome).to_have_text("open: the motor does not answer")


def click(tab: Tab, node: Locator) -> None:
    """Click where it is, and on whatever gets that."""
    node.scroll_into_view_if_needed()
    box = node.bounding_box()
    assert box is not None
    tab.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_what_is_grey_says_why_when_it_is_clicked(operated: Tab, client: Client) -> None:
    outcome = part(operated, "outcome")
    for name in ("Open", "Set force", "Zero …", "Disable"):
        click(operated, button(operated, name))
        told = f"{name.replace(' …', '').lower()}: press “Take control” first"
        expect(outcome).to_have_text(told)
        expect(toasts(operated)).to_contain_text([told])
        expect(toasts(operated)).to_have_count(1)
    enable(operated, client)
    expect(toasts(operated)).to_have_count(0)
    click(operated, button(operated, "Clear the fault"))
    expect(outcome).to_have_text("clear the fault: the motor reports no fault")
    client.result("stop", level="hold")
    expect(button(operated, "Open")).to_be_disabled()
    click(operated, button(operated, "Open"))
    expect(outcome).to_have_text("open: stopped: “Clear the stop” first")
    client.result("stop.clear")
    client.result("sim.object", width_mm=OBJECT_MM)
    button(operated, "Grasp").click()
    expect(part(operated, "outcome")).to_contain_text("grasp: object held")
    expect(part(operated, "slider")).to_be_disabled()
    click(operated, part(operated, "slider"))
    expect(outcome).to_have_text("move: something is held, which it would drop")
    assert client.result("state.get")["is_grasped"]


def test_what_is_squeezed_behind_a_stop_is_let_go_of(operated: Tab, client: Client) -> None:
    """A finger, say: the jaws keep their hold behind a stop."""
    grasp(client)
    client.result("stop", level="hold", why="my finger")
    why = part(operated, "why")
    expect(why).to_contain_text("to let go of what is squeezed: “Take control”, “Let go”")
    take_control(operated)
    expect(why).to_contain_text("to let go of what is squeezed: “Let go”")
    button(operated, "Let go").click()
    client.until(lambda state: bool(state["mode"] == "relaxed"))
    assert client.result("state.get")["stop"]["level"] == "relax"
    expect(why).not_to_contain_text("to let go")
    expect(part(operated, "outcome")).to_have_text("let go: done")
    expect(part(operated, "mode")).to_have_text("STOPPED")


def test_what_needs_an_enabled_motor_is_grey_without_one_and_says_so(
    operated: Tab, client: Client
) -> None:
    take_control(operated)
    why, outcome = part(operated, "to-use"), part(operated, "outcome")
    expect(why).to_have_text("“Enable” first")
    for name in ("Open", "Grasp", "Let go", "Replay"):
        expect(button(operated, name)).to_be_disabled()
        click(operated, button(operated, name))
        expect(outcome).to_have_text(f"{name.lower()}: “Enable” first")
    operated.keyboard.press("e")
    client.until(lambda state: bool(state["enabled"]))
    expect(button(operated, "Open")).to_be_enabled()
    expect(why).to_have_text("")
    client.result("stop", level="hold")
    expect(why).to_have_text("stopped: “Clear the stop” first")
    expect(why).to_be_in_viewport(ratio=1)
    expect(button(operated, "Let go")).to_be_enabled()
    expect(button(operated, "Enable")).to_be_disabled()
    button(operated, "Clear the stop").click()
    expect(why).to_have_text("")


def test_what_to_do_about_a_fault_is_said_in_the_bar_until_it_is_over(
    operated: Tab, client: Client, window: BrowserContext, operating: Page
) -> None:
    enable(operated, client)
    client.result("sim.fault", name="overload")
    text = "emove what loads the jaws, then enable again (“Enable”): the motor reports overload"
    expect(toasts(operated)).to_contain_text([f"R{text}"])
    expect(part(operated, "said")).to_contain_text(f"r{text}")
    expect(part(operated, "to-use")).to_have_text("a fault: “Enable” again")
    operated.keyboard.press("o")
    expect(part(operated, "outcome")).to_have_text("open: a fault: “Enable” again")
    expect(toasts(operated)).to_have_count(1)
    other = opened(window, operating)
    expect(toasts(other)).to_contain_text([f"R{text}"])
    operated.bring_to_front()
    operated.keyboard.press("e")
    for tab in (operated, other):
        expect(toasts(tab)).to_have_count(0)


def test_what_to_do_about_a_silent_motor_is_said_in_the_bar_and_the_head(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    client.result("sim.fault", name="silent")
    text = "he motor does not answer: check its 24 V supply, the CAN wiring and its id"
    expect(toasts(operated)).to_contain_text([f"T{text}"])
    expect(part(operated, "said")).to_have_text(
        re.compile(rf"^\s*t{text}; what is shown is the motor's last report")
    )
    client.result("sim.fault", name="none")
    expect(toasts(operated)).to_have_count(0)


def test_who_took_control_is_said_beside_what_a_key_lacks(operated: Tab, client: Client) -> None:
    take_control(operated)
    client.result("lease.take", why="my turn")
    expect(toasts(operated)).to_contain_text(["python took control: my turn"])
    operated.keyboard.press("o")
    expect(toasts(operated)).to_have_count(2)
    button(operated, "Take it over").click()
    expect(toasts(operated)).to_have_count(0)


def test_a_trajectory_that_is_taught_is_no_longer_said_to_be_missing(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    part(operated, "name").fill("p7a")
    button(operated, "Replay").click()
    expect(toasts(operated)).to_contain_text(["no trajectory 'p7a'"])
    part(operated, "name").fill("p7")
    expect(toasts(operated)).to_have_count(0)
    part(operated, "name").fill("p7a")
    button(operated, "Replay").click()
    expect(toasts(operated)).to_contain_text(["no trajectory 'p7a'"])
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as p7a")
    expect(toasts(operated)).to_have_count(0)


def test_a_key_on_a_page_that_only_looks_says_why(shown: Tab) -> None:
    shown.keyboard.press("o")
    expect(part(shown, "outcome")).to_have_text("open: this page looks and stops only")


@pytest.mark.parametrize(
    ("field", "value", "press", "told"),
    [
        ("force", "99", "Grasp", "force: It may be from 0.5 to 40 N, and is 99."),
        ("force", "", "Grasp", "force: It may be from 0.5 to 40 N, and is empty."),
        ("pace", "999", "Open", "speed: It may be from 0.1 to 150 mm/s, and is 999."),
        ("speed", "9", "Replay", "replay: It may be from 0.1 to 4 times the speed, and is 9."),
        (
            "speed",
            "0.05",
            "Replay",
            "replay: It may be from 0.1 to 4 times the speed, and is 0.05.",
        ),
    ],
)
def test_a_number_that_cannot_be_is_refused_in_the_pages_words(
    operated: Tab, client: Client, field: str, value: str, press: str, told: str
) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    node = part(operated, field)
    node.fill(value)
    button(operated, press).click()
    expect(part(operated, "outcome")).to_have_text(told)
    said = node.evaluate("(node) => node.validationMessage")
    assert said == told.partition(": ")[2]  # not the browser's
    assert client.result("job.list")["jobs"] == before
    node.fill("1")
    assert node.evaluate("(node) => node.validity.valid")


def test_a_motion_that_ended_wrongly_says_why_until_the_next_one(
    operated: Tab, client: Client
) -> None:
    """In the shell's words, with the page's names in the place of commands."""
    enable(operated, client)
    button(operated, "Grasp").click()
    why = "grasp: no object, .*: the jaws came to their empty end: .*, then “Open”, and once more"
    expect(toasts(operated)).to_have_text([re.compile(why)])
    expect(part(operated, "events")).to_contain_text("the jaws came to their empty end")
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    expect(toasts(operated)).to_have_count(0)
    client.result("sim.object", width_mm=OBJECT_MM)
    button(operated, "Close").click()
    why = "close: protected.*: something was in the way, and the jaws let go of it: .* “Grasp”"
    expect(toasts(operated)).to_have_text([re.compile(why)])


def test_no_force_is_set_that_would_close_empty_jaws(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    force = button(operated, "Set force")
    expect(force).to_be_disabled()
    box = force.bounding_box()
    assert box is not None
    operated.mouse.click(box["x"] + 5, box["y"] + 5)
    told = "set force: nothing is gripped, and the jaws would close: “Grasp”"
    expect(part(operated, "outcome")).to_have_text(told)
    assert not client.result("state.get")["force_set_n"]
    client.result("sim.object", width_mm=OBJECT_MM)
    button(operated, "Grasp").click()
    expect(part(operated, "outcome")).to_contain_text("grasp: object held")
    part(operated, "force").fill("7")
    force.click()
    client.until(lambda state: bool(state["force_set_n"] == 7 and state["is_grasped"]))
    button(operated, "Disable").click()
    expect(part(operated, "outcome")).to_have_text("disable: done, what was held was let go")
    button(operated, "Enable").click()
    button(operated, "Disable").click()
    expect(part(operated, "outcome")).to_have_text("disable: done")


def begin_to_close(tab: Tab, client: Client) -> None:
    """Close slowly, and return on the way."""
    button(tab, "Open").click()
    expect(part(tab, "outcome")).to_contain_text("open: reached")
    part(tab, "pace").fill("10")
    button(tab, "Close").click()
    client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "close"))
    expect(part(tab, "mode")).to_contain_text("moving: close")


def test_a_motion_that_disable_has_ended_is_said_until_the_next_one_begins(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    begin_to_close(operated, client)
    button(operated, "Disable").click()
    expect(toasts(operated)).to_contain_text([re.compile("close: .*disabled the motor")])
    button(operated, "Enable").click()
    expect(button(operated, "Open")).to_be_enabled()
    expect(toasts(operated)).to_have_count(1)
    part(operated, "pace").fill("")
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    expect(toasts(operated)).to_have_count(0)


@pytest.mark.parametrize("press", ["button", "key"])
def test_hold_freezes_the_jaws_in_the_middle_of_this_pages_motion(
    operated: Tab, client: Client, press: str
) -> None:
    enable(operated, client)
    begin_to_close(operated, client)
    if press == "button":
        button(operated, "Hold").click()
    else:
        operated.locator("h1").click()
        operated.keyboard.press("h")
    expect(part(operated, "outcome")).to_have_text("hold: done")
    state = client.until(lambda state: state["job"] is None)
    expect(toasts(operated)).to_have_count(0)
    assert state["mode"] == "holding"
    operated.wait_for_timeout(500)
    now_mm = client.result("state.get")["opening_mm"]
    assert now_mm == pytest.approx(state["opening_mm"], abs=1)
    assert now_mm > 20


def test_nothing_is_minus_0(operated: Tab) -> None:
    figures = """async () => {
      const { figure } = await import("./format.js");
      return [-0.04, -0, 0.04, -0.06].map((value) => figure(value, 1, "N"));
    }"""
    assert operated.evaluate(figures) == ["0.0 N", "0.0 N", "0.0 N", "-0.1 N"]
