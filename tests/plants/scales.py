"""How fast the jaws get with any scale of a calibration: `python -m tests.plants.scales`.

Each scale comes as a file's content. Where the daemon takes it, because the configured stroke is as
wrong as the file is, every motion is played as fast as it is allowed, on the simulator and on a
plant that shares no code with it. What counts is the true speed of the motor.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from litegripd.model.gripper import SPAN_INSET_MM, STROKE_MM, STROKE_RANGE_MM
from tests.plants.parameters import LIMITS_RAD, MM_RAD, TRAVEL_RAD, PlantParameters
from tests.plants.rigs import PlantRig, Rig, SimulatedRig
from tests.world import Client, World

SCALES = (0.001, 0.1, 0.7027, 1.0, 7.48, 26.3, 45.0, 52.69, 60.0, 74.8, 105.4, 526.9, 3952.0, 1e6)
"""mm/rad: the range of the format's reader, and the vendor's scale times 0.5, 2, 10 and 75."""


@dataclass(frozen=True, slots=True)
class Ran:
    """What one scale did: why it was refused, or the highest true speed of the motor (rad/s).

    `asked_mm_s` is the highest speed that `motion.move` took.
    """

    scale: float
    stroke_mm: float
    refused: str | None
    asked_mm_s: float | None = None
    fastest_rad_s: float | None = None


WORLDS: dict[str, Callable[[], Rig]] = {
    "simulator": lambda: SimulatedRig("normal", 200, 60.0, is_looked_at=False),
    "other plant": lambda: PlantRig(PlantParameters(), "normal", 200, 45.0),
}


@cache
def run(name: str, scale: float, stroke_mm: float) -> Ran:
    """Load a calibration with the true limits and this scale, and move as fast as it goes."""
    world = WORLDS[name]()
    world.controller.gripper_id = replace(world.controller.gripper_id, stroke_mm=stroke_mm)
    client = world.enabled()
    closed_rad, open_rad = LIMITS_RAD["normal"]
    content = {"zero_position_rad": closed_rad, "max_position_rad": open_rad, "rad_to_mm": scale}
    answer = client.call("calibration.load", content=content)
    if "error" in answer:
        return Ran(scale, stroke_mm, answer["error"]["data"]["reason"])
    fastest_rad_s, asked_mm_s = 0.0, 0.0

    def play(method: str, **params: Any) -> None:
        nonlocal fastest_rad_s, asked_mm_s
        speed_mm_s = 150.0
        number = client.send(method, speed_mm_s=speed_mm_s, **params)
        refused = _refused(world, client, number)
        if refused is not None:
            speed_mm_s = float(refused["limit"])
            number = client.send(method, speed_mm_s=0.999 * speed_mm_s, **params)
        if method == "motion.move":
            asked_mm_s = max(asked_mm_s, speed_mm_s)
        began_s = world.now_s
        while not client.has_answer(number) and world.now_s < began_s + 20.0:
            world.tick()
            fastest_rad_s = max(fastest_rad_s, abs(world.speed_rad_s))

    for openness in (0.9, 0.1, 0.9):
        play("motion.move", openness=openness)
    for method in ("motion.close", "motion.open", "motion.grasp"):
        play(method)
    return Ran(scale, stroke_mm, None, asked_mm_s, fastest_rad_s)


def _refused(world: World, client: Client, number: int) -> dict[str, Any] | None:
    """Return the data of a refusal that names a limit, None where the motion has begun."""
    world.tick()
    if not client.has_answer(number) or "error" not in client.answers[number]:
        return None
    data: dict[str, Any] = client.answers[number]["error"]["data"]
    return data if "limit" in data else None


def agreeing_stroke_mm(scale: float) -> float:
    """Return the stroke with which a daemon takes this scale, as far as one can be configured."""
    low_mm, high_mm = STROKE_RANGE_MM
    return min(max(scale * TRAVEL_RAD - SPAN_INSET_MM, low_mm), high_mm)


def main() -> None:
    """Print the table."""
    print("| mm/rad | with stroke_mm | plant | taken | move at most | motor at most |")
    print("| ---: | ---: | --- | --- | ---: | ---: |")
    for scale in SCALES:
        for stroke_mm in (STROKE_MM, agreeing_stroke_mm(scale)):
            for name in WORLDS:
                ran = run(name, scale, stroke_mm)
                cells = f"| {scale:g} | {stroke_mm:.4g} | {name} |"
                if ran.refused is not None:
                    print(f"{cells} no | | |")
                else:
                    print(
                        f"{cells} yes | {ran.asked_mm_s:.3g} mm/s | {ran.fastest_rad_s:.2f} rad/s,"
                        f" {(ran.fastest_rad_s or 0.0) * MM_RAD:.0f} true mm/s |"
                    )


if __name__ == "__main__":
    main()
