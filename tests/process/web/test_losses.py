"""What was held and is no more, or with too little: the page says so, and claims no hold."""

import re
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import OBJECT_MM, button, grasp, opened, part
from tests.process.web.page_process import Page


def alarm(tab: Tab) -> Any:
    return tab.locator("#alarm")


def toasts(tab: Tab) -> Any:
    return tab.locator("#toasts li")


def power_fails_for_a_moment(client: Client) -> None:
    client.result("sim.fault", name="silent")
    client.until(lambda state: bool(state["motor"] == "silent"))
    client.result("sim.fault", name="none")


@pytest.mark.parametrize(
    ("let_go", "also"),
    [
        (lambda client: client.result("sim.fault", name="overload"), ", FAULT: overload"),
        (power_fails_for_a_moment, ""),
    ],
    ids=["overload", "power"],
)
def test_what_a_fault_lets_go_is_said_until_it_is_read_or_the_next_motion_begins(
    window: BrowserContext, looking: Page, client: Client, let_go: Any, also: str
) -> None:
    grasp(client)
    tab = opened(window, looking)
    expect(alarm(tab)).to_be_hidden()
    let_go(client)
    told = re.compile(r"LET GO: what was held with 10 N, at \d\d\.\d mm, (has been|must be taken)")
    second = opened(window, looking)  # which knows it from the events of before
    for shown in (tab, second):
        expect(alarm(shown)).to_have_text(f"LET GO{also}")
        expect(toasts(shown)).to_have_text([told])
        expect(part(shown, "lost")).to_have_text("LET GO")
        expect(part(shown, "lost-text")).to_contain_text("what was held with 10 N")
    button(second, "Read").click()
    expect(alarm(second)).not_to_contain_text("LET GO")
    expect(part(second, "lost")).to_be_hidden()
    expect(toasts(second)).to_have_count(0)
    expect(alarm(tab)).to_have_text(f"LET GO{also}")
    client.result("sim.fault", name="none")
    client.until(lambda state: bool(state["motor"] == "disabled"))
    client.despite_silence("motor.enable")
    client.despite_silence("motion.open")
    for shown in (tab, second):
        expect(alarm(shown)).to_be_hidden()
        expect(toasts(shown)).to_have_count(0)
        expect(part(shown, "lost")).to_be_hidden()


def test_of_a_lost_object_no_hold_is_claimed_once_the_motor_is_off(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    client.result("sim.object")
    said = part(tab, "said")
    expect(said).to_contain_text("the object is lost: the jaws closed on, and hold where they are.")
    client.result("sim.fault", name="overload")
    whole = r"^\s*At \S+: the object is lost\. The motor reports overload"
    expect(said).to_have_text(re.compile(whole))
    client.result("stop", level="hold")
    expect(said).to_have_text(
        re.compile(r"^\s*Stopped .* the object is lost\. The motor reports overload")
    )


MARK = "(node) => getComputedStyle(node, '::before').color"


def test_a_weak_motor_is_said_while_it_lasts_and_its_hold_is_not_green(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    held, mode = part(tab, "held"), part(tab, "mode")
    expect(held).to_have_text("object detected")
    expect(alarm(tab)).to_be_hidden()
    green = held.evaluate(MARK)
    expect(mode).to_have_css("color", green)
    client.result("sim.fault", name="weak")
    for shown in (tab, opened(window, looking)):
        told = "WEAK MOTOR: holds with less than was asked for"
        expect(alarm(shown)).to_have_text(told)
        expect(part(shown, "mode")).not_to_have_css("color", green)
        assert part(shown, "held").evaluate(MARK) != green
    client.result("sim.fault", name="none")
    expect(alarm(tab)).to_be_hidden()
    expect(mode).to_have_css("color", green)
    assert held.evaluate(MARK) == green


def test_an_object_that_nobody_holds_is_not_said_to_be_none(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    client.result("sim.object", width_mm=OBJECT_MM)
    tab = opened(window, looking)
    expect(tab.locator(".jaws .item")).to_be_visible()
    expect(part(tab, "held")).to_have_text("nothing held")
