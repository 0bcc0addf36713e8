"""The worst that a call, a file, a frame or a leader can do to a finger, in simulation.

python -m bench.jaws.worst

The object is as soft as a finger, or rigid; a figure is the worst of all objects and both mounts.
Each method that moves has a row, and each field of the motion configuration at both ends of its
range. The time is simulated, so the table is the same on every machine.
"""

import math
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

from bench.jaws.damaged import worst_of_one_bit
from bench.jaws.presses import FROM_MM, OBJECT_MM, RIGID_NM_RAD, TO_MM, Bench, Leader, kinetic_mj
from bench.jaws.rig import TRAVEL_MM
from bench.tables import table
from bench.teleop.follow import SETTLE_S
from litegripd.app.build import METHODS
from litegripd.model.gripper import DM4310, FASTEST_MM_S
from litegripd.model.motion_config import MotionConfig, ranges_of
from litegripd.sim.plant import MOUNTS, limits_of_mount
from tests.trajectories import uploaded
from tests.world import PERIOD_S

SOFT_NM_RAD = (10.0, 30.0)
"""A finger is that soft, and damped."""
OBJECTS_NM_RAD = (*SOFT_NM_RAD, RIGID_NM_RAD)
MOST_N = 40.0
MOST_MM_S = 1.3 * FASTEST_MM_S
LATER_S = 3.0
WITHIN_S = 12.0
RUNS_S = 0.2
"""After so long, jaws that began at `FROM_MM` run as fast as was asked."""
WIDE_MM = 80.0

MOVING = frozenset(row.name for row in METHODS if row.needs_lease and row.stop_voids)
"""The methods that may move the jaws: a software stop makes those void that came before it."""

FORCED = {
    "an object vanishes": "a set force that is let go of, before any measurement tells of it",
    "a damaged frame": "the motor obeys a frame whose damage SLCAN cannot show",
    "`zero_gravity`, `relax`": "the object itself throws the jaws open: they are slack",
    "by 3 N·m": "a torque that the caller has set, let go of",
    "what a push": "a torque that the caller has set, let go of",
}
"""What no bound of commands holds back, by what its rows begin with or name."""


@dataclass(frozen=True, slots=True)
class Worst:
    """The highest speed, clamp and torque of a scene, and what clamp and torque stay after it."""

    mm_s: float = 0.0
    clamp_nm: float = 0.0
    nm: float = 0.0
    left_clamp_nm: float = 0.0
    left_nm: float = 0.0

    def cells(self) -> list[str]:
        """Return the cells of a row."""
        return [
            f"{self.mm_s:.0f}",
            f"{self.energy_mj:.1f}",
            f"{newtons(self.clamp_nm):.0f}",
            f"{self.nm:.1f}",
            f"{newtons(self.left_clamp_nm):.0f} N, {self.left_nm:.1f} N·m",
        ]

    @property
    def energy_mj(self) -> float:
        """The energy of rotor and fingers at the highest speed."""
        return kinetic_mj(self.mm_s)


def newtons(torque_nm: float) -> float:
    """Return the force of a torque as the daemon counts it."""
    return 10.0 * torque_nm


def worst(scenes: Iterable[Worst]) -> Worst:
    """Return the worst of each figure."""
    seen = list(scenes)
    return Worst(
        max(one.mm_s for one in seen),
        max(one.clamp_nm for one in seen),
        max(one.nm for one in seen),
        max(one.left_clamp_nm for one in seen),
        max(one.left_nm for one in seen),
    )


def seen(bench: Bench, later_s: float = LATER_S) -> Worst:
    """Let some seconds pass; return what has been seen since the last reset, and what stays."""
    bench.run(later_s)
    gripper = bench.gripper
    peaks = (bench.peak_mm_s, bench.felt_nm, bench.peak_nm)
    return Worst(*peaks, gripper.clamp_nm, abs(gripper.motor_torque_nm))


Scene = Callable[[str, float], Worst]
"""Plays on a mount, with an object of some stiffness."""


def ended(bench: Bench, number: int) -> Worst:
    """Let a motion end, if it does."""
    client, ends_s = bench.client_of_bench, bench.now_s + WITHIN_S
    while not client.has_answer(number) and bench.now_s < ends_s:
        bench.tick()
    return seen(bench)


def onto(method: str, from_mm: float = FROM_MM, **params: Any) -> Scene:
    """Return a call that leads the jaws onto the object."""

    def play(mount: str, stiffness_nm_rad: float) -> Worst:
        bench = Bench(mount, from_mm)
        bench.put_object(stiffness_nm_rad)
        return ended(bench, bench.client_of_bench.send(method, **params))

    return play


def opening(mount: str, _stiffness_nm_rad: float) -> Worst:
    """Open onto the stop."""
    bench = Bench(mount, TO_MM)
    return ended(bench, bench.client_of_bench.send("motion.open", speed_mm_s=FASTEST_MM_S))


def gripping(mount: str, stiffness_nm_rad: float, force_n: float) -> Bench:
    """Return a gripper that holds the object by a force."""
    bench = Bench(mount, OBJECT_MM + 5.0)
    bench.put_object(stiffness_nm_rad)
    client = bench.client_of_bench
    client.result("motion.grasp", force_n=force_n, until="verdict")
    bench.run(force_n / MotionConfig().force_rate_n_s + 0.5)
    bench.reset()
    return bench


def gripped(method: str, force_n: float = 20.0, **params: Any) -> Scene:
    """Return a call while an object is held."""

    def play(mount: str, stiffness_nm_rad: float) -> Worst:
        bench = gripping(mount, stiffness_nm_rad, force_n)
        return ended(bench, bench.client_of_bench.send(method, **params))

    return play


def stiff_file(bench: Bench, **more: Any) -> dict[str, Any]:
    """Return a file's content with the stiffest gains, for the true limits."""
    geometry = bench.controller.geometry
    assert geometry is not None
    content = {
        "zero_position_rad": geometry.closed_rad,
        "max_position_rad": geometry.open_rad,
        "rad_to_mm": geometry.rad_to_mm,
    }
    return content | {"kp": 500.0, "kd": 5.0} | more


def loads(mount: str, stiffness_nm_rad: float) -> Worst:
    """Load a stiff file while an object is held, and stop."""
    bench = gripping(mount, stiffness_nm_rad, 20.0)
    client = bench.client_of_bench
    client.call("calibration.load", content=stiff_file(bench))
    client.result("stop")
    return seen(bench)


def enables(mount: str, stiffness_nm_rad: float) -> Worst:
    """Enable a motor whose jaws a hand presses on the object meanwhile."""
    bench = Bench(mount, OBJECT_MM + 1.0)
    bench.put_object(stiffness_nm_rad)
    bench.client_of_bench.result("motor.disable")
    closing = bench.gripper.parameters.close_sign
    bench.gripper.push(3.0 * closing)
    bench.run(0.5)
    number = bench.client_of_bench.send("motor.enable")
    bench.run(0.1)
    bench.gripper.push(0.0)
    bench.reset()
    return ended(bench, number)


def clears(mount: str, stiffness_nm_rad: float) -> Worst:
    """Stop while an object is held, and clear the stop."""
    bench = gripping(mount, stiffness_nm_rad, 20.0)
    bench.client_of_bench.result("stop")
    return ended(bench, bench.client_of_bench.send("stop.clear"))


def holds(mount: str, stiffness_nm_rad: float) -> Worst:
    """Hold jaws that a hand moves, as fast as a motion may."""
    bench = Bench(mount, FROM_MM)
    bench.put_object(stiffness_nm_rad)
    client = bench.client_of_bench
    client.result("motion.zero_gravity")
    bench.gripper.push(0.25 * bench.gripper.parameters.close_sign)
    bench.run_until(lambda: bench.peak_mm_s > 0.95 * FASTEST_MM_S, 2.0)
    bench.reset()
    bench.gripper.push(0.0)
    return ended(bench, client.send("motion.hold"))


def sets_zero(mount: str, stiffness_nm_rad: float) -> Worst:
    """Set the zero of jaws that press on the object."""
    bench = gripping(mount, stiffness_nm_rad, 20.0)
    client = bench.client_of_bench
    client.call("motor.disable")
    return ended(bench, client.send("motor.set_zero"))


def streams(torque_nm: float) -> Scene:
    """Return a stream beyond the object, that ends."""

    def play(mount: str, stiffness_nm_rad: float) -> Worst:
        bench = Bench(mount, FROM_MM)
        bench.put_object(stiffness_nm_rad)
        for _ in range(round(1.0 / PERIOD_S)):
            bench.client_of_bench.send(
                "stream.set", opening_mm=TO_MM, speed_mm_s=FASTEST_MM_S, torque_nm=torque_nm
            )
            bench.tick()
        return seen(bench)

    return play


def pushed(mount: str, stiffness_nm_rad: float, *, vanishes: bool = False) -> Worst:
    """Push on the object with the most torque, and then take it away, or let the jaws go."""
    bench = Bench(mount, FROM_MM)
    bench.put_object(stiffness_nm_rad)
    push_nm = DM4310.holding_nm * bench.gripper.parameters.close_sign
    for tick in range(600):
        if tick == 400 and vanishes:
            bench.reset()
            bench.gripper.remove_object()
        let_go = tick >= 400 and not vanishes
        bench.client_of_bench.send("stream.set", push_nm=0.0 if let_go else push_nm)
        bench.tick()
    return seen(bench)


def path(speed_mm_s: float) -> list[tuple[float, float]]:
    count = round((FROM_MM - TO_MM) / speed_mm_s / 0.01)
    way_mm = (FROM_MM - TO_MM) / count
    return [(0.01 * n, (FROM_MM - way_mm * n) / TRAVEL_MM) for n in range(count + 1)]


def plays(mount: str, stiffness_nm_rad: float) -> Worst:
    """Play a path through the object."""
    bench = Bench(mount, FROM_MM)
    bench.put_object(stiffness_nm_rad)
    client = bench.client_of_bench
    name = uploaded(client, path(0.99 * FASTEST_MM_S))
    return ended(bench, client.send("trajectory.play", name=name))


def paused(mount: str, stiffness_nm_rad: float) -> Worst:
    """Pause a replay in front of the object, and continue it as fast as it goes."""
    bench = Bench(mount, FROM_MM)
    bench.put_object(stiffness_nm_rad)
    client = bench.client_of_bench
    name = uploaded(client, path(50.0))
    number = client.send("trajectory.play", name=name)
    bench.run(0.4)
    client.result("trajectory.control", action="pause")
    bench.run(0.5)
    client.call("trajectory.control", action="speed", speed=2.9)
    client.result("trajectory.control", action="resume")
    return ended(bench, number)


class Moving(Leader):
    """Makes the link of a follower whose leader does as a function of time says."""

    def __init__(self, opening_mm: Callable[[float], float]) -> None:
        super().__init__(0.0)
        self._opening_mm = opening_mm

    def _openness(self, at_s: float) -> float:
        opening_mm = FROM_MM if at_s < SETTLE_S else self._opening_mm(at_s - SETTLE_S)
        return opening_mm / TRAVEL_MM


def closes(speed_mm_s: float) -> Callable[[float], float]:
    return lambda at_s: max(FROM_MM - speed_mm_s * at_s, TO_MM)


def leaps(at_s: float) -> float:
    return FROM_MM if int(at_s / 0.3) % 2 else 0.0


def lies(at_s: float) -> float:
    return random.Random(round(at_s / PERIOD_S)).uniform(-3.0, 4.0) * TRAVEL_MM


def led(opening_mm: Callable[[float], float], **params: Any) -> Scene:
    """Return a leader and its follower, whose jaws meet the object."""

    def play(mount: str, stiffness_nm_rad: float) -> Worst:
        bench = follower(mount, opening_mm, **params)
        bench.put_object(stiffness_nm_rad)
        return seen(bench, 2.0 + LATER_S)

    return play


def follower(mount: str, opening_mm: Callable[[float], float], **params: Any) -> Bench:
    """Return a follower that has found its leader."""
    leader = Moving(opening_mm)
    bench = Bench(mount, FROM_MM, leader)
    leader.now_s = bench.now_s
    bench.client_of_bench.result("teleop.start", mode="slave", host="leader", **params)
    bench.run(SETTLE_S)
    bench.reset()
    return bench


FAST = {"speed_mm_s": FASTEST_MM_S}
CALLS: dict[str, Scene] = {
    "motor.enable": enables,
    "motion.open": opening,
    "motion.close": onto("motion.close", **FAST),
    "motion.grasp": onto("motion.grasp", force_n=MOST_N, until="verdict", **FAST),
    "motion.move": onto("motion.move", opening_mm=TO_MM, kp=500.0, kd=2.0, **FAST),
    "motion.hold": holds,
    "motion.zero_gravity": gripped("motion.zero_gravity", MOST_N),
    "motion.set_force": onto("motion.set_force", force_n=MOST_N),
    "stream.set": streams(1.0),
    "stop.clear": clears,
    "calibration.load": loads,
    "calibration.rescale": gripped("calibration.rescale", stroke_mm=75.0),
    "calibration.zero": onto("calibration.zero", config={"speed_mm_s": FASTEST_MM_S}),
    "calibration.manual": gripped("calibration.manual", step="begin"),
    "motor.set_zero": sets_zero,
    "trajectory.play": plays,
    "trajectory.control": paused,
    "teleop.start": led(closes(FASTEST_MM_S)),
}
"""A scene for each method that may move the jaws."""


# What is configured, and what a file says


def configured(config: dict[str, Any]) -> Iterator[Worst]:
    """Play the motions as fast as they go, with fields of the configuration at an end."""
    together = dict(config)
    if "stop_lead_mm" in config:
        together["max_lead_mm"] = max(config["stop_lead_mm"], MotionConfig().max_lead_mm)
    if config.get("max_lead_mm", math.inf) < MotionConfig().stop_lead_mm:
        together["stop_lead_mm"] = config["max_lead_mm"]
    speed = {} if any("speed" in name for name in config) else FAST
    motions = [
        onto("motion.move", opening_mm=TO_MM, config=together, **speed),
        onto("motion.close", config=together, **speed),
        onto("motion.grasp", force_n=MOST_N, until="verdict", config=together, **speed),
        onto("motion.set_force", force_n=MOST_N, config=together),
    ]
    if any(name.startswith("calib") for name in config):
        motions.append(onto("calibration.zero", config=together))
    for motion in motions:
        for mount, stiffness_nm_rad in zip(MOUNTS, (SOFT_NM_RAD[-1], RIGID_NM_RAD), strict=True):
            yield motion(mount, stiffness_nm_rad)


def filed(**content: Any) -> Iterator[Worst]:
    """Load a file while the jaws stand, and play the motions as fast as it lets them."""
    for mount, stiffness_nm_rad in product(MOUNTS, (SOFT_NM_RAD[-1], RIGID_NM_RAD)):
        for method, params in (
            ("motion.move", {"openness": 0.2}),
            ("motion.close", {}),
            ("motion.open", {}),
            ("motion.grasp", {"force_n": MOST_N, "until": "verdict"}),
        ):
            bench = Bench(mount, FROM_MM)
            bench.put_object(stiffness_nm_rad)
            client = bench.client_of_bench
            given = dict(content)
            closed_rad, open_rad = limits_of_mount(mount)
            way = 1.0 if open_rad > closed_rad else -1.0
            given["zero_position_rad"] = closed_rad + way * given.pop("closed_by_rad", 0.0)
            given["max_position_rad"] = open_rad + way * given.pop("open_by_rad", 0.0)
            travel_rad = abs(given["max_position_rad"] - given["zero_position_rad"])
            given["rad_to_mm"] = given.pop("share", 1.0) * (TRAVEL_MM / travel_rad)
            client.result("calibration.load", content=given)
            scale = given["rad_to_mm"]
            speed_mm_s = 0.999 * min(FASTEST_MM_S, DM4310.fastest_rad_s * scale)
            yield ended(bench, client.send(method, speed_mm_s=speed_mm_s, **params))


FILES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("the softest gains", {"kp": 1.0, "kd": 0.1}),
    ("the stiffest gains", {"kp": 500.0, "kd": 5.0}),
    ("stiff gains, the least damping", {"kp": 500.0, "kd": 1.0}),
    ("soft gains, the most damping", {"kp": 1.0, "kd": 5.0}),
    ("the smallest scale", {"share": 0.845}),
    ("the largest scale", {"share": 1.13}),
    ("limits 0.3 rad too wide", {"closed_by_rad": -0.3, "open_by_rad": 0.3}),
    ("limits 0.3 rad too narrow", {"closed_by_rad": 0.3, "open_by_rad": -0.3}),
)


# What happens on the way


def moving(mount: str, method: str = "motion.move", speed_mm_s: float = FASTEST_MM_S) -> Bench:
    """Return a gripper whose jaws run."""
    bench = Bench(mount, WIDE_MM)
    params = {"opening_mm": 5.0} if method == "motion.move" else {}
    if method == "motion.grasp":
        params = {"force_n": MOST_N}
    bench.client_of_bench.send(method, speed_mm_s=speed_mm_s, **params)
    bench.run(RUNS_S)
    bench.reset()
    return bench


def stops(level: str) -> Iterator[Worst]:
    """Stop running jaws, and jaws that hold an object by the most force."""
    for mount, ticks in product(MOUNTS, range(4)):
        bench = moving(mount)
        bench.run(ticks * PERIOD_S)
        bench.client_of_bench.result("stop", level=level)
        yield seen(bench)
    for mount, stiffness_nm_rad in product(MOUNTS, OBJECTS_NM_RAD):
        if level != "hold" and stiffness_nm_rad != RIGID_NM_RAD:
            continue  # what is soft opens slack jaws by itself
        bench = gripping(mount, stiffness_nm_rad, MOST_N)
        bench.client_of_bench.result("stop", level=level)
        yield seen(bench)


def relaxes() -> Iterator[Worst]:
    """Let jaws go slack that hold a soft object by the most force."""
    for mount, stiffness_nm_rad in product(MOUNTS, SOFT_NM_RAD):
        yield CALLS["motion.zero_gravity"](mount, stiffness_nm_rad)
        bench = gripping(mount, stiffness_nm_rad, MOST_N)
        bench.client_of_bench.result("stop", level="relax")
        yield seen(bench)


def held_up(late_s: float | None = None) -> Iterator[Worst]:
    """Hold running jaws fast for a moment, or let the daemon be late."""
    methods = ("motion.move", "motion.close", "motion.grasp")
    times_s = (0.03, 0.05, 0.1, 0.15, 0.2) if late_s is None else (0.02, late_s)
    for mount, method, speed_mm_s, for_s in product(MOUNTS, methods, (50.0, FASTEST_MM_S), times_s):
        bench = moving(mount, method, speed_mm_s)
        bench.hold_up(for_s, late=late_s is not None)
        yield seen(bench, 0.5)


def held_up_leader() -> Iterator[Worst]:
    """Hold a follower's jaws fast for a moment, while its leader goes on."""
    for mount, speed_mm_s, for_s in product(MOUNTS, (50.0, FASTEST_MM_S, 1000.0), (0.05, 0.3)):
        bench = follower(mount, closes(speed_mm_s))
        bench.run(0.1)
        bench.hold_up(for_s, late=False)
        yield seen(bench, 1.0)


def vanishes(force_n: float) -> Iterator[Worst]:
    """Take an object away that is held."""
    for mount, stiffness_nm_rad in product(MOUNTS, OBJECTS_NM_RAD):
        bench = gripping(mount, stiffness_nm_rad, force_n)
        bench.gripper.remove_object()
        yield seen(bench)


def gives_way() -> Iterator[Worst]:
    """Take an object away that a motion presses on: nobody has set a force."""
    for mount, stiffness_nm_rad, method in product(
        MOUNTS, OBJECTS_NM_RAD, ("motion.move", "motion.close")
    ):
        bench = Bench(mount, FROM_MM)
        bench.put_object(stiffness_nm_rad)
        params = {"opening_mm": TO_MM} if method == "motion.move" else {}
        bench.client_of_bench.send(method, speed_mm_s=FASTEST_MM_S, **params)
        bench.run_until(lambda b=bench: b.gripper.clamp_nm > 0.0)  # type: ignore[misc]
        bench.run(0.1)
        bench.reset()
        bench.gripper.remove_object()
        yield seen(bench)


def by_3_nm() -> Iterator[Worst]:
    """Take an object away that a stream presses on with the most torque."""
    for mount, stiffness_nm_rad in product(MOUNTS, OBJECTS_NM_RAD):
        bench = Bench(mount, FROM_MM)
        bench.put_object(stiffness_nm_rad)
        for tick in range(300):
            if tick == 200:
                bench.reset()
                bench.gripper.remove_object()
            bench.client_of_bench.send(
                "stream.set", opening_mm=TO_MM, speed_mm_s=FASTEST_MM_S, torque_nm=3.0
            )
            bench.tick()
        yield seen(bench)


def push_vanishes() -> Iterator[Worst]:
    """Take an object away that a push presses on with the most torque."""
    for mount, stiffness_nm_rad in product(MOUNTS, OBJECTS_NM_RAD):
        yield pushed(mount, stiffness_nm_rad, vanishes=True)


def by_damage() -> Worst:
    """Damage one command."""
    damage = worst_of_one_bit()
    return Worst(damage.mm_s, 0.0, damage.nm)


def everywhere(scene: Scene) -> Iterator[Worst]:
    """Play a scene on both mounts with each object."""
    return (scene(*setting) for setting in product(MOUNTS, OBJECTS_NM_RAD))


SLACK = ("motion.zero_gravity", "calibration.manual")
"""What is soft opens the slack jaws by itself; that has a row of its own."""


def rows() -> Iterator[tuple[str, Worst]]:
    """Return the name and the worst of each row."""
    for method, scene in CALLS.items():
        if method in SLACK:
            rigid = (scene(mount, RIGID_NM_RAD) for mount in MOUNTS)
            yield f"`{method}`", worst(rigid)
        else:
            yield f"`{method}`", worst(everywhere(scene))
    yield "`stream.set` by 3 N·m", worst(everywhere(streams(3.0)))
    yield "`stream.set` pushes by 4 N·m, and lets go", worst(everywhere(pushed))
    yield "`job.cancel`, `stop`: hold", worst(stops("hold"))
    yield "`stop`: relax", worst(stops("relax"))
    yield "`stop`: disable", worst(stops("disable"))
    for name, (low, high) in ranges_of(DM4310).items():
        ends = (scene for value in (low, high) for scene in configured({name: whole(name, value)}))
        yield f"`{name}` {low:g} and {high:g}", worst(ends)
    for name, content in FILES:
        yield f"a file: {name}", worst(filed(**content))
    for speed_mm_s in (50.0, FASTEST_MM_S, 1000.0):
        yield f"a leader closes at {speed_mm_s:g} mm/s", worst(everywhere(led(closes(speed_mm_s))))
    yield "a leader leaps", worst(everywhere(led(leaps)))
    yield "a leader lies", worst(everywhere(led(lies)))
    yield "a follower is held up", worst(held_up_leader())
    yield "jaws are held up", worst(held_up())
    yield "a tick is late by up to 80 ms", worst(held_up(0.08))
    yield "what `move` and `close` press on gives way", worst(gives_way())
    for force_n in (10.0, 20.0, 30.0, 40.0):
        yield f"an object vanishes from {force_n:g} N", worst(vanishes(force_n))
    yield "what a stream by 3 N·m presses on vanishes", worst(by_3_nm())
    yield "what a push by 4 N·m presses on vanishes", worst(push_vanishes())
    yield "`zero_gravity`, `relax`: a soft object held with 40 N", worst(relaxes())
    yield "a damaged frame (SLCAN)", by_damage()


def whole(name: str, value: float) -> float:
    """Return an integer for a field that takes no other number."""
    return int(value) if isinstance(getattr(MotionConfig(), name), int) else value


def is_forced(name: str) -> bool:
    """Return True if a row's figures are no command's."""
    return any(begins in name for begins in FORCED)


HEAD = ["what", "mm/s", "mJ", "N", "N·m", "after 3 s"]


def main() -> None:
    """Print the table."""
    table("The worst", HEAD, ([name, *worst_of_row.cells()] for name, worst_of_row in rows()))


if __name__ == "__main__":
    main()
