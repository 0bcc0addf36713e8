"""A jaw of the simulated world is led by the pointer; what is taught so can be replayed."""

import time

import pytest
from playwright.sync_api import Page as Tab
from playwright.sync_api import expect

from tests.process.daemon_process import Client
from tests.process.web.on_page import button, enable, part

TRAVEL_MM = 87.0
FINGERS_AND_MARGINS_MM = 2 * 12 + 4
WAY_MM = 25.0


def lead(tab: Tab, way_mm: float, speed_mm_s: float) -> None:
    """Drag the right jaw by so much at a speed; keep it there."""
    jaw = tab.locator(".jaws .jaw").nth(1).bounding_box()
    rail = tab.locator(".jaws .rail").bounding_box()
    assert jaw is not None
    assert rail is not None
    mm = rail["width"] / (TRAVEL_MM + FINGERS_AND_MARGINS_MM)
    x, y = jaw["x"] + jaw["width"] / 2, jaw["y"] + jaw["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    began_s, takes_s = time.monotonic(), abs(way_mm) / speed_mm_s
    while (share := (time.monotonic() - began_s) / takes_s) < 1.0:
        tab.mouse.move(x + way_mm * mm * share, y)
    tab.mouse.move(x + way_mm * mm, y)


@pytest.mark.parametrize("way_mm", [-WAY_MM, WAY_MM])
@pytest.mark.parametrize("speed_mm_s", [50.0, 100.0, 150.0])
def test_jaws_that_are_led_arrive_and_what_was_taught_is_replayed_at_once(
    operated: Tab, client: Client, speed_mm_s: float, way_mm: float
) -> None:
    enable(operated, client)
    part(operated, "slider").fill("70" if way_mm < 0 else "20")
    expect(part(operated, "outcome")).to_contain_text("move: reached")
    part(operated, "name").fill(f"hand {speed_mm_s} {way_mm}")
    button(operated, "Teach").click()
    state = client.until(lambda state: bool(state["job"] and state["job"]["kind"] == "record"))
    lead(operated, way_mm, speed_mm_s)
    led_mm = state["opening_mm"] + 2 * way_mm
    client.until(
        lambda state: (
            abs(state["opening_mm"] - led_mm) < 1.0 and abs(state["velocity_rad_s"]) < 0.01
        )
    )
    operated.mouse.up()
    client.until(lambda _state: client.result("sim.get")["push_nm"] == 0)
    button(operated, "End and keep").click()
    expect(part(operated, "outcome")).to_contain_text("kept as hand")
    button(operated, "Replay").click()
    expect(part(operated, "outcome")).to_have_text("replay: completed")
    expect(part(operated, "speed")).to_have_value("1")
    expect(operated.locator("#toasts li")).to_have_count(0)
    assert client.result("state.get")["opening_mm"] == pytest.approx(led_mm, abs=3.0)
