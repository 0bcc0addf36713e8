"""How hard the jaws press and how fast they get: tables of docs/generated/pressing-figures.md.

python -m bench.jaws.presses

What the jaws meet is an object of `OBJECT_MM`, rigid (`RIGID_NM_RAD`) or as soft as a finger
(`SOFT_NM_RAD`), or a rigid stop. A figure is the worst of both mounts. The time is simulated, so
the tables are the same on every machine.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

from bench.jaws.held import SETTINGS, HeldRig
from bench.jaws.rig import TRAVEL_MM
from bench.tables import table
from bench.teleop.follow import SETTLE_S, ScriptedLeader
from litegripd.app.build import build_service
from litegripd.control.motions.move import Direction
from litegripd.model.gripper import DM4310, FORCE_PER_TORQUE_N_NM
from litegripd.model.teleop import LinkOptions
from litegripd.sim.plant import MOUNTS, SimulatorParameters, limits_of_mount
from litegripd.teleop.link import Link
from tests.trajectories import uploaded
from tests.world import PERIOD_S, FixedFacts, World

SPEEDS_MM_S = (50.0, 150.0)
RIGID_NM_RAD, SOFT_NM_RAD = 1500.0, 20.0
OBJECT_MM = 40.0
FROM_MM, TO_MM = 70.0, 20.0
LATER_S = 4.0
PRESSED_S = 4.0
"""How long what does not end by itself is watched."""
LOOKS = 10
ABOVE = 1.02
"""Less counts as the torque itself: a frame's codes are coarse."""
LOSS_FORCES_N = (10.0, 20.0, 30.0, 40.0)
COILS_C = (25.0, 50.0)
FREE_SPEEDS_MM_S = (50.0, 100.0, 150.0)
HELD_UP_S = (0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2)
FAST = 1.2
"""Times what was asked for: jaws that catch up, and do not merely overshoot."""
LATE_S = (0.05, 0.08)
"""Ticks so late that any motor bears them."""


class Bench(World):
    """A daemon and its gripper, looked at ten times in each period from `reset` on."""

    def __init__(
        self,
        mount: str,
        opening_mm: float,
        leader: "Leader | None" = None,
        object_nm_rad: float = RIGID_NM_RAD,
        *,
        period_s: float = PERIOD_S,
    ) -> None:
        self._object_nm_rad = object_nm_rad
        closed_rad, open_rad = limits_of_mount(mount)
        usual = SimulatorParameters()
        parameters = SimulatorParameters(
            closed_rad=closed_rad,
            open_rad=open_rad,
            initial_opening_mm=opening_mm,
            closed_springback_rad=(usual.closed_springback_press_nm - 2.0 * usual.coulomb_nm)
            / RIGID_NM_RAD,
            open_stiffness_nm_rad=RIGID_NM_RAD,
        )
        self.fast_mm_s = math.inf
        self.reset()
        super().__init__(mount, parameters=parameters, period_s=period_s)
        if leader is not None:
            self.service = build_service(
                self.controller, FixedFacts(), period_s, dumps=self.dumps, links=leader
            )
        self.client_of_bench = self.enabled()
        self.reset()

    def reset(self) -> None:
        """Begin to look."""
        self.peak_nm = self.peak_mm_s = self.felt_nm = 0.0
        self.above_rating_s = self.above_peak_s = self.fast_s = 0.0

    def advance(self) -> None:
        """Let the gripper move until now, and look at it on the way."""
        gripper, began_s = self.gripper, self.now_s - self.period_s
        for look in range(1, LOOKS + 1):
            gripper.advance(began_s + self.period_s * look / LOOKS)
            torque_nm = abs(gripper.motor_torque_nm)
            speed_mm_s = abs(gripper.velocity_rad_s) * gripper.parameters.rad_to_mm
            self.peak_nm = max(self.peak_nm, torque_nm)
            self.felt_nm = max(self.felt_nm, gripper.clamp_nm)
            self.peak_mm_s = max(self.peak_mm_s, speed_mm_s)
            look_s = self.period_s / LOOKS
            self.above_rating_s += look_s * (torque_nm > ABOVE * DM4310.rated_nm)
            self.above_peak_s += look_s * (torque_nm > ABOVE * DM4310.peak_nm)
            self.fast_s += look_s * (speed_mm_s > self.fast_mm_s)

    def hold_up(self, held_s: float, *, late: bool) -> None:
        """Let the jaws be stuck, or the daemon stand still, for a while; look from then on."""
        if late:
            self.now_s += held_s - self.period_s
        else:
            self.gripper.jam()
            self.run(held_s)
            self.gripper.free()
        self.reset()

    def put_object(self, stiffness_nm_rad: float | None = None) -> None:
        stiffness = self._object_nm_rad if stiffness_nm_rad is None else stiffness_nm_rad
        self.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=stiffness)

    def seen(self, outcome: str, later_s: float) -> "Pressed":
        """Return what was seen so far, and what stays after so long."""
        felt_n = self.felt_nm * FORCE_PER_TORQUE_N_NM
        so_far = (outcome, self.peak_nm, self.above_rating_s, self.above_peak_s, felt_n)
        self.run(later_s)
        left_n = self.gripper.clamp_nm * FORCE_PER_TORQUE_N_NM
        return Pressed(*so_far, abs(self.gripper.motor_torque_nm), left_n)


@dataclass(frozen=True, slots=True)
class Pressed:
    """What was seen of one motion; `left_nm` is the torque `LATER_S` after its end.

    It made more than the motor's rated and peak torque for some seconds. `felt_n` and `left_n` are
    what the object felt, 0 without one.
    """

    outcome: str
    peak_nm: float
    above_rating_s: float
    above_peak_s: float
    felt_n: float
    left_nm: float
    left_n: float


class Leader:
    """Makes the link of a follower whose leader closes at a speed, and stays closed."""

    def __init__(self, speed_mm_s: float) -> None:
        self.now_s = 0.0
        self._speed_mm_s = speed_mm_s

    def open(self, _options: LinkOptions) -> Link:
        return ScriptedLeader(self._openness, self.now_s, PERIOD_S)

    def warning(self, _options: LinkOptions) -> str | None:
        return None

    def _openness(self, at_s: float) -> float:
        closed_mm = self._speed_mm_s * max(at_s - SETTLE_S, 0.0)
        return max(FROM_MM - closed_mm, TO_MM) / TRAVEL_MM


Motion = Callable[[str, float, float], Pressed]
"""By mount, speed (mm/s) and stiffness of the object (N·m/rad)."""


def ended(bench: Bench, number: int) -> Pressed:
    """Let a motion end, and look at what stays."""
    client = bench.client_of_bench
    bench.run_until(lambda: client.has_answer(number))
    return bench.seen(str(client.answers[number]["result"]["outcome"]), LATER_S)


def meeting(method: str, speed_is: str = "speed_mm_s", **params: Any) -> Motion:
    """Return a motion that closes onto the object."""

    def run(mount: str, speed_mm_s: float, object_nm_rad: float) -> Pressed:
        bench = Bench(mount, FROM_MM, object_nm_rad=object_nm_rad)
        bench.put_object()
        number = bench.client_of_bench.send(method, **{speed_is: speed_mm_s}, **params)
        return ended(bench, number)

    return run


def to_stop(direction: Direction) -> Motion:
    """Return a motion to a stop."""

    def run(mount: str, speed_mm_s: float, _object_nm_rad: float) -> Pressed:
        bench = Bench(mount, OBJECT_MM)
        return ended(
            bench, bench.client_of_bench.send(f"motion.{direction}", speed_mm_s=speed_mm_s)
        )

    return run


def stream(torque_nm: float) -> Motion:
    """Return a stream of set-points beyond the object; what is left is what it presses with."""

    def run(mount: str, speed_mm_s: float, object_nm_rad: float) -> Pressed:
        bench = Bench(mount, FROM_MM, object_nm_rad=object_nm_rad)
        bench.put_object()
        for _ in range(round(PRESSED_S / PERIOD_S)):
            bench.client_of_bench.send(
                "stream.set", opening_mm=TO_MM, speed_mm_s=speed_mm_s, torque_nm=torque_nm
            )
            bench.tick()
        return bench.seen("pressing", 0.0)

    return run


def play(torque_nm: float) -> Motion:
    """Return a replay of a path through the object."""

    def run(mount: str, speed_mm_s: float, object_nm_rad: float) -> Pressed:
        bench = Bench(mount, FROM_MM, object_nm_rad=object_nm_rad)
        bench.put_object()
        count = round((FROM_MM - TO_MM) / (0.99 * speed_mm_s) / 0.01)
        way_mm = (FROM_MM - TO_MM) / count
        points = [(0.01 * n, (FROM_MM - way_mm * n) / TRAVEL_MM) for n in range(count + 1)]
        client = bench.client_of_bench
        name = uploaded(client, points)
        return ended(bench, client.send("trajectory.play", name=name, torque_nm=torque_nm))

    return run


def follow(mount: str, speed_mm_s: float, object_nm_rad: float) -> Pressed:
    """Follow a leader that closes beyond the object, and stays there."""
    leader = Leader(speed_mm_s)
    bench = Bench(mount, FROM_MM, leader, object_nm_rad)
    bench.put_object()
    leader.now_s = bench.now_s
    bench.client_of_bench.send("teleop.start", mode="slave", host="leader")
    bench.run(SETTLE_S)
    bench.reset()
    bench.run((FROM_MM - TO_MM) / speed_mm_s + PRESSED_S)
    return bench.seen("pressing", 0.0)


def zero(mount: str, speed_mm_s: float, _object_nm_rad: float) -> Pressed:
    """Measure the travel between rigid stops, with nothing in the way."""
    bench = Bench(mount, OBJECT_MM)
    config = {"speed_mm_s": speed_mm_s}
    return ended(bench, bench.client_of_bench.send("calibration.zero", config=config))


ROWS: tuple[tuple[str, Motion], ...] = (
    ("`grasp` by 10 N", meeting("motion.grasp", force_n=10.0, until="verdict")),
    ("`grasp` by 40 N", meeting("motion.grasp", force_n=40.0, until="verdict")),
    ("`close`, something in the way", meeting("motion.close")),
    ("`close`, at the stop", to_stop("close")),
    ("`open`, at the stop", to_stop("open")),
    ("`move`, `goto`", meeting("motion.move", opening_mm=TO_MM)),
    ("`stream`", stream(1.0)),
    ("`stream` by 3 N·m", stream(3.0)),
    ("`play`", play(2.0)),
    ("`play` by 3 N·m", play(3.0)),
    ("a follower", follow),
    ("`zero`", zero),
)


WITHOUT_OBJECT = ("`close`, at the stop", "`open`, at the stop", "`zero`")


def pressed_row(name: str, motion: Motion, object_nm_rad: float = RIGID_NM_RAD) -> list[str]:
    """Return what a motion does at each speed, and what stays after the faster ones."""
    cells, after = [name], ""
    for speed_mm_s in SPEEDS_MM_S:
        seen = [motion(mount, speed_mm_s, object_nm_rad) for mount in MOUNTS]
        cell = f"{max(one.peak_nm for one in seen):.2f} N·m"
        for most_nm, above_s in (
            (DM4310.rated_nm, max(one.above_rating_s for one in seen)),
            (DM4310.peak_nm, max(one.above_peak_s for one in seen)),
        ):
            cell += f", {1e3 * above_s:.0f} ms above {most_nm:g}" if above_s else ""
        felt_n, left_n = max(one.felt_n for one in seen), max(one.left_n for one in seen)
        cells.append(f"{cell}; {felt_n:.0f} N" if felt_n else cell)
        outcomes = ", ".join(sorted({one.outcome for one in seen}))
        after = f"`{outcomes}`, {max(one.left_nm for one in seen):.2f} N·m"
        after += f"; {left_n:.0f} N" if felt_n else ""
    return [*cells, after]


def lost_row(force_n: float) -> list[str]:
    """Return what free jaws do whose object vanishes, after grasps at each speed."""
    cells = [f"{force_n:g} N"]
    for speed_mm_s in SPEEDS_MM_S:
        rigs = (HeldRig(setting, force_n, speed_mm_s=speed_mm_s) for setting in SETTINGS)
        seen = [rig.watch(lambda rig: rig.gripper.remove_object()) for rig in rigs]
        peak_mm_s = max(after.peak_mm_s for after in seen)
        told_ms = max(1e3 * after.told_s if after.told_s else float("nan") for after in seen)
        far_mm = max(after.far_mm for after in seen)
        energy_mj = kinetic_mj(peak_mm_s)
        cells.append(f"{peak_mm_s:.0f} mm/s, {energy_mj:.0f} mJ, {told_ms:.0f} ms, {far_mm:.1f} mm")
    return cells


def kinetic_mj(speed_mm_s: float) -> float:
    """Return the energy of rotor and fingers at a speed of the jaws."""
    usual = SimulatorParameters()
    return 500.0 * usual.inertia_kg_m2 * (speed_mm_s / usual.rad_to_mm) ** 2


def free_row(speed_mm_s: float) -> list[str]:
    """Return how fast free jaws get in a `move`, and what energy they have."""
    fastest = 0.0
    for mount in MOUNTS:
        for from_mm, to_mm in ((FROM_MM, TO_MM), (TO_MM, FROM_MM)):
            bench = Bench(mount, from_mm)
            bench.client_of_bench.result("motion.move", opening_mm=to_mm, speed_mm_s=speed_mm_s)
            fastest = max(fastest, bench.peak_mm_s)
    asked, got = kinetic_mj(speed_mm_s), kinetic_mj(fastest)
    return [f"{speed_mm_s:g} mm/s", f"{asked:.1f} mJ", f"{fastest:.0f} mm/s", f"{got:.1f} mJ"]


HELD_UP: tuple[tuple[str, dict[str, Any]], ...] = (
    ("motion.move", {"opening_mm": TO_MM}),
    ("motion.close", {}),
    ("motion.grasp", {"force_n": 10.0, "until": "verdict"}),
)


def held_up_rows(method: str, params: dict[str, Any]) -> Iterator[list[str]]:
    """Return how fast jaws get that were held up for a moment, by something or by a late tick."""
    name = method.partition(".")[2]
    for happens, times_s in (("held fast", HELD_UP_S), ("a late tick", LATE_S)):
        cells = [f"`{name}`, {happens}"]
        for speed_mm_s in SPEEDS_MM_S:
            seen = []
            for mount, held_s in product(MOUNTS, times_s):
                bench = Bench(mount, FROM_MM)
                bench.fast_mm_s = FAST * speed_mm_s
                bench.client_of_bench.send(method, speed_mm_s=speed_mm_s, **params)
                bench.run(0.1)
                bench.hold_up(held_s, late=times_s is LATE_S)
                bench.run(0.3)
                seen.append(bench)
            fastest, fast_s = (max(b.peak_mm_s for b in seen), max(b.fast_s for b in seen))
            cells.append(f"{fastest:.0f} mm/s, {kinetic_mj(fastest):.0f} mJ, {1e3 * fast_s:.0f} ms")
        yield cells


def borne_row(force_n: float) -> list[str]:
    """Return for how long a coil of some temperature bears a force, as an event foretells it."""
    cells = [f"{force_n:g} N"]
    for coil_c in COILS_C:
        bench = Bench(MOUNTS[0], FROM_MM)
        bench.put_object()
        bench.gripper.heat_coil(coil_c)
        bench.run(SETTLE_S)
        bench.client_of_bench.result("events.subscribe")
        bench.client_of_bench.result("motion.grasp", force_n=force_n, until="verdict")
        told = [n["params"] for n in bench.client_of_bench.notifications if n["method"] == "event"]
        borne_s = [event["data"]["bears_s"] for event in told if event["kind"] == "heat"]
        cells.append(f"{borne_s[0]:.0f} s" if borne_s else "an hour or more")
    return cells


def speeds(what: str) -> Iterator[str]:
    return (f"{what} {speed:g} mm/s" for speed in SPEEDS_MM_S)


def main() -> None:
    """Print all tables."""
    head = ["motion", *speeds("most at"), "then"]
    table("Something rigid is met", head, (pressed_row(*row) for row in ROWS))
    soft = (pressed_row(*row, SOFT_NM_RAD) for row in ROWS if row[0] not in WITHOUT_OBJECT)
    table("Something soft is met", head, soft)
    head = ["held with", *speeds("grasped at")]
    table("The held object vanishes", head, map(lost_row, LOSS_FORCES_N))
    head = ["held with", *(f"from {coil_c:g} °C" for coil_c in COILS_C)]
    table("The coil bears it for", head, map(borne_row, LOSS_FORCES_N))
    head = ["asked for", "energy", "fastest", "energy then"]
    table("Free jaws", head, map(free_row, FREE_SPEEDS_MM_S))
    head = ["motion", *speeds("at")]
    rows = (row for held_up in HELD_UP for row in held_up_rows(*held_up))
    table("Jaws that were held up", head, rows)


if __name__ == "__main__":
    main()
