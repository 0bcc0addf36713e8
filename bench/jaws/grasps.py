"""Grasps in simulation: ours beside the way of the vendor's SDK, on the same objects.

python -m bench.jaws.grasps [GRASPS per row, default 10] [SEED, default 1]

Every row is a kind of object, gripped with the default force and speed (20 N, 50 mm/s) at random
widths, starts and mounts. The time is simulated, so the table, which
docs/generated/grasping-figures.md has, is the same on every machine. Each figure is the worst of
the grasps; the error is the mean. Peak is the motor's true torque up to the verdict, which is
counted from the first touch.
"""

import random
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.jaws.rig import DEFAULTS, Rig, VendorGrasp, ours
from bench.tables import line
from litegripd.control.motions.grasp import GraspRequest
from litegripd.model.state import GraspResult


@dataclass(frozen=True, slots=True)
class Kind:
    """A row: what is gripped (nothing, without figures), and what happens to it."""

    name: str
    item: dict[str, float] | None
    vanishes: bool = False
    thump: bool = False


KINDS = (
    Kind("very stiff, 1500 N·m/rad", {"stiffness_nm_rad": 1500.0}),
    Kind("stiff, 250 N·m/rad", {"stiffness_nm_rad": 250.0}),
    Kind("soft, 40 N·m/rad", {"stiffness_nm_rad": 40.0}),
    Kind("yields at 3 mm/s", {"yield_mm_s": 3.0, "yield_torque_nm": 0.3}),
    Kind("vanishes while held", {"stiffness_nm_rad": 250.0}, vanishes=True),
    Kind("none, but a thump", None, thump=True),
)


@dataclass(slots=True)
class Figures:
    """What was seen of one grasp; None where there was nothing to be seen."""

    right: bool = False
    peak_nm: float | None = None
    verdict_ms: float | None = None
    hold_percent: float | None = None
    hold_least_n: float | None = None
    vanish_mm_s: float | None = None
    reported_ms: float | None = None


def grasp(kind: Kind, way: str, chance: random.Random) -> Figures:
    """Grasp once, at a width and a start of `chance`."""
    width_mm = chance.uniform(20.0, 65.0)
    rig = Rig(chance.choice(("normal", "reverse")), width_mm + chance.uniform(5.0, 18.0))
    rig.looks = 5
    if kind.item is not None:
        rig.gripper.put_object(width_mm=width_mm, **kind.item)
    request = GraspRequest(DEFAULTS.force_n, DEFAULTS.grasp_speed_mm_s, until="verdict")
    vendor = way == "vendor"
    action = VendorGrasp(rig.geometry, request) if vendor else ours(rig.geometry, request)
    job = rig.begin(action)
    if kind.thump:
        thump(rig, chance)
    rig.run_until(lambda: not job.is_running or rig.gripper.opening_mm <= width_mm)
    touched_s = rig.now_s
    rig.run_until(lambda: not job.is_running)
    expected = "no_object" if kind.item is None else "object_held"
    seen = Figures(isinstance(job.result, GraspResult) and job.result.outcome == expected)
    if kind.item is not None:
        seen.peak_nm, seen.verdict_ms = rig.peak_nm, (rig.now_s - touched_s) * 1e3
        watch_hold(rig, rig.geometry.torque_nm(request.force_n), seen)
    if kind.vanishes:
        watch_vanishing(rig, seen)
    return seen


def thump(rig: Rig, chance: random.Random) -> None:
    """Hold the jaws up by hand for a moment, on their way."""
    rig.run(chance.uniform(0.2, 0.3))
    rig.gripper.push(-rig.geometry.close_sign * chance.uniform(1.0, 3.0))
    rig.run(chance.uniform(0.02, 0.07))
    rig.gripper.push(0.0)


def watch_hold(rig: Rig, force_nm: float, seen: Figures) -> None:
    """Look at the true force for a second, once it has been ramped."""
    rig.run(1.5)
    squeezed_nm = []
    for _ in range(200):
        rig.tick()
        squeezed_nm.append(rig.squeeze_nm)
    seen.hold_percent = (statistics.fmean(squeezed_nm) / force_nm - 1.0) * 100.0
    seen.hold_least_n = min(squeezed_nm) * rig.geometry.nm_to_n


def watch_vanishing(rig: Rig, seen: Figures) -> None:
    """Take the object away, and look how fast the jaws get and when that is noticed."""
    rig.gripper.remove_object()
    rig.peak_mm_s, began_s = 0.0, rig.now_s
    rig.run_until(lambda: not rig.is_grasped or rig.now_s - began_s > 2.0)
    if not rig.is_grasped:
        seen.reported_ms = (rig.now_s - began_s) * 1e3
    rig.run(0.2)
    seen.vanish_mm_s = rig.peak_mm_s


COLUMNS: tuple[tuple[str, str, Callable[[list[Any]], float], str], ...] = (
    ("peak N·m", "peak_nm", max, ".2f"),
    ("verdict ms", "verdict_ms", max, ".0f"),
    ("hold error %", "hold_percent", statistics.fmean, "+.1f"),
    ("least force N", "hold_least_n", min, ".1f"),
    ("vanishes mm/s", "vanish_mm_s", max, ".0f"),
    ("noticed ms", "reported_ms", max, ".0f"),
)


def row(kind: Kind, way: str, seen: list[Figures]) -> str:
    cells = [kind.name, way, f"{sum(s.right for s in seen)} of {len(seen)}"]
    for _, name, summary, form in COLUMNS:
        values = [value for s in seen if (value := getattr(s, name)) is not None]
        cells.append(format(summary(values), form) if values else "")
    return line(cells)


def main(count: int = 10, seed: int = 1) -> None:
    """Print the table."""
    titles = ["object", "way", "right", *(title for title, *_ in COLUMNS)]
    print(line(titles))
    print(line(["---"] * len(titles)))
    for kind in KINDS:
        for way in ("ours", "vendor"):
            chances = (random.Random(f"{seed} {kind.name} {n}") for n in range(count))
            print(row(kind, way, [grasp(kind, way, chance) for chance in chances]), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
