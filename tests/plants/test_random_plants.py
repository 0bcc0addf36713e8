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


@pytest.mark.parametrize("seed", [70, 125])
def test_jaws_that_stick_at_one_place_again_and_again_are_at_no_stop(seed: int) -> None:
    seen = play("zero", seed)
    assert seen.complaints == []
    assert seen.peak_nm is not None
    assert seen.peak_nm <= 2.0 * seen.trial.plant.torque_factor
