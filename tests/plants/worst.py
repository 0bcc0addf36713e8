"""The plants that were worst at something: each by the seed of `random_plant`, and what it was."""

from tests.plants.parameters import PlantParameters, random_plant

STICKS_AT_THE_ZONE = random_plant(59)
"""An empty grasp at 92 mm/s stood at 5.9 mm, before the end, and was held."""
BACKLASH_FEIGNS_NO_FRICTION = random_plant(8)
"""Its first millimetre takes half the friction of the rest: jaws with a budget for it stand."""
BREAKS_LOOSE_AT_TWICE = random_plant(20)
"""Standing jaws are held by twice the friction, on a soft cable, with a noisy speed."""
CREEPS_UNDER_A_WEIGHT = random_plant(5)
"""With a weight of 0.5 N·m it travelled at 0.45 of its speed into the dead band, and stood."""
STUCK_UNDER_A_WEIGHT = random_plant(4)
"""With a weight of 0.5 N·m it did not start, and was held: 0.6 N·m hold standing jaws."""
FELT_MOST = random_plant(31)
"""With 0.43 N·m of friction an object felt 12 N of a set 1 N."""

LOADED: tuple[PlantParameters, ...] = (
    STICKS_AT_THE_ZONE,
    BACKLASH_FEIGNS_NO_FRICTION,
    BREAKS_LOOSE_AT_TWICE,
    CREEPS_UNDER_A_WEIGHT,
    STUCK_UNDER_A_WEIGHT,
)
