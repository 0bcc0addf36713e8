"""Tables of measurements: what the command that they name prints stands on the page."""

import random
from pathlib import Path

from bench import grasps, holding, presses, touch
from bench.grasps import line
from bench.rig import Rig
from bench.teleop_follow import WAYS
from bench.teleop_lossy import NETWORKS, after_cut, tracking


def page(name: str) -> list[str]:
    """Return the lines of a page."""
    text = (Path(__file__).parents[2] / "docs" / f"{name}.md").read_text(encoding="utf-8")
    return text.splitlines()


def test_the_figures_of_teleoperation_are_those_of_its_bench() -> None:
    travel_mm = Rig("normal", 60.0).geometry.travel_mm
    worst, vendor = NETWORKS[-1], next(way for way in WAYS if "SDK" in way.name)
    assert tracking(vendor, worst, travel_mm) in page("teleoperation")
    assert after_cut(vendor, travel_mm) in page("teleoperation")


def test_the_figures_of_safety_are_those_of_its_bench() -> None:
    by_name = dict(presses.ROWS)
    for name in ("`move`, `goto`", "a follower"):
        assert line(presses.pressed_row(name, by_name[name])) in page("safety")
    assert line(presses.free_row(150.0)) in page("safety")
    assert line(presses.lost_row(40.0)) in page("safety")


def test_the_figures_of_grasping_are_those_of_its_benches() -> None:
    kind = next(kind for kind in grasps.KINDS if kind.vanishes)
    chances = (random.Random(f"1 {kind.name} {number}") for number in range(10))
    seen = [grasps.grasp(kind, "ours", chance) for chance in chances]
    assert grasps.row(kind, "ours", seen) in page("grasping")
    gave_way = [holding.kept(holding.seen(n, holding.step(2.0))) for n in holding.FORCES_N]
    assert line(["2 mm", *gave_way]) in page("grasping")


def test_the_figures_of_a_first_touch_are_those_of_its_bench() -> None:
    assert line(touch.touch_row(1.0)) in page("grasping")
    assert line(touch.touch_row(20.0)) in page("grasping")
    assert line(touch.impact_row(150.0)) in page("grasping")
