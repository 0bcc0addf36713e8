"""What disturbs a hold, on a plant that is not the simulator: nothing that is there is let go.

Also what is reported meanwhile: clamp and loss detection are true, or said to be unknown.
"""

import pytest

from litegripd.control.holds import Grip
from litegripd.model.motion_config import MotionConfig
from tests.plants.parameters import Item, PlantParameters
from tests.plants.world import PlantWorld
from tests.world import Client

WIDTH_MM = 50.0
STIFF_NM_RAD = 250.0


class Holding:
    """A plant with an object of 50 mm, and a client of its daemon."""

    def __init__(
        self,
        *,
        plant: PlantParameters | None = None,
        stiffness_nm_rad: float = STIFF_NM_RAD,
        rate_n_s: float = 20.0,
    ) -> None:
        config = MotionConfig(force_rate_n_s=rate_n_s)
        self.world = PlantWorld(
            plant or PlantParameters(), "normal", 200, opening_mm=60.0, config=config
        )
        self.client: Client = self.world.enabled()
        self.client.result("events.subscribe")
        self.world.mechanics.put(Item(WIDTH_MM, stiffness_nm_rad))

    def grasp(self, force_n: float, settle_s: float = 2.5, **more: object) -> None:
        result = self.client.result("motion.grasp", force_n=force_n, until="verdict", **more)
        assert result["outcome"] == "object_held"
        self.world.run(settle_s)

    def opened_by_hand(self, opening_mm: float, duration_s: float) -> None:
        self.world.hold_open(opening_mm, duration_s)
        self.world.run(duration_s)

    @property
    def clamp_n(self) -> float:
        return self.world.looks[-1].clamp_n

    def events(self, kind: str) -> list[dict[str, object]]:
        return self.client.events(kind)


@pytest.mark.parametrize("opening_mm", [2.0, 5.0, 8.0])
@pytest.mark.parametrize(("before_n", "after_n"), [(30.0, 10.0), (20.0, 5.0)])
def test_a_bump_while_the_force_is_lowered_loses_nothing(
    before_n: float, after_n: float, opening_mm: float
) -> None:
    holding = Holding()
    holding.grasp(before_n)
    holding.client.result("motion.set_force", force_n=after_n)
    holding.world.run(0.1)
    holding.opened_by_hand(opening_mm, 0.06)
    holding.world.run(1.5)
    assert holding.world.state.is_grasped
    assert holding.clamp_n > 0.7 * after_n
    assert holding.events("object_lost") == holding.events("object_moved") == []


@pytest.mark.parametrize(("force_n", "opening_mm"), [(5.0, 3.0), (5.0, 5.0), (3.0, 5.0)])
def test_a_bump_right_after_a_gentle_contact_loses_nothing(
    force_n: float, opening_mm: float
) -> None:
    holding = Holding()
    holding.grasp(force_n, settle_s=0.05)
    holding.opened_by_hand(opening_mm, 0.06)
    holding.world.run(1.6)
    assert holding.world.state.is_grasped
    assert holding.clamp_n > 0.7 * force_n


@pytest.mark.parametrize("noise_rad_s", [0.1, 0.3])
@pytest.mark.parametrize("force_n", [3.0, 4.5])
def test_a_squeeze_that_is_to_be_held_is_not_let_go_for_noise(
    force_n: float, noise_rad_s: float
) -> None:
    for seed in range(4):
        holding = Holding(plant=PlantParameters(seed=seed, speed_noise_rad_s=noise_rad_s))
        holding.client.result("motion.set_force", force_n=force_n)
        holding.world.run(2.5)
        holding.client.result("motion.hold")
        holding.world.run(1.0)
        assert isinstance(holding.world.controller.idle, Grip)


@pytest.mark.parametrize("method", [None, "motion.grasp", "motion.set_force"])
@pytest.mark.parametrize("stops", [False, True])
def test_a_force_that_is_asked_for_in_a_search_comes_back_as_fast(
    method: str | None, stops: bool
) -> None:
    holding = Holding(rate_n_s=5.0)
    holding.grasp(30.0, settle_s=6.0)
    before_n, world = holding.clamp_n, holding.world
    world.hold_open(8.0, 0.09)

    def searches() -> bool:
        grip = world.controller.grip
        return grip is not None and grip.clamp_n[0] == 0.0

    world.run_until(searches, 1.0)
    if method is not None:
        holding.client.send(method, force_n=30.0)
        world.run(0.01)
    if stops:
        holding.client.send("stop", level="hold")
    world.run(0.6)
    assert holding.clamp_n > 0.9 * before_n


def test_a_stiff_hold_promises_neither_a_clamp_nor_that_a_loss_is_noticed() -> None:
    holding = Holding(stiffness_nm_rad=1500.0, rate_n_s=60.0)
    holding.grasp(10.0, hold_by="gains")
    holding.opened_by_hand(4.5, 0.3)
    holding.world.run(0.5)
    state = holding.world.state
    low_n, high_n = holding.world.clamp_range_n
    assert low_n <= holding.clamp_n <= high_n
    assert (state.loss_detection, state.loss_detection_from_n) == (False, None)


def test_a_grasp_of_what_went_unnoticed_is_no_success() -> None:
    """Friction held the jaws when the object vanished; a grasp has to feel for it."""
    holding = Holding(plant=PlantParameters(coulomb_nm=0.3))
    holding.grasp(3.0)
    assert holding.world.state.loss_detection is False
    holding.world.mechanics.put(None)
    holding.world.run(3.0)
    assert holding.client.result("motion.close")["outcome"] == "blocked"  # as far as is known
    result = holding.client.result("motion.grasp", force_n=3.0, until="verdict")
    assert (result["ok"], result["outcome"]) == (False, "object_lost")
    assert holding.client.result("motion.close")["ok"]


def test_a_grasp_of_what_is_held_gently_presses_no_harder_than_any_grasp() -> None:
    holding = Holding(plant=PlantParameters(coulomb_nm=0.3))
    holding.grasp(3.0)
    before_n, began_s = holding.clamp_n, holding.world.now_s
    holding.grasp(3.0)
    clamps_n = [look.clamp_n for look in holding.world.looks_since(began_s)]
    assert min(clamps_n) > 0.5 * before_n
    assert max(clamps_n) < 13.0
    assert holding.clamp_n == pytest.approx(before_n, abs=1.5)


def test_a_clamp_that_heat_has_lowered_is_reported_so() -> None:
    holding = Holding()
    holding.grasp(30.0)
    holding.world.controller.output.heat.allowance_nm = 1.0
    holding.world.run(0.1)
    assert "heat" in holding.world.state.limited
    assert holding.world.clamp_range_n[1] < 15.0


def test_a_hand_that_holds_the_jaws_open_for_long_does_not_move_the_object() -> None:
    holding = Holding(rate_n_s=60.0)
    holding.grasp(20.0)
    before_n = holding.clamp_n
    holding.opened_by_hand(10.0, 2.0)
    holding.world.run(1.0)
    assert holding.world.state.is_grasped
    assert holding.clamp_n == pytest.approx(before_n, abs=1.0)
