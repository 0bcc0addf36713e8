"""What acts in a dialog obeys the rule of the page's other buttons, and says why not."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import OBJECT_MM, button, enable, part, teach

SAMPLES = 30
STOPPED = "Not now: a stop is latched, “Clear the stop” first."


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
    dialog.get_by_role("button", name="Close").click()
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
    button(operated, "Teach").click()
    expect(operated.get_by_role("dialog")).to_contain_text(told)
    button(operated, "No, leave it").click()
