"""What an object feels lies in the reported interval, whatever gripper it is.

A short form of `python -m tests.plants.clamps`.
"""

from dataclasses import replace

import pytest

from tests.plants.clamps import KINDS, Sample, clamp_trial, plain_trial, samples
from tests.plants.parameters import PlantParameters
from tests.plants.worst import CLAMPED

SEEDS = range(1, 31)
LEAST_SHARES = {0.05: 0.98, 0.2: 0.9}

any_rig = pytest.mark.parametrize("rig", KINDS)


@any_rig
@pytest.mark.parametrize("kt_error", LEAST_SHARES)
def test_the_truth_is_inside(rig: str, kt_error: float) -> None:
    found = [sample for seed in SEEDS for sample in samples(rig, clamp_trial(seed, kt_error))]
    inside = sum(sample.is_inside for sample in found)
    assert inside >= LEAST_SHARES[kt_error] * len(found)


def settled(rig: str, plant: PlantParameters, force_n: float, load_nm: float = 0.0) -> Sample:
    """Return what is felt and said of a grip with a load on the jaws all the time."""
    return samples(rig, plain_trial(plant, force_n, load_nm))[0]


@any_rig
def test_a_hand_that_closes_the_jaws_feigns_no_exact_force(rig: str) -> None:
    """The jaws took no torque while they closed, so friction seemed to hide nothing: 5.0 to 5.0."""
    sample = settled(rig, PlantParameters(), 5.0, load_nm=0.15)
    assert sample.is_inside
    assert sample.high_n - sample.low_n >= 2.0 * (1.5 + 0.1 * 5.0)


@any_rig
@pytest.mark.parametrize("torque_factor", [0.95, 1.05])
@pytest.mark.parametrize("name", CLAMPED)
def test_the_worst_plants_are_told_truly(rig: str, name: str, torque_factor: float) -> None:
    plant = replace(CLAMPED[name], torque_factor=torque_factor)
    assert all(sample.is_inside for sample in samples(rig, plain_trial(plant, 30.0)))


@any_rig
@pytest.mark.parametrize("force_n", [2.0, 5.0, 10.0, 20.0, 40.0])
def test_the_usual_gripper_is_told_as_narrowly_as_can_be(rig: str, force_n: float) -> None:
    sample = settled(rig, PlantParameters(), force_n)
    assert sample.is_inside
    hidden_n = 3.6 + 0.1 * force_n
    assert sample.low_n >= force_n - hidden_n
    assert sample.high_n <= force_n + hidden_n
