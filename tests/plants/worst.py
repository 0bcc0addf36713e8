"""The plants on which something was worst, by the name of what it was: one line each."""

from tests.plants.parameters import PlantParameters, random_plant

WORST: dict[str, PlantParameters] = {
    "what a press leaves on a soft object: 17 N": random_plant(12),
    "swings with more than the usual gains": random_plant(7),
    "bounces off something rigid, and shakes there": random_plant(9),
}
