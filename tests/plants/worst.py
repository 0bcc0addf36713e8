"""Random plants that were the worst at something, by name: a line each, and what they are for."""

from collections.abc import Mapping

from tests.plants.parameters import PlantParameters, random_plant

WORST: Mapping[str, PlantParameters] = {
    "damping, fast filter": random_plant(866),  # least inertia for its lags: swings from kd 2 on
    "damping, little friction": random_plant(393),  # swings with the shipped kp 5 and kd 2
    "damping, long": random_plant(278),  # swings with kp 5 and kd 2 for longer than any other
    "a hold at the vendor's gains": random_plant(25),  # worst of the first 40 with kp 100 and kd 2
    "stiffness": random_plant(20),  # swings by 17 mm with kp 500 and kd 1
}
