"""A number is what was typed, with a comma as with a point; what is no number acts as none."""

import re

import pytest
from playwright.sync_api import Page as Tab
from playwright.sync_api import expect

from tests.process.daemon_process import Client
from tests.process.web.on_page import KEEP_WHAT_IS_SENT, button, enable, part, sent

FIELDS = {
    "pace": ("Close", "motion.close", "speed_mm_s"),
    "force": ("Grasp", "motion.grasp", "force_n"),
    "speed": ("Replay", "trajectory.play", "speed"),
    "object": ("Put in", "sim.object", "width_mm"),
}
"""By each field: what takes it, and as which parameter of what."""


def type_into(tab: Tab, selector: str, text: str) -> None:
    """Type as a person does: what the browser drops is dropped."""
    field = tab.locator(selector)
    field.press("ControlOrMeta+a")
    field.press("Delete")
    field.press_sequentially(text)


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize(("text", "number"), [("2,5", 2.5), (" 3.50 ", 3.5)])
def test_a_decimal_comma_is_a_point(
    operated: Tab, client: Client, field: str, text: str, number: float
) -> None:
    press, method, parameter = FIELDS[field]
    enable(operated, client)
    operated.evaluate(KEEP_WHAT_IS_SENT)
    type_into(operated, f"[data-is={field}]", text)
    button(operated, press).click()
    assert sent(operated, method)[parameter] == number


@pytest.mark.parametrize("field", FIELDS)
def test_what_is_no_number_is_refused_and_acts_as_none(
    operated: Tab, client: Client, field: str
) -> None:
    press, method, _ = FIELDS[field]
    enable(operated, client)
    operated.evaluate(KEEP_WHAT_IS_SENT)
    node = part(operated, field)
    for text in ("1,2,5", "1.000,5", "1e1", "12mm", "-", "9" * 400):
        node.fill("")
        operated.keyboard.insert_text(text)  # as it is pasted
        button(operated, press).click()
        told = node.evaluate("(node) => node.validationMessage")
        assert told.endswith(", and is no number."), text
        if field != "object":
            expect(part(operated, "outcome")).to_contain_text(told)
            expect(operated.locator("#toasts li")).to_contain_text(
                [told]
            )  # whatever ends meanwhile
    operated.wait_for_timeout(100)
    assert method not in [line["method"] for line in operated.evaluate("window.sent")]


def test_the_opening_of_a_caliper_has_a_comma_or_a_point_and_else_nothing_is_corrected(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    button(operated, "Zero …").click()
    correct, uses = button(operated, "Correct the scale only"), operated.locator("#zero-uses")
    expect(correct).to_be_enabled()
    type_into(operated, "#zero-stroke", "8,,4")
    expect(uses).not_to_contain_text("would use")
    correct.click()
    stroke = operated.locator("#zero-stroke")
    assert "is no number" in stroke.evaluate("(node) => node.validationMessage")
    expect(button(operated, "Correct and save")).to_be_hidden()
    progress = operated.locator("#zero-progress")
    operated.evaluate(KEEP_WHAT_IS_SENT)
    move = button(operated, "The jaws are free: move them")
    for text, why in (
        ("abc", "is no number"),
        ("1e9", "is no number"),
        ("0", "is 0"),
        ("-5", "-5"),
    ):
        type_into(operated, "#zero-stroke", text)
        for press in (move, correct):
            press.click()
            told = f"How far the jaws open: It may be from 1 to 1000 mm, and .*{why}"
            expect(progress).to_have_text(re.compile(told))
    methods = operated.evaluate("window.sent.map(({method}) => method)")
    assert not {"calibration.zero", "calibration.rescale"} & set(methods)
    type_into(operated, "#zero-stroke", "84,2")
    expect(uses).to_contain_text("it would use 84.2 mm")
    correct.click()
    button(operated, "Correct and save").click()
    expect(operated.locator("#zero-progress")).to_contain_text("It is saved.")
    assert sent(operated, "calibration.rescale")["stroke_mm"] == 84.2
