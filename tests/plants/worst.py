"""Random plants that were the worst at something, by the name of what it was: one line each."""

from collections.abc import Mapping

from tests.plants.parameters import PlantParameters, random_plant

CLAMPED: Mapping[str, PlantParameters] = {
    "friction hid more of its clamp than was reported": random_plant(72),
    "its torque constant was off by more than friction hides": random_plant(11),
}
PRESSING: Mapping[str, PlantParameters] = {
    "what a press leaves on a soft object: 17 N": random_plant(12),
    "swings with more than the usual gains": random_plant(7),
    "bounces off something rigid, and shakes there": random_plant(9),
}
SWINGING: Mapping[str, PlantParameters] = {
    "damping, fast filter": random_plant(866),  # least inertia for its lags: swings from kd 2 on
    "damping, little friction": random_plant(393),  # swings with the shipped kp 5 and kd 2
    "damping, long": random_plant(278),  # swings with kp 5 and kd 2 for longer than any other
    "a hold at the vendor's gains": random_plant(25),  # worst of the first 40 with kp 100 and kd 2
    "stiffness": random_plant(20),  # swings by 17 mm with kp 500 and kd 1
}
LOADED: Mapping[str, PlantParameters] = {  # empty grasps that were held
    "sticks at the zone": random_plant(59),  # at 92 mm/s: it stood at 5.9 mm, before the end
    "backlash feigns no friction": random_plant(8),  # half of the rest, in its first millimetre
    "breaks loose at twice": random_plant(20),  # of its friction, on a soft cable, with noise
    "creeps under a weight": random_plant(5),  # of 0.5 N·m, into the dead band
    "stuck under a weight": random_plant(4),  # of 0.5 N·m: it did not start
}
FELT_MOST = random_plant(31)
"""With 0.43 N·m of friction an object felt 12 N of a set 1 N."""
FREED: Mapping[str, PlantParameters] = {
    "came free at 537 mm/s": random_plant(25),  # a `move` at 150 mm/s, held fast for 0.1 s
    "came free at 457 mm/s": random_plant(12),
    "was thrown back at 372 mm/s": random_plant(37),  # a stop of a `move` at 150 mm/s
    "was thrown back at 336 mm/s": random_plant(6),
}
