"""Plants that were the worst of many at something, by what that was."""

from collections.abc import Mapping

from tests.plants.parameters import PlantParameters, random_plant

WORST: Mapping[str, PlantParameters] = {
    "friction hid more of its clamp than was said": random_plant(72),
    "its torque constant was off by more than friction hides": random_plant(11),
}
