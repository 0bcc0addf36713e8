"""Random plants that were the worst at something, by the name of what it was: one line each."""

from collections.abc import Mapping

from tests.plants.parameters import PlantParameters, random_plant

WORST: Mapping[str, PlantParameters] = {
    "friction hid more of its clamp than was reported": random_plant(72),
    "its torque constant was off by more than friction hides": random_plant(11),
    "what a press leaves on a soft object: 17 N": random_plant(12),
    "swings with more than the usual gains": random_plant(7),
    "bounces off something rigid, and shakes there": random_plant(9),
    "damping, fast filter": random_plant(866),  # least inertia for its lags: swings from kd 2 on
    "damping, little friction": random_plant(393),  # swings with the shipped kp 5 and kd 2
    "damping, long": random_plant(278),  # swings with kp 5 and kd 2 for longer than any other
    "a hold at the vendor's gains": random_plant(25),  # worst of the first 40 with kp 100 and kd 2
    "stiffness": random_plant(20),  # swings by 17 mm with kp 500 and kd 1
}
