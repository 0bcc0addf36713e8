"""Tables of measurements: what the command that they name prints stands on the page."""

import random
from pathlib import Path

from bench.jaws import damaged, grasps, holding, presses, touch, worst
from bench.jaws.presses import kinetic_mj
from bench.jaws.rig import Rig
from bench.tables import line
from bench.teleop.follow import WAYS
from bench.teleop.lossy import NETWORKS, after_cut, tracking
from litegripd.model.gripper import DM4310
from litegripd.model.motion_config import ranges_of


def page(name: str) -> list[str]:
    """Return the lines of a page."""
    text = (Path(__file__).parents[2] / "docs" / f"{name}.md").read_text(encoding="utf-8")
    return text.splitlines()


def test_the_figures_of_teleoperation_are_those_of_its_bench() -> None:
    travel_mm = Rig("normal", 60.0).geometry.travel_mm
    worst, vendor = NETWORKS[-1], next(way for way in WAYS if "SDK" in way.name)
    assert tracking(vendor, worst, travel_mm) in page("generated/teleoperation-figures")
    assert after_cut(vendor, travel_mm) in page("generated/teleoperation-figures")


def test_the_figures_of_presses_are_those_of_its_bench() -> None:
    by_name = dict(presses.ROWS)
    for name in ("`move`, `goto`", "a follower"):
        assert line(presses.pressed_row(name, by_name[name])) in page("generated/pressing-figures")
    assert line(presses.free_row(150.0)) in page("generated/pressing-figures")
    assert line(presses.lost_row(40.0)) in page("generated/pressing-figures")
    assert line(damaged.field_row("a hold")) in page("generated/pressing-figures")


def test_each_method_that_moves_has_its_worst_on_the_page() -> None:
    assert set(worst.CALLS) == worst.MOVING
    names = [cells[0] for cells in worst_rows()]
    assert {f"`{method}`" for method in worst.MOVING} <= set(names)
    limits = " ".join(names)
    assert all(f"`{name}`" in limits for name in ranges_of(DM4310))
    for name in ("motion.move", "stop.clear"):
        scenes = worst.everywhere(worst.CALLS[name])
        assert [f"`{name}`", *worst.worst(scenes).cells()] in worst_rows()


def test_only_physics_throws_the_jaws() -> None:
    """On the page; the bench that writes it measures."""
    most_mj = kinetic_mj(worst.MOST_MM_S)
    for name, mm_s, energy_mj, *_ in worst_rows():
        if not worst.is_forced(name):
            assert float(mm_s) <= worst.MOST_MM_S, name
            assert float(energy_mj) <= most_mj, name


def worst_rows() -> list[list[str]]:
    """Return the cells of each row of the table of the worst."""
    lines = page("generated/pressing-figures")
    began = lines.index(line(worst.HEAD)) + 2
    rows = lines[began : lines.index("", began)]
    return [[cell.strip() for cell in row.split("|")[1:-1]] for row in rows]


def test_the_figures_of_grasping_are_those_of_its_benches() -> None:
    kind = next(kind for kind in grasps.KINDS if kind.vanishes)
    chances = (random.Random(f"1 {kind.name} {number}") for number in range(10))
    seen = [grasps.grasp(kind, "ours", chance) for chance in chances]
    assert grasps.row(kind, "ours", seen) in page("generated/grasping-figures")
    gave_way = [holding.kept(holding.seen(n, holding.step(2.0))) for n in holding.FORCES_N]
    assert line(["2 mm", *gave_way]) in page("generated/grasping-figures")


def test_the_figures_of_a_first_touch_are_those_of_its_bench() -> None:
    assert line(touch.touch_row(1.0)) in page("generated/grasping-figures")
    assert line(touch.touch_row(20.0)) in page("generated/grasping-figures")
    assert line(touch.impact_row(150.0)) in page("generated/grasping-figures")
