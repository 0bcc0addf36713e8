"""A recording that is broken off: the page says so at once, and offers what there is of it."""

import re

import pytest
from playwright.sync_api import BrowserContext, Dialog, Locator, expect
from playwright.sync_api import Page as Tab

from tests.process.daemon_process import Client
from tests.process.web.on_page import (
    button,
    discard,
    enable,
    grasp,
    opened,
    part,
    take_control,
    teach,
    wait_until_it_fits,
)
from tests.process.web.page_process import Page

SAMPLES = 30


@pytest.fixture
def recording(operated: Tab, client: Client) -> int:
    """Begin to teach on the page; return the job, which has some samples."""
    enable(operated, client)
    part(operated, "name").fill("part")
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    job: int = client.result("trajectory.status")["job"]
    return job


def kept(client: Client) -> list[str]:
    return [one["name"] for one in client.result("trajectory.list")["trajectories"]]


def break_off(client: Client, job: int, how: str) -> None:
    if how == "stop":
        client.result("stop", level="hold", why="lunch")
    else:
        client.result("job.cancel", job=job)


@pytest.mark.parametrize(("how", "why"), [("cancel", "cancelled by"), ("stop", "a stop (hold) by")])
def test_a_recording_that_is_broken_off_is_said_and_its_part_is_kept(
    operated: Tab, client: Client, recording: int, how: str, why: str
) -> None:
    break_off(client, recording, how)
    toast = operated.locator("#toasts li")
    for told in (part(operated, "outcome"), toast):
        expect(told).to_have_text(re.compile(r"The recording was broken off after \d+ samples"))
        expect(told).to_contain_text(why)
    button(operated, "Keep the part").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")
    assert kept(client) == ["part"]
    expect(toast).to_have_count(0)
    expect(button(operated, "Teach")).to_be_visible()
    expect(button(operated, "Keep the part")).to_be_hidden()


def test_a_part_that_nobody_wants_is_discarded(
    operated: Tab, client: Client, recording: int
) -> None:
    break_off(client, recording, "cancel")
    expect(button(operated, "Keep the part")).to_be_visible()
    discard(operated)
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)
    assert kept(client) == []
    button(operated, "Teach").click()  # and a new one is whole again
    expect(button(operated, "End and keep")).to_be_visible()
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")


def test_a_recording_under_way_is_discarded(operated: Tab, client: Client, recording: int) -> None:
    discard(operated)
    client.until(lambda state: state["job"] is None)
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)
    assert client.result("trajectory.status")["job"] == recording
    assert kept(client) == []


def test_a_page_opened_anew_offers_what_a_closed_one_has_recorded(
    window: BrowserContext, operating: Page, operated: Tab, client: Client, recording: int
) -> None:
    operated.close()
    client.until(lambda state: state["job"] is None)
    there_are = client.result("trajectory.status")["samples"]
    tab = opened(window, operating)
    take_control(tab)
    told = tab.locator("#toasts li")
    expect(told).to_contain_text(f"The recording was broken off after {there_are} samples (")
    expect(told).to_contain_text("“Keep the part” or “Discard”: the client that owned it went away")
    part(tab, "name").fill("part")
    button(tab, "Keep the part").click()
    expect(part(tab, "outcome")).to_contain_text("kept as part")
    [there] = client.result("trajectory.list")["trajectories"]
    assert (there["name"], there["samples"]) == ("part", there_are)


def test_teach_throws_nothing_away_that_was_recorded_elsewhere(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    client.result("trajectory.record_start", zero_gravity=False, max_samples=SAMPLES)
    client.until(lambda _state: not client.result("trajectory.status")["active"])
    button(operated, "Teach").click()
    told = f"The recording has ended after {SAMPLES} samples (0.3 s), “End and keep” or “Discard”"
    expect(part(operated, "outcome")).to_have_text(told)
    assert client.result("state.get")["job"] is None
    discard(operated)
    expect(part(operated, "outcome")).to_have_text("The recording is discarded.")
    button(operated, "Give control back").click()
    take_control(operated)
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")


def test_what_another_program_has_kept_is_offered_no_more(
    operated: Tab, client: Client, recording: int
) -> None:
    break_off(client, recording, "cancel")
    expect(button(operated, "Keep the part")).to_be_visible()
    client.result("trajectory.record_stop", name="elsewhere", allow_partial=True)
    button(operated, "Give control back").click()
    take_control(operated)
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)


@pytest.mark.parametrize("has_control", [True, False])
def test_what_another_page_has_discarded_is_offered_no_more(
    window: BrowserContext,
    operating: Page,
    operated: Tab,
    client: Client,
    recording: int,
    has_control: bool,
) -> None:
    break_off(client, recording, "cancel")
    expect(button(operated, "Keep the part")).to_be_visible()
    if has_control:
        client.result("trajectory.record_stop", allow_partial=True)
    else:
        other = opened(window, operating)
        button(other, "Take it over").click()
        discard(other)
    expect(button(operated, "Keep the part")).to_be_hidden()
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li", has_text="The recording was")).to_have_count(0)
    told = "The recording is there no more: it was kept, discarded or replaced elsewhere."
    expect(part(operated, "outcome")).to_have_text(told)


def test_a_question_whether_to_replace_ends_with_the_recording_of_which_it_was(
    operated: Tab, client: Client
) -> None:
    """Otherwise a part would replace a whole motion by a yes that was meant for another one."""
    teach(operated, client, "whole")
    [whole] = client.result("trajectory.list")["trajectories"]
    name, dialog = part(operated, "name"), operated.get_by_role("dialog")
    name.fill("new")
    button(operated, "Teach").click()
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    name.fill("whole")
    button(operated, "End and keep").click()
    long = f"There is a motion of {whole['duration_s']:.1f} s with the name “whole” already. "
    expect(dialog).to_contain_text(f"{long}Replace it by the new one, which goes on until")
    operated.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    button(operated, "Keep the part").click()
    part_s = client.result("trajectory.status")["unkept"]["duration_s"]
    told = f"Replace it by the part of {part_s:.1f} s of a recording that was broken off?"
    expect(dialog).to_contain_text(f"{long}{told}")
    button(operated, "No, leave it").click()
    assert client.result("trajectory.list")["trajectories"] == [whole]


def test_a_yes_for_a_whole_motion_is_none_for_a_part_of_it(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    button(operated, "Teach").click()
    button(operated, "Replace it").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")  # a new one
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    operated.keyboard.press("Escape")
    button(operated, "Keep the part").click()
    expect(operated.get_by_role("dialog")).to_contain_text("Replace it by the part of ")
    button(operated, "No, leave it").click()


def test_who_leaves_the_page_is_warned_only_while_it_records(
    operated: Tab, client: Client, recording: int
) -> None:
    warned: list[str] = []

    def stay(dialog: Dialog) -> None:
        warned.append(dialog.type)
        dialog.dismiss()

    operated.on("dialog", stay)
    with operated.expect_event("dialog"):
        operated.close(run_before_unload=True)
    assert warned == ["beforeunload"]
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")
    with operated.expect_event("close"):  # in control, and not asked
        operated.close(run_before_unload=True)
    assert warned == ["beforeunload"]


@pytest.mark.parametrize("name", ["a/b", "", ".hidden", "end "])
def test_a_name_that_cannot_be_is_refused_before_the_recording(
    operated: Tab, client: Client, name: str
) -> None:
    enable(operated, client)
    before = client.result("job.list")["jobs"]
    part(operated, "name").fill(name)
    button(operated, "Teach").click()
    expect(part(operated, "outcome")).to_contain_text("“Name”: it may have 1 to 64 characters")
    assert client.result("job.list")["jobs"] == before
    toasts = operated.locator("#toasts li")
    expect(toasts).to_contain_text(["“Name”: it may have"])
    part(operated, "name").fill("plain name 1.2")
    expect(toasts).to_have_count(0)  # as soon as another is typed
    button(operated, "Teach").click()
    expect(button(operated, "End and keep")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)


def test_a_bad_name_is_complained_of_no_more_once_something_else_was_done(
    operated: Tab, client: Client
) -> None:
    enable(operated, client)
    part(operated, "name").fill("a/b")
    button(operated, "Teach").click()
    expect(operated.locator("#toasts li")).to_contain_text(["“Name”: it may have"])
    button(operated, "Hold").click()
    expect(operated.locator("#toasts li")).to_have_count(0)


def test_control_is_not_given_back_while_a_recording_runs(
    operated: Tab, client: Client, recording: int
) -> None:
    """It would run on with nobody's control, the jaws slack, and its end be out of reach."""
    button(operated, "Give control back").click()
    told = (
        "give control back: a recording runs, and the jaws are slack: “End and keep” or “Discard”"
    )
    expect(operated.locator("#toasts li")).to_contain_text([f"{told} first"])
    assert client.result("lease.get")["owner"]["program"] == "litegripd-web"
    assert client.result("state.get")["job"]["job"] == recording
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")
    expect(operated.locator("#toasts li")).to_have_count(0)
    button(operated, "Give control back").click()
    expect(button(operated, "Take control")).to_be_visible()


def test_the_head_says_that_it_teaches_and_replays(
    operated: Tab, client: Client, recording: int
) -> None:
    mode = part(operated, "mode")
    operated.set_viewport_size({"width": 360, "height": 740})
    expect(mode).to_have_text("teaching: jaws slack")
    wait_until_it_fits(operated)
    assert not mode.evaluate("(node) => node.scrollWidth > node.clientWidth")  # all of it is read
    client.result("sim.push", torque_nm=0.6)
    client.until(lambda state: bool(state["opening_mm"] < 40))
    client.result("sim.push", torque_nm=0)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")
    expect(part(operated, "events")).to_contain_text("teach: ended, ")
    expect(part(operated, "events")).not_to_contain_text("stopped")
    part(operated, "speed").fill("0.1")  # so that it is seen
    button(operated, "Replay").click()
    expect(mode).to_have_text(re.compile(r"^replaying( \(\w+\))?$"))
    operated.keyboard.press("Escape")
    expect(part(operated, "stopped")).to_be_visible()


def test_teaching_asks_before_it_drops_what_is_held(operated: Tab, client: Client) -> None:
    grasp(client)
    take_control(operated)
    expect(part(operated, "held")).to_have_text("object detected")
    button(operated, "Teach").click()
    expect(operated.get_by_role("dialog")).to_contain_text("Something is held: it will drop.")
    button(operated, "No, leave it").click()
    assert client.result("state.get")["is_grasped"]
    button(operated, "Teach").click()
    operated.get_by_role("dialog").get_by_role("button", name="Teach").click()
    expect(part(operated, "outcome")).to_contain_text("Recording: ")


def test_a_replay_asks_before_it_drops_what_is_held(operated: Tab, client: Client) -> None:
    teach(operated, client, "wave")
    button(operated, "Give control back").click()
    expect(button(operated, "Take control")).to_be_visible()
    grasp(client)
    take_control(operated)
    expect(part(operated, "held")).to_have_text("object detected")
    before = client.result("job.list")["jobs"]
    part(operated, "speed").fill("0.2")  # the simulated push was faster than a hand
    button(operated, "Replay").click()
    expect(operated.get_by_role("dialog")).to_contain_text("Something is held: it will drop.")
    button(operated, "No, leave it").click()
    assert client.result("state.get")["is_grasped"]
    assert client.result("job.list")["jobs"] == before
    button(operated, "Replay").click()
    operated.get_by_role("dialog").get_by_role("button", name="Replay").click()
    client.until(lambda state: state["is_grasped"] is False)


def middle(node: Locator) -> tuple[float, float]:
    box = node.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_who_presses_teach_twice_teaches_once(operated: Tab, client: Client) -> None:
    """The second press comes before the answer to the first, or falls on what stands there then."""
    enable(operated, client)
    part(operated, "name").fill("twice")
    at = middle(button(operated, "Teach"))
    for _ in range(2):
        operated.mouse.click(*at)
    expect(button(operated, "End and keep")).to_be_visible()
    operated.mouse.click(*at)
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    assert client.result("trajectory.status")["active"]
    assert kept(client) == []
    expect(button(operated, "Open")).to_be_disabled()
    expect(operated.locator("#toasts li")).to_have_count(0)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as twice")


PRESS_AGAIN = """
() => {
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    send.call(this, text);
    if (JSON.parse(text).method !== "trajectory.record_stop") return;
    document.querySelector("[data-do=keep]").click();
  };
}
"""
"""A second press, which comes before the answer to the first."""


def test_who_ends_a_recording_twice_keeps_it_once(
    operated: Tab, client: Client, recording: int
) -> None:
    operated.evaluate(PRESS_AGAIN)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")
    expect(operated.get_by_role("dialog")).to_be_hidden()
    assert client.result("trajectory.status")["job"] == recording
    assert kept(client) == ["part"]


@pytest.mark.parametrize("width", [390, 1400])
def test_the_names_that_there_are_lie_over_nothing_that_they_are_for(
    operated: Tab, client: Client, width: int
) -> None:
    operated.set_viewport_size({"width": width, "height": 844})
    enable(operated, client)
    for name in ("t0", "a1_pick_left_box_from_table"):
        part(operated, "name").fill(name)
        button(operated, "Teach").click()
        client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
        button(operated, "End and keep").click()
        expect(part(operated, "outcome")).to_contain_text(f"kept as {name}")
    field, names = part(operated, "name"), part(operated, "names")
    field.click()
    expect(names.get_by_role("button")).to_have_count(2)
    for name in ("Teach", "Replay"):
        button(operated, name).click(trial=True)  # nothing is over it
    field.fill("T")
    expect(names.get_by_role("button")).to_have_count(2)
    field.fill("t0")
    expect(names).to_be_hidden()
    field.fill("LEFT")
    expect(names.get_by_role("button")).to_have_text(["a1_pick_left_box_from_table"])
    names.get_by_role("button").click()
    expect(field).to_have_value("a1_pick_left_box_from_table")
    button(operated, "Replay").click(trial=True)


def test_a_recording_is_discarded_only_after_a_question(
    operated: Tab, client: Client, recording: int
) -> None:
    button(operated, "Discard").click()
    expect(operated.get_by_role("dialog")).to_contain_text("Discard the recording")
    button(operated, "No, leave it").click()
    status = client.result("trajectory.status")
    assert (status["active"], status["job"]) == (True, recording)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")


def test_no_teaching_begins_while_a_motion_runs(operated: Tab, client: Client) -> None:
    enable(operated, client)
    button(operated, "Open").click()
    expect(part(operated, "outcome")).to_contain_text("open: reached")
    part(operated, "pace").fill("10")
    button(operated, "Close").click()
    expect(part(operated, "mode")).to_contain_text("moving: close")
    expect(button(operated, "Teach")).to_be_disabled()
    box = button(operated, "Teach").bounding_box()
    assert box is not None
    operated.mouse.click(box["x"] + 5, box["y"] + 5)
    expect(part(operated, "outcome")).to_have_text("teach: a motion runs: “Hold” ends it")
    operated.keyboard.press("h")
    expect(button(operated, "Teach")).to_be_enabled()


def test_no_key_moves_the_jaws_that_a_hand_leads(
    operated: Tab, client: Client, recording: int
) -> None:
    for key, name in (("o", "open"), ("c", "close"), ("g", "grasp")):
        operated.keyboard.press(key)
        told = (
            f"{name}: a recording runs, with a hand at the jaws: “End and keep” or “Discard” first"
        )
        expect(part(operated, "outcome")).to_have_text(told)
    expect(button(operated, "Open")).to_be_disabled()
    expect(part(operated, "slider")).to_be_disabled()
    assert client.result("state.get")["job"]["job"] == recording
    operated.keyboard.press("h")  # which holds, and does end it
    client.until(lambda state: state["job"] is None)
    expect(button(operated, "Open")).to_be_enabled()


def test_a_recording_that_was_broken_off_before_is_dated_so(operated: Tab, client: Client) -> None:
    client.despite_silence("motor.enable")
    client.result("trajectory.record_start")
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    client.result("stop", level="hold")
    client.result("stop.clear")
    ended_s = client.result("state.get")["monotonic_s"]
    line = part(operated, "events").locator("li[data-kind=job_ended]").first
    expect(line).to_contain_text(re.compile(r"job \d+, teach: a stop \(hold\)"))
    client.until(lambda state: bool(state["monotonic_s"] > ended_s + 2.5))
    take_control(operated)
    toast = operated.locator("#toasts li", has_text="The recording was broken off")
    dated = toast.locator("time").inner_text().strip()
    assert dated == line.locator("time").inner_text()
