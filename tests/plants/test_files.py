"""The file that ships, and the ends of what a file may have, on grippers of all kinds.

`python -m tests.plants.gains` plays all pairs of gains: docs/generated/gains-figures.md.
"""

import pytest

from litegripd.model.motion_config import LEAST_DAMPING_S
from tests.plants.files import SHIPPED_KD, SHIPPED_KP, SHIPPED_WORK_MM, play_all
from tests.plants.parameters import PlantParameters, random_plant

MOUNTS = ("normal", "reverse")


@pytest.mark.parametrize("seed", range(1, 9))
def test_the_file_that_ships_is_right_on_random_grippers(seed: int) -> None:
    mount = MOUNTS[seed % 2]
    assert play_all(random_plant(seed), mount, SHIPPED_KP, SHIPPED_KD, SHIPPED_WORK_MM) == []


@pytest.mark.parametrize(
    ("mount", "kp", "kd"),
    [
        ("normal", 1.0, 0.01),
        ("reverse", 5.0, 5.0),
        ("reverse", 100.0, 2.0),
        ("normal", 500.0, 500.0 * LEAST_DAMPING_S),
    ],
)
def test_gains_do_not_decide_whether_a_motion_gets_there(mount: str, kp: float, kd: float) -> None:
    assert play_all(PlantParameters(), mount, kp, kd) == []
