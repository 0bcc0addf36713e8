"""The plants on which something was worst, by the name of what it was: one line each."""

from tests.plants.parameters import PlantParameters, random_plant

WORST: dict[str, PlantParameters] = {
    "friction hid more of its clamp than was reported": random_plant(72),
    "its torque constant was off by more than friction hides": random_plant(11),
    "what a press leaves on a soft object: 17 N": random_plant(12),
    "swings with more than the usual gains": random_plant(7),
    "bounces off something rigid, and shakes there": random_plant(9),
}
