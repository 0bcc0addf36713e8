"""A recording that is broken off: the page says so at once, and offers what there is of it."""

import re

import pytest
from playwright.sync_api import Page as Tab
from playwright.sync_api import expect

from tests.process.daemon_process import Client
from tests.process.web.on_page import button, enable, part, wait_until_it_fits

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
    button(operated, "Discard").click()
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)
    assert kept(client) == []
    button(operated, "Teach").click()  # and a new one is whole again
    expect(button(operated, "End and keep")).to_be_visible()
    client.until(lambda _state: client.result("trajectory.status")["samples"] > SAMPLES)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as part")


def test_a_recording_under_way_is_discarded(operated: Tab, client: Client, recording: int) -> None:
    button(operated, "Discard").click()
    client.until(lambda state: state["job"] is None)
    expect(button(operated, "Teach")).to_be_visible()
    expect(operated.locator("#toasts li")).to_have_count(0)
    assert client.result("trajectory.status")["job"] == recording
    assert kept(client) == []


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
