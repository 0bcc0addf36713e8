"""What holds and what is lost in simulation: tables of docs/generated/grasping-figures.md.

python -m bench.jaws.holding

An object of 50 mm and 250 N·m/rad. Every cell of the first three tables is the worst of both mounts
and 100, 200 and 1000 Hz; the time is simulated, so that the tables are the same on every machine.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

from bench.jaws.damping import HOLD_FORCE_N, MOTORS, swing_of_gain, swing_of_hold
from bench.jaws.held import RATES_HZ, SETTINGS, After, HeldRig, Setting
from bench.tables import table
from litegripd.sim.plant import MOUNTS, SimulatorParameters

FORCES_N = (5.0, 10.0, 20.0, 30.0, 40.0)
PUSHES = ((1.5, 0.015), (2.5, 0.015), (4.0, 0.03))
OPENINGS = ((2.0, 0.03), (3.0, 0.06))
STEPS_MM = (0.5, 1.0, 2.0, 3.0, 4.0)
LOSS_FORCES_N = (3.0, 5.0, 10.0, 20.0, 30.0, 40.0)
SPEEDS_MM_S = (25.0, 50.0, 100.0)
CLAMPS_N = (2.0, 3.0, 5.0, 10.0, 20.0, 30.0, 40.0)
SMALL_FORCES_N = (2.0, 3.0, 4.0, 5.0, 6.0)
FRICTIONS = {1.0: "usual friction", 2.0: "twice", 3.0: "three times"}
DAMPINGS = {0.5: "", 1.0: ", the hold", 2.0: "", 3.0: "", 4.5: ""}
CALM_NM = 0.1

Happen = Callable[[HeldRig], None]


def push(torque_nm: float, lasts_s: float) -> Happen:
    return lambda rig: rig.push_open(torque_nm, lasts_s)


def opening(open_mm: float, lasts_s: float) -> Happen:
    return lambda rig: rig.hold_open(open_mm, lasts_s)


def step(way_mm: float) -> Happen:
    return lambda rig: rig.gripper.give_way(way_mm)


def vanish(rig: HeldRig) -> None:
    rig.gripper.remove_object()


def seen(force_n: float, happen: Happen, speed_mm_s: float = 50.0) -> list[After]:
    """Return what came of it in every setting."""
    rigs = (HeldRig(setting, force_n, speed_mm_s=speed_mm_s) for setting in SETTINGS)
    return [rig.watch(happen) for rig in rigs]


def kept(afters: list[After]) -> str:
    """Say how many of them kept the object, and how soon the clamp was back."""
    lost = sum(not after.is_held for after in afters)
    slack = sum(after.is_held and after.is_short for after in afters)
    if lost or slack:
        said = [f"lost {lost} of {len(afters)}"] if lost else []
        return ", ".join(said + ([f"weak {slack} of {len(afters)}"] if slack else []))
    back_ms = max(1e3 * (after.back_s or 0.0) for after in afters)
    moved_mm = [after.moved_mm for after in afters if after.moved_mm is not None]
    return f"{back_ms:.0f} ms" + (f" ({len(moved_mm)} moved)" if moved_mm else "")


def told(afters: list[After]) -> str:
    """Say how fast the jaws got, when the loss was told, and how far they closed."""
    peak_mm_s = max(after.peak_mm_s for after in afters)
    times_s = [after.told_s for after in afters]
    known_s = [at_s for at_s in times_s if at_s is not None]
    when = f"{1e3 * max(known_s):.0f} ms" if known_s else "not reported"
    if known_s and len(known_s) < len(times_s):
        when += f", {len(times_s) - len(known_s)} not reported"
    if any(after.times_told > 1 for after in afters):
        when += ", repeated"
    return f"{peak_mm_s:.0f} mm/s, {when}, {max(after.far_mm for after in afters):.1f} mm"


def newtons(forces_n: Iterable[float]) -> list[str]:
    return [f"{force_n:g} N" for force_n in forces_n]


def bumps() -> None:
    bumped = [(f"push {nm:g} N·m, {1e3 * s:.0f} ms", push(nm, s)) for nm, s in PUSHES]
    bumped += [(f"opened {mm:g} mm, {1e3 * s:.0f} ms", opening(mm, s)) for mm, s in OPENINGS]
    rows = ([name, *(kept(seen(n, happen)) for n in FORCES_N)] for name, happen in bumped)
    table("Bumps: until the clamp is back", ["hand", *newtons(FORCES_N)], rows)


def steps() -> None:
    rows = ([f"{mm:g} mm", *(kept(seen(n, step(mm))) for n in FORCES_N)] for mm in STEPS_MM)
    title = "Steps of the object: until the clamp is back"
    table(title, ["gives way by", *newtons(FORCES_N)], rows)


def losses() -> None:
    found = {
        (force_n, speed): seen(force_n, vanish, speed)
        for force_n in LOSS_FORCES_N
        for speed in SPEEDS_MM_S
    }
    rows = (
        [f"{force_n:g} N", *(told(found[force_n, speed]) for speed in SPEEDS_MM_S)]
        for force_n in LOSS_FORCES_N
    )
    head = ["force", *(f"grasp at {speed:g} mm/s" for speed in SPEEDS_MM_S)]
    table("Losses: fastest jaws, told after, further closed", head, rows)
    rows = (
        [f"{rate_hz} Hz", *(told(_of_rate(found[n, 50.0], rate_hz)) for n in LOSS_FORCES_N)]
        for rate_hz in RATES_HZ
    )
    table("Losses at 50 mm/s by control rate", ["rate", *newtons(LOSS_FORCES_N)], rows)


def _of_rate(afters: list[After], rate_hz: int) -> list[After]:
    settings = zip(SETTINGS, afters, strict=True)
    return [after for setting, after in settings if setting.rate_hz == rate_hz]


def clamp() -> None:
    table("Clamp", ["asked", "true", "`clamp_n`"], map(_clamp_row, CLAMPS_N))


def _clamp_row(force_n: float) -> list[str]:
    rigs = [HeldRig(setting, force_n) for setting in SETTINGS]
    true_n = [rig.clamp_n for rig in rigs]
    bounds = [bound for rig in rigs if (bound := rig.clamp_bounds_n) is not None]
    said = f"{min(low for low, _ in bounds):.1f} to {max(high for _, high in bounds):.1f} N"
    return [f"{force_n:g} N", f"{min(true_n):.1f} to {max(true_n):.1f} N", said]


def friction() -> None:
    rows = (
        [f"{force_n:g} N", *(_loss_with_friction(force_n, share) for share in FRICTIONS)]
        for force_n in SMALL_FORCES_N
    )
    head = ["force", *FRICTIONS.values()]
    table("Losses by small forces and with more friction: told after", head, rows)


def rubbing(share: float) -> SimulatorParameters:
    """Return the simulator's figures with so many times the friction."""
    usual = SimulatorParameters()
    breakaway_nm = share * usual.breakaway_nm
    return replace(usual, coulomb_nm=share * usual.coulomb_nm, breakaway_nm=breakaway_nm)


def _loss_with_friction(force_n: float, share: float) -> str:
    rigs = [HeldRig(Setting(mount, 200), force_n, parameters=rubbing(share)) for mount in MOUNTS]
    from_n = max(rig.loss_detected_from_n or math.inf for rig in rigs)
    times_s = [rig.watch(vanish).told_s for rig in rigs]
    known_s = [at_s for at_s in times_s if at_s is not None]
    cell = f"{1e3 * max(known_s):.0f} ms" if len(known_s) == len(times_s) else "not reported"
    return cell + (f" (from {from_n:.1f} N)" if force_n < from_n else "")


def damping() -> None:
    rows = (
        [f"kd {kd:g}{used}", *(swing(swing_of_gain(motor, kd)) for motor in MOTORS)]
        for kd, used in DAMPINGS.items()
    )
    bounds = (motor.most_damping() for motor in MOTORS)
    most = ["largest by the formula", *(_bound(damping) for damping in bounds)]
    head = ["", *(motor.name for motor in MOTORS)]
    table("Damping: speed filter, inertia", head, [*rows, most])
    events: tuple[tuple[str, Happen], ...] = (
        ("opened by 2 mm for 30 ms", opening(2.0, 0.03)),
        ("gave way by 2 mm", step(2.0)),
        ("vanished", vanish),
    )
    held = (
        [name, *(swing(swing_of_hold(motor, happen)) for motor in MOTORS)]
        for name, happen in events
    )
    title = f"Shaking of a hold by {HOLD_FORCE_N:g} N: speed filter, inertia"
    table(title, ["what happened", *(motor.name for motor in MOTORS)], held)


def swing(torque_nm: float) -> str:
    return "calm" if torque_nm < CALM_NM else f"± {torque_nm:.1f} N·m"


def _bound(damping: float) -> str:
    return "any" if math.isinf(damping) else f"{damping:.1f}"


def main() -> None:
    """Print all tables."""
    for part in (bumps, steps, losses, clamp, friction, damping):
        part()


if __name__ == "__main__":
    main()
