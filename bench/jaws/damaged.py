"""What one damaged command does to the jaws until the next one comes, in simulation.

python -m bench.jaws.damaged

Over SLCAN a frame is a line of hexadecimal letters without a checksum. Each command that holds,
grips and motions really send is damaged in each of its 64 bits, and in each of its letters in each
way. The time is simulated, so the table is the same on every machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import product

from bench.jaws.presses import FROM_MM, OBJECT_MM, TO_MM, Bench, kinetic_mj
from bench.tables import table
from litegripd.model.gripper import FASTEST_MM_S
from litegripd.model.motor import CanFrame
from litegripd.sim.plant import MOUNTS
from tests.world import CAN_ID, FRAME_TIME_S, is_command

RATES_HZ = (1000, 200, 100)
BITS, LETTERS = 64, 16
SPEED_BOUND_MM_S = 1.3 * FASTEST_MM_S
LOOK_S = 0.5e-3
BRAKED_S = 0.004
"""How long after the next command the jaws may still gain speed: the current follows slowly."""
FIELDS = {"position": (48, 64), "velocity": (36, 48), "kp": (24, 36), "kd": (12, 24)}
"""The bits of a command's fields, counted from its end; the first 12 are the torque's."""


@dataclass(frozen=True, slots=True)
class Damage:
    """The highest speed and torque until the next command has an effect, and how far they went."""

    field: str
    mm_s: float
    way_mm: float
    nm: float
    bits: int
    """How many bits of the frame are wrong."""


def moved(bench: Bench) -> Bench:
    """Run as fast as is allowed."""
    client = bench.client_of_bench
    client.send("motion.move", opening_mm=TO_MM, speed_mm_s=FASTEST_MM_S)
    bench.run(0.15)
    return bench


def standing(bench: Bench) -> Bench:
    """Hold a position after a move."""
    bench.client_of_bench.result("motion.move", opening_mm=FROM_MM - 10.0)
    bench.run(0.5)
    return bench


def gripping(force_n: float, bench: Bench) -> Bench:
    """Hold something by force."""
    bench.put_object(250.0)
    bench.client_of_bench.result("motion.grasp", force_n=force_n, until="verdict")
    bench.run(2.0)
    return bench


def slack(bench: Bench) -> Bench:
    """Be slack."""
    bench.client_of_bench.result("motion.zero_gravity")
    bench.run(0.3)
    return bench


KINDS = {
    "a hold": standing,
    "a grip by 5 N": lambda bench: gripping(5.0, bench),
    "a grip by 20 N": lambda bench: gripping(20.0, bench),
    "a move at 150 mm/s": moved,
    "slack jaws": slack,
}


def masks() -> Iterator[int]:
    """Return how a single letter can be wrong; a single bit is among them."""
    for letter, change in product(range(LETTERS), range(1, 16)):
        yield change << (4 * letter)


def field_of(mask: int) -> str:
    """Return the field that a damage changes most: that of its highest bit."""
    place = mask.bit_length() - 1
    found = (name for name, (low, high) in FIELDS.items() if low <= place < high)
    return next(found, "torque")


@cache
def damages(kind: str, rate_hz: int) -> tuple[Damage, ...]:
    """Return what each damage of a command does."""
    return tuple(damage for mount in MOUNTS for damage in _of_mount(kind, rate_hz, mount))


def _of_mount(kind: str, rate_hz: int, mount: str) -> Iterator[Damage]:
    opening_mm = OBJECT_MM + 5.0 if "grip" in kind else FROM_MM
    bench = KINDS[kind](Bench(mount, opening_mm, period_s=1.0 / rate_hz))
    before = bench.gripper.fork()
    before.advance(bench.now_s + bench.period_s)
    sent = [s.frame for s in bench.sent[-20:] if s.frame.can_id == CAN_ID and is_command(s.frame)]
    for mask in masks():
        damaged = int.from_bytes(sent[-1].data, "big") ^ mask
        gripper = before.fork()
        now_s = bench.now_s + bench.period_s + FRAME_TIME_S
        gripper.receive(now_s, CanFrame(CAN_ID, damaged.to_bytes(8, "big")))
        began_mm, mm_s, nm = gripper.opening_mm, 0.0, 0.0
        looks, more = round(bench.period_s / LOOK_S), round(BRAKED_S / LOOK_S)
        for look in range(looks + more):
            if look == looks:
                gripper.receive(now_s, sent[-1])
            now_s += LOOK_S
            gripper.advance(now_s)
            mm_s = max(mm_s, abs(gripper.velocity_rad_s) * gripper.parameters.rad_to_mm)
            nm = max(nm, abs(gripper.motor_torque_nm))
        way_mm = abs(gripper.opening_mm - began_mm)
        yield Damage(field_of(mask), mm_s, way_mm, nm, mask.bit_count())


def worst_of(found: Iterator[Damage]) -> Damage:
    return max(found, key=lambda damage: damage.mm_s)


def worst_of_one_bit() -> Damage:
    """Return the worst that one wrong bit does at 200 Hz."""
    return worst_of(one for kind in KINDS for one in damages(kind, 200) if one.bits == 1)


def rate_row(kind: str) -> list[str]:
    """Return the worst of a wrong bit, and of a wrong letter, at each rate."""
    cells = [kind]
    for rate_hz in RATES_HZ:
        found = damages(kind, rate_hz)
        bit, letter = worst_of(d for d in found if d.bits == 1), worst_of(iter(found))
        fast = sum(one.mm_s > SPEED_BOUND_MM_S for one in found) / len(found)
        cells.append(
            f"{bit.mm_s:.0f} mm/s, {bit.way_mm:.1f} mm, {kinetic_mj(bit.mm_s):.0f} mJ;"
            f" a letter {letter.mm_s:.0f} mm/s; {fast:.0%}"
        )
    return cells


def field_row(kind: str) -> list[str]:
    """Return the highest speed (mm/s) that a wrong bit of each field makes at 200 Hz."""
    found = [one for one in damages(kind, 200) if one.bits == 1]
    names = (*FIELDS, "torque")
    return [kind, *(f"{worst_of(d for d in found if d.field == n).mm_s:.0f}" for n in names)]


def main() -> None:
    """Print the tables."""
    head = ["damaged command of", *(f"at {rate_hz} Hz" for rate_hz in RATES_HZ)]
    table("One damaged command", head, map(rate_row, KINDS))
    head = ["a wrong bit in, mm/s", *FIELDS, "torque"]
    table("By field, at 200 Hz", head, map(field_row, KINDS))


if __name__ == "__main__":
    main()
