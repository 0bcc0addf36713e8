"""The frames a second on the bus in each phase, counted with the simulator: as a page says."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.bus_world import BusWorld
from tests.world import PERIOD_S

PAGE = Path(__file__).parents[2] / "docs/installation.md"
COUNTED_S = 5.0
SETTLED_S = 2.0


def table() -> dict[str, tuple[float, ...]]:
    """Return the page's rows: frames sent, frames received, both, and the share of the bus in %."""
    text = PAGE.read_text(encoding="utf-8").partition("## What the bus carries\n")[2]
    rows = re.findall(r"^\| ([^|]+) \| (\d+) \| (\d+) \| (\d+) \| ([\d.]+) % \|$", text, re.M)
    return {name: tuple(map(float, figures)) for name, *figures in rows}


def faulted(world: BusWorld) -> None:
    world.enabled()
    world.faults.to_motor.drop(1.0)
    world.run(0.5)
    world.faults.to_motor.drop(0.0)
    world.run_until(lambda: world.state.mode == "fault", 2.0)


def moving(world: BusWorld) -> None:
    client = world.enabled()
    client.result("motion.open")
    client.send("motion.close", speed_mm_s=5)
    world.run(1.0)
    assert world.state.mode == "moving"


def slack(world: BusWorld) -> None:
    world.enabled().result("stop", level="relax")
    assert world.state.mode == "relaxed"


def silent(world: BusWorld) -> None:
    world.start()
    world.faults.to_motor.drop(1.0)
    world.run_until(lambda: world.state.bus == "motor_silent", 2.0)


def off(world: BusWorld) -> None:
    world.start()
    world.faults.bus_off()


def down(world: BusWorld) -> None:
    world.enabled()
    world.faults.link_down()


def stalled(world: BusWorld) -> None:
    world.enabled()
    world.faults.stall()


def frames_a_second(bring: Callable[[BusWorld], object], rate_hz: float) -> tuple[float, ...]:
    """Return the frames that were sent and received, and the share of the bus that they take."""
    with BusWorld(period_s=1.0 / rate_hz) as world:
        bring(world)
        world.run(SETTLED_S)
        counters = world.bus.counters
        before = (counters.sent, counters.received, counters.bits)
        world.run(COUNTED_S)
        after = (counters.sent, counters.received, counters.bits)
        sent, received, bits = (
            (later - earlier) / COUNTED_S for earlier, later in zip(before, after, strict=True)
        )
    return sent, received, sent + received, 100.0 * bits / 1_000_000


@pytest.mark.parametrize(
    ("row", "phases"),
    [
        ("is disabled, or has a fault", (BusWorld.start, faulted)),
        ("is enabled: it holds, moves, grips, is slack", (BusWorld.enabled, moving, slack)),
        ("does not answer, or the controller is bus-off", (silent, off)),
        ("cannot be reached: the link is down, or nobody acknowledges", (down, stalled)),
    ],
)
def test_the_page_tells_what_is_counted(
    row: str, phases: tuple[Callable[[BusWorld], object], ...]
) -> None:
    for bring in phases:
        sent, received, both, share = frames_a_second(bring, 1.0 / PERIOD_S)
        told_sent, told_received, told_both, told_share = table()[row]
        assert sent == pytest.approx(told_sent, abs=0.5)
        assert received == pytest.approx(told_received, abs=0.5)
        assert both == pytest.approx(told_both, abs=0.5)
        assert share == pytest.approx(told_share, abs=0.15)


def test_the_page_has_no_other_row() -> None:
    assert len(table()) == 4


@pytest.mark.parametrize("rate_hz", [100, 500])
def test_an_enabled_motor_has_twice_the_rate_and_a_disabled_one_hardly_more(rate_hz: int) -> None:
    assert frames_a_second(BusWorld.enabled, rate_hz)[2] == pytest.approx(2 * rate_hz)
    assert 33.0 <= frames_a_second(BusWorld.start, rate_hz)[2] <= 40.0
