"""The daemon on random plants: nothing that is there is dropped, nothing shakes, verdicts are true.

A short form of `python -m tests.plants`. A failure names scene and seed:
`python -m tests.plants --scenes SCENE --seed SEED` plays it again.
"""

import pytest

from tests.plants.scenes import play

SEEDS = range(1, 25)
ALWAYS = ("bump", "step", "loss", "regrasp")
IN_TURN = ("grasp", "close", "zero")


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("scene", ALWAYS)
def test_what_is_held(scene: str, seed: int) -> None:
    assert play(scene, seed).complaints == []


@pytest.mark.parametrize("seed", SEEDS)
def test_one_of_the_others(seed: int) -> None:
    assert play(IN_TURN[seed % len(IN_TURN)], seed).complaints == []
