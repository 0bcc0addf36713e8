"""Tables of measurements: what the command that they name prints stands on the page."""

from pathlib import Path

from bench.rig import Rig
from bench.teleop_follow import WAYS
from bench.teleop_lossy import NETWORKS, after_cut, tracking

PAGE = (Path(__file__).parents[2] / "docs" / "teleoperation.md").read_text(encoding="utf-8")


def test_the_figures_of_teleoperation_are_those_of_its_bench() -> None:
    travel_mm = Rig("normal", 60.0).geometry.travel_mm
    worst, vendor = NETWORKS[-1], next(way for way in WAYS if "SDK" in way.name)
    assert tracking(vendor, worst, travel_mm) in PAGE.splitlines()
    assert after_cut(vendor, travel_mm) in PAGE.splitlines()
