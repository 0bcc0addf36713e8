"""What every motion does with a calibration file's gains: on plants that are not the simulator's.

A file may have any kp and kd that its reader takes. `open`, `close`, `move`, `grasp`, `zero`, a
recording, its replay and a follower must not care. A course plays them one after the other on one
random gripper, as its owner would, and returns what went wrong, in words.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from litegripd.model.calibration import Calibration
from litegripd.model.gripper import Geometry
from litegripd.model.motor import MotorPhase
from tests.plants.parameters import LIMITS_RAD, MM_RAD, Item, PlantParameters
from tests.plants.scenes import EASY_NM
from tests.plants.world import PlantWorld
from tests.trajectories import sampled, swing, uploaded
from tests.world import Client

SHIPPED_KP, SHIPPED_KD, SHIPPED_WORK_MM = 5.0, 2.0, 80.0
"""Of the file that ships with the gripper."""
NEAR_MM = 1.3
"""`reach_tol`, 0.02 rad, and what the fingers' own play hides of the motor's position."""
LAG_SHARE = 0.05
"""How far a follower may be from its leader at the ends of a slow sweep, as a share of the travel:
the vendor's own gains leave friction 0.014 rad, and the closing side sticks."""
EASY_STICK_NM = 0.9
"""A `close` presses with 0.94 N·m. Jaws that stick with more stop in front of the stop with any
gains."""


@dataclass(slots=True)
class Course:
    """One gripper with one file, and what went wrong so far."""

    world: PlantWorld
    client: Client
    wrong: list[str] = field(default_factory=list)

    def expect(self, name: str, result: Mapping[str, Any], *outcomes: str) -> None:
        """Note an outcome that is none of these."""
        if result.get("outcome") not in outcomes:
            self.wrong.append(f"{name}: {result.get('outcome') or result}")

    def near(self, name: str, opening_mm: float, within_mm: float = NEAR_MM) -> None:
        """Note jaws that are not at this opening, by the motor's own position."""
        state = self.world.state
        here_mm = state.opening_mm
        play_mm = self.world.parameters.backlash_mm
        if here_mm is None or abs(here_mm - opening_mm) > within_mm + play_mm:
            self.wrong.append(f"{name}: at {here_mm} mm, not {opening_mm:g}")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Return the result of a call, or its error."""
        answer = self.client.call(method, within_s=60.0, **params)
        result: dict[str, Any] = answer.get("result") or answer["error"]
        return result


def course(
    parameters: PlantParameters,
    mount: str,
    kp: float | None,
    kd: float | None,
    work_stroke_mm: float = 0.0,
    rate_hz: int = 200,
) -> Course:
    """Return an enabled gripper with a file of these gains, None for one that has none."""
    world = PlantWorld(parameters, mount, rate_hz, opening_mm=45.0)
    geometry = Geometry(*LIMITS_RAD[mount], MM_RAD)
    file = Calibration(
        geometry, kp_nm_rad=kp, kd_nm_s_rad=kd, work_stroke_mm=work_stroke_mm, channel="can0"
    )
    world.controller.use_calibration(file)
    return Course(world, world.enabled())


def opens(here: Course) -> None:
    """Open: onto the stop, or to the work stroke and not onto it."""
    work_mm = here.world.state.work_stroke_mm
    result = here.call("motion.open")
    here.expect("open", result, "pressed_home" if work_mm is None else "reached")
    if work_mm is not None:
        here.near("open", work_mm)


def closes(here: Course) -> None:
    """Close onto the stop."""
    result = here.call("motion.close")
    if here.world.parameters.stick_nm <= EASY_STICK_NM * here.world.parameters.torque_factor:
        here.expect("close", result, "pressed_home")


def moves(here: Course) -> None:
    """Move to two openings, slowly and fast."""
    for opening_mm, speed_mm_s in ((60.0, 20.0), (25.0, 150.0)):
        result = here.call("motion.move", opening_mm=opening_mm, speed_mm_s=speed_mm_s)
        here.expect("move", result, "reached")
        here.near("move", opening_mm)


def grasps(here: Course) -> None:
    """Grasp an object, and let it go."""
    here.world.mechanics.put(Item(width_mm=30.0))
    result = here.call("motion.grasp", force_n=15.0, until="verdict")
    here.expect("grasp", result, "object_held")
    here.world.run(1.0)
    if not here.world.state.is_grasped:
        here.wrong.append("grasp: not held any more")
    opens(here)
    here.world.mechanics.put(None)


def replays(here: Course) -> None:
    """Record jaws that a hand moves, and replay that; then a swing that begins elsewhere."""
    geometry = here.world.geometry
    here.call("trajectory.record_start")
    here.world.run(0.3)
    here.world.hold_open(20.0, 3.0)
    here.world.run(3.5)
    taught_mm = here.world.state.opening_mm or 0.0
    recording = here.call("trajectory.record_stop").get("name")
    here.call("motion.move", opening_mm=20.0)
    result = here.call("trajectory.play", name=recording)
    if "limit" in result.get("data", {}):  # the jaws sprang when the hand let go: play it slower
        speed = 0.99 * result["data"]["limit"]
        result = here.call("trajectory.play", name=recording, speed=speed)
    here.expect("play what was taught", result, "completed")
    here.near("play what was taught", taught_mm)
    path = sampled(swing(size=0.3, period_s=4.0), 4.0)
    result = here.call("trajectory.play", name=uploaded(here.client, path))
    here.expect("play", result, "completed")
    here.near("play", 0.5 * geometry.travel_mm)


def follows(here: Course) -> None:
    """Follow a synthetic leader through a whole sweep."""
    status = here.call("teleop.start", mode="slave", fake_leader=True)
    if "active" not in status:
        here.wrong.append(f"teleop: {status}")
        return
    here.world.run(3.0)
    worst = 0.0
    for _ in range(round(6.0 / here.world.period_s)):
        here.world.tick()
        action: Any = here.world.controller.action
        wanted = action.status(here.world.now_s).openness
        state = here.world.state
        turns = wanted is not None and min(wanted, 1.0 - wanted) < 0.02
        slow = here.world.parameters.stick_nm <= EASY_STICK_NM or (wanted or 0.0) > 0.5
        if turns and slow and state.openness is not None:
            worst = max(worst, abs(state.openness - wanted))
    phase = here.call("teleop.stop").get("phase")
    if worst > LAG_SHARE:
        here.wrong.append(f"teleop ({phase}): {worst:.3f} of the travel from its leader")


def zeroes(here: Course) -> None:
    """Measure the travel."""
    result, plant = here.call("calibration.zero"), here.world.parameters
    if max(plant.stick_nm, plant.breakaway_nm) < EASY_NM:
        here.expect("zero", result, "measured")


STEPS: Mapping[str, Callable[[Course], None]] = {
    "open": opens,
    "close": closes,
    "move": moves,
    "grasp": grasps,
    "play": replays,
    "teleop": follows,
    "zero": zeroes,
}


def play_all(
    parameters: PlantParameters,
    mount: str,
    kp: float | None,
    kd: float | None,
    work_stroke_mm: float = 0.0,
    steps: Mapping[str, Callable[[Course], None]] = STEPS,
) -> list[str]:
    """Return what went wrong, in words; each step begins with jaws that are half open.

    The motor is enabled before, and disabled after all steps.
    """
    here = course(parameters, mount, kp, kd, work_stroke_mm)
    for step in steps.values():
        here.call("motion.move", opening_mm=45.0)
        try:
            step(here)
        except AssertionError as error:
            here.wrong.append(f"{step.__name__}: {error}"[:200])
    here.call("motor.disable")
    if not here.world.in_phase(MotorPhase.DISABLED):
        here.wrong.append("disable: the motor is not disabled")
    return here.wrong
