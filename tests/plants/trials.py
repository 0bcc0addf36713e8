"""A random plant, a random object, and what is asked: all that a scene needs, from one seed."""

import random
from dataclasses import dataclass

from litegripd.model.motion_config import MotionConfig
from tests.plants.parameters import Item, PlantParameters, between, random_plant

MOUNTS = ("normal", "reverse")
RATES_HZ = (200, 200, 200, 200, 100, 1000)


@dataclass(frozen=True, slots=True)
class Trial:
    """What one scene is played with; `push_nm` is 0 where a hand moves the jaws by `open_mm`."""

    plant: PlantParameters
    mount: str
    rate_hz: int
    force_n: float
    speed_mm_s: float
    rate_n_s: float
    opening_mm: float
    item: Item | None
    push_nm: float
    open_mm: float
    hand_s: float
    step_mm: float

    @property
    def config(self) -> MotionConfig:
        """The daemon's configuration."""
        return MotionConfig(force_rate_n_s=self.rate_n_s)

    @property
    def true_force_n(self) -> float:
        """What the asked force is when the motor's torque constant is the true one."""
        return self.force_n * self.plant.torque_factor

    @property
    def can_follow(self) -> bool:
        """True when the asked force moves standing jaws, with something to spare."""
        friction_nm = 0.0 if self.item is None else self.item.friction_nm
        return self.true_force_n / 10.0 > 1.15 * (self.plant.breakaway_nm + friction_nm)

    @property
    def ramp_s(self) -> float:
        """How long the force takes at most to be what was asked, from the contact's 10 N."""
        return abs(self.force_n - 10.0) / self.rate_n_s + 0.2


def random_trial(seed: int, scene: str) -> Trial:
    """Return the trial of a seed for a scene; a fifth of the grasps meet nothing."""
    chance = random.Random(f"trial {seed} {scene}")
    is_empty = scene == "zero" or (scene == "grasp" and chance.random() < 0.2)
    yields = scene == "grasp" and chance.random() < 0.2
    item = Item(
        width_mm=chance.uniform(14.0, 63.0),
        stiffness_nm_rad=between(chance, 60.0, 1500.0),
        damping_nm_s_rad=chance.uniform(0.05, 1.0),
        friction_nm=chance.choice((0.0, 0.0, chance.uniform(0.0, 0.2))),
        yield_mm_s=chance.uniform(0.3, 3.0) if yields else 0.0,
        yield_nm=chance.uniform(0.2, 2.0) if yields else 0.0,
    )
    is_push = chance.random() < 0.5
    nearest_mm = 14.0 if is_empty else item.width_mm + 2.0
    return Trial(
        plant=random_plant(seed),
        mount=chance.choice(MOUNTS),
        rate_hz=chance.choice(RATES_HZ),
        force_n=chance.choice((2.0, 3.0, 5.0, 10.0, 20.0, 30.0, chance.uniform(2.0, 30.0))),
        speed_mm_s=chance.uniform(25.0, 100.0),
        rate_n_s=chance.choice((20.0, 60.0)),
        opening_mm=nearest_mm + chance.uniform(0.0, 20.0),
        item=None if is_empty else item,
        push_nm=chance.uniform(0.5, 4.0) if is_push else 0.0,
        open_mm=chance.uniform(0.5, 3.0),
        hand_s=chance.uniform(0.01, 0.04) if is_push else chance.uniform(0.02, 0.06),
        step_mm=chance.choice((0.5, 1.0, 2.0)),
    )
