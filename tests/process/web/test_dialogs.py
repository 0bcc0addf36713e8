"""What acts in a dialog obeys the rule of the page's other buttons, and says why not."""

import os
from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import (
    KEEP_WHAT_IS_SENT,
    OBJECT_MM,
    button,
    correct_the_scale,
    enable,
    grasp,
    kinds_since,
    part,
    sent,
    teach,
    wait_until_it_fits,
)
from tests.process.web.page_process import CHANNEL

SAMPLES = 30
STOPPED = "Not now: stopped: “Clear the stop” first."


def zero_dialog(tab: Tab) -> Locator:
    button(tab, "Zero …").click()
    dialog = tab.get_by_role("dialog", name="Measure the travel")
    expect(button(tab, "The jaws are free: move them")).to_be_enabled()
    return dialog


@pytest.mark.parametrize(
    ("begin", "why", "end", "then"),
    [
        (
            lambda client: client.result("stop", level="hold", why="lunch"),
            STOPPED,
            lambda client: client.result("stop.clear"),
            "",
        ),
        (
            lambda client: client.result("sim.fault", name="silent"),
            "Not now: the motor does not answer.",
            lambda client: client.result("sim.fault", name="none"),
            "Not now: “Enable” first.",
        ),
    ],
    ids=["stop", "silent"],
)
def test_what_moves_in_a_dialog_is_grey_where_nothing_moves(
    operated: Tab,
    client: Client,
    begin: Callable[[Client], object],
    why: str,
    end: Callable[[Client], object],
    then: str,
) -> None:
    enable(operated, client)
    dialog = zero_dialog(operated)
    move = button(operated, "The jaws are free: move them")
    colour = "(node) => getComputedStyle(node).backgroundColor"
    blue = move.evaluate(colour)
    place = move.bounding_box()
    begin(client)
    expect(move).to_be_disabled()
    assert move.evaluate(colour) != blue
    expect(dialog).to_contain_text(why)
    expect(button(operated, "Correct the scale only")).to_be_enabled()  # it moves nothing
    assert move.bounding_box() == place
    end(client)
    expect(dialog.locator(".barred")).to_have_text(then)
    expect(move).to_be_enabled(enabled=not then)


def test_without_control_a_dialog_changes_nothing(operated: Tab, client: Client) -> None:
    enable(operated, client)
    dialog = zero_dialog(operated)
    client.result("lease.take", ttl_s=60.0, purpose="mine", why="it is my turn")
    for name in ("The jaws are free: move them", "Correct the scale only"):
        expect(button(operated, name)).to_be_disabled()
    expect(dialog).to_contain_text("Not now: press “Take it over” first.")
    button(operated, "Cancel").click()
    expect(dialog).to_be_hidden()


def test_a_question_is_not_answered_by_what_would_move_behind_a_stop(
    operated: Tab, client: Client
) -> None:
    teach(operated, client, "wave")
    button(operated, "Teach").click()
    yes = button(operated, "Replace it")
    expect(yes).to_be_enabled()
    operated.keyboard.press("Escape")
    expect(yes).to_be_disabled()
    expect(operated.get_by_role("dialog")).to_contain_text(STOPPED)
    button(operated, "Clear the stop").click()
    expect(yes).to_be_enabled()
    operated.keyboard.press("Escape")
    expect(yes).to_be_disabled()
    button(operated, "No, leave it").click()
    expect(operated.get_by_role("dialog")).to_be_hidden()


def test_enter_takes_the_answer_that_does_nothing(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    jobs = client.result("job.list")["jobs"]
    button(operated, "Teach").click()
    expect(button(operated, "No, leave it")).to_be_focused()
    operated.keyboard.press("Enter")
    dialog = operated.get_by_role("dialog")
    expect(dialog).to_be_hidden()
    zero_dialog(operated)
    operated.keyboard.press("Enter")
    button(operated, "Cancel").click()
    expect(dialog).to_be_hidden()
    assert client.result("job.list")["jobs"] == jobs


def test_a_part_replaces_another_motion_behind_the_stop_that_broke_it_off(
    operated: Tab, client: Client
) -> None:
    teach(operated, client, "wave")
    part(operated, "name").fill("new")
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    operated.keyboard.press("Escape")
    part(operated, "name").fill("wave")
    button(operated, "Keep the part").click()
    button(operated, "Replace it").click()  # it moves nothing
    expect(part(operated, "outcome")).to_contain_text("kept as wave")


def test_what_is_not_measured_is_closed_and_not_done(operated: Tab, client: Client) -> None:
    enable(operated, client)
    dialog = zero_dialog(operated)
    button(operated, "The jaws are free: move them").click()
    expect(operated.locator("#zero-progress")).to_contain_text("step")
    operated.keyboard.press("Escape")
    expect(operated.locator("#zero-progress")).to_contain_text("Not measured")
    expect(button(operated, "The jaws are free: move them")).to_be_disabled()
    dialog.get_by_role("button", name="Back").click()
    expect(dialog).to_be_hidden()


def test_nothing_stops_measuring_before_it_can_be_stopped(operated: Tab, client: Client) -> None:
    """“Stop measuring” never closes the dialog while the jaws go on."""
    enable(operated, client)
    zero_dialog(operated)
    operated.evaluate(
        """() => {
          document.getElementById("zero-start").click();
          document.getElementById("zero-cancel").click();
        }"""
    )
    expect(operated.get_by_role("dialog")).to_be_visible()


def hold_something(tab: Tab, client: Client) -> None:
    button(tab, "Open").click()
    expect(part(tab, "outcome")).to_contain_text("open: reached")
    client.result("sim.object", width_mm=OBJECT_MM)
    button(tab, "Grasp").click()
    expect(part(tab, "held")).to_have_text("object detected")
    expect(part(tab, "outcome")).to_contain_text("grasp: object held")


def test_what_would_drop_what_is_held_says_so(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    hold_something(operated, client)
    told = "Something is held: it will drop."
    dialog = zero_dialog(operated)
    expect(dialog).to_contain_text(told)
    move, cancel = button(operated, "The jaws are free: move them"), button(operated, "Cancel")
    place = move.bounding_box()
    colour = "(node) => getComputedStyle(node).backgroundColor"
    plain, blue = move.evaluate(colour), cancel.evaluate(colour)
    client.result("sim.object")
    expect(dialog).not_to_contain_text(told)
    expect(move).to_have_css("background-color", blue)  # what does no harm has been in its place
    expect(cancel).to_have_css("background-color", plain)
    assert plain != blue
    assert move.bounding_box() == place
    button(operated, "Cancel").click()
    hold_something(operated, client)
    operated.set_viewport_size({"width": 700, "height": 390})  # low, and enlarged
    zero_dialog(operated)
    expect(dialog.get_by_text(told)).to_be_in_viewport(ratio=1)
    button(operated, "Cancel").click()
    operated.set_viewport_size({"width": 1280, "height": 900})
    button(operated, "Teach").click()
    expect(operated.get_by_role("dialog")).to_contain_text(told)
    button(operated, "No, leave it").click()


def test_control_is_taken_from_who_moves_the_jaws_only_when_that_is_meant(
    operated: Tab, client: Client
) -> None:
    client.despite_silence("motor.enable")
    client.despite_silence("motion.open")
    client.result("lease.acquire", purpose="a script")
    moves = client.send("motion.close", speed_mm_s=3)
    expect(part(operated, "mode")).to_contain_text("moving: close")
    dialog, take = operated.get_by_role("dialog"), operated.locator("[data-do=take-over]")
    take.click()
    expect(dialog).to_contain_text(
        f"Take {CHANNEL} over from python (pid {os.getpid()}), a script?"
    )
    expect(dialog).to_contain_text("At this moment it moves the jaws (close).")
    expect(dialog).to_contain_text("That motion ends then, and the jaws hold on where they are.")
    expect(dialog).to_contain_text("python moves nothing more until it asks for control again.")
    button(operated, "No, leave it").click()
    expect(dialog).to_be_hidden()
    state = client.result("state.get")
    assert (state["mode"], client.result("lease.get")["mine"]) == ("moving", True)
    take.click()
    dialog.get_by_role("button", name="Take it over").click()
    expect(button(operated, "Disable")).to_be_enabled()
    assert client.answer(moves)["error"]["data"]["reason"] == "lease_lost"
    stopped_mm = client.until(lambda state: bool(state["mode"] == "holding"))["opening_mm"]
    assert stopped_mm > 30


def test_control_of_a_hold_is_taken_only_when_that_is_meant_and_the_hold_stays(
    operated: Tab, client: Client
) -> None:
    grasp(client, force_n=8.0)
    client.result("lease.acquire")
    expect(part(operated, "held")).to_have_text("object detected")
    dialog, take = operated.get_by_role("dialog"), operated.locator("[data-do=take-over]")
    take.click()
    told = "it holds an object, with the force set to 8 N. The jaws hold on, with the same force."
    expect(dialog).to_contain_text(told)
    client.result("lease.release")
    expect(dialog).to_be_hidden()  # there is nobody to be asked about
    client.result("lease.acquire")
    take.click()
    dialog.get_by_role("button", name="Take it over").click()
    expect(button(operated, "Disable")).to_be_enabled()
    state = client.result("state.get")
    assert (state["is_grasped"], state["force_set_n"]) == (True, 8.0)


SCREENS = {"wide": (1400, 900), "phone": (390, 844), "phone, on its side": (844, 390)}
AIMS = """
() => [...document.querySelectorAll("#zero button")].map((node) => {
  const {x, y, width, height} = node.getBoundingClientRect();
  return [node.id, x, y, width, height].join(" ");
})
"""
CUT = """
(node) => {
  const [said, room] = [node, node.parentElement].map((one) => one.getBoundingClientRect());
  return said.top < room.top - 1 || said.bottom > room.bottom + 1;
}
"""
CUT_IN_THE_BOX = """
(node) => {
  const said = node.getBoundingClientRect(), room = node.closest(".told").getBoundingClientRect();
  return said.top < room.top - 1 || said.bottom > room.bottom + 1;
}
"""


@pytest.fixture(params=SCREENS)
def sized(operated: Tab, request: pytest.FixtureRequest) -> Tab:
    width, height = SCREENS[request.param]
    operated.set_viewport_size({"width": width, "height": height})
    wait_until_it_fits(operated)
    return operated


def test_each_button_of_the_dialog_that_measures_stays_where_it_is(
    sized: Tab, client: Client
) -> None:
    enable(sized, client)
    zero_dialog(sized)
    cancel, progress = sized.locator("#zero-cancel"), sized.locator("#zero-progress")
    expect(sized.locator("#zero-title")).to_be_in_viewport(ratio=1)
    place = sized.evaluate(AIMS)
    button(sized, "The jaws are free: move them").click()
    expect(progress).to_contain_text("step")
    expect(cancel).to_have_text("Stop measuring")
    assert sized.evaluate(AIMS) == place
    client.result("sim.fault", name="overload")
    expect(progress).to_contain_text("Not measured: the motor reports overload")
    expect(cancel).to_have_text("Back")
    assert sized.evaluate(AIMS) == place
    assert not progress.evaluate(CUT)
    assert not progress.evaluate("(node) => node.scrollHeight > node.clientHeight")
    client.result("sim.fault", name="none")
    correct_the_scale(sized)
    expect(progress).to_contain_text("It is saved.")
    expect(cancel).to_have_text("Done")
    assert sized.evaluate(AIMS) == place


LINES = """
() => [...document.querySelectorAll("#zero .told > *, #zero .told li")].map((node) => {
  const {x, y, width, height} = node.getBoundingClientRect();
  return [node.id || node.tagName, x, y, width, height].join(" ");
})
"""


def test_a_result_of_measuring_moves_and_cuts_nothing_that_the_dialog_says(
    sized: Tab, client: Client
) -> None:
    enable(sized, client)
    zero_dialog(sized)
    progress = sized.locator("#zero-progress")
    title, warning = sized.locator("#zero-title"), sized.locator("#zero ol li").first
    lines = sized.evaluate(LINES)
    button(sized, "The jaws are free: move them").click()
    for told in ("step", "Measured: "):
        expect(progress).to_contain_text(told)
        assert sized.evaluate(LINES) == lines
        for node in (title, warning):
            assert not node.evaluate(CUT_IN_THE_BOX)
        assert not progress.evaluate("(node) => node.scrollHeight > node.clientHeight")


def test_all_that_the_dialog_tells_is_in_sight_on_a_phone_before_it_measures(
    operated: Tab, client: Client
) -> None:
    operated.set_viewport_size({"width": 390, "height": 844})
    wait_until_it_fits(operated)
    enable(operated, client)
    zero_dialog(operated)
    told = operated.locator("#zero .told")
    assert not told.evaluate("(node) => node.scrollHeight > node.clientHeight")


def test_what_is_done_is_closed_by_the_main_button(operated: Tab, client: Client) -> None:
    enable(operated, client)
    zero_dialog(operated)
    move, cancel = (
        button(operated, "The jaws are free: move them"),
        operated.locator("#zero-cancel"),
    )
    colour = "(node) => getComputedStyle(node).backgroundColor"
    blue, plain = move.evaluate(colour), cancel.evaluate(colour)
    assert blue != plain
    correct_the_scale(operated)
    expect(cancel).to_have_text("Done")
    expect(cancel).to_have_css("background-color", blue)
    expect(move).to_be_enabled()
    expect(move).to_have_css("background-color", plain)
    cancel.click()
    zero_dialog(operated)
    expect(move).to_have_css("background-color", blue)
    button(operated, "Cancel").click()


def test_a_second_click_where_measuring_was_stopped_begins_and_saves_nothing(
    sized: Tab, client: Client
) -> None:
    enable(sized, client)
    zero_dialog(sized)
    sized.get_by_label("The jaws open").fill("83")
    button(sized, "The jaws are free: move them").click()
    progress = sized.locator("#zero-progress")
    expect(progress).to_contain_text("step")
    box = sized.locator("#zero-cancel").bounding_box()
    assert box is not None
    client.result("sim.fault", name="overload")  # fails with a long reason, and so as it may save
    expect(progress).to_contain_text("Not measured: ")
    client.result("sim.fault", name="none")
    jobs, before_mm = (
        client.result("job.list")["jobs"],
        client.result("calibration.get")["travel_mm"],
    )
    for _ in range(4):
        for share in (0.1, 0.5, 0.9):  # wherever on it the hand rests
            sized.mouse.click(box["x"] + box["width"] * share, box["y"] + box["height"] / 2)
        sized.wait_for_timeout(260)
    assert client.result("job.list")["jobs"] == jobs
    assert client.result("calibration.get")["travel_mm"] == before_mm


DEAF = """
() => new Promise((resolve) => {
  const buttons = ["start", "rescale"].map((name) => document.getElementById(`zero-${name}`));
  const isDeaf = () => buttons.map((node) => node.disabled);
  const progress = document.getElementById("zero-progress");
  new MutationObserver((_, observer) => {
    if (!progress.textContent.startsWith("Not measured")) return;
    observer.disconnect();
    setTimeout(() => resolve(isDeaf()), 500);
  }).observe(progress, {childList: true});
  document.getElementById("zero-cancel").click();
})
"""


def test_what_moves_or_saves_is_deaf_for_a_moment_when_the_dialog_shows_something_else(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    zero_dialog(operated)
    move, rescale = (
        button(operated, name)
        for name in ("The jaws are free: move them", "Correct the scale only")
    )
    move.click()
    expect(operated.locator("#zero-progress")).to_contain_text("step")
    assert operated.evaluate(DEAF) == [True, True]
    expect(move).to_be_enabled()
    expect(rescale).to_be_enabled()


def test_a_scale_is_saved_only_when_that_is_meant(operated: Tab, client: Client) -> None:
    enable(operated, client)
    before = client.result("calibration.get")["travel_mm"]
    zero_dialog(operated)
    operated.get_by_label("The jaws open").fill("83")
    button(operated, "Correct the scale only").dblclick()
    expect(operated.get_by_text("The scale will use 83 mm, in place of ")).to_be_visible()
    expect(button(operated, "Correct and save")).to_be_enabled()
    button(operated, "No, leave it").click()
    expect(button(operated, "Correct the scale only")).to_be_enabled()
    assert client.result("calibration.get")["travel_mm"] == before
    expect(operated.locator("#zero-progress")).to_be_empty()


PUT = """
(node, [x, y]) => Object.assign(node.style, {position: "fixed", left: `${x}px`, top: `${y}px`})
"""
"""Put a button somewhere else."""


def test_a_second_click_on_what_closes_a_dialog_presses_nothing_behind_it(
    operated: Tab, client: Client
) -> None:
    """What stands elsewhere is pressed at once."""
    enable(operated, client)
    zero_dialog(operated)
    box = button(operated, "Cancel").bounding_box()
    assert box is not None
    at = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for name, x in (("open", at[0] - 30), ("close", at[0] + 80)):
        operated.locator(f"[data-do={name}]").evaluate(PUT, [x, at[1] - 10])
    before = client.result("job.list")["jobs"]
    for _ in range(3):
        operated.mouse.click(*at)
    operated.mouse.click(at[0] + 100, at[1])
    expect(part(operated, "outcome")).to_contain_text("close: ")
    assert kinds_since(client, before) == ["close"]


NATIVE = """
() => [...document.querySelectorAll("select, datalist, input")].filter(
  ({tagName, type, list}) => tagName !== "INPUT" || list
    || !["text", "number", "range", "radio", "checkbox", "file"].includes(type)
).map((node) => node.outerHTML)
"""
"""What opens a list or a picker of the browser's own, which takes Esc while it is open."""
REMEMBERED = """
() => [...document.querySelectorAll("input[type=text], input[type=number]")]
  .filter((node) => node.autocomplete !== "off").map((node) => node.outerHTML)
"""


@pytest.mark.parametrize("key", ["Space", "ArrowDown", "Alt+ArrowDown"])
def test_escape_stops_while_the_mount_is_chosen(operated: Tab, client: Client, key: str) -> None:
    enable(operated, client)
    dialog = zero_dialog(operated)
    assert operated.evaluate(NATIVE) == []
    assert operated.evaluate(REMEMBERED) == []
    dialog.locator("#zero-mount").locator("input").first.focus()
    operated.keyboard.press(key)
    operated.keyboard.press("Escape")
    client.until(lambda state: state["stop"] is not None)


def test_the_mount_that_is_chosen_is_the_one_that_is_measured(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    zero_dialog(operated)
    expect(operated.get_by_label("as it is now (normal)")).to_be_checked()
    operated.get_by_label("reverse").check()
    operated.evaluate(KEEP_WHAT_IS_SENT)
    button(operated, "The jaws are free: move them").click()
    asked = operated.get_by_role("dialog").last
    expect(asked).to_contain_text("As “reverse” the jaws close where they open now")
    button(operated, "No, leave it").click()
    methods = operated.evaluate("window.sent.map(({method}) => method)")
    assert "calibration.zero" not in methods
    button(operated, "The jaws are free: move them").click()
    button(operated, "It is mounted reverse").click()
    expect(operated.locator("#zero-progress")).to_contain_text("step")
    assert sent(operated, "calibration.zero")["mount"] == "reverse"
    expect(
        operated.get_by_role("radio", name="reverse")
    ).to_be_disabled()  # it says what is measured
    button(operated, "Stop measuring").click()


def test_escape_stops_while_the_names_are_shown_and_one_of_them_is_taken(
    operated: Tab, client: Client
) -> None:
    teach(operated, client, "wave")
    name, wave = part(operated, "name"), button(operated, "wave")
    expect(wave).to_be_hidden()
    name.fill("")
    expect(wave).to_be_visible()
    wave.click()
    expect(name).to_have_value("wave")
    expect(wave).to_be_visible()  # a second click presses nothing else
    operated.keyboard.press("ArrowDown")
    operated.keyboard.press("Escape")
    client.until(lambda state: state["stop"] is not None)
    button(operated, "Give control back").click()
    expect(wave).to_be_hidden()
