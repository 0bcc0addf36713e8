"""The grippers that were worst at something, by name: one line each, with what it was then."""

from tests.plants.parameters import PlantParameters, random_plant

WORST: dict[str, PlantParameters] = {
    "came free at 537 mm/s": random_plant(25),  # a `move` at 150 mm/s, held fast for 0.1 s
    "came free at 457 mm/s": random_plant(12),
    "was thrown back at 372 mm/s": random_plant(37),  # a stop of a `move` at 150 mm/s
    "was thrown back at 336 mm/s": random_plant(6),
}
