"""What a tick costs with the simulator's own mechanics and with MuJoCo's, and how far they part.

python -m bench.mechanics

The gripper alone, without a daemon, gets a command every 5 ms. A cost is the processor's time for
one of these, physics and motor: the median. How far the jaws part is simulated, and the same on
every machine.
"""

import statistics
import time
from collections.abc import Callable

from bench.tables import table
from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, MitCommand
from litegripd.motor import codec
from litegripd.sim.gripper import SimulatedGripper, build_gripper

PERIOD_S = 0.005
TICKS = 2000
SWEEP = 400
MM_RAD = 52.69

Course = Callable[[int], MitCommand]
"""The command of a tick."""


def sweep(between_mm: tuple[float, float]) -> Course:
    """Go to and fro at constant speed, once in `SWEEP` ticks."""

    def at(tick: int) -> MitCommand:
        low_mm, high_mm = between_mm
        share = abs(2.0 * (tick % SWEEP) / SWEEP - 1.0)
        opening_mm = low_mm + share * (high_mm - low_mm)
        return MitCommand(-opening_mm / MM_RAD, 0.0, 100.0, 2.0, 0.0)

    return at


COURSES: dict[str, Course] = {
    "standing, 60 mm": lambda _tick: MitCommand(-60.0 / MM_RAD, 0.0, 100.0, 2.0, 0.0),
    "moving, 45 to 80 mm": sweep((45.0, 80.0)),
    "pressing 30 mm with 1 N·m": lambda _tick: MitCommand(0.0, 0.0, 0.0, 1.0, 1.0),
}


class Played:
    """A gripper that is driven tick by tick."""

    def __init__(self, mechanics: str | None) -> None:
        self.gripper = build_gripper(mechanics=mechanics, object_mm=None if mechanics else 30.0)
        self._tick = 0
        self._can_id = self.gripper.parameters.can_id
        self.gripper.receive(0.0, CanFrame(self._can_id, codec.ENABLE))

    def play(self, course: Course) -> float:
        """Send the command of the next tick; return what the tick costs in microseconds."""
        data = codec.encode_command(course(self._tick), DM4310.ranges)
        self._tick += 1
        before_s = time.thread_time()
        self.gripper.receive(self._tick * PERIOD_S, CanFrame(self._can_id, data))
        return (time.thread_time() - before_s) * 1e6


def costs(mechanics: str | None, course: Course) -> str:
    """Return the cost of a tick."""
    played = Played(mechanics)
    all_us = [played.play(course) for _ in range(TICKS)][SWEEP:]
    return f"{statistics.median(all_us):.0f}"


def apart_mm(course: Course) -> float:
    """Return how far the openings of both part at most on the same commands."""
    both = [Played(mechanics) for mechanics in (None, "mujoco")]
    most_mm = 0.0
    for _ in range(TICKS):
        for played in both:
            played.play(course)
        grippers: list[SimulatedGripper] = [played.gripper for played in both]
        most_mm = max(most_mm, abs(grippers[0].opening_mm - grippers[1].opening_mm))
    return most_mm


def main() -> None:
    """Print the table."""
    rows = (
        [name, costs(None, course), costs("mujoco", course), f"{apart_mm(course):.2f}"]
        for name, course in COURSES.items()
    )
    head = ("", "own, µs", "MuJoCo, µs", "apart at most, mm")
    table("A tick of 5 ms", head, rows)


if __name__ == "__main__":
    main()
