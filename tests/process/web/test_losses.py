"""What was held and is no more, or with too little: the page says so, and claims no hold."""

import contextlib
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client, DaemonProcess
from tests.process.restarting import held, restartable
from tests.process.web.on_page import (
    OBJECT_MM,
    button,
    enable,
    fact,
    grasp,
    opened,
    part,
    take_control,
    teach,
)
from tests.process.web.page_process import Page, mortal, page

BACK = "(node) => getComputedStyle(node).backgroundColor"


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
        (lambda client: client.result("sim.fault", name="silent"), ", MOTOR SILENT"),
        (power_fails_for_a_moment, ""),
    ],
    ids=["overload", "silent", "power"],
)
def test_what_a_fault_lets_go_is_said_until_it_is_read_or_the_next_motion_begins(
    window: BrowserContext, looking: Page, client: Client, let_go: Any, also: str
) -> None:
    grasp(client)
    tab = opened(window, looking)
    expect(alarm(tab)).to_be_hidden()
    let_go(client)
    what = r"what was held with 10 N, at \d\d\.\d mm, "
    advice = (
        r"(remove what .* \(“Enable”\): the motor reports overload"
        r"|the motor (does not answer: check|reports that it is off).*)"
    )
    again = "(“Enable”, )?“Open”, then “Grasp” again; "
    told = rf"LET GO: ({advice}; {what}(has been|must be taken)|{again}{what}was let go)"
    past = r"was let go( by a fault \([a-z ]+\)|: the motor (did not answer|was off, which .*))"
    second = opened(window, looking)  # which knows it from the events of before
    for shown in (tab, second):
        expect(alarm(shown)).to_have_text(f"LET GO{also}")
        expect(toasts(shown)).to_have_text([re.compile(told)])
        expect(part(shown, "lost")).to_have_text("LET GO")
        expect(part(shown, "lost-text")).to_contain_text("what was held with 10 N")
    button(second, "Read").click()
    expect(alarm(second)).not_to_contain_text("LET GO")
    expect(part(second, "lost")).to_be_hidden()
    expect(toasts(second)).to_have_count(0)
    expect(alarm(tab)).to_have_text(f"LET GO{also}")
    client.result("sim.fault", name="none")
    client.until(lambda state: bool(state["motor"] == "disabled"))
    for method in ("clear_fault", "enable", "disable", "enable"):  # none of them moves the jaws
        client.despite_silence(f"motor.{method}")
    for method in ("hold", "zero_gravity"):
        client.despite_silence(f"motion.{method}")
    job = client.result("job.list")["jobs"][-1]["job"]
    expect(part(tab, "events")).to_contain_text(f"job {job}, zero_gravity")
    expect(alarm(tab)).to_have_text("LET GO")
    expect(toasts(tab)).to_have_text([re.compile(f"LET GO: {again}{what}{past}Read$")])
    expect(part(tab, "lost-text")).to_have_text(re.compile(f"{past}\\.$"))
    expect(part(tab, "lost")).to_be_visible()
    client.despite_silence("motion.open")
    for shown in (tab, second):
        expect(alarm(shown)).to_be_hidden()
        expect(toasts(shown)).to_have_count(0)
        expect(part(shown, "lost")).to_be_hidden()


def test_a_page_that_is_opened_later_tells_of_no_loss_from_before_the_last_motion(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    """The events that are kept do not reach back to that motion; what was lost is kept longer."""
    grasp(client)
    client.result("sim.object")
    client.until(lambda state: state["is_grasped"] is False)
    expect(part(opened(window, looking), "lost")).to_be_visible()
    client.despite_silence("motion.open")
    for _ in range(40):
        client.despite_silence("motion.hold")
    later = opened(window, looking)
    expect(part(later, "held")).to_have_text("nothing held")
    expect(part(later, "lost")).to_be_hidden()


def test_a_replay_that_is_refused_takes_no_loss_away_and_one_that_moves_does(
    window: BrowserContext, operating: Page, operated: Tab, client: Client
) -> None:
    teach(operated, client, "part")
    button(operated, "Give control back").click()
    expect(button(operated, "Take control")).to_be_visible()
    grasp(client)
    client.result("sim.fault", name="overload")
    expect(alarm(operated)).to_have_text("LET GO, FAULT: overload")
    client.result("sim.fault", name="none")
    client.result("sim.object")
    enable(operated, client)
    part(operated, "name").fill("there is none")
    button(operated, "Replay").click()
    seen = toasts(operated).filter(visible=True)
    expect(toasts(operated)).to_contain_text(["replay: ", "LET GO: "])
    expect(part(operated, "events")).to_contain_text("play: ")  # that it was refused
    expect(seen).to_contain_text(["LET GO: "])
    expect(alarm(operated)).to_have_text("LET GO")
    part(operated, "name").fill("part")
    part(operated, "speed").fill("0.1")
    button(operated, "Replay").click()
    expect(alarm(operated)).to_be_hidden()
    expect(toasts(operated)).to_have_count(0)
    assert client.result("state.get")["job"] is not None  # as soon as it moves
    client.until(lambda state: state["job"] is None)
    assert client.result("job.list")["jobs"][-1]["state"] == "done"
    later = opened(window, operating)  # which knows it from the events alone
    expect(part(later, "held")).to_have_text("nothing held")
    expect(alarm(later)).to_be_hidden()


def test_a_loss_is_seen_in_the_place_of_what_a_key_was_refused_for_later(
    operated: Tab, client: Client
) -> None:
    grasp(client)
    client.result("sim.fault", name="overload")
    expect(alarm(operated)).to_have_text("LET GO, FAULT: overload")
    operated.keyboard.press("o")
    expect(toasts(operated)).to_have_count(2)
    seen = toasts(operated).filter(visible=True)
    expect(seen).to_contain_text(["LET GO: remove what loads the jaws, then enable again"])
    take_control(operated)
    expect(toasts(operated)).to_have_count(1)
    button(operated, "Enable").click()
    part(operated, "name").fill("a/b")  # no name
    button(operated, "Teach").click()
    expect(toasts(operated)).to_have_count(2)
    expect(seen).to_contain_text(["LET GO: “Open”, then “Grasp” again; what was held"])
    expect(seen).to_have_css(
        "background-color", alarm(operated).locator(".loud").first.evaluate(BACK)
    )


def test_what_has_no_room_in_the_head_is_shown_as_long_as_somebody_wants_to_read_it(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    client.result("sim.fault", name="silent")
    said = part(tab, "said")
    expect(said).to_contain_text("must be taken for let go")
    said.click()
    expect(said).to_have_attribute("aria-expanded", "true")
    later_s = client.result("state.get")["monotonic_s"] + 0.5
    client.until(lambda state: bool(state["monotonic_s"] > later_s))
    expect(said).to_have_attribute("aria-expanded", "true", timeout=1)
    said.click()
    expect(said).to_have_attribute("aria-expanded", "false")
    client.result("sim.fault", name="none")


def test_of_a_lost_object_no_hold_is_claimed_once_the_motor_is_off(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    client.result("sim.object")
    said = part(tab, "said")
    again = "“Open”, then “Grasp” again; the object is lost"
    expect(said).to_have_text(
        re.compile(rf"At \S+: {again}: the jaws closed on, and hold where they are\.")
    )
    client.despite_silence("motion.zero_gravity")
    expect(said).to_have_text(re.compile(rf"^\s*At \S+: {again}\.\s*$"))
    client.despite_silence("motor.disable")
    expect(said).to_have_text(re.compile(rf"^\s*At \S+: “Enable”, {again}\.\s*$"))
    client.result("sim.fault", name="overload")
    whole = r"^\s*At \S+: the object is lost\.\s+Remove what .*: the motor reports overload"
    expect(said).to_have_text(re.compile(whole))
    client.result("stop", level="hold")
    expect(said).to_have_text(
        re.compile(r"^\s*At \S+: the object is lost\. Stopped .*\. Remove what loads the jaws")
    )


WEAK_FIGURES = re.compile(r"; it makes 0\.\d\d of the commanded \d\.\d\d N·mRead$")
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
        told = "WEAK MOTOR: makes less than was asked for"
        expect(alarm(shown)).to_have_text(told)
        now = "WEAK MOTOR: support what is held, it may slip; check the supply's voltage"
        expect(toasts(shown)).to_contain_text([now])
        expect(toasts(shown)).to_have_text([WEAK_FIGURES])
        expect(part(shown, "mode")).not_to_have_css("color", green)
        expect(part(shown, "mode")).to_have_text("holding weakly")
        expect(shown.locator(".jaw.holds").first).not_to_have_css("fill", green)
        assert part(shown, "held").evaluate(MARK) != green
    client.result("sim.fault", name="none")
    expect(alarm(tab)).to_be_hidden()
    expect(toasts(tab)).to_have_count(0)
    expect(mode).to_have_css("color", green)
    expect(mode).to_have_text("holding")
    expect(tab.locator(".jaw.holds").first).to_have_css("fill", green)
    assert held.evaluate(MARK) == green


def test_a_weak_motor_that_holds_nothing_has_nothing_to_be_supported(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    client.result("sim.fault", name="weak")
    expect(toasts(tab)).to_contain_text(["support what is held"])
    client.despite_silence("motion.open")
    expect(part(tab, "held")).to_have_text("nothing held")
    expect(toasts(tab)).to_contain_text(["WEAK MOTOR: check the supply's voltage"])
    button(tab, "Read").click()
    expect(toasts(tab)).to_have_count(0)
    client.despite_silence("motion.grasp", until="verdict")
    expect(toasts(tab)).to_contain_text(["WEAK MOTOR: support what is held"])  # which is new
    client.result("sim.fault", name="none")


def test_a_force_that_heat_has_lowered_is_said_while_it_is_so_and_its_hold_is_not_green(
    window: BrowserContext, tmp_path: Path
) -> None:
    with (
        mortal(tmp_path, "hot") as (_, daemon, running),  # it stays hot for long
        daemon.connect() as client,
    ):
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        grasp(client, force_n=30)
        tab = opened(window, running)
        held, mode, bar = part(tab, "held"), part(tab, "mode"), tab.locator("header")
        expect(held).to_have_text("object detected")
        green, before = held.evaluate(MARK), bar.bounding_box()
        expect(mode).to_have_css("color", green)
        client.result("sim.heat", coil_c=79)
        phone = opened(window, running)
        phone.set_viewport_size({"width": 390, "height": 844})
        for shown in (phone, tab):
            shown.bring_to_front()
            expect(alarm(shown)).to_have_text("FORCE LOWERED BY HEAT")
            expect(alarm(shown)).to_be_in_viewport(ratio=1)
            said = toasts(shown).locator("span")
            expect(said).to_contain_text(["support what is held, it may slip, and set less force"])
            assert said.evaluate("(node) => node.scrollHeight <= node.clientHeight")
            expect(part(shown, "mode")).not_to_have_css("color", green)
            assert part(shown, "held").evaluate(MARK) != green
        assert bar.bounding_box() == before
        button(tab, "Read").click()
        expect(toasts(tab)).to_have_count(0)
        expect(alarm(tab)).to_have_text("FORCE LOWERED BY HEAT")
        client.result("motion.set_force", force_n=5)
        expect(alarm(tab)).to_be_hidden()
        expect(toasts(phone)).to_have_count(0)
        expect(mode).to_have_css("color", green)
        assert held.evaluate(MARK) == green


def test_jaws_that_are_pushed_open_are_not_said_to_hold_until_they_are_back(
    operated: Tab, client: Client
) -> None:
    tab = operated
    enable(tab, client)
    client.result("sim.object", width_mm=OBJECT_MM)
    button(tab, "Grasp").click()
    held, mode, outcome = part(tab, "held"), part(tab, "mode"), part(tab, "outcome")
    expect(outcome).to_contain_text("grasp: object held")
    expect(mode).to_have_text("holding")
    green = held.evaluate(MARK)
    for is_there in (True, False):
        client.result("sim.push", torque_nm=-3)
        expect(mode).to_have_text("pushed open")
        expect(mode).not_to_have_css("color", green)
        expect(held).to_have_text("object?")
        assert held.evaluate(MARK) != green
        expect(tab.locator(".jaws .holds")).to_have_count(0)
        expect(part(tab, "slider-text")).to_have_text("held or not?")
        expect(part(tab, "why")).to_contain_text("pushed the jaws open")
        expect(fact(tab, "On the object")).to_have_text("--")
        expect(outcome).to_have_text("")
        assert client.result("state.get")["is_grasped"]
        if not is_there:
            client.result("sim.object")
        client.result("sim.push", torque_nm=0)
        if is_there:
            expect(held).to_have_text("object detected")
            expect(fact(tab, "On the object")).to_contain_text(" N by the motor")
            expect(mode).to_have_css("color", green)
    expect(alarm(tab)).to_have_text("OBJECT LOST")
    expect(toasts(tab)).to_contain_text(["OBJECT LOST"])  # and no push
    expect(mode).to_have_text("still")


def test_that_the_jaws_are_pushed_open_stands_in_the_bar_and_afterwards_that_they_were(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab, other = opened(window, looking), opened(window, looking)
    told = "PUSHED OPEN: look whether what the jaws gripped is still between them"
    past = "The jaws were pushed open: look if what they gripped is still held"
    for one in (tab, other):
        expect(part(one, "held")).to_have_text("object detected")
    client.result("sim.push", torque_nm=-3)
    for one in (tab, other):
        one.bring_to_front()
        one.evaluate("scrollTo(0, document.body.scrollHeight)")
        expect(alarm(one)).to_have_text("PUSHED OPEN")
        expect(alarm(one)).to_be_in_viewport(ratio=1)
        expect(alarm(one).locator(".loud")).to_have_count(0)
        expect(toasts(one)).to_contain_text([told])
    button(other, "Read").click()
    expect(toasts(other)).to_have_count(0)
    expect(alarm(other)).to_have_text("PUSHED OPEN")
    client.result("sim.push", torque_nm=0)
    for one in (tab, other):
        expect(part(one, "held")).to_have_text("object detected")
        expect(alarm(one)).to_be_hidden()
    expect(toasts(tab)).to_contain_text([past])
    expect(toasts(other)).to_have_count(0)
    client.result("sim.push", torque_nm=-3)
    for one in (tab, other):
        expect(toasts(one)).to_contain_text([told])
    client.result("sim.push", torque_nm=0)
    for one in (tab, other):
        expect(toasts(one)).to_contain_text([past])
    button(tab, "Read").click()
    expect(toasts(tab)).to_have_count(0)
    client.despite_silence("motion.open")
    expect(toasts(other)).to_have_count(0)


def test_a_page_that_is_opened_then_says_too_that_the_jaws_are_pushed_open(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    tab = opened(window, looking)
    grasp(client)
    expect(part(tab, "mode")).to_have_text("holding")
    tab.wait_for_timeout(1500)  # until litegripd-web has kept a batch of it
    client.result("sim.push", torque_nm=-3)
    client.until(lambda state: bool(state["opening_mm"] > 80))
    expect(part(opened(window, looking), "mode")).to_have_text("pushed open")
    client.result("sim.push", torque_nm=0)


def test_a_soft_object_that_springs_back_from_a_lowered_force_pushes_nothing_open(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    client.despite_silence("motion.open")
    client.result("sim.object", width_mm=60, stiffness_nm_rad=20)
    assert client.result("motion.grasp", force_n=40, until="verdict")["ok"]
    tab = opened(window, looking)
    expect(part(tab, "held")).to_have_text("object detected")
    squeezed_mm = client.until(lambda state: bool(state["force_n"] > 39))["opening_mm"]
    expect(fact(tab, "Force")).to_have_text(re.compile("^(39|40)"))  # the page has seen it, too
    client.result("motion.set_force", force_n=1)
    client.until(lambda state: bool(state["opening_mm"] > squeezed_mm + 7))
    tab.wait_for_timeout(1000)
    expect(part(tab, "mode")).to_have_text("holding")
    expect(part(tab, "held")).to_have_text("object detected")


def test_jaws_with_nothing_between_them_are_still_and_not_said_to_hold(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    tab = opened(window, looking)
    client.despite_silence("motor.enable")
    mode = part(tab, "mode")
    expect(mode).to_have_text("still")
    still = mode.evaluate("(node) => getComputedStyle(node).color")
    grasp(client)
    expect(mode).to_have_text("holding")
    expect(mode).not_to_have_css("color", still)
    client.result("sim.object")
    expect(part(tab, "lost")).to_be_visible()
    expect(mode).to_have_text("still")


def test_an_object_that_nobody_holds_is_not_said_to_be_none(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    client.result("sim.object", width_mm=OBJECT_MM)
    tab = opened(window, looking)
    expect(tab.locator(".jaws .item")).to_be_visible()
    expect(part(tab, "held")).to_have_text("nothing held")


@pytest.mark.parametrize("size", [(1400, 900), (360, 740)], ids=["wide", "phone"])
def test_what_came_of_a_stop_is_said_before_the_loss_is_again(
    operated: Tab, client: Client, size: tuple[int, int]
) -> None:
    operated.set_viewport_size({"width": size[0], "height": size[1]})
    grasp(client)
    expect(part(operated, "held")).to_have_text("object detected")
    client.result("sim.fault", name="overload")
    expect(toasts(operated)).to_contain_text(["LET GO"])
    expect(toasts(operated)).to_be_visible()
    operated.keyboard.press("Escape")
    said = operated.locator("#notice")
    expect(said).to_be_visible()
    expect(said).to_have_text("Stopped. Nothing moves until it is cleared.")
    assert said.evaluate("(node) => node.clientWidth") > 60
    expect(toasts(operated)).to_be_visible()
    expect(said).to_be_hidden()


@contextlib.contextmanager
def ready(daemon: DaemonProcess) -> Iterator[Client]:
    """Connect to a daemon, and wait until its gripper can be used."""
    with daemon.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        yield client


@pytest.mark.parametrize("how", ["kill", "end"])
def test_what_a_daemon_has_taken_with_it_is_said_until_it_is_read_or_the_next_motion(
    window: BrowserContext, tmp_path: Path, how: str
) -> None:
    told = "the daemon was restarted: what was held was let go, the stop is gone"
    again = "“Enable”, “Open”, then “Grasp” again"
    with mortal(tmp_path, "gone") as (run, daemon, shown), contextlib.ExitStack() as clients:
        client = clients.enter_context(ready(daemon))
        grasp(client)
        tab, other = opened(window, shown), opened(window, shown)
        take_control(tab)
        client.result("stop", level="hold")
        for one in (tab, other):
            expect(part(one, "mode")).to_have_text("STOPPED")
        getattr(daemon, how)()
        expect(part(tab, "mode")).to_have_text("no daemon")
        for one in (tab, other):
            expect(alarm(one)).to_have_text("LET GO, NO DAEMON")
            expect(part(one, "lost-text")).to_contain_text("no daemon: what was held must be taken")
        expect(toasts(other)).to_contain_text(["LET GO: no daemon"])
        client = clients.enter_context(ready(run()))
        taken = f"“Take control”, {again}; {told}, you no longer have control."
        expect(toasts(tab)).to_contain_text([taken])
        expect(toasts(other)).to_contain_text([f"{told}."])
        for one in (tab, other):
            expect(alarm(one)).to_have_text("LET GO")
            expect(part(one, "lost-text")).to_contain_text("what was held was let go.")
        take_control(tab)
        expect(toasts(tab)).to_contain_text([f"{again}; {told}."])
        button(other, "Read").click()
        expect(toasts(other)).to_have_count(0)
        expect(alarm(other)).to_be_hidden()
        button(tab, "Enable").click()
        expect(part(tab, "outcome")).to_have_text("enable: done")
        expect(toasts(tab)).to_contain_text([f"{told}."])
        client.result("stop", level="hold")
        expect(toasts(tab)).to_contain_text([re.compile("what was held was let go.Read$")])
        client.result("stop.clear")
        button(tab, "Open").click()
        expect(toasts(tab)).to_have_count(0)
        expect(alarm(tab)).to_be_hidden()


def test_what_led_to_the_end_of_a_daemon_is_there_when_the_next_one_has_begun(
    window: BrowserContext, tmp_path: Path
) -> None:
    with mortal(tmp_path, "before") as (run, daemon, shown), contextlib.ExitStack() as clients:
        client = clients.enter_context(ready(daemon))
        tab = opened(window, shown)
        client.result("stop", level="hold", why="a hand is in it")
        events = part(tab, "events")
        expect(events).to_contain_text("a hand is in it")
        ended = time.strftime("%H:%M:%S")
        daemon.kill()
        expect(part(tab, "mode")).to_have_text("no daemon")
        clients.enter_context(ready(run()))
        expect(part(tab, "mode")).to_have_text("disabled")
        expect(events).to_contain_text("a hand is in it")
        plot = tab.locator(".plots .u-over").first
        plot.hover(position={"x": 1, "y": 20})  # the first moment that is drawn is told then
        first = tab.locator(".plots .u-legend .u-value").first
        expect(first).to_have_text(re.compile(r"\d\d:\d\d:\d\d"))
        assert first.inner_text() <= ended


def test_what_another_program_lets_go_of_by_disabling_is_lost(
    operated: Tab, client: Client
) -> None:
    """As a script does at its end, behind a stop, too."""
    grasp(client)
    expect(part(operated, "held")).to_have_text("object detected")
    client.result("stop", level="hold")
    expect(part(operated, "mode")).to_have_text("STOPPED")
    client.result("motor.disable")
    expect(alarm(operated)).to_have_text("LET GO, STOPPED")
    told = re.compile(
        r"“Enable”, “Open”, then “Grasp” again; what was held was let go: disabled by "
    )
    expect(part(operated, "lost-text")).to_have_text(told)
    client.result("stop.clear")
    client.despite_silence("motor.enable")
    client.despite_silence("motion.open")
    expect(alarm(operated)).to_be_hidden()


def test_what_is_let_go_by_the_pages_own_button_is_no_loss(operated: Tab, client: Client) -> None:
    enable(operated, client)
    client.result("sim.object", width_mm=OBJECT_MM)
    button(operated, "Grasp").click()
    expect(part(operated, "held")).to_have_text("object detected")
    button(operated, "Disable").click()
    expect(part(operated, "mode")).to_have_text("disabled")
    expect(alarm(operated)).to_be_hidden()


@pytest.mark.parametrize("is_over", [False, True])
def test_a_recording_that_a_daemon_took_with_it_is_said_and_offered_no_more(
    window: BrowserContext, tmp_path: Path, is_over: bool
) -> None:
    with mortal(tmp_path, "taught") as (run, daemon, shown), contextlib.ExitStack() as clients:
        client = clients.enter_context(ready(daemon))
        tab = opened(window, shown)
        enable(tab, client)
        button(tab, "Teach").click()
        client.until(lambda _state: client.result("trajectory.status")["samples"] > 20)
        if is_over:
            client.result("stop", level="hold")
            expect(toasts(tab)).to_contain_text([re.compile("The recording was broken off")])
        daemon.end()
        expect(toasts(tab)).to_contain_text(["The recording is lost: the daemon has ended."])
        assert re.search(r"a recording of \d+ samples is lost: nobody", daemon.log)
        client = clients.enter_context(ready(run()))
        what = "the stop is gone, the recording is lost" if is_over else "the recording is lost"
        told = f"The daemon was restarted: {what}, you no longer have control."
        expect(toasts(tab)).to_contain_text([told])
        expect(toasts(tab)).to_have_count(1)
        take_control(tab)
        expect(toasts(tab)).to_contain_text([f"{what}."])
        button(tab, "Enable").click()
        client.until(lambda state: bool(state["enabled"]))
        button(tab, "Teach").click()
        expect(button(tab, "End and keep")).to_be_visible()
        expect(toasts(tab).filter(has_text="the recording is lost")).to_have_count(0)


def test_control_that_ended_with_litegripd_web_is_said_to_be_gone(
    window: BrowserContext, client: Client, place: Path, tmp_path: Path
) -> None:
    secret = tmp_path / "secret"
    options = ("--socket", str(place), "--operate", "--token-file", str(secret))
    with page(*options) as first:
        first.told = f"{first.url}#{secret.read_text().strip()}"
        tab, other = opened(window, first), opened(window, first)
        grasp(client)
        take_control(tab)
        expect(part(other, "held")).to_have_text("object detected")
    expect(part(tab, "mode")).to_have_text("no connection")
    with page(*options, f"--port={first.port}"):
        told = "The connection to litegripd-web was cut: you no longer have control."
        expect(toasts(tab)).to_contain_text([told])
        expect(part(other, "held")).to_have_text("object detected")
        expect(toasts(other)).to_have_count(0)
        expect(alarm(tab)).to_be_hidden()
        take_control(tab)
        expect(toasts(tab)).to_have_count(0)


def test_a_loss_is_said_while_litegripd_web_is_gone(
    window: BrowserContext, client: Client, place: Path
) -> None:
    with page("--socket", str(place), "--operate") as running:
        tab = opened(window, running)
        grasp(client)
        client.result("sim.object")
        expect(part(tab, "lost")).to_have_text("OBJECT LOST")
    expect(part(tab, "mode")).to_have_text("no connection")
    expect(part(tab, "lost")).to_have_text("OBJECT LOST")
    expect(alarm(tab)).to_have_text("OBJECT LOST, NO CONNECTION")
    tried = "() => new Promise((done) => setTimeout(done, 2500))"  # to connect again
    tab.evaluate(tried)
    expect(part(tab, "lost")).to_be_visible(timeout=1)
    expect(tab.locator("article")).to_have_class(re.compile("has-lost"), timeout=1)


def test_a_motion_whose_answer_a_cut_connection_took_is_said_to_be_that(
    window: BrowserContext, client: Client, place: Path
) -> None:
    with page("--socket", str(place), "--operate") as running:
        tab = opened(window, running)
        enable(tab, client)
        part(tab, "speed").fill("5")
        button(tab, "Close").click()
        client.until(lambda state: bool(state["mode"] == "moving"))
    told = "close: the connection was cut before it was answered: look where the jaws are"
    expect(toasts(tab).filter(has_text=told)).to_have_count(1)
    expect(toasts(tab).filter(has_text="Start litegripd-web again")).to_have_count(1)


KEEP_WHAT_IS_SAID = """
() => {
  window.said = [];
  new MutationObserver(() => window.said.push(document.body.innerText))
    .observe(document.body, {childList: true, characterData: true, subtree: true});
}
"""


def test_a_daemon_that_was_restarted_while_the_jaws_hold_has_let_go_of_nothing(
    window: BrowserContext, tmp_path: Path
) -> None:
    with restartable(tmp_path) as daemon, daemon.connect() as client:
        held(client)
        socket_path = str(daemon.first.socket_path)
        with page("--socket", socket_path, "--operate") as running:
            tab, other = opened(window, running), opened(window, running)
            take_control(tab)
            other.evaluate(KEEP_WHAT_IS_SAID)
            tab.evaluate(KEEP_WHAT_IS_SAID)
            daemon.restart_at_last(client)
            told = re.compile("you no longer have control", re.IGNORECASE)
            expect(toasts(tab).filter(has_text=told)).to_have_count(1)  # by whom, who is first says
            expect(part(other, "mode")).not_to_have_text("no daemon")
            expect(toasts(other).filter(has_text="restarted")).to_have_count(0)
            why = "A new daemon has taken the gripper over: you no longer have control."
            expect(toasts(tab).filter(has_text=why)).to_have_count(1)
            for shown in (tab, other):
                said = " ".join(shown.evaluate("window.said"))
                assert not re.search("no daemon|start the daemon|connect again", said, re.I)
            take_control(tab)
            expect(toasts(tab).filter(has_text=why)).to_have_count(0)
