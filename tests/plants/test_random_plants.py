"""The daemon on random plants: nothing that is there is dropped, nothing shakes, verdicts are true.

A short form of `python -m tests.plants`. A failure names scene and seed:
`python -m tests.plants --scenes SCENE --seed SEED` plays it again.
"""

import pytest

from tests.plants.scenes import play

PLANTS = 24
ALWAYS = ("bump", "step", "loss", "regrasp")
IN_TURN = ("grasp", "close", "zero")


@pytest.mark.parametrize("seed", range(1, PLANTS + 1))
def test_a_random_plant(seed: int) -> None:
    scenes = (*ALWAYS, IN_TURN[seed % len(IN_TURN)])
    complaints = {scene: found for scene in scenes if (found := play(scene, seed).complaints)}
    assert complaints == {}
