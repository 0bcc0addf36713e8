"""The plants on which something was worst, by the name of what it was: one line each."""

from tests.plants.parameters import PlantParameters, random_plant

WORST: dict[str, PlantParameters] = {
    "friction hid more of its clamp than was reported": random_plant(72),
    "its torque constant was off by more than friction hides": random_plant(11),
}
