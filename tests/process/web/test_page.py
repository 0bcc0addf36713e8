"""The page in a real browser: what is seen on it, and what is done."""

import contextlib
import json
import re
import signal
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import BrowserContext, expect
from playwright.sync_api import Page as Tab

from litegrip_client.values.voices import CALLS
from tests.process.daemon_process import Client, DaemonProcess, configured, daemon
from tests.process.web.on_page import (
    KEEP_WHAT_IS_SENT,
    OBJECT_MM,
    button,
    called_well,
    correct_the_scale,
    drag,
    enable,
    fact,
    grasp,
    kinds_since,
    opened,
    part,
    places,
    sent,
    take_control,
    teach,
    wait_until_it_fits,
)
from tests.process.web.page_process import CHANNEL, Page, page, welcome

STROKE_MM = 85.0
"""What is configured, if nothing else is said."""


MISSED = "NOT STOPPED: press STOP again."


def near(text: str, value: float, within: float) -> bool:
    return abs(float(text.split(maxsplit=1)[0]) - value) <= within


def test_a_grasp_of_another_program_is_watched(shown: Tab, client: Client) -> None:
    grasp(client, 12.0)
    expect(part(shown, "mode")).to_have_text("holding")
    expect(part(shown, "why")).not_to_contain_text("held")  # that is said beside it
    expect(part(shown, "held")).to_have_text("object detected")
    expect(fact(shown, "Set force")).to_have_text("12.0 N")
    expect(fact(shown, "On the object")).to_contain_text("to")
    where = "(node) => node.getBoundingClientRect().x"
    names = [shown.locator(f"dt:text-is('{name}')") for name in ("Opening", "On the object")]
    assert names[0].evaluate(where) == names[1].evaluate(where)  # each begins a row
    assert near(fact(shown, "Opening").inner_text(), OBJECT_MM, 1.0)
    line = part(shown, "events").locator("li", has_text="grasp: object held")
    expect(line.first).to_contain_text("12.0 N")
    jaws = shown.locator("svg.jaws")
    expect(jaws).to_have_attribute("aria-label", re.compile("something is held"))
    left, right = (jaws.locator(".jaw").nth(index).bounding_box() for index in (0, 1))
    rail = jaws.locator(".rail").bounding_box()
    assert left is not None
    assert right is not None
    assert rail is not None
    # To scale: the rail is as wide as the travel and the two fingers, but for its margins.
    travel_mm = client.result("calibration.get")["travel_mm"]
    mm = rail["width"] / (travel_mm + 2 * 12 + 4)
    assert (right["x"] - left["x"] - left["width"]) / mm == pytest.approx(OBJECT_MM, abs=1.5)


def test_who_only_looks_finds_nothing_to_act_with_but_the_stop(shown: Tab, client: Client) -> None:
    for name in ("Take control", "Enable", "Open", "Grasp", "Put in"):
        expect(button(shown, name)).to_be_hidden()
    expect(part(shown, "slider")).to_be_disabled()
    shown.keyboard.press("o")
    shown.get_by_role("button", name="STOP Esc").click()
    stopped = part(shown, "stopped")
    told = r"^Stopped at [0-9:]{8} by STOP on the page\. "
    cleared = r"Nothing moves until it is cleared \('litegripctl clear'\)\.$"
    expect(stopped).to_have_text(re.compile(told + cleared))
    expect(button(shown, "Clear the stop")).to_be_hidden()
    state = client.result("state.get")
    assert state["stop"]["level"] == "hold"
    assert state["job"] is None


def test_control_is_taken_kept_and_given_back(operated: Tab, client: Client) -> None:
    expect(button(operated, "Disable")).to_be_disabled()
    expect(part(operated, "to-use")).to_have_text("to use what is below")
    take_control(operated)
    expect(part(operated, "to-use")).to_have_text("“Enable” first")
    owner = client.result("lease.get")["owner"]
    assert owner["purpose"] == "the page in a browser"
    assert owner["ttl_s"] == 3
    assert client.refusal("motor.enable") == "lease_held"
    expect(fact(operated, "Lease")).to_contain_text("the page in a browser")
    button(operated, "Give control back").click()
    expect(button(operated, "Disable")).to_be_disabled()
    expect(fact(operated, "Lease")).to_have_text("free")
    assert client.result("lease.get")["owner"] is None


def test_control_ends_when_nobody_sees_the_page(operated: Tab, client: Client) -> None:
    take_control(operated)
    longer_s = client.result("state.get")["monotonic_s"] + 4  # than the lease lives by itself
    client.until(lambda state: bool(state["monotonic_s"] > longer_s))
    assert client.result("lease.get")["owner"] is not None
    hidden = "{get: () => true, configurable: true}"
    operated.evaluate(f"Object.defineProperty(document, 'hidden', {hidden})")
    client.until(lambda _state: client.result("lease.get")["owner"] is None)
    operated.evaluate("delete document.hidden")
    expect(part(operated, "outcome")).to_have_text(
        "You no longer have control: the page was hidden or cut off, or the daemon stood still"
    )


def test_control_of_another_program_can_be_taken_over(operated: Tab, client: Client) -> None:
    client.result("lease.acquire", purpose="a script")
    expect(fact(operated, "Lease")).to_contain_text("a script")
    expect(button(operated, "Take control")).to_be_hidden()
    button(operated, "Take it over").click()
    expect(button(operated, "Disable")).to_be_enabled()
    assert client.refusal("motion.hold") == "lease_lost"
    client.result("lease.take", why="I need it")
    expect(button(operated, "Disable")).to_be_disabled()
    for told in (part(operated, "outcome"), operated.locator("#toasts")):
        expect(told).to_contain_text(re.compile(r"python took control: I need it(Read)?$"))
    operated.keyboard.press("o")  # with the words of the button that there is
    expect(part(operated, "outcome")).to_have_text("open: press “Take it over” first")


def test_the_slider_moves_the_jaws(operated: Tab, client: Client) -> None:
    enable(operated, client)
    slider = part(operated, "slider")
    slider.fill("80")
    state = client.until(lambda state: state["job"] is None and state["opening_mm"] > 79)
    assert state["opening_mm"] == pytest.approx(80, abs=1)
    expect(part(operated, "outcome")).to_contain_text("move: ")
    slider.press("ArrowLeft")
    client.until(lambda state: bool(state["opening_mm"] < 79.8))


def test_the_slider_follows_other_motions_while_it_has_the_focus(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    slider = part(operated, "slider")
    slider.fill("25")
    client.until(lambda state: state["job"] is None and state["opening_mm"] < 26)
    expect(slider).to_be_focused()
    operated.keyboard.press("o")
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    expect(part(operated, "slider-text")).to_have_text(re.compile(r"^(79\.5|80\.0|80\.5) mm$"))
    operated.keyboard.press("ArrowLeft")
    expect(part(operated, "outcome")).to_contain_text("move: reached")
    assert client.result("state.get")["opening_mm"] > 78
    box = slider.bounding_box()
    assert box is not None
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    operated.mouse.move(*middle)
    operated.mouse.down()
    expect(part(operated, "slider-text")).to_have_text(re.compile("^4"))
    operated.keyboard.press("c")
    client.until(lambda state: bool(state["opening_mm"] < 1))
    expect(part(operated, "slider-text")).to_have_text(re.compile("^4"))  # it is dragged
    operated.mouse.up()
    client.until(lambda state: state["job"] is None and state["opening_mm"] > 40)
    operated.mouse.down()
    operated.mouse.move(middle[0] + 60, middle[1], steps=3)
    operated.mouse.move(*middle, steps=3)
    operated.mouse.up()  # nothing has changed
    operated.keyboard.press("o")
    expect(part(operated, "slider-text")).to_have_text(re.compile(r"^(79\.5|80\.0|80\.5) mm$"))


UNDONE = "move: not done, the slider was not let go: drag it again"


def drag_the_slider(tab: Tab, share: float) -> None:
    """Drag it to a share of its length, and do not let it go."""
    box = part(tab, "slider").bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    tab.mouse.move(box["x"] + box["width"] / 2, y)
    tab.mouse.down()
    tab.mouse.move(box["x"] + box["width"] * share, y, steps=5)


def test_a_slider_that_is_dragged_while_something_is_gripped_drops_nothing(
    operated: Tab, client: Client
) -> None:
    client.result("sim.object", width_mm=OBJECT_MM)
    enable(operated, client)
    operated.keyboard.press("o")
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    drag_the_slider(operated, 0.8)
    operated.keyboard.press("g")
    expect(part(operated, "slider")).to_be_disabled()
    expect(part(operated, "outcome")).to_have_text(UNDONE)
    operated.mouse.up()
    expect(part(operated, "held")).to_have_text("object detected")
    state = client.result("state.get")
    assert (state["is_grasped"], state["job"]) == (True, None)
    assert client.result("job.list")["jobs"][-1]["kind"] == "grasp"


def test_a_slider_that_loses_the_focus_while_it_is_dragged_moves_nothing(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    drag_the_slider(operated, 0.8)
    operated.keyboard.press("Tab")
    expect(part(operated, "outcome")).to_have_text(UNDONE)
    operated.mouse.up()
    drag_the_slider(operated, 0.7)
    operated.mouse.up()
    expect(part(operated, "outcome")).to_have_text("move: reached")
    assert kinds_since(client, before) == ["move"]


def test_a_key_presses_no_button_that_was_clicked_before(operated: Tab, client: Client) -> None:
    client.result("sim.object", width_mm=OBJECT_MM)
    enable(operated, client)
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    operated.keyboard.press("g")
    expect(part(operated, "outcome")).to_contain_text("grasp: object held")
    jobs = client.result("job.list")["jobs"]
    for key in ("Space", "Enter", "Shift+O"):
        operated.keyboard.press(key)
    operated.keyboard.press("h")
    expect(part(operated, "outcome")).to_have_text("hold: done")
    assert client.result("state.get")["is_grasped"]
    assert set(kinds_since(client, jobs)) <= {"hold"}


def test_keys_move_and_escape_stops_a_motion(operated: Tab, client: Client) -> None:
    enable(operated, client)
    operated.keyboard.press("o")
    client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "open"))
    operated.keyboard.press("Escape")
    state = client.until(lambda state: state["stop"] is not None)
    assert state["opening_mm"] < 79
    expect(part(operated, "stopped")).to_be_visible()
    expect(part(operated, "mode")).to_have_text("STOPPED")
    expect(operated.locator("#notice")).to_have_text(re.compile("^Stopped"))
    expect(button(operated, "Close")).to_be_disabled()
    operated.keyboard.press("c")
    assert client.result("state.get")["job"] is None
    button(operated, "Clear the stop").click()
    expect(part(operated, "stopped")).to_be_hidden()
    operated.keyboard.press("c")
    client.until(lambda state: bool(state["opening_mm"] < 1))


def test_a_letter_in_a_field_is_a_letter(operated: Tab, client: Client) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    part(operated, "name").fill("")
    part(operated, "name").press_sequentially("coge")
    expect(part(operated, "name")).to_have_value("coge")
    assert client.result("job.list")["jobs"] == before


def test_control_that_is_taken_by_two_clicks_is_not_given_back(
    operated: Tab, client: Client
) -> None:
    take = button(operated, "Take control")
    box = take.bounding_box()
    assert box is not None
    at = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    operated.mouse.click(*at)
    give = button(operated, "Give control back")
    expect(give).to_be_visible()
    operated.mouse.click(*at)
    button(operated, "Enable").click()
    client.until(lambda state: bool(state["enabled"]))
    give.dblclick()
    expect(take).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)


def test_the_keys_that_scroll_move_no_jaws(operated: Tab, client: Client) -> None:
    enable(operated, client)
    slider = part(operated, "slider")
    slider.click()
    client.until(lambda state: state["job"] is None)
    before = client.result("job.list")["jobs"]
    expect(slider).to_be_focused()
    for key in ("Home", "End", "PageUp", "PageDown"):
        operated.keyboard.press(key)
    operated.keyboard.press("ArrowLeft")
    client.until(lambda state: client.result("job.list")["jobs"] != before)
    expect(part(operated, "outcome")).to_have_text("move: reached")
    at_mm = float(slider.input_value())
    assert kinds_since(client, before) == ["move"]
    assert abs(client.result("state.get")["opening_mm"] - at_mm) < 1.0


def test_the_slider_ends_within_the_travel(operated: Tab, client: Client) -> None:
    enable(operated, client)
    slider = part(operated, "slider")
    most_mm = float(slider.get_attribute("max") or "nan")
    travel_mm = client.result("hello")["gripper"]["travel_mm"]
    assert travel_mm - 0.11 < most_mm <= travel_mm
    box = slider.bounding_box()
    assert box is not None
    operated.mouse.click(box["x"] + box["width"] - 2, box["y"] + box["height"] / 2)
    expect(part(operated, "outcome")).to_have_text("move: reached")


def test_the_wheel_over_a_field_changes_no_figure(operated: Tab, client: Client) -> None:
    enable(operated, client)
    field = part(operated, "force")
    field.click()
    field.hover()
    for _ in range(3):
        operated.mouse.wheel(0, -100)
    expect(field).to_be_focused()
    operated.keyboard.press("End")
    operated.keyboard.type("5")
    expect(field).to_have_value("105")


def test_a_grasp_with_a_force_and_letting_go(operated: Tab, client: Client) -> None:
    client.result("sim.object", width_mm=OBJECT_MM)
    enable(operated, client)
    part(operated, "force").fill("6")
    button(operated, "Grasp").click()
    expect(part(operated, "outcome")).to_contain_text("grasp: object held")
    assert client.result("state.get")["force_set_n"] == 6
    part(operated, "force").fill("8")
    button(operated, "Set force").click()
    client.until(lambda state: bool(state["force_set_n"] == 8))
    button(operated, "Let go").click()
    client.until(lambda state: bool(state["mode"] == "relaxed"))
    part(operated, "force").fill("99")
    button(operated, "Grasp").click()
    expect(part(operated, "outcome")).to_contain_text("force: ")
    expect(part(operated, "outcome")).to_contain_text("40")


def test_what_another_client_does_meanwhile_is_said(operated: Tab, client: Client) -> None:
    enable(operated, client)
    client.result("stop", level="hold", why="lunch")
    expect(part(operated, "stopped")).to_contain_text("lunch")
    expect(button(operated, "Open")).to_be_disabled()
    expect(button(operated, "Disable")).to_be_enabled()


def test_the_daemon_goes_and_comes_back(
    window: BrowserContext, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    def run() -> "contextlib.AbstractContextManager[DaemonProcess]":
        return daemon(tmp_path, "sim9", "--simulate")

    with contextlib.ExitStack() as stack:
        with run() as first:
            first.connect().close()
            own = page("--socket", str(first.socket_path), "--operate")
            tab = opened(window, stack.enter_context(own))
            take_control(tab)
        expect(part(tab, "mode")).to_have_text("no daemon")
        expect(part(tab, "why")).not_to_be_empty()
        expect(part(tab, "outcome")).to_have_text("")  # nobody has control now
        expect(fact(tab, "Opening")).to_have_text("60.0 mm, last known")
        expect(button(tab, "Give control back")).to_be_hidden()
        expect(button(tab, "Open")).to_be_disabled()
        tab.keyboard.press("Escape")
        expect(tab.locator("#notice")).to_contain_text("STOP did not reach")
        expect(tab.locator("#notice")).to_contain_text("Cut the motor's power")
        with run() as second, second.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
            expect(part(tab, "mode")).to_have_text("disabled")
            expect(button(tab, "Take control")).to_be_visible()
            expect(tab.locator("#notice")).to_have_text("")
            toasts = tab.locator("#toasts li")
            expect(toasts).to_contain_text(
                ["The daemon was restarted: you no longer have control.", MISSED]
            )
            enable(tab, client)
            expect(toasts).to_have_count(1)
            tab.keyboard.press("Escape")
            expect(toasts).to_have_count(0)
            expect(tab.locator("#notice")).to_have_text(re.compile("^Stopped"))
            client.result("stop.clear")
            expect(tab.locator("#notice")).to_have_text("")


def test_what_a_stop_has_not_reached_says_whether_it_is_stopped_once_it_answers(
    window: BrowserContext, tmp_path: Path
) -> None:
    with contextlib.ExitStack() as stack:
        with daemon(tmp_path, "sim8", "--simulate") as first:
            first.connect().close()
            own = page("--socket", str(first.socket_path), "--operate")
            running = stack.enter_context(own)
            tab = opened(window, running)
        expect(part(tab, "mode")).to_have_text("no daemon")
        notice, outcome = tab.locator("#notice"), part(tab, "outcome")
        tab.keyboard.press("Escape")
        expect(notice).to_have_text(
            f"STOP did not reach {CHANNEL} (no daemon answers). Cut the motor's power."
        )
        running.process.send_signal(signal.SIGSTOP)  # the page meets the new daemon once it stops
        with daemon(tmp_path, "sim8", "--simulate") as second, second.connect() as client:
            client.result("stop", level="hold")
            running.process.send_signal(signal.SIGCONT)
            expect(part(tab, "mode")).to_have_text("STOPPED")
            expect(notice).to_have_text("Stopped. Nothing moves until it is cleared.")
            expect(outcome).to_have_text("")
            expect(tab.locator("#toasts li")).to_have_count(0)


def test_the_object_is_dragged_and_the_jaws_are_pushed(operated: Tab, client: Client) -> None:
    grasp(client)
    item = operated.locator(".jaws .item")
    expect(item).to_be_visible()
    drag(operated, item, 0, 200)
    expect(part(operated, "world-text")).to_contain_text("no object")
    assert client.result("sim.get")["object"] is None
    client.until(lambda state: not state["is_grasped"])
    client.despite_silence("motion.open")
    drag(operated, item, 0, -200)
    expect(part(operated, "world-text")).to_contain_text("an object of 40 mm")
    assert client.result("sim.get")["object"]["width_mm"] == OBJECT_MM
    client.result("sim.object")
    client.result("motion.zero_gravity")
    before = client.result("state.get")["opening_mm"]
    right = operated.locator(".jaws .jaw").nth(1)
    drag(operated, right, -100, 0, until=lambda: client.result("sim.get")["push_nm"] > 0)
    client.until(lambda state: bool(state["opening_mm"] < before - 1))
    expect(part(operated, "world-text")).not_to_contain_text("a hand")
    client.until(lambda _state: bool(client.result("sim.get")["push_nm"] == 0))


def test_the_world_by_its_buttons(operated: Tab, client: Client) -> None:
    part(operated, "object").fill("25")
    button(operated, "Put in").click()
    expect(part(operated, "world-text")).to_contain_text("an object of 25 mm")
    button(operated, "Take away").click()
    expect(part(operated, "world-text")).to_contain_text("no object")
    push = button(operated, "Push closed")
    push.focus()
    operated.keyboard.down(" ")
    expect(part(operated, "world-text")).to_contain_text("a hand closes with 0.8 N·m")
    operated.keyboard.up(" ")
    expect(part(operated, "world-text")).not_to_contain_text("a hand")
    button(operated, "Fault").click()
    expect(part(operated, "mode")).to_have_text("fault")
    expect(part(operated, "why")).to_contain_text("overload")
    take_control(operated)
    button(operated, "Clear the fault").click()
    expect(part(operated, "mode")).to_have_text("disabled")


def test_zeroing_asks_before_it_moves(operated: Tab, client: Client) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    dialog = operated.get_by_role("dialog", name="Measure the travel")
    button(operated, "Zero …").click()
    expect(dialog).to_contain_text("fingers away")
    button(operated, "Cancel").click()
    expect(dialog).to_be_hidden()
    assert client.result("job.list")["jobs"] == before
    button(operated, "Zero …").click()
    operated.evaluate(KEEP_WHAT_IS_SENT)
    button(operated, "The jaws are free: move them").click()
    expect(operated.locator("#zero-progress")).to_contain_text(re.compile(r"Measured: 8\d"))
    expect(operated.locator("#zero-progress")).to_contain_text(
        "The scale uses the configured 85 mm"
    )
    expect(operated.locator("#zero-progress")).to_contain_text("calibration rescale --stroke-mm MM")
    assert stroke_of(client) == pytest.approx(STROKE_MM)
    assert "stroke_mm" not in sent(operated, "calibration.zero")  # the daemon knows it
    button(operated, "Done").click()
    expect(dialog).to_be_hidden()


def stroke_of(client: Client) -> float:
    """Return how far the jaws open, by the calibration in use."""
    travel_mm: float = client.result("calibration.get")["travel_mm"]
    return travel_mm - 1.0


def load(client: Client, travel_mm: float, work_mm: float | None = None) -> None:
    """Have a calibration used by which the jaws travel so far, and open to `work_mm`."""
    travel_rad = 1.65
    content = {
        "calibrated": True,
        "zero_position_rad": 0.0,
        "max_position_rad": -travel_rad,
        "rad_to_mm": travel_mm / travel_rad,
    }
    if work_mm is not None:
        content["work_stroke_mm"] = work_mm
    client.result("calibration.load", content=content)


def test_the_measured_opening_sets_the_scale(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Zero …").click()
    stroke, uses = operated.get_by_label("The jaws open"), operated.locator("#zero-uses")
    expect(stroke).to_have_value("85")
    expect(uses).to_contain_text("it would use 85 mm (configured: 85 mm).")
    stroke.fill("84.2")
    expect(uses).to_contain_text("it would use 84.2 mm (configured: 85 mm).")
    button(operated, "The jaws are free: move them").click()
    expect(operated.locator("#zero-progress")).to_contain_text(
        "saved. The scale uses 84.2 mm (configured: 85"
    )
    assert stroke_of(client) == pytest.approx(84.2)
    expect(uses).to_contain_text("Now the scale uses 84.2 mm (configured: 85 mm). ")


def test_a_correction_is_what_the_dialog_begins_with_the_next_time(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    stroke, uses = operated.get_by_label("The jaws open"), operated.locator("#zero-uses")
    progress = operated.locator("#zero-progress")
    now = "Now the scale uses 88 mm"
    button(operated, "Zero …").click()
    stroke.fill("88")
    correct_the_scale(operated)
    expect(progress).to_contain_text("It is saved.")
    expect(uses).to_contain_text(f"{now} (configured: 85 mm). ")
    button(operated, "Done").click()
    button(operated, "Zero …").click()
    expect(stroke).to_have_value("88")
    expect(uses).to_contain_text(f"{now} (configured: 85 mm). ")
    correct_the_scale(operated)
    expect(progress).to_contain_text("It is saved.")
    assert stroke_of(client) == pytest.approx(88)
    stroke.fill("60")
    expect(uses).to_contain_text(f"{now}; it would use 60 mm (configured: 85 mm). ")
    correct_the_scale(operated)
    expect(progress).to_contain_text("Not corrected: ")
    expect(uses).to_contain_text(now)


def test_a_stroke_that_cannot_be_is_refused_in_the_dialog(operated: Tab, client: Client) -> None:
    enable(operated, client)
    before_mm = stroke_of(client)
    button(operated, "Zero …").click()
    operated.get_by_label("The jaws open").fill("60")

    def measure(tab: Tab) -> None:
        button(tab, "The jaws are free: move them").click()

    for press in (measure, correct_the_scale):
        press(operated)
        progress = operated.get_by_role("dialog").locator("#zero-progress")
        expect(progress).to_contain_text(re.compile("^Not (measured|corrected): .*85 mm"))
        operated.evaluate("document.getElementById('zero-progress').textContent = ''")
    assert stroke_of(client) == before_mm


def test_the_scale_is_corrected_without_a_motion(
    operated: Tab, simulated: DaemonProcess, client: Client
) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    button(operated, "Zero …").click()
    operated.get_by_label("The jaws open").fill("83")
    correct_the_scale(operated)
    expect(operated.locator("#zero-progress")).to_contain_text("Corrected: 84.0 mm of travel")
    expect(operated.locator("#zero-progress")).to_contain_text("It is saved.")
    assert stroke_of(client) == pytest.approx(83)
    assert client.result("job.list")["jobs"] == before
    expect(part(operated, "slider")).to_have_attribute("max", "84.0")
    files = [json.loads(path.read_text()) for path in simulated.log_path.parent.rglob("*.json")]
    assert any(file.get("rad_to_mm", 0) == rad_to_mm(client) for file in files)


def rad_to_mm(client: Client) -> float:
    scale: float = client.result("calibration.get")["rad_to_mm"]
    return scale


def test_a_doubtful_scale_is_said_until_it_is_corrected(
    window: BrowserContext, own: DaemonProcess
) -> None:
    with own.connect() as client, page("--socket", str(own.socket_path), "--operate") as running:
        client.until(lambda state: bool(state["calibrated"]))
        operated = opened(window, running)
        warning = part(operated, "doubted")
        expect(warning).to_be_hidden()
        load(client, 120.0)
        expect(warning).to_be_in_viewport()
        expect(warning).to_contain_text(
            "takes the jaws' travel for 120 mm, as earlier versions did"
        )
        expect(warning).to_contain_text("“Correct the scale only” corrects it")
        line = part(operated, "events").locator("li.warning", has_text="as earlier versions did")
        expect(line).to_have_count(1)
        load(client, 121.0)  # doubtful for the same reason
        expect(warning).to_contain_text("takes the jaws' travel for 121 mm")
        expect(button(operated, "Correct the scale …")).to_be_disabled()
        take_control(operated)
        button(operated, "Correct the scale …").click()
        correct_the_scale(operated)
        expect(operated.locator("#zero-progress")).to_contain_text("It is saved.")
        expect(warning).to_be_hidden()
        assert stroke_of(client) == pytest.approx(STROKE_MM)


def test_who_only_looks_sees_a_doubtful_scale_from_the_start(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    load(client, 120.0)
    tab = opened(window, looking)
    expect(part(tab, "doubted")).to_contain_text("“Correct the scale only”")
    expect(button(tab, "Correct the scale …")).to_be_hidden()


def test_figures_follow_the_calibration(operated: Tab, client: Client) -> None:
    ranges = client.result("config.get")["ranges"]
    expect(part(operated, "force")).to_have_attribute("max", f"{ranges['force_n'][1]:g}")
    for travel_mm, work_mm in ((80.0, 60.5), (90.0, None)):
        load(client, travel_mm, work_mm)
        expect(part(operated, "slider")).to_have_attribute("max", f"{travel_mm:.1f}")
        expect(part(operated, "object")).to_have_attribute("max", f"{travel_mm:g}")
        jaws = operated.locator("svg.jaws")
        width = travel_mm + 2 * 12 + 8
        expect(jaws).to_have_attribute("viewBox", re.compile(rf"^-{width / 2:g} 0 {width:g} "))
        work = jaws.locator(".work")
        if work_mm is None:
            expect(work).to_have_count(0)
            continue
        expect(work.locator("text")).to_have_text("Open: 60.5 mm")
        expect(work.locator("title")).to_contain_text("the work stroke, not to the stop")
        expect(jaws).to_have_attribute("aria-label", re.compile("open goes to 60.5 mm"))
        marks = [line.get_attribute("x1") for line in work.locator("line").all()]
        assert marks == ["-30.25", "30.25"]


def test_the_jaws_open_to_the_mark(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: ")
    expect(operated.locator(".work text")).to_have_text("Open: 80 mm")
    mark = operated.locator(".work line").nth(1).bounding_box()
    jaw = operated.locator(".jaws .jaw").nth(1).bounding_box()
    assert mark is not None
    assert jaw is not None
    assert jaw["x"] == pytest.approx(mark["x"] + mark["width"] / 2, abs=4)


def test_more_than_the_vendor_recommends_is_said(operated: Tab) -> None:
    take_control(operated)
    note, force = part(operated, "force-note"), part(operated, "force")
    for force_n, is_said in ((10, False), (20, False), (20.5, True), (40, True), (5, False)):
        force.fill(f"{force_n}")
        expect(note).to_be_visible(visible=is_said)
        assert force.evaluate("(node) => node.validity.valid")
    expect(note).to_contain_text("at most 20 N for continuous work")
    expect(note).to_contain_text("The coil's heat limits")
    before = [place for place in places(operated) if place.startswith(("teach", "play", "grasp"))]
    force.fill("30")
    expect(note).to_be_visible()
    assert set(before) <= set(places(operated))
    force.fill("41")
    assert not force.evaluate("(node) => node.validity.valid")


@pytest.mark.parametrize("width", [390, 844, 1400])
def test_what_is_replayed_and_how_fast_stand_side_by_side(operated: Tab, width: int) -> None:
    operated.set_viewport_size({"width": width, "height": 900})
    wait_until_it_fits(operated)
    speed, replay = (
        part(operated, "speed").bounding_box(),
        button(operated, "Replay").bounding_box(),
    )
    assert speed is not None
    assert replay is not None
    assert replay["x"] == pytest.approx(speed["x"] + speed["width"] + 8, abs=2)
    assert abs(replay["y"] - speed["y"]) < 2


def test_measuring_can_be_cancelled(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Zero …").click()
    button(operated, "The jaws are free: move them").click()
    expect(operated.locator("#zero-progress")).to_contain_text("step")
    button(operated, "Stop measuring").click()
    expect(operated.locator("#zero-progress")).to_contain_text("Not measured")
    client.until(lambda state: state["job"] is None)


def test_a_motion_is_taught_kept_and_replayed(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    assert [kept["name"] for kept in client.result("trajectory.list")["trajectories"]] == ["wave"]
    part(operated, "speed").fill("0.1")
    button(operated, "Replay").click()
    expect(part(operated, "outcome")).to_contain_text("replay: completed")


def test_a_dump_is_shown_and_anything_else_is_not(
    shown: Tab, client: Client, tmp_path: Path
) -> None:
    grasp(client)
    dumped = client.result("recorder.dump")
    field, toasts = shown.locator("#dump-file"), shown.locator("#toasts li")
    field.set_input_files(dumped["path"])
    section = shown.locator("#dump")
    expect(section.get_by_role("heading")).to_contain_text(f"{dumped['ticks']} ticks")
    expect(section.locator(".events")).to_contain_text("object held")
    times = section.locator(".events time").all_inner_texts()
    assert times == sorted(times, reverse=True)  # the newest first
    expect(section.locator(".events li").last).not_to_contain_text("object held")
    expect(section.locator("canvas")).to_have_count(2)
    content = Path(dumped["path"]).read_bytes()
    for name, wrong in {"notes": b"hello", "cut": content[: len(content) // 2]}.items():
        damaged = tmp_path / f"{name}.mcap"
        damaged.write_bytes(wrong)
        field.set_input_files(str(damaged))
        expect(toasts).to_contain_text([f"{name}.mcap cannot be shown: "])
    field.set_input_files(dumped["path"])
    expect(toasts).to_have_count(0)  # another one is shown
    field.set_input_files(str(damaged))
    expect(toasts).to_contain_text(["cannot be shown: "])
    button(shown, "Read").click()
    expect(toasts).to_have_count(0)
    expect(shown.locator("#notice")).to_have_text("")
    button(shown, "Put away").click()
    expect(section).to_be_hidden()


def test_a_wrong_secret_is_said(window: BrowserContext, looking: Page, client: Client) -> None:
    tab = window.new_page()
    tab.goto(f"{looking.url}#{'x' * 43}")
    expect(part(tab, "why")).to_contain_text("open the address that litegripd-web printed")
    expect(part(tab, "why")).to_contain_text("was not told it")
    tab.set_viewport_size({"width": 360, "height": 740})
    assert tab.locator(".why").evaluate("(node) => node.scrollHeight <= node.clientHeight")
    other = window.new_page()
    other.goto(looking.url)
    expect(other.get_by_role("heading", level=2)).to_contain_text("lacks its secret")


def test_a_name_that_browsers_do_not_take_for_secure_is_said(
    window: BrowserContext, place: Path
) -> None:
    with page("--socket", str(place), "--name", "robot.lab") as running:
        tab = window.new_page()
        tab.goto(running.told.replace("127.0.0.1", "robot.lab"))
        expect(tab.locator("#notice")).to_contain_text("open the page at 127.0.0.1 or localhost")
        button(tab, "STOP Esc").click()
    expect(tab.locator("#notice")).to_have_text(
        "STOP does nothing here: cut the motor's power. "
        "Then open the page at 127.0.0.1 or localhost, or with TLS."
    )


@pytest.mark.parametrize("cut", [5, 1])
def test_an_address_that_was_cut_short_is_named(
    window: BrowserContext, looking: Page, client: Client, cut: int
) -> None:
    tab = window.new_page()
    tab.goto(looking.told[:-cut])
    expect(part(tab, "why")).to_contain_text("mistyped or cut short")
    expect(part(tab, "why")).to_contain_text("open the address that litegripd-web printed")
    expect(part(tab, "why")).to_be_in_viewport(ratio=1)


STORED = """
async () => JSON.stringify([
  {...sessionStorage}, {...localStorage}, document.cookie, history.state, location.href,
  await indexedDB.databases(), await caches.keys(),
])
"""


def test_the_secret_is_nowhere_where_the_next_owner_of_the_port_finds_it(shown: Tab) -> None:
    secrets = re.findall(r"[A-Za-z0-9_-]{43}", shown.evaluate(STORED))
    assert secrets == []
    shown.reload()
    expect(shown.get_by_role("heading", level=2)).to_contain_text("lacks its secret")
    assert re.findall(r"[A-Za-z0-9_-]{43}", shown.evaluate(STORED)) == []


def test_a_frozen_daemon_is_late_and_a_stop_is_not_confirmed(
    operated: Tab, simulated: DaemonProcess, client: Client
) -> None:
    take_control(operated)
    simulated.process.send_signal(signal.SIGSTOP)
    try:
        expect(part(operated, "mode")).to_have_text("late")
        expect(part(operated, "why")).to_contain_text("No newer state has come for")
        expect(operated.locator(".jaws .jaw.unknown")).to_have_count(2)
        expect(fact(operated, "Opening")).to_have_text(re.compile(r"\d mm, last known$"))
        operated.keyboard.press("Escape")
        notice = operated.locator("#notice")
        expect(notice).to_have_text(f"STOP not confirmed by {CHANNEL}. Cut the motor's power.")
    finally:
        simulated.process.send_signal(signal.SIGCONT)
    expect(part(operated, "mode")).to_have_text("STOPPED")
    expect(notice).to_have_text("Stopped. Nothing moves until it is cleared.")


def test_a_frozen_page_server_is_late_too(
    window: BrowserContext, simulated: DaemonProcess, client: Client
) -> None:
    with page("--socket", str(simulated.socket_path)) as running:
        tab = window.new_page()
        tab.goto(running.told)
        expect(part(tab, "mode")).to_have_text("disabled")
        running.process.send_signal(signal.SIGSTOP)
        try:
            expect(part(tab, "mode")).to_have_text("late")
            expect(part(tab, "why")).to_contain_text("the daemon or litegripd-web stands still")
            tab.get_by_role("button", name="STOP Esc").click()
            expect(tab.locator("#notice")).to_contain_text("STOP not confirmed")
        finally:
            running.process.send_signal(signal.SIGCONT)
        expect(tab.locator("#notice")).to_contain_text("Stopped.")


def test_what_was_pressed_before_a_standstill_moves_nothing_after_it(
    window: BrowserContext, simulated: DaemonProcess, client: Client
) -> None:
    with page("--operate", "--socket", str(simulated.socket_path)) as running:
        grasp(client)
        tab = opened(window, running)
        take_control(tab)
        expect(part(tab, "held")).to_have_text("object detected")
        before = client.result("job.list")["jobs"]
        running.process.send_signal(signal.SIGSTOP)
        try:
            button(tab, "Open").click()
            expect(part(tab, "mode")).to_have_text("late")
        finally:
            running.process.send_signal(signal.SIGCONT)
        told = re.compile(r"^open: it came \d\.\d s after it was pressed, so it was not done")
        expect(part(tab, "outcome")).to_have_text(told)
        assert client.result("state.get")["is_grasped"]
        assert client.result("job.list")["jobs"] == before


def test_a_slider_that_is_dragged_while_the_page_turns_late_moves_nothing(
    window: BrowserContext, simulated: DaemonProcess, client: Client
) -> None:
    with page("--operate", "--socket", str(simulated.socket_path)) as running:
        tab = opened(window, running)
        enable(tab, client)
        before = client.result("job.list")["jobs"]
        drag_the_slider(tab, 0.8)
        running.process.send_signal(signal.SIGSTOP)
        try:
            expect(part(tab, "mode")).to_have_text("late")
        finally:
            running.process.send_signal(signal.SIGCONT)
        expect(part(tab, "mode")).not_to_have_text("late")
        expect(part(tab, "outcome")).to_contain_text(UNDONE)
        tab.mouse.up()
        assert client.result("job.list")["jobs"] == before


def test_a_lost_object_is_said_loudly_until_the_next_motion(
    window: BrowserContext, looking: Page, client: Client
) -> None:
    grasp(client)
    tab = opened(window, looking)
    lost = part(tab, "lost")
    expect(lost).to_be_hidden()
    client.result("sim.object")
    expect(lost).to_be_visible()
    expect(lost).to_contain_text("OBJECT LOST")
    expect(part(tab, "held")).to_have_text("nothing held")
    expect(part(opened(window, looking), "lost")).to_be_visible()
    client.despite_silence("motion.open")
    expect(lost).to_be_hidden()


def test_what_is_held_is_not_dropped_by_the_slider_and_an_empty_field_is_not_0(
    operated: Tab, client: Client
) -> None:
    grasp(client)
    take_control(operated)
    expect(part(operated, "slider")).to_be_disabled()
    expect(part(operated, "slider-text")).to_contain_text("something is held")
    before = len(client.result("job.list")["jobs"])
    part(operated, "force").fill("")
    button(operated, "Set force").click()
    expect(part(operated, "outcome")).to_contain_text("force: ")
    part(operated, "object").fill("")
    button(operated, "Put in").click()
    assert client.result("state.get")["is_grasped"]
    assert client.result("state.get")["force_set_n"] == 10
    assert len(client.result("job.list")["jobs"]) == before


def test_the_plots_begin_with_what_was_before_the_page(looking: Page, client: Client) -> None:
    began_s = client.result("state.get")["monotonic_s"]
    client.until(lambda state: bool(state["monotonic_s"] > began_s + 4))
    with looking.connect() as browser:
        history = welcome(browser)["history"]
    assert history["fields"][0] == "monotonic_s"
    times = [row[0] for row in history["rows"]]
    assert times == sorted(times)
    assert times[-1] - times[0] > 2


def test_a_replay_that_is_too_fast_is_offered_at_the_speed_that_goes(
    operated: Tab, client: Client
) -> None:
    teach(operated, client, "wave")
    part(operated, "speed").fill("4")
    button(operated, "Replay").click()
    toasts = operated.locator("#toasts li")
    expect(toasts).to_contain_text(["That replay is too fast"])
    limit = float(part(operated, "speed").input_value())
    assert 0 < limit < 4
    button(operated, "Replay").click()
    expect(part(operated, "outcome")).to_contain_text("replay: completed")
    expect(toasts).to_have_count(0)


def test_a_taught_motion_is_not_replaced_unasked(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    samples = client.result("trajectory.list")["trajectories"][0]["samples"]
    button(operated, "Teach").click()
    dialog = operated.get_by_role("dialog")
    expect(dialog).to_contain_text("“wave” already. Replace it by a new one?")
    button(operated, "No, leave it").click()
    assert client.result("trajectory.list")["trajectories"][0]["samples"] == samples
    assert client.result("state.get")["job"] is None
    button(operated, "Teach").click()
    button(operated, "Replace it").click()
    client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "record"))
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as wave")


def test_messages_have_the_words_of_the_page(operated: Tab, client: Client) -> None:
    enable(operated, client)
    part(operated, "name").fill("nothere")
    button(operated, "Replay").click()
    outcome = part(operated, "outcome")
    expect(outcome).to_contain_text("no trajectory 'nothere'; the field “Name” lists them")
    part(operated, "pace").fill("10")
    button(operated, "Close").click()
    client.until(lambda state: bool(state["job"]))
    button(operated, "Zero …").click()
    button(operated, "The jaws are free: move them").click()
    expect(operated.locator("#zero-progress")).to_contain_text(
        "wait for it (“Events” tell when it ends), cancel it ('litegripctl cancel') or stop"
    )


def test_health_is_called_as_the_shell_calls_it(shown: Tab, client: Client) -> None:
    text = part(shown, "health-text")
    expect(text).to_have_text(called_well())
    client.result("sim.fault", name="overload")
    client.until_health(lambda health: bool(health["verdict"] == "down"))
    expect(text).to_have_text(re.compile("^Down: .*overload"))


WITHOUT_WORDS = """
async (methods) => {
  const { inPageWords } = await import("./format.js");
  const told = (method) =>
    inPageWords(method, [{ start: 0, end: method.length, method, parameter: null }]);
  return methods.filter((method) => told(method) === method);
}
"""


def test_the_page_has_words_for_what_the_shell_has_words_for(shown: Tab) -> None:
    methods = [method for method, (_, command) in CALLS.items() if command]
    assert shown.evaluate(WITHOUT_WORDS, methods) == []


def test_dark_and_light_are_chosen_and_kept(shown: Tab) -> None:
    shown.emulate_media(color_scheme="light")
    root = shown.locator("html")
    expect(root).to_have_attribute("data-theme", "light")
    shown.get_by_role("button", name="Switch between light and dark").click()
    expect(root).to_have_attribute("data-theme", "dark")
    shown.reload()
    expect(root).to_have_attribute("data-theme", "dark")


def test_what_was_typed_is_there_when_the_page_is_opened_again(
    operated: Tab, operating: Page
) -> None:
    """A force that was chosen for what is in the jaws is not another one then."""
    take_control(operated)
    typed = {"force": "17", "pace": "33", "name": "wave", "speed": "0.5"}
    for name, value in typed.items():
        part(operated, name).fill(value)
    operated.goto("about:blank")
    operated.goto(operating.told)
    for name, value in typed.items():
        expect(part(operated, name)).to_have_value(value)


def test_a_phone_tells_what_the_jaws_do_wherever_it_is_scrolled_to(
    operated: Tab, client: Client
) -> None:
    brief = operated.locator("#brief")
    enable(operated, client)
    expect(brief).to_be_hidden()  # what says it is in sight
    operated.set_viewport_size({"width": 390, "height": 844})
    button(operated, "Open").click()
    expect(brief).to_have_text(re.compile(r"^(79\.9|80\.0) mm, still\. Open: reached$"))
    part(operated, "events").scroll_into_view_if_needed()
    expect(brief).to_be_in_viewport(ratio=1)
    expect(part(operated, "mode")).not_to_be_in_viewport()
    operated.keyboard.press("Escape")  # what is said then has its place
    expect(operated.locator("#notice")).to_contain_text("Stopped")
    expect(brief).to_be_hidden()


def test_two_grippers_stand_on_one_page_and_stop_together(
    window: BrowserContext, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    sockets = tmp_path / "litegripd"
    sockets.mkdir()
    names = (f"{CHANNEL}-left", f"{CHANNEL}-right")
    with contextlib.ExitStack() as stack:
        clients = []
        for name in names:
            running = stack.enter_context(configured(tmp_path / name, name))
            clients.append(stack.enter_context(running.connect()))
            (sockets / f"{name}.sock").symlink_to(running.socket_path)
            stop = running.socket_path.with_suffix(".stop.sock")
            (sockets / f"{name}.stop.sock").symlink_to(stop)
        with page("--operate", channels=names) as shown:
            tab = window.new_page()
            tab.set_viewport_size({"width": 1400, "height": 900})
            tab.goto(shown.told)
            for name in names:
                panel = tab.get_by_role("article", name=f"Gripper {name}")
                expect(panel.locator("[data-is=mode]")).to_have_text("disabled")
                expect(panel.locator(".jaws .tray")).to_be_visible()
                grasp_button = panel.get_by_role("button", name="Grasp", exact=True)
                expect(grasp_button).to_be_in_viewport(ratio=1)
            before = places(tab)
            tab.get_by_role("article", name=names[0]).get_by_role("button", name="STOP").click()
            clients[0].until(lambda state: state["stop"] is not None)
            assert clients[1].result("state.get")["stop"] is None
            expect(tab.locator(".mode").first).to_have_text("STOPPED")
            assert places(tab) == before
            tab.keyboard.press("Escape")
            clients[1].until(lambda state: state["stop"] is not None)


def test_on_a_phone_nothing_is_cut_off_and_the_stop_stays_in_sight(operated: Tab) -> None:
    operated.set_viewport_size({"width": 360, "height": 640})
    wait_until_it_fits(operated)
    operated.evaluate("scrollTo(0, document.body.scrollHeight)")
    expect(operated.get_by_role("button", name="STOP")).to_be_in_viewport()


NAMELESS = """
() => [...document.querySelectorAll("button, input, select, textarea, svg, figure")]
  .filter((node) => !node.textContent.trim() && !node.getAttribute("aria-label"))
  .filter((node) => !node.labels?.length)
  .map((node) => node.outerHTML)
"""
CONTRAST = """
() => {
  const linear = (part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
  const light = (color) => {
    const [r, g, b] = color.match(/[0-9.]+/g).map((part) => linear(Number(part) / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const color = getComputedStyle(at).backgroundColor;
      if (!color.startsWith("rgba(0, 0, 0, 0")) return color;
    }
    return "rgb(255, 255, 255)";
  };
  const ratio = (node) => {
    const both = [light(getComputedStyle(node).color), light(behind(node))];
    return (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
  };
  const words = "h1, h2, h3, p, dt, dd, label, legend, button:enabled, .mode, time, output";
  return [...document.querySelectorAll(words)]
    .filter((node) => node.checkVisibility() && node.textContent.trim() && ratio(node) < 4.5)
    .map((node) => `${ratio(node)}: ${node.outerHTML.slice(0, 100)}`);
}
"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_a_name_and_can_be_read(operated: Tab, client: Client, scheme: Any) -> None:
    operated.emulate_media(color_scheme=scheme)
    client.result("stop", level="hold")
    expect(part(operated, "stopped")).to_be_visible()
    assert operated.evaluate(NAMELESS) == []
    assert operated.evaluate(CONTRAST) == []  # WCAG 2.2, 1.4.3
    assert operated.evaluate("matchMedia('(prefers-color-scheme: dark)').matches") == (
        scheme == "dark"
    )


LINE_COLORS = """
() => ["--measured", "--commanded"].map((name) => {
  const probe = document.body.appendChild(document.createElement("i"));
  probe.style.color = `var(${name})`;
  const color = getComputedStyle(probe).color;
  probe.remove();
  return color;
})
"""
LEGEND_COLORS = """
(plot) => [...plot.querySelectorAll(".u-series .u-marker")].slice(1)
  .map((mark) => getComputedStyle(mark).borderTopColor)
"""


def test_the_plots_legends_have_the_colors_of_their_lines(shown: Tab) -> None:
    legends = shown.locator(".u-legend")
    expect(legends).to_have_count(2)
    seen = []
    for scheme in ("light", "dark", "light"):
        shown.emulate_media(color_scheme=scheme)
        expect(shown.locator("html")).to_have_attribute("data-theme", scheme)
        colors = shown.evaluate(LINE_COLORS)
        assert [legend.evaluate(LEGEND_COLORS) for legend in legends.all()] == [colors, colors]
        seen.append(colors)
    assert seen[0] == seen[2] != seen[1]
